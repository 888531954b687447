"""Drawables of a run: messages as meshes, points, lines, fingers, images, numbers and texts.

The view, the report, the film and the exporters write these drawables in their own formats, with
the names and colours of `LAYERS`. A drawable replaces the earlier one of its path, unless its layer
accumulates. Where the object was turned over, everything is drawn in its first pose; messages of a
placement whose pose is not known yet are not drawn.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from palpate.core.arrays import Floats
from palpate.core.poses import IDENTITY_POSE, Pose
from palpate.core.touch import Pad
from palpate.launch.colours import COLOURS, rgb
from palpate.launch.files.mesh_file import uncertainties
from palpate.messages import types
from palpate.nodes.specs.sensors import pad_of_info
from palpate.tools.surfaces import TruthSurface

Faces = NDArray[np.int32]
SCALARS = {  # of vertices; the first that is known colours a mesh
    "deviation": "distance from the truth",
    "uncertainty": "stated standard deviation",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class DrawnSizes:
    """Sizes of what is drawn over a surface, the same in all views and files."""

    lift: float = 0.0004  # [m] off the surface along its normal, so that the surface hides nothing
    taxel_radius: float = 0.0004  # [m]
    contact_radius: float = 0.0009  # [m] of a contact of the hand
    voxel_radius: float = 0.0006  # [m] of a cell at a boundary of free or unknown space
    place_radius: float = 0.0015  # [m] of the mark at an opening without touches


SIZES = DrawnSizes()


class Layer(NamedTuple):
    """Drawables that are switched on and off together, and have one colour."""

    label: str  # in legends
    colour: str  # ``#rrggbb``
    hint: str  # tooltip
    shown: bool = True  # at first, where layers can be chosen
    opacity: float = 1.0
    accumulates: bool = False  # whether a drawable leaves the earlier ones of its path in place

    @property
    def rgb(self) -> tuple[int, int, int]:
        """Red, green and blue, 0 to 255."""
        red, green, blue = bytes.fromhex(self.colour[1:])
        return red, green, blue


LAYERS: Mapping[str, Layer] = {
    "solid": Layer("solid", COLOURS["solid"], "The solid as it is rebuilt."),
    "contours": Layer("contours", COLOURS["contour"], "Traced contours without their gaps."),
    "touched": Layer(
        "touched", COLOURS["touch"], "Touched taxels and contacts of the hand.", accumulates=True
    ),
    "finger": Layer("finger", COLOURS["finger"], "The pad at its last touch.", opacity=0.55),
    "truth": Layer(
        "true solid",
        COLOURS["truth"],
        "The solid that is touched, where it is known.",
        shown=False,
        opacity=0.4,
    ),
    "lattice": Layer(
        "lattice",
        "#4a4a4a",
        "Control points of the final solid, if it is a deformed prism.",
        shown=False,
    ),
    "free": Layer(
        "free space",
        COLOURS["finger"],
        "Boundary of the space that fingers swept without touching anything.",
        shown=False,
    ),
    "unknown": Layer(
        "unknown space",
        COLOURS["untouched"],
        "Boundary of the space of which nothing is known.",
        shown=False,
    ),
    "untouched": Layer(
        "unknown places", COLOURS["untouched"], "Largest openings that no touch has closed."
    ),
}


class Mesh(NamedTuple):
    """Triangles in the world frame, and scalars of their vertices."""

    vertices: Floats  # (n, 3) [m]
    faces: Faces  # (m, 3)
    uncertainty: Floats | None = None  # (n,) standard deviation [m]
    surface: TruthSurface | None = None  # the true surface, for deviations

    @property
    def known(self) -> tuple[str, ...]:
        """Names of the scalars that are known."""
        known = {"deviation": self.surface, "uncertainty": self.uncertainty}
        return tuple(name for name, value in known.items() if value is not None)

    def scalars(self, name: str = "", kept: Any = slice(None)) -> dict[str, Floats]:
        """Known scalars (k,) [m] of the `kept` vertices, by name; all of them without `name`.

        The deviation from the truth comes first, then the uncertainty that the model states. The
        first one colours the mesh.
        """
        scalars = dict[str, Floats]()
        if self.surface is not None and name in ("", "deviation"):
            scalars["deviation"] = self.surface.deviations(self.vertices[kept])
        if self.uncertainty is not None and name in ("", "uncertainty"):
            scalars["uncertainty"] = np.asarray(self.uncertainty[kept])
        return scalars


class Points(NamedTuple):
    """Points in the world frame."""

    points: Floats  # (n, 3) [m]
    radius: float  # [m]
    normals: Floats = np.zeros(3)  # (n, 3) or (3,), outward; 0 where there is no surface

    def lifted(self) -> Floats:
        """Points (n, 3) a little off the surface on which they lie [m]."""
        return self.points + SIZES.lift * self.normals


class Lines(NamedTuple):
    """Strips of points in the world frame."""

    strips: tuple[Floats, ...]  # (k, 3) each, k at least 2 [m]
    normals: tuple[Floats, ...] = ()  # (k, 3) of each strip, outward; empty without a surface

    def pieces(self, lift: float = SIZES.lift) -> Floats:
        """Segments (n, 2, 3), `lift` [m] off the surface on which they lie."""
        normals = self.normals or (np.zeros(3),) * len(self.strips)
        lifted = [a + lift * b for a, b in zip(self.strips, normals, strict=True)]
        pieces = [np.stack([strip[:-1], strip[1:]], axis=1) for strip in lifted]
        return np.concatenate([np.zeros((0, 2, 3)), *pieces])


class Finger(NamedTuple):
    """A fingertip."""

    number: int
    pose: Floats  # (7,) of its pad
    pad: Pad | None  # None before the sensor is known


class Image(NamedTuple):
    """Compression of each taxel."""

    values: Floats  # (rows, cols) [m]


class Number(NamedTuple):
    """A value of a curve against robot time; the unit stands in the path."""

    value: float
    rgb: tuple[int, int, int]  # of the curve, 0 to 255


class Text(NamedTuple):
    """A line of the log."""

    text: str
    level: str
    node: str


class Nothing(NamedTuple):
    """Removes the drawable of its path."""


Shape = Mesh | Points | Lines | Finger | Image | Number | Text | Nothing


class Drawable(NamedTuple):
    """A shape, and where and when it is shown."""

    path: str  # such as ``contours/3``
    shape: Shape
    time: float | None = None  # robot time from which on it is shown [s]; None: always
    facts: Mapping[str, object] = {}  # about it, with units in the names

    @property
    def layer(self) -> str:
        """Name in `LAYERS`, or of the kind of a curve, an image or a text."""
        return self.path.partition("/")[0]


@dataclass(slots=True)
class Known:
    """Facts of earlier messages that drawing later ones needs."""

    pad: Pad | None = None
    taxel_stiffness: float = np.nan  # [N/m]
    surface: TruthSurface | None = None
    times: dict[int, float] = field(default_factory=dict)  # robot time of each model [s]
    # Poses of the object in the world after each time that it was turned over, stated by models.
    placements: tuple[Pose, ...] = ()

    def take(self, message: Any) -> None:
        """Remember the facts of a message."""
        if isinstance(message, types.SensorInfo):
            self.pad, self.taxel_stiffness = pad_of_info(message), message.taxel_stiffness
        elif isinstance(message, types.Truth):
            self.surface = TruthSurface(message)
        elif isinstance(message, types.ShapeModel):
            self.times[message.number] = message.robot_time
            if len(message.placements) > len(self.placements):
                self.placements = tuple(map(Pose.from_array, message.placements))

    def object_pose(self, placement: int) -> Pose | None:
        """Pose of the object in the world in a placement; None if no model has stated it yet."""
        if placement == 0:
            return Pose.from_array(IDENTITY_POSE)
        return self.placements[placement - 1] if placement <= len(self.placements) else None


def drawables(message: Any, known: Known) -> list[Drawable]:
    """Drawables of a message, none for most types. `known` has to `take` the message before."""
    draw = _DRAWN.get(type(message))
    return [] if draw is None else [*draw(message, known)]


def _truth(truth: types.Truth, known: Known) -> Iterable[Drawable]:
    # The coarse mesh is enough to be seen; errors are measured from the fine one.
    mesh = Mesh(truth.floor_vertices, truth.floor_faces)
    yield Drawable("truth", mesh, None, {"height_m": truth.height})


def _model(model: types.ShapeModel, known: Known) -> Iterable[Drawable]:
    time = model.robot_time
    if not len(model.faces):  # nothing could be rebuilt
        yield from (Drawable(path, Nothing(), time) for path in ("solid", "lattice"))
        return
    facts = {
        "number": model.number,
        "touches": model.touches,
        "deviation_m": model.deviation,
        "final": str(model.final).lower(),
    }
    yield Drawable("solid", model_mesh(model, known.surface), time, facts)
    if model.control.size:
        yield Drawable("lattice", Lines(tuple(_lattice(model.control))), time)


def model_mesh(model: types.ShapeModel, surface: TruthSurface | None) -> Mesh:
    """The mesh of a model, with what is known of its vertices."""
    stated = uncertainties(model)
    return Mesh(model.vertices, model.faces, stated if stated.any() else None, surface)


def _lattice(control: Floats) -> Iterable[Floats]:
    """Lines (k, 3) of control points on the outside of their lattice."""
    for axis in range(3):
        lines = np.moveaxis(control, axis, 2)
        inside = np.zeros(lines.shape[:2], np.bool_)
        inside[1:-1, 1:-1] = True
        yield from lines[~inside]


def _contour(contour: types.Contour, known: Known) -> Iterable[Drawable]:
    """Strips between the gaps, where nothing could be touched."""
    order = np.arange(len(contour.points))
    if contour.status == "closed":
        order = np.append(order, order[:1])
    gaps = {start.tobytes() for start in contour.gap_starts}
    cuts = [i for i, number in enumerate(order, 1) if contour.points[number].tobytes() in gaps]
    strips = [part for part in np.split(order, cuts) if len(part) > 1]
    lines = Lines(*(tuple(rows[i] for i in strips) for rows in (contour.points, contour.normals)))
    facts = {"status": contour.status, "height_m": contour.height, "touches": contour.touches}
    yield Drawable(f"contours/{contour.id}", lines, contour.robot_time, facts)


def _patch(patch: types.SurfacePatch, known: Known) -> Iterable[Drawable]:
    object_pose = known.object_pose(patch.placement)
    if len(patch.points) and object_pose is not None:
        normals = patch.normals @ object_pose.axes
        points = Points(object_pose.to_local(patch.points), SIZES.taxel_radius, normals)
        yield Drawable("touched", points, patch.robot_time)


def _contacts(grasp: types.GraspContacts, known: Known) -> Iterable[Drawable]:
    object_pose = known.object_pose(grasp.placement)
    if len(grasp.points) and object_pose is not None:
        points = Points(object_pose.to_local(grasp.points), SIZES.contact_radius)
        yield Drawable("touched", points, grasp.robot_time)


def _frame(frame: types.TactileFrame, known: Known) -> Iterable[Drawable]:
    object_pose = known.object_pose(frame.placement)
    if object_pose is None:
        return
    pose = object_pose.inverse() @ Pose.from_array(frame.pose)
    finger = Finger(frame.finger, pose.array if frame.placement else frame.pose, known.pad)
    yield Drawable(f"finger/{frame.finger}", finger, frame.robot_time)


def pad_size(pad: Pad) -> tuple[float, float, float]:
    """Edge lengths of the plate that is drawn for a pad [m]."""
    return pad.cols * pad.pitch, pad.rows * pad.pitch, pad.thickness


def pad_body(pad: Pad) -> tuple[Floats, Faces]:
    """Vertices and triangles of a pad in its own frame: the face, and the plate behind it."""
    x, y = pad.grid()
    face = np.stack([x, y, -pad.sag()], axis=-1)
    corners = np.arange(pad.rows * pad.cols).reshape(pad.rows, pad.cols)
    a, b, c, d = corners[:-1, :-1], corners[:-1, 1:], corners[1:, 1:], corners[1:, :-1]
    skin = np.concatenate([np.stack(t, -1).reshape(-1, 3) for t in ((a, b, c), (a, c, d))])
    rim = np.concatenate([corners[0], corners[1:, -1], corners[-1, -2::-1], corners[-2:0:-1, 0]])
    vertices = face.reshape(-1, 3)
    plate = np.column_stack([vertices[rim, :2], np.full(len(rim), face[..., 2].min())])
    plate[:, 2] -= pad.thickness
    under = len(vertices) + np.arange(len(rim))
    after = np.roll(np.arange(len(rim)), -1)
    sides = [[rim, under, under[after]], [rim, under[after], rim[after]]]
    back = np.stack([np.full(len(rim), len(vertices) + len(rim)), under[after], under], axis=-1)
    faces = np.concatenate([skin, *(np.stack(t, axis=-1) for t in sides), back])
    middle = plate.mean(axis=0, keepdims=True)
    return np.concatenate([vertices, plate, middle]), faces.astype(np.int32)


def _image(image: types.TactileImage, known: Known) -> Iterable[Drawable]:
    pressed, time = np.where(image.mask, image.compression, 0.0), image.robot_time
    yield Drawable(f"compression/{image.finger}", Image(pressed), time)
    force = float(pressed.sum()) * known.taxel_stiffness
    if not np.isnan(force):
        yield Drawable(f"force_N/{image.finger}", Number(force, rgb("finger")), time)


def _space(space: types.SpaceMap, known: Known) -> Iterable[Drawable]:
    """Boundaries of free and of unknown space at the time of their model."""
    swept, seen = space.states == 1, space.states != 0
    free = swept & ~scipy.ndimage.binary_erosion(swept)
    unknown = ~seen & scipy.ndimage.binary_dilation(seen)
    for path, edge in (("free", free), ("unknown", unknown)):
        middles = np.asarray(space.low + space.step * np.argwhere(edge))
        yield Drawable(path, Points(middles, SIZES.voxel_radius), known.times.get(space.number))


def _done(done: types.PlanDone, known: Known) -> Iterable[Drawable]:
    if len(done.open_places):
        normals = done.open_normals if len(done.open_normals) else np.zeros(3)
        places = Points(done.open_places, SIZES.place_radius, normals)
        yield Drawable("untouched", places, done.robot_time)


def _score(score: types.Score, known: Known) -> Iterable[Drawable]:
    error = Number(1e3 * score.rms, rgb("error"))
    yield Drawable("error_mm/rms", error, score.robot_time)


def _estimate(estimate: types.PlanEstimate, known: Known) -> Iterable[Drawable]:
    if estimate.rms_bound_95 is not None:
        bound = Number(1e3 * estimate.rms_bound_95, rgb("bound"))
        yield Drawable("error_mm/bound_95", bound, estimate.robot_time)


def _log(record: types.LogRecord, known: Known) -> Iterable[Drawable]:
    text = Text(record.text, record.level, record.node)
    yield Drawable(f"log/{record.node}", text, record.robot_time)


_DRAWN: Mapping[type, Callable[[Any, Known], Iterable[Drawable]]] = {
    types.Truth: _truth,
    types.ShapeModel: _model,
    types.Contour: _contour,
    types.SurfacePatch: _patch,
    types.GraspContacts: _contacts,
    types.TactileFrame: _frame,
    types.TactileImage: _image,
    types.SpaceMap: _space,
    types.PlanDone: _done,
    types.Score: _score,
    types.PlanEstimate: _estimate,
    types.LogRecord: _log,
}
# Names of types that `Known` takes facts from; they are read even if their topics are not chosen.
TYPES_NEEDED = frozenset({"SensorInfo", "ShapeModel", "Truth"})
TYPES_DRAWN = TYPES_NEEDED | {kind.__name__ for kind in _DRAWN}
