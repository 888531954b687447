"""What a graph has done, in robot time: touches, contours, models, and how good they were.

Fed with messages in any order, from a recording or from a graph that still runs; whoever draws asks
what there was at a time.
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
    TAXEL_RADIUS,
    Drawable,
    Finger,
    Known,
    Lines,
    Points,
    drawables,
)
from palpate.tools.surfaces import TruthSurface

TRACED = ("closed", "occluded")  # How a contour ends that is of use
MOST_POINTS = 48  # Of one touch that are drawn, spread over its taxels


class Touch(NamedTuple):
    """One touch, as far as it is drawn."""

    time: float  # Robot time at its end, s
    goal: int  # Number of its contour or probe
    number: int  # Within the goal
    finger: int
    pose: Floats  # Of the pad, (7,)
    outcome: str  # Of the guarded move, as of a SurfacePatch
    kind: str  # Of the surface, as of a SurfacePatch
    points: Floats  # Touched taxels, world frame (n, 3), at most `MOST_POINTS`
    normal: Floats  # (3,)
    residual: float  # Of the local fit, m
    compression: Floats  # Under each taxel (rows, cols), m; (0, 0) where no image was published
    force: float  # On all taxels together, N; NaN where it cannot be told

    def touched(self) -> Points:
        """The points as they are drawn."""
        return Points(self.points, TAXEL_RADIUS, self.normal)

    def placed(self, pad: Pad | None) -> Drawable:
        """The finger as it is drawn."""
        return Drawable(f"finger/{self.finger}", Finger(self.finger, self.pose, pad), self.time)


class Moment(NamedTuple):
    """What there is at a robot time, as lengths of the timeline's lists."""

    touches: int
    grasps: int
    contours: int
    models: int


