"""The scene in the browser: nodes of viser for a timeline, shown at a moment.

A node is made once and then only shown or hidden, so that a jump in time sends small messages. What
changes with every touch (its patch, the contour that grows) is small, and is sent again.
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
    LAYERS,
    SIZES,
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
NO_SHADOW: dict[str, Any] = {"cast_shadow": False, "receive_shadow": False}  # shadows are slow


@dataclass(frozen=True, slots=True, kw_only=True)
class SceneSettings:
    """Limits of what a browser draws, and sizes in the scene.

    With more triangles, drawing in software is slower than 5 frames a second.
    """

    max_triangles: int = 20_000  # of a surface; a finer one is thinned
    max_solids: int = 48  # kept in the browser
    chunk_touches: int = 32  # touches whose points are one node
    taxel_stride: int = 2  # only each `taxel_stride`-th point of a touch is drawn
    line_width: float = 4.0  # [pixels]
    thin_width: float = 2.0  # [pixels] of a growing contour and of the lattice
    axis_length: float = 0.03  # [m] of the line behind a pad
    floor_size: float = 0.4  # [m] side of the floor
    floor_cell: float = 0.01  # [m] side of its cells
    opening: float = 0.6  # [rad] vertical opening angle of the camera
    near: float = 0.002  # [m] from the camera, below which nothing is drawn
    max_narrow_aspect: float = 0.7  # width / height of a window whose panel covers its bottom
    panel_share: float = 0.3  # fraction of the height of such a window that the panel covers


DEFAULT_SCENE = SceneSettings()


class Scale(NamedTuple):
    """Meaning of the colours of the solid."""

    name: Colouring
    top: float  # value of the last colour [m]


class ViewOptions(NamedTuple):
    """What is chosen to be seen."""

    colouring: Colouring = "plain"
    layers: frozenset[str] = frozenset()


@dataclass(slots=True)
class Scene:
    """Nodes for all that a timeline holds."""

    server: viser.ViserServer
    line: Timeline
    settings: SceneSettings = DEFAULT_SCENE
    scale: Scale | None = None  # of the solid that is shown
    triangles: tuple[int, int] = (0, 0)  # of that solid: drawn, and all
    _nodes: dict[str, Any] = field(default_factory=dict)  # by name
    _visible: set[str] = field(default_factory=set)
    _scales: dict[str, Scale | None] = field(default_factory=dict)  # by name of a solid
    _thinned: dict[object, tuple[NDArray[np.intp], Faces]] = field(default_factory=dict)
    _sources: dict[str, Any] = field(default_factory=dict)  # of what each node was made, by name
    _has_camera: bool = False

    def __post_init__(self) -> None:
        scene = self.server.scene
        scene.configure_environment_map(None)
        scene.configure_default_lights(False, cast_shadow=False)
        scene.add_light_hemisphere("/sky", ground_color=(150, 150, 160), intensity=1.2)
        scene.add_light_directional("/sun", intensity=2.0, position=LIGHT.direction().tolist())

    def show(self, moment: Moment, options: ViewOptions) -> None:
        """Show a moment."""
        self._aim()
        with self.server.atomic():
            wanted = {*self._drawn(moment, options), *self._patch(moment)}
            for name in self._visible ^ wanted:
                self._nodes[name].visible = name in wanted
        self._visible = wanted

    def prepare(self, options: ViewOptions) -> bool:
        """Make one solid that a jump may need; false if none is missing."""
        for model in self.line.models[-self.settings.max_solids :]:
            shapes = (drawable.shape for drawable in self.line.drawables_of(model))
            mesh = next(shape for shape in shapes if isinstance(shape, Mesh))
            if _solid_name(model.number, mesh, options.colouring) not in self._nodes:
                self._make_solid(model.number, mesh, options.colouring)
                return True
        return False

    def _put(self, name: str, make: Callable[..., Any], *what: Any, **looks: Any) -> str:
        self._nodes[name] = make(name, *what, visible=name in self._visible, **looks)
        return name

    def _put_mesh(self, name: str, vertices: Floats, faces: Faces, **looks: Any) -> str:
        add = self.server.scene.add_mesh_simple
        return self._put(name, add, vertices, faces, **NO_SHADOW, **looks)

    def _put_glb(self, name: str, body: bytes) -> str:
        return self._put(name, self.server.scene.add_glb, body, **NO_SHADOW)

    def _put_points(self, name: str, points: Floats, radius: float, colour: Any) -> str:
        return self._put(
            name,
            self.server.scene.add_point_cloud,
            points,
            colour,
            point_size=radius,
            point_shape="square"
            if radius == SIZES.taxel_radius
            else "circle",  # taxels are many and small
            point_shading="flat",
            precision="float32",
        )

    def _put_lines(self, name: str, segments: Floats, colour: Any, width: float) -> str:
        """Put line segments (n, 2, 3); `width` [pixels]."""
        add = self.server.scene.add_line_segments
        return self._put(name, add, segments, colour, thickness=width, thickness_units="screen")

    def _aim(self) -> None:
        """Aim the camera and lay the floor, once, as soon as there is something to see."""
        world, known = self.line.world, self.line.truth or self.line.touches or self.line.grasps
        if self._has_camera or not known:
            return
        self._has_camera = True
        low, _ = self.line.bounds()
        centre = (0.0, 0.0) if world is None else (float(world.centre[0]), float(world.centre[1]))
        floor = float(low[2]) if world is None or world.held else world.platform
        self.server.scene.add_grid(
            "/floor",
            self.settings.floor_size,
            self.settings.floor_size,
            cell_size=self.settings.floor_cell,
            section_size=5 * self.settings.floor_cell,
            position=(*centre, floor),
        )
        camera = self.server.initial_camera
        camera.fov, camera.near = self.settings.opening, self.settings.near
        camera.position, camera.look_at = self.camera(1.0)
        for client in self.server.get_clients().values():
            self.aim(client.camera)

    def camera(self, aspect: float) -> tuple[Floats, Floats]:
        """First position of the camera, and its target, in a window of this width over height."""
        low, high = self.line.bounds()
        middle, half_opening = 0.5 * (low + high), 0.5 * self.settings.opening
        radius = 0.5 * float(np.linalg.norm(high - low)) + self.settings.axis_length
        back = np.array([0.45, -0.82, 0.36]) * radius / np.sin(half_opening) / min(aspect, 1.0)
        if self.is_narrow(aspect):
            covered = self.settings.panel_share * np.tan(half_opening) * np.linalg.norm(back)
            middle = middle - [0.0, 0.0, covered]
        return middle + back, middle

    def is_narrow(self, aspect: float) -> bool:
        """Whether the panel covers the bottom of a window of this width over height."""
        return aspect < self.settings.max_narrow_aspect

    def aim(self, camera: viser.CameraHandle) -> None:
        """Put the camera of a client to its first position."""
        position, target = self.camera(camera.aspect)
        camera.fov, camera.near = self.settings.opening, self.settings.near
        camera.position, camera.look_at = position, target

    def _drawn(self, moment: Moment, options: ViewOptions) -> Iterator[str]:
        """Names of the nodes of a moment; makes those that are missing."""
        self.scale, self.triangles, taxels = None, (0, 0), list[Points]()
        for drawable in self.line.drawn(moment, options.layers):
            match drawable.shape:
                case Points(radius=radius) as points if radius == SIZES.taxel_radius:
                    taxels.append(points)
                case Finger(pad=pad) as finger if pad is not None:
                    yield self._finger(f"/{drawable.path}", finger)
                case Mesh() as mesh if drawable.layer == "solid":
                    yield self._solid(drawable.facts["number"], mesh, options.colouring)
                case Mesh() | Lines() | Points() as shape:
                    path, time = drawable.path, drawable.time
                    name = f"/{path}" if time is None else f"/{path}/{time}"
                    if self._sources.get(name) is not shape:
                        self._sources[name] = shape
                        self._make(name, drawable)
                    yield name
        size = self.settings.chunk_touches
        for first in range(0, len(taxels), size):
            yield self._chunk(f"/touched/taxels/{first}", taxels[first : first + size])

    def _make(self, name: str, drawable: Drawable) -> None:
        layer, settings = LAYERS[drawable.layer], self.settings
        match drawable.shape:
            case Points() as points:
                self._put_points(name, points.lifted(), points.radius, layer.rgb)
            case Lines() as lines:
                is_thin = drawable.layer == "lattice" or "growing" in drawable.path
                width = settings.thin_width if is_thin else settings.line_width
                self._put_lines(name, lines.pieces(), layer.rgb, width)
            case Mesh() as mesh:
                kept, faces = thinned(mesh.vertices, mesh.faces, settings.max_triangles)
                looks = {"color": layer.rgb, "opacity": layer.opacity}
                self._put_mesh(name, mesh.vertices[kept], faces, **looks)

    def _chunk(self, name: str, taxels: list[Points]) -> str:
        """Touched points of several touches."""
        sources, stride = [id(touch.points) for touch in taxels], self.settings.taxel_stride
        if self._sources.get(name) != sources:
            self._sources[name] = sources
            points = np.concatenate([touch.lifted()[::stride] for touch in taxels])
            self._put_points(name, points, SIZES.taxel_radius, LAYERS["touched"].rgb)
        return name

    def _patch(self, moment: Moment) -> Iterator[str]:
        """Name of the node of the points that the last touch of each finger met."""
        past = self.line.touches[: moment.touches]
        last = [touch.touched() for touch in {touch.finger: touch for touch in past}.values()]
        sources = [id(points.points) for points in last]
        if sources and self._sources.get("/patch") != sources:
            self._sources["/patch"] = sources
            points = np.concatenate([cloud.lifted() for cloud in last])
            self._put_points("/patch", points, SIZES.contact_radius, LAYERS["touched"].rgb)
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
                np.array(
                    [[[0.0, 0.0, -self.settings.axis_length], [0.0, 0.0, -finger.pad.thickness]]]
                ),
                colour,
                thickness=self.settings.line_width,
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
            self._thinned[number] = thinned(mesh.vertices, mesh.faces, self.settings.max_triangles)
        kept, faces = self._thinned[number]
        values = None if colouring == "plain" else mesh.scalars(colouring, kept).get(colouring)
        self._scales[name] = None if values is None else Scale(colouring, scale_top(values))
        vertices, colours = mesh.vertices[kept], np.array(LAYERS["solid"].rgb, np.uint8)
        if values is not None:
            colours = shades(values, scale_top(values))
        self._put_glb(name, unlit_glb(vertices, faces, shaded(vertices, faces, colours)))
        hidden = [solid for solid in self._scales if solid not in self._visible and solid != name]
        for old in hidden[: max(0, len(self._scales) - self.settings.max_solids)]:
            self._nodes.pop(old).remove()
            del self._scales[old]


def _solid_name(number: object, mesh: Mesh, colouring: Colouring) -> str:
    """Name of the node of a solid, which is drawn plain if the values to colour it are unknown."""
    return f"/solid/{colouring if colouring in mesh.known else 'plain'}/{number}"
