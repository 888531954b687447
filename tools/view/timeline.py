"""Events of a run in robot time: touches, contours, models, and their scores.

A timeline takes messages in any order, from a recording or from a graph that still runs. Drawings
ask it for the state at a time.
"""

from __future__ import annotations

from bisect import bisect_right, insort
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from palpate.core.arrays import Floats, Ints
from palpate.core.poses import Pose
from palpate.core.touch import Pad
from palpate.messages import types
from palpate.tools.bag.decoding import open_decoded
from palpate.tools.drawables import (
    LAYERS,
    SIZES,
    Drawable,
    Finger,
    Known,
    Lines,
    Points,
    drawables,
)
from palpate.tools.surfaces import TruthSurface

TRACED = ("closed", "occluded")  # status of a contour that is counted


class Touch(NamedTuple):
    """One touch, as far as it is drawn."""

    time: float  # robot time at its end [s]
    goal: int  # number of its contour or probe
    number: int  # in the goal
    finger: int
    pose: Floats  # (7,) of the pad
    outcome: str  # of the guarded move, as in a SurfacePatch
    kind: str  # of the surface, as in a SurfacePatch
    points: Floats  # (n, 3) touched taxels in the world frame, at most `Timeline.max_points`
    normal: Floats  # (3,)
    residual: float  # of the local fit [m]
    compression: Floats  # (rows, cols) of each taxel [m]; (0, 0) without a published image
    force: float  # on all taxels together [N]; NaN if unknown

    def touched(self) -> Points:
        """The points as they are drawn."""
        return Points(self.points, SIZES.taxel_radius, self.normal)

    def placed(self, pad: Pad | None) -> Drawable:
        """The finger as it is drawn."""
        return Drawable(f"finger/{self.finger}", Finger(self.finger, self.pose, pad), self.time)


class Moment(NamedTuple):
    """Lengths of the timeline's lists at a robot time."""

    touches: int
    grasps: int
    contours: int
    models: int


