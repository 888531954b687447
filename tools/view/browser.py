"""The scene in the browser: nodes of viser for all that a timeline holds, shown as of a moment.

A node is made once and then only shown or hidden, so that a jump in time sends small messages. What
changes with every touch (its patch, the contour that grows) is small, and is sent anew.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any, Literal, NamedTuple

import numpy as np
import viser
from numpy.typing import NDArray

from palpate.core.arrays import Floats
from palpate.tools.drawables import (
    CONTACT_RADIUS,
    LAYERS,
    TAXEL_RADIUS,
    Drawable,
    Faces,
    Finger,
    Lines,
    Mesh,
    Points,
    pad_body,
)
from palpate.tools.surfaces import scale_top, shades, thinned
from palpate.tools.view.glb import LIGHT, shaded, unlit_glb
from palpate.tools.view.timeline import Moment, Timeline

Colouring = Literal["plain", "deviation", "uncertainty"]
MOST_TRIANGLES = 20_000  # Of one surface: drawn in software, more are slower than 5 frames a second
MOST_SOLIDS = 48  # Kept in the browser
CHUNK, EVERY = 32, 2  # Touches whose points are one node, and of which every second is drawn
LINE_WIDTH, THIN = 4.0, 2.0  # Pixels; thin: of a contour that grows, and the lattice
NO_SHADOW: dict[str, Any] = {"cast_shadow": False, "receive_shadow": False}  # They take long
AXIS = 0.03  # Length of the pad's axis, m
GRID, GRID_CELL = 0.4, 0.01  # Side of the floor and of its cells, m
NARROW = 0.7  # Width by height of a window under which the panel lies over its lower part
SHEET = 0.3  # Share of the height that the panel takes there
OPENING = 0.6  # Of the camera, radians of the whole height


class Scale(NamedTuple):
    """What the colours of the solid mean."""

    name: Colouring
    top: float  # Value of the last colour, m


class Wishes(NamedTuple):
    """What is wanted to be seen."""

    colouring: Colouring = "plain"
    layers: frozenset[str] = frozenset()


@dataclass(slots=True)
class Scene:
    """Nodes for all that a timeline holds."""

    server: viser.ViserServer
    line: Timeline
    scale: Scale | None = None  # Of the solid that is shown
    triangles: tuple[int, int] = (0, 0)  # Of the solid: shown, and those that it has
    _nodes: dict[str, Any] = field(default_factory=dict)  # By name
    _visible: set[str] = field(default_factory=set)
    _scales: dict[str, Scale | None] = field(default_factory=dict)  # By name of a solid
    _thinned: dict[object, tuple[NDArray[np.intp], Faces]] = field(default_factory=dict)
    _made: dict[str, Any] = field(default_factory=dict)  # Of what each node was made, by name
    _aimed: bool = False

    def __post_init__(self) -> None:
        scene = self.server.scene
        scene.configure_environment_map(None)
        scene.configure_default_lights(False, cast_shadow=False)
        scene.add_light_hemisphere("/sky", ground_color=(150, 150, 160), intensity=1.2)
        scene.add_light_directional("/sun", intensity=2.0, position=LIGHT)

    def show(self, moment: Moment, wishes: Wishes) -> None:
        """Show what there was at a moment."""
        self._aim()
        with self.server.atomic():
            wanted = {*self._drawn(moment, wishes), *self._patch(moment)}
            for name in self._visible ^ wanted:
                self._nodes[name].visible = name in wanted
        self._visible = wanted

    def prepare(self, wishes: Wishes) -> bool:
        """Make one solid that a jump may ask for; false if all are there."""
        for model in self.line.models[-MOST_SOLIDS:]:
            shapes = (one.shape for one in self.line.of(model))
            mesh = next(one for one in shapes if isinstance(one, Mesh))
            if _solid_name(model.number, mesh, wishes.colouring) not in self._nodes:
                self._make_solid(model.number, mesh, wishes.colouring)
                return True
        return False

    def _put(self, name: str, make: Callable[..., Any], *what: Any, **how: Any) -> str:
        self._nodes[name] = make(name, *what, visible=name in self._visible, **how)
        return name

    def _put_mesh(self, name: str, vertices: Floats, faces: Faces, **how: Any) -> str:
        add = self.server.scene.add_mesh_simple
        return self._put(name, add, vertices, faces, **NO_SHADOW, **how)

    def _put_glb(self, name: str, body: bytes) -> str:
        return self._put(name, self.server.scene.add_glb, body, **NO_SHADOW)

    def _put_points(self, name: str, points: Floats, radius: float, colour: Any) -> str:
        return self._put(
            name,
            self.server.scene.add_point_cloud,
            points,
            colour,
            point_size=radius,
            point_shape="square" if radius == TAXEL_RADIUS else "circle",  # many, and small
            point_shading="flat",
            precision="float32",
        )

    def _put_lines(self, name: str, segments: Floats, colour: Any, width: float) -> str:
        """Lines (n, 2, 3), of a width in pixels."""
        add = self.server.scene.add_line_segments
        return self._put(name, add, segments, colour, thickness=width, thickness_units="screen")

    def _aim(self) -> None:
        """Point the camera at what there is, once, and lay the floor."""
        world, known = self.line.world, self.line.truth or self.line.touches or self.line.grasps
        if self._aimed or not known:
            return
        self._aimed = True
        low, _ = self.line.bounds()
        centre = (0.0, 0.0) if world is None else (float(world.centre[0]), float(world.centre[1]))
        floor = float(low[2]) if world is None or world.held else world.platform
        self.server.scene.add_grid(
            "/floor",
            GRID,
            GRID,
            cell_size=GRID_CELL,
            section_size=5 * GRID_CELL,
            position=(*centre, floor),
        )
        camera = self.server.initial_camera
        camera.fov, camera.near = OPENING, 0.002
        camera.position, camera.look_at = self.camera(1.0)
        for client in self.server.get_clients().values():
            self.point(client.camera)

    def camera(self, aspect: float) -> tuple[Floats, Floats]:
        """Where the camera begins, and what it looks at, in a window as wide by its height."""
        low, high = self.line.bounds()
        middle, half = 0.5 * (low + high), 0.5 * float(np.linalg.norm(high - low)) + AXIS
        back = np.array([0.45, -0.82, 0.36]) * half / np.sin(0.5 * OPENING) / min(aspect, 1.0)
        if aspect < NARROW:
            middle = middle - [0.0, 0.0, SHEET * np.tan(0.5 * OPENING) * np.linalg.norm(back)]
        return middle + back, middle

    def point(self, camera: viser.CameraHandle) -> None:
        """Have somebody's camera begin."""
        position, target = self.camera(camera.aspect)
        camera.fov, camera.near = OPENING, 0.002
        camera.position, camera.look_at = position, target

    def _drawn(self, moment: Moment, wishes: Wishes) -> Iterator[str]:
        """The nodes of a moment, of which those that are new are made."""
        self.scale, self.triangles, taxels = None, (0, 0), list[Points]()
        for one in self.line.drawn(moment, wishes.layers):
            match one.shape:
                case Points(radius=radius) as points if radius == TAXEL_RADIUS:
                    taxels.append(points)
                case Finger(pad=pad) as finger if pad is not None:
                    yield self._finger(f"/{one.path}", finger)
                case Mesh() as mesh if one.layer == "solid":
                    yield self._solid(one.facts["number"], mesh, wishes.colouring)
                case Mesh() | Lines() | Points() as shape:
                    name = f"/{one.path}" if one.time is None else f"/{one.path}/{one.time}"
                    if self._made.get(name) is not shape:
                        self._made[name] = shape
                        self._make(name, one)
                    yield name
        for first in range(0, len(taxels), CHUNK):
            yield self._chunk(f"/touched/taxels/{first}", taxels[first : first + CHUNK])

    def _make(self, name: str, one: Drawable) -> None:
        layer = LAYERS[one.layer]
        match one.shape:
            case Points() as points:
                self._put_points(name, points.lifted(), points.radius, layer.rgb)
            case Lines() as lines:
                thin = one.layer == "lattice" or "growing" in one.path
                self._put_lines(name, lines.pieces(), layer.rgb, THIN if thin else LINE_WIDTH)
            case Mesh() as mesh:
                kept, faces = thinned(mesh.vertices, mesh.faces, MOST_TRIANGLES)
                how = {"color": layer.rgb, "opacity": layer.opacity}
                self._put_mesh(name, mesh.vertices[kept], faces, **how)

    def _chunk(self, name: str, taxels: list[Points]) -> str:
        """Touched points of several touches."""
        made = [id(one.points) for one in taxels]
        if self._made.get(name) != made:
            self._made[name] = made
            points = np.concatenate([one.lifted()[::EVERY] for one in taxels])
            self._put_points(name, points, TAXEL_RADIUS, LAYERS["touched"].rgb)
        return name

    def _patch(self, moment: Moment) -> Iterator[str]:
        """What the last touch of each finger felt."""
        past = self.line.touches[: moment.touches]
        last = [one.touched() for one in {one.finger: one for one in past}.values()]
        made = [id(one.points) for one in last]
        if made and self._made.get("/patch") != made:
            self._made["/patch"] = made
            points = np.concatenate([one.lifted() for one in last])
            self._put_points("/patch", points, CONTACT_RADIUS, LAYERS["touched"].rgb)
        if last:
            yield "/patch"

    def _finger(self, name: str, finger: Finger) -> str:
        """A pad in its pose, with the axis along which it presses."""
        if name not in self._nodes and finger.pad is not None:
            colour, opacity = LAYERS["finger"].rgb, LAYERS["finger"].opacity
            body = pad_body(finger.pad)
            self._put_mesh(name, *body, color=colour, opacity=opacity, side="double")
            self.server.scene.add_line_segments(
                f"{name}/axis",
                np.array([[[0.0, 0.0, -AXIS], [0.0, 0.0, -finger.pad.thickness]]]),
                colour,
                thickness=LINE_WIDTH,
                thickness_units="screen",
            )
        self._nodes[name].position = finger.pose[:3]
        self._nodes[name].wxyz = np.roll(finger.pose[3:], 1)
        return name

    def _solid(self, number: object, mesh: Mesh, colouring: Colouring) -> str:
        name = _solid_name(number, mesh, colouring)
        if name not in self._nodes:
            self._make_solid(number, mesh, colouring)
        self.scale = self._scales[name]
        self.triangles = len(self._thinned[number][1]), len(mesh.faces)
        return name

    def _make_solid(self, number: object, mesh: Mesh, colouring: Colouring) -> None:
        name = _solid_name(number, mesh, colouring)
        if number not in self._thinned:
            self._thinned[number] = thinned(mesh.vertices, mesh.faces, MOST_TRIANGLES)
        kept, faces = self._thinned[number]
        values = None if colouring == "plain" else mesh.scalars(colouring, kept).get(colouring)
        self._scales[name] = None if values is None else Scale(colouring, scale_top(values))
        places, colours = mesh.vertices[kept], np.array(LAYERS["solid"].rgb, np.uint8)
        if values is not None:
            colours = shades(values, scale_top(values))
        self._put_glb(name, unlit_glb(places, faces, shaded(places, faces, colours)))
        old = [one for one in self._scales if one not in self._visible and one != name]
        for one in old[: max(0, len(self._scales) - MOST_SOLIDS)]:
            self._nodes.pop(one).remove()
            del self._scales[one]


def _solid_name(number: object, mesh: Mesh, colouring: Colouring) -> str:
    """Name of a node; a mesh of which nothing is known of what is asked for is drawn plain."""
    return f"/solid/{colouring if colouring in mesh.known else 'plain'}/{number}"
