"""The scene in the browser: nodes of viser for all that a timeline holds, shown as of a moment.

A node is made once and then only shown or hidden, so that a jump in time sends small messages. What
changes with every touch (its patch, the contour that grows) is small, and is sent anew.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal, NamedTuple

import numpy as np
import viser
from numpy.typing import NDArray

from palpate.core.arrays import Floats
from palpate.core.touch import Pad
from palpate.launch.colours import rgb
from palpate.launch.files.mesh_file import uncertainties
from palpate.messages.types import ShapeModel
from palpate.tools.surfaces import scale_top, shades, thinned
from palpate.tools.view.drawn import (
    LIGHT,
    Faces,
    boundary,
    contour_segments,
    growing,
    lattice_lines,
    lifted,
    pad_body,
    shaded,
    unlit_glb,
)
from palpate.tools.view.timeline import Moment, Timeline, Touch

Colouring = Literal["plain", "deviation", "uncertainty"]
MOST_TRIANGLES = 20_000  # Of one surface: drawn in software, more are slower than 5 frames a second
MOST_SOLIDS = 48  # Kept in the browser
CHUNK, EVERY = 32, 2  # Touches whose points are one node, and of which every second is drawn
POINT, CONTACT, VOXEL = 0.0004, 0.0009, 0.0006  # Radii of points, m
LATTICE = (74, 74, 74)
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
    points: bool = True
    truth: bool = False
    lattice: bool = False
    free: bool = False
    unknown: bool = False


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
    _thinned: dict[int, tuple[NDArray[np.intp], Faces]] = field(default_factory=dict)
    _chunks: dict[str, list[int]] = field(default_factory=dict)  # Identities of touches
    _drawn: Sequence[Touch] = ()  # Last touches of the fingers that are shown
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
        wishes = self._possible(wishes)
        with self.server.atomic():
            wanted = {*self._contours(moment), *self._points(moment, wishes)}
            wanted |= {*self._fingers(moment), *self._space(moment, wishes)}
            wanted |= {*self._solid(moment, wishes), *self._references(wishes)}
            for name in self._visible ^ wanted:
                self._nodes[name].visible = name in wanted
        self._visible = wanted

    def prepare(self, wishes: Wishes) -> bool:
        """Make one solid that a jump may ask for; false if all are there."""
        wishes = self._possible(wishes)
        for model in self.line.models[-MOST_SOLIDS:]:
            if _solid_name(model, wishes.colouring) not in self._nodes:
                self._make_solid(model, wishes.colouring)
                return True
        return False

    def _possible(self, wishes: Wishes) -> Wishes:
        unknown = wishes.colouring == "deviation" and self.line.truth is None
        return wishes._replace(colouring="plain") if unknown else wishes

    def _put(self, name: str, make: Callable[..., Any], *what: Any, **how: Any) -> str:
        self._nodes[name] = make(name, *what, visible=name in self._visible, **how)
        return name

    def _put_mesh(self, name: str, vertices: Floats, faces: Faces, **how: Any) -> str:
        add = self.server.scene.add_mesh_simple
        return self._put(name, add, vertices, faces, **NO_SHADOW, **how)

    def _put_glb(self, name: str, body: bytes) -> str:
        return self._put(name, self.server.scene.add_glb, body, **NO_SHADOW)

    def _put_points(self, name: str, points: Floats, colour: Any, radius: float) -> str:
        return self._put(
            name,
            self.server.scene.add_point_cloud,
            points,
            colour,
            point_size=radius,
            point_shape="square" if radius == POINT else "circle",  # many, and small
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

    def _contours(self, moment: Moment) -> Iterator[str]:
        """Contours, and the one that grows."""
        known = self.line.contours
        for contour in known:
            name = f"/contours/{contour.id}"
            if name not in self._nodes:
                self._put_lines(name, contour_segments(contour), rgb("contour"), 4.0)
        yield from (f"/contours/{one.id}" for one in known[: moment.contours])
        done = {one.id for one in known[: moment.contours]}
        past = self.line.touches[: moment.touches]
        for finger in {one.finger for one in past}:
            way = growing([one for one in past if one.finger == finger], done)
            if len(way) > 1:
                pieces = np.stack([way[:-1], way[1:]], axis=1)
                yield self._put_lines(f"/growing/{finger}", pieces, rgb("contour"), 2.0)

    def _points(self, moment: Moment, wishes: Wishes) -> Iterator[str]:
        """Touched points: chunks that are whole, and what is left over."""
        if not wishes.points:
            return
        for number, grasp in enumerate(self.line.grasps[: moment.grasps]):
            name = f"/points/grasp/{number}"
            if name not in self._nodes and len(grasp.points):
                self._put_points(name, grasp.points, rgb("touch"), CONTACT)
            if name in self._nodes:
                yield name
        whole = moment.touches // CHUNK
        for number in range(whole):
            yield self._chunk(f"/points/{number}", slice(number * CHUNK, (number + 1) * CHUNK))
        if whole * CHUNK < moment.touches:
            yield self._chunk("/points/rest", slice(whole * CHUNK, moment.touches))

    def _chunk(self, name: str, which: slice) -> str:
        touches = self.line.touches[which]
        known = [id(one) for one in touches]
        if self._chunks.get(name) != known:
            self._chunks[name] = known
            points = np.concatenate([lifted(one)[::EVERY] for one in touches])
            self._put_points(name, points, rgb("touch"), POINT)
        return name

    def _fingers(self, moment: Moment) -> Iterator[str]:
        """Pad and patch of the last touch of each finger."""
        past = self.line.touches[: moment.touches]
        last = [*{one.finger: one for one in past}.values()]
        for one in last if self.line.pad is not None else ():
            name = f"/pad/{one.finger}"
            if name not in self._nodes:
                self._make_pad(name, self.line.pad)
            self._nodes[name].position = one.pose[:3]
            self._nodes[name].wxyz = np.roll(one.pose[3:], 1)
            yield name
        if [*map(id, last)] != [*map(id, self._drawn)] and last:
            self._drawn = last
            touched = np.concatenate([lifted(one) for one in last])
            self._put_points("/patch", touched, rgb("touch"), CONTACT)
        if last:
            yield "/patch"

    def _make_pad(self, name: str, pad: Pad | None) -> None:
        """A pad in its own frame, with the axis along which it presses."""
        assert pad is not None
        self._put_mesh(name, *pad_body(pad), color=rgb("finger"), opacity=0.55, side="double")
        self.server.scene.add_line_segments(
            f"{name}/axis",
            np.array([[[0.0, 0.0, -AXIS], [0.0, 0.0, -pad.thickness]]]),
            rgb("finger"),
            thickness=4.0,
            thickness_units="screen",
        )

    def _solid(self, moment: Moment, wishes: Wishes) -> Iterator[str]:
        self.scale, self.triangles = None, (0, 0)
        if moment.models:
            model = self.line.models[moment.models - 1]
            name = _solid_name(model, wishes.colouring)
            if name not in self._nodes:
                self._make_solid(model, wishes.colouring)
            self.scale = self._scales[name]
            self.triangles = len(self._thinned[model.number][1]), len(model.faces)
            yield name

    def _make_solid(self, model: ShapeModel, colouring: Colouring) -> None:
        name = _solid_name(model, colouring)
        if model.number not in self._thinned:
            self._thinned[model.number] = thinned(model.vertices, model.faces, MOST_TRIANGLES)
        kept, faces = self._thinned[model.number]
        values = self._values(model, kept, colouring)
        self._scales[name] = None if values is None else Scale(colouring, scale_top(values))
        places = model.vertices[kept]
        if values is None:
            colours = np.array(rgb("solid"), np.uint8)
        else:
            colours = shades(values, scale_top(values))
        self._put_glb(name, unlit_glb(places, faces, shaded(places, faces, colours)))
        old = [one for one in self._scales if one not in self._visible and one != name]
        for one in old[: max(0, len(self._scales) - MOST_SOLIDS)]:
            self._nodes.pop(one).remove()
            del self._scales[one]

    def _values(
        self, model: ShapeModel, kept: NDArray[np.intp], colouring: Colouring
    ) -> Floats | None:
        """What is told of the vertices that are kept, m; None where nothing is."""
        if colouring == "uncertainty":
            return uncertainties(model)[kept]
        if colouring == "plain":
            return None
        assert self.line.surface is not None
        return self.line.surface.deviations(model.vertices[kept])

    def _references(self, wishes: Wishes) -> Iterator[str]:
        """The true solid, and the control lattice of the last model that has one."""
        truth = self.line.truth
        if wishes.truth and truth is not None:
            if "/truth" not in self._nodes:
                vertices, faces = truth.floor_vertices, truth.floor_faces  # the coarser ones
                kept, faces = thinned(vertices, faces, MOST_TRIANGLES)
                self._put_mesh("/truth", vertices[kept], faces, color=rgb("truth"), opacity=0.4)
            yield "/truth"
        control = next((x.control for x in reversed(self.line.models) if x.control.size), None)
        if wishes.lattice and control is not None:
            if "/lattice" not in self._nodes:
                points, pairs = lattice_lines(control)
                colours = np.tile(np.array(LATTICE, np.uint8), (len(points), 1))
                self._put_glb("/lattice", unlit_glb(points, pairs, colours))
            yield "/lattice"

    def _space(self, moment: Moment, wishes: Wishes) -> Iterator[str]:
        """Boundaries of what is known to be free, and of what nobody knows."""
        space = self.line.space_at(moment)
        if space is None:
            return
        for kind, wanted, colour in (("free", wishes.free, rgb("finger")),
                                     ("unknown", wishes.unknown, rgb("untouched"))):  # fmt: skip
            name = f"/space/{kind}/{space.number}"
            if wanted and name not in self._nodes:
                self._put_points(name, boundary(space, free=kind == "free"), colour, VOXEL)
            if wanted:
                yield name


def _solid_name(model: ShapeModel, colouring: Colouring) -> str:
    return f"/solid/{colouring}/{model.number}"