@dataclass(slots=True)
class Timeline:
    """All received messages, each kind in the order of robot time."""

    touches: list[Touch] = field(default_factory=list)
    contours: list[types.Contour] = field(default_factory=list)
    probes: list[types.Probe] = field(default_factory=list)
    grasps: list[types.GraspContacts] = field(default_factory=list)
    models: list[types.ShapeModel] = field(default_factory=list)  # with triangles
    spaces: dict[int, types.SpaceMap] = field(default_factory=dict)  # by number of the model
    scores: dict[int, types.Score] = field(default_factory=dict)
    estimates: dict[int, types.PlanEstimate] = field(default_factory=dict)
    truth: types.Truth | None = None
    world: types.World | None = None
    done: types.PlanDone | None = None
    known: Known = field(default_factory=Known)  # sensor and true surface
    max_compression: float = 0.0  # [m] of all taxels
    max_points: int = 48  # of a touch that are drawn, spread over its taxels
    # Each message and its drawables, by the message's identity.
    _drawables: dict[int, tuple[Any, list[Drawable]]] = field(default_factory=dict)
    _images: dict[tuple[int, int, int], Floats] = field(default_factory=dict)
    _without_image: dict[tuple[int, int, int], Touch] = field(
        default_factory=dict
    )  # touches without an image yet
    # Patches from before the sensor, or the object's pose in their placement, was known.
    _early: list[types.SurfacePatch] = field(default_factory=list)

    def add(self, message: Any) -> None:
        """Take a message; types that are never drawn are ignored."""
        self.known.take(message)
        take = _TAKEN.get(type(message))
        if take is not None:
            take(self, message)

    @property
    def end(self) -> float:
        """Robot time of the last event [s]."""
        kinds = (self.touches, self.contours, self.models, self.grasps)
        return max((_time(events[-1]) for events in kinds if events), default=0.0)

    def at(self, time: float) -> Moment:
        """The moment at a robot time [s]."""
        kinds = (self.touches, self.grasps, self.contours, self.models)
        return Moment(*(bisect_right(events, time, key=_time) for events in kinds))

    def traced(self, moment: Moment) -> int:
        """Number of contours traced by a moment, without those that were given up."""
        return sum(contour.status in TRACED for contour in self.contours[: moment.contours])

    def space_at(self, moment: Moment) -> types.SpaceMap | None:
        """The last map of free space by a moment."""
        numbers = (model.number for model in reversed(self.models[: moment.models]))
        return next((self.spaces[number] for number in numbers if number in self.spaces), None)

    @property
    def surface(self) -> TruthSurface | None:
        """The true surface, for distances from it; None if it is unknown."""
        return self.known.surface

    def drawables_of(self, message: Any) -> list[Drawable]:
        """Drawables of one of the timeline's messages, made once."""
        if id(message) not in self._drawables:
            self._drawables[id(message)] = message, drawables(message, self.known)
        return self._drawables[id(message)][1]

    def drawn(self, moment: Moment, layers: Collection[str] = LAYERS) -> Iterator[Drawable]:
        """Drawables that are seen at a moment in some layers.

        A solid stays until the next with triangles; unknown places are seen at the end only.
        """
        messages: list[Any] = [self.truth, *self.models[: moment.models][-1:]]
        if {"free", "unknown"} & {*layers}:
            messages.append(self.space_at(moment))
        if moment == self.at(np.inf):
            messages.append(self.done)
        messages += [*self.contours[: moment.contours], *self.grasps[: moment.grasps]]
        for message in messages:
            shown = [] if message is None else self.drawables_of(message)
            yield from (drawable for drawable in shown if drawable.layer in layers)
        past = self.touches[: moment.touches]
        if "contours" in layers:
            yield from growing(past, {contour.id for contour in self.contours[: moment.contours]})
        if "touched" in layers:
            yield from (Drawable("touched", touch.touched(), touch.time) for touch in past)
        if "finger" in layers:
            last = {touch.finger: touch for touch in past}.values()
            yield from (touch.placed(self.known.pad) for touch in last)

    def bounds(self) -> tuple[Floats, Floats]:
        """Corners, (3,) each, of the box of contacts and solids; a cube of 0.1 m without any."""
        points = [touch.points for touch in self.touches if len(touch.points)]
        points += [grasp.points for grasp in self.grasps if len(grasp.points)]
        points += [mesh.vertices for mesh in (self.truth, *self.models[-1:]) if mesh is not None]
        if not points:
            return np.full(3, -0.05), np.full(3, 0.05)
        lows, highs = zip(*((some.min(axis=0), some.max(axis=0)) for some in points), strict=True)
        return np.min(lows, axis=0), np.max(highs, axis=0)

    def touch_rate(self, window: float = 20.0) -> tuple[Floats, Floats]:
        """Robot times (n,) [s], and touches per second (n,) over the `window` [s] before each."""
        times = np.array([touch.time for touch in self.touches])
        before = np.searchsorted(times, times - window, side="right")
        return times, (np.arange(1, len(times) + 1) - before) / np.minimum(window, times + 1e-9)

    def _take_early(self) -> None:
        early, self._early = self._early, []
        for patch in early:
            self._take_patch(patch)

    def _take_truth(self, truth: types.Truth) -> None:
        self.truth = truth
        self._drawables.clear()  # their deviations are measured from it

    def _take_image(self, image: types.TactileImage) -> None:
        pressed = np.where(image.mask, image.compression, 0.0)
        self.max_compression = max(self.max_compression, float(pressed.max(initial=0.0)))
        key = image.finger, image.goal, image.touch
        touch = self._without_image.pop(key, None)
        if touch is None:
            self._images[key] = pressed
        else:
            index = next(i for i, known in enumerate(self.touches) if known is touch)
            self.touches[index] = self._with_image(touch, pressed)

    def _with_image(self, touch: Touch, pressed: Floats) -> Touch:
        force = float(pressed.sum()) * self.known.taxel_stiffness
        return touch._replace(compression=pressed, force=force)

    def _take_patch(self, patch: types.SurfacePatch) -> None:
        object_pose = self.known.object_pose(patch.placement)
        if self.known.pad is None or object_pose is None:
            self._early.append(patch)
            return
        pose, normal = patch.pose, patch.normal
        if patch.placement:  # drawn in the object's first pose
            pose = (object_pose.inverse() @ Pose.from_array(pose)).array
            normal = normal @ object_pose.axes
        key = patch.finger, patch.goal, patch.touch
        touch = Touch(
            patch.robot_time,
            patch.goal,
            patch.touch,
            patch.finger,
            pose,
            patch.outcome,
            patch.kind,
            self._touched(patch),
            normal,
            patch.residual,
            np.zeros((0, 0)),
            np.nan,
        )
        if key in self._images:
            touch = self._with_image(touch, self._images.pop(key))
        else:
            self._without_image[key] = touch
        insort(self.touches, touch, key=_rank)

    def _touched(self, patch: types.SurfacePatch) -> Floats:
        """Touched taxels (n, 3) [m]: some that are spread evenly, if there are many."""
        shapes = (drawable.shape for drawable in drawables(patch, self.known))
        clouds = (shape.points for shape in shapes if isinstance(shape, Points))
        points = [np.zeros((0, 3)), *clouds][-1]
        return points[:: max(1, -(-len(points) // self.max_points))]

    def _take_model(self, model: types.ShapeModel) -> None:
        if len(model.placements):
            self._drawables.clear()  # contacts are drawn by the poses of the object
            self._take_early()
        if len(model.faces):
            insort(self.models, model, key=_rank)


def _time(event: Any) -> float:
    time: float = event.time if isinstance(event, Touch) else event.robot_time
    return time


def _rank(event: Any) -> tuple[float, int, int]:
    """Key of the order of events: by time, and by number at the same time."""
    if isinstance(event, Touch):
        return event.time, event.goal, event.number
    return event.robot_time, event.id if hasattr(event, "id") else event.number, 0


def growing(touches: Sequence[Touch], done: set[int]) -> Iterator[Drawable]:
    """The contour that each finger is tracing: a line through the middles of its contacts.

    `done`: identifiers of the contours that are finished.
    """
    for finger, last in {touch.finger: touch for touch in touches}.items():
        if last.goal not in done:
            own = (touch for touch in touches if (touch.finger, touch.goal) == (finger, last.goal))
            points = [touch.touched().lifted() for touch in own if len(touch.points)]
            away = (np.linalg.norm(some - some.mean(axis=0), axis=1) for some in points)
            middles = [some[np.argmin(far)] for some, far in zip(points, away, strict=True)]
            if len(middles) > 1:
                yield Drawable(f"contours/growing/{finger}", Lines((np.array(middles),)))


_TAKEN: Mapping[type, Callable[[Timeline, Any], None]] = {
    types.SensorInfo: lambda line, _: line._take_early(),
    types.TactileImage: Timeline._take_image,
    types.SurfacePatch: Timeline._take_patch,
    types.ShapeModel: Timeline._take_model,
    types.Contour: lambda line, message: insort(line.contours, message, key=_rank),
    types.Probe: lambda line, message: insort(line.probes, message, key=_rank),
    types.GraspContacts: lambda line, message: insort(line.grasps, message, key=_rank),
    types.SpaceMap: lambda line, message: line.spaces.__setitem__(message.number, message),
    types.Score: lambda line, message: line.scores.__setitem__(message.number, message),
    types.PlanEstimate: lambda line, message: line.estimates.__setitem__(message.number, message),
    types.Truth: Timeline._take_truth,
    types.World: lambda line, message: setattr(line, "world", message),
    types.PlanDone: lambda line, message: setattr(line, "done", message),
}
TYPES_DRAWN = frozenset(kind.__name__ for kind in _TAKEN)  # names of types


def read_timeline(run: Path) -> Timeline:
    """The timeline of a run, from its directory or its recording.

    Raises InputError if there is no recording, or it is damaged or of another version.
    """
    source = open_decoded(run)
    kinds = source.recording.types
    topics = [topic for topic in source.topics if kinds[topic][0] in TYPES_DRAWN]
    line = Timeline()
    for decoded in source.published(topics):
        line.add(decoded.message)
    return line


def curve_of(line: Timeline) -> tuple[Ints, Floats, Floats, Floats]:
    """Number, robot time [s], rms error [m] and bound [m] of each model with either of the two.

    NaN where an error or a bound is unknown.
    """
    numbers = sorted(line.scores.keys() | line.estimates.keys())
    rows = []
    for number in numbers:
        score, estimate = line.scores.get(number), line.estimates.get(number)
        judged = score or estimate
        assert judged is not None
        bound = estimate.rms_bound_95 if estimate is not None else None
        rms = np.nan if score is None else score.rms
        rows.append((judged.robot_time, rms, np.nan if bound is None else bound))
    times, errors, bounds = np.array(rows).reshape(-1, 3).T
    return np.array(numbers, np.int64), times, errors, bounds