@dataclass(slots=True)
class Timeline:
    """All that was received, each kind in the order of robot time."""

    touches: list[Touch] = field(default_factory=list)
    contours: list[types.Contour] = field(default_factory=list)
    probes: list[types.Probe] = field(default_factory=list)
    grasps: list[types.GraspContacts] = field(default_factory=list)
    models: list[types.ShapeModel] = field(default_factory=list)  # Those that have triangles
    spaces: dict[int, types.SpaceMap] = field(default_factory=dict)  # By number of the model
    scores: dict[int, types.Score] = field(default_factory=dict)
    estimates: dict[int, types.PlanEstimate] = field(default_factory=dict)
    truth: types.Truth | None = None
    world: types.World | None = None
    done: types.PlanDone | None = None
    known: Known = field(default_factory=Known)  # Sensor and true surface
    deepest: float = 0.0  # Largest compression of a taxel, m
    # Each message, and what is drawn of it, by its identity
    _drawables: dict[int, tuple[Any, list[Drawable]]] = field(default_factory=dict)
    _images: dict[tuple[int, int, int], Floats] = field(default_factory=dict)
    _blind: dict[tuple[int, int, int], Touch] = field(default_factory=dict)  # Without an image yet
    # Before the sensor was known, or how the object lay
    _early: list[types.SurfacePatch] = field(default_factory=list)

    def add(self, message: Any) -> None:
        """Take a message; types that nobody draws are passed over."""
        self.known.take(message)
        take = _TAKEN.get(type(message))
        if take is not None:
            take(self, message)

    @property
    def end(self) -> float:
        """Robot time of the last that happened, s."""
        lasts = (self.touches, self.contours, self.models, self.grasps)
        return max((_time(one[-1]) for one in lasts if one), default=0.0)

    def at(self, time: float) -> Moment:
        """What there was at a robot time."""
        kinds = (self.touches, self.grasps, self.contours, self.models)
        return Moment(*(bisect_right(some, time, key=_time) for some in kinds))

    def traced(self, moment: Moment) -> int:
        """How many contours were of use by then: those that gave up are drawn, but not counted."""
        return sum(one.status in TRACED for one in self.contours[: moment.contours])

    def space_at(self, moment: Moment) -> types.SpaceMap | None:
        """The last map of free space by then."""
        numbers = (one.number for one in reversed(self.models[: moment.models]))
        return next((self.spaces[one] for one in numbers if one in self.spaces), None)

    @property
    def surface(self) -> TruthSurface | None:
        """The true surface, to measure distances from; None where nobody knows it."""
        return self.known.surface

    def of(self, message: Any) -> list[Drawable]:
        """The drawables of a message that is kept, made once."""
        if id(message) not in self._drawables:
            self._drawables[id(message)] = message, drawables(message, self.known)
        return self._drawables[id(message)][1]

    def drawn(self, moment: Moment, layers: Collection[str] = LAYERS) -> Iterator[Drawable]:
        """What is to be seen at a moment in these layers.

        A solid stays until the next that has triangles; unknown places are seen at the end.
        """
        messages: list[Any] = [self.truth, *self.models[: moment.models][-1:]]
        if {"free", "unknown"} & {*layers}:
            messages.append(self.space_at(moment))
        if moment == self.at(np.inf):
            messages.append(self.done)
        messages += [*self.contours[: moment.contours], *self.grasps[: moment.grasps]]
        for message in messages:
            found = [] if message is None else self.of(message)
            yield from (one for one in found if one.layer in layers)
        past = self.touches[: moment.touches]
        if "contours" in layers:
            yield from growing(past, {one.id for one in self.contours[: moment.contours]})
        if "touched" in layers:
            yield from (Drawable("touched", one.touched(), one.time) for one in past)
        if "finger" in layers:
            last = {one.finger: one for one in past}.values()
            yield from (one.placed(self.known.pad) for one in last)

    def bounds(self) -> tuple[Floats, Floats]:
        """The corners, (3,) each, of the box about all that is solid; a cube without anything."""
        found = [one.points for one in self.touches if len(one.points)]
        found += [one.points for one in self.grasps if len(one.points)]
        found += [one.vertices for one in (self.truth, *self.models[-1:]) if one is not None]
        if not found:
            return np.full(3, -0.05), np.full(3, 0.05)
        return (
            np.min([one.min(axis=0) for one in found], axis=0),
            np.max([one.max(axis=0) for one in found], axis=0),
        )

    def touch_rate(self, window: float = 20.0) -> tuple[Floats, Floats]:
        """Robot times (n,), s, and touches a second (n,) over the `window` that ends there, s."""
        times = np.array([one.time for one in self.touches])
        before = np.searchsorted(times, times - window, side="right")
        return times, (np.arange(1, len(times) + 1) - before) / np.minimum(window, times + 1e-9)

    def _take_early(self) -> None:
        early, self._early = self._early, []
        for patch in early:
            self._take_patch(patch)

    def _take_truth(self, truth: types.Truth) -> None:
        self.truth = truth
        self._drawables.clear()  # models deviate from it

    def _take_image(self, image: types.TactileImage) -> None:
        pressed = np.where(image.mask, image.compression, 0.0)
        self.deepest = max(self.deepest, float(pressed.max(initial=0.0)))
        key = image.finger, image.goal, image.touch
        touch = self._blind.pop(key, None)
        if touch is None:
            self._images[key] = pressed
        else:
            place = next(i for i, one in enumerate(self.touches) if one is touch)
            self.touches[place] = self._with_image(touch, pressed)

    def _with_image(self, touch: Touch, pressed: Floats) -> Touch:
        force = float(pressed.sum()) * self.known.taxel_stiffness
        return touch._replace(compression=pressed, force=force)

    def _take_patch(self, patch: types.SurfacePatch) -> None:
        lies = self.known.lies(patch.placement)
        if self.known.pad is None or lies is None:
            self._early.append(patch)
            return
        pose, normal = patch.pose, patch.normal
        if patch.placement:  # drawn as the object lay at first
            pose = (lies.inverse() @ Pose.from_array(pose)).array
            normal = normal @ lies.axes
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
            self._blind[key] = touch
        insort(self.touches, touch, key=_rank)

    def _touched(self, patch: types.SurfacePatch) -> Floats:
        """Touched taxels (n, 3), of many some that are spread evenly [m]."""
        shapes = (one.shape for one in drawables(patch, self.known))
        points = [np.zeros((0, 3)), *(one.points for one in shapes if isinstance(one, Points))][-1]
        return points[:: max(1, -(-len(points) // MOST_POINTS))]

    def _take_model(self, model: types.ShapeModel) -> None:
        if len(model.placements):
            self._drawables.clear()  # what the hand met is drawn where the object lay
            self._take_early()
        if len(model.faces):
            insort(self.models, model, key=_rank)


def _time(one: Any) -> float:
    time: float = one.time if isinstance(one, Touch) else one.robot_time
    return time


def _rank(one: Any) -> tuple[float, int, int]:
    """What things are sorted by: what ends at the same time, by its number."""
    if isinstance(one, Touch):
        return one.time, one.goal, one.number
    return one.robot_time, one.id if hasattr(one, "id") else one.number, 0


def growing(touches: Sequence[Touch], done: set[int]) -> Iterator[Drawable]:
    """The contour that each finger traces: a line through the middles of its contacts."""
    for finger, last in {one.finger: one for one in touches}.items():
        if last.goal not in done:
            of_goal = (one for one in touches if (one.finger, one.goal) == (finger, last.goal))
            points = [one.touched().lifted() for one in of_goal if len(one.points)]
            away = (np.linalg.norm(some - some.mean(axis=0), axis=1) for some in points)
            middles = [some[np.argmin(far)] for some, far in zip(points, away, strict=True)]
            if len(middles) > 1:
                yield Drawable(f"contours/growing/{finger}", Lines((np.array(middles),)))


_TAKEN: Mapping[type, Callable[[Timeline, Any], None]] = {
    types.SensorInfo: lambda line, _: line._take_early(),
    types.TactileImage: Timeline._take_image,
    types.SurfacePatch: Timeline._take_patch,
    types.ShapeModel: Timeline._take_model,
    types.Contour: lambda line, one: insort(line.contours, one, key=_rank),
    types.Probe: lambda line, one: insort(line.probes, one, key=_rank),
    types.GraspContacts: lambda line, one: insort(line.grasps, one, key=_rank),
    types.SpaceMap: lambda line, one: line.spaces.__setitem__(one.number, one),
    types.Score: lambda line, one: line.scores.__setitem__(one.number, one),
    types.PlanEstimate: lambda line, one: line.estimates.__setitem__(one.number, one),
    types.Truth: Timeline._take_truth,
    types.World: lambda line, one: setattr(line, "world", one),
    types.PlanDone: lambda line, one: setattr(line, "done", one),
}
TYPES_DRAWN = frozenset(kind.__name__ for kind in _TAKEN)  # Names of the types that are of use


def read_timeline(run: Path) -> Timeline:
    """The timeline of a run, by its directory or its recording.

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
    """Of each judged model: number, robot time (s), true rms error and stated bound (m), or NaN."""
    numbers = sorted(line.scores.keys() | line.estimates.keys())
    rows = []
    for number in numbers:
        score, told = line.scores.get(number), line.estimates.get(number)
        known = score or told
        assert known is not None
        bound = told.rms_bound_95 if told is not None else None
        rms = np.nan if score is None else score.rms
        rows.append((known.robot_time, rms, np.nan if bound is None else bound))
    times, errors, bounds = np.array(rows).reshape(-1, 3).T
    return np.array(numbers, np.int64), times, errors, bounds
