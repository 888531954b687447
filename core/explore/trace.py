"""Tracing one contour, touch by touch: the state and its one step.

The state is a value. What was felt since the last accepted arc is kept in it, and the routine
that is under way is resumed over that (see `routine`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.explore.aim import UPRIGHT, Aim, Stance
from palpate.core.explore.begin import begin
from palpate.core.explore.felt import Felt
from palpate.core.explore.march import JOINED, Course, Path, Stride, course_at_end, extend
from palpate.core.explore.routine import resume
from palpate.core.touch.pad import Pad

Status = Literal["closed", "no_contact", "no_arc", "stuck", "overrun", "out_of_touches"]

AROUND = math.radians(260.0)
"""A loop can only close after winding this far about its own middle."""
OVERRUN = math.radians(420.0)
"""Winding this far without closing is going in circles."""
CLOSED = 1.0e-3
"""The loop is closed when the new arc passes the start at this distance, m."""
LEAST_POINTS = 10


@dataclass(frozen=True, slots=True, eq=False)
class Slice:
    """What is to be traced."""

    height: float
    """Height of the slice in the slicing frame, m."""
    centre: Floats
    """Where the object's axis is expected, (2,), m."""
    radius: float
    """Distance from which the pad approaches, m."""
    most_touches: int
    """Touches after which tracing gives up."""


@dataclass(frozen=True, slots=True, eq=False)
class Trace:
    """A contour under way."""

    slice: Slice
    """What is traced."""
    path: Path | None = None
    """Points so far; None until the first arc."""
    course: Course | None = None
    """Where the path is going at its end; None until the first arc."""
    stance: Stance = UPRIGHT
    """How the pad is held."""
    felt: tuple[Felt | None, ...] = ()
    """What was felt since the last accepted arc."""
    touches: int = 0
    """Touches made."""
    gaps: tuple[float, ...] = field(default=())
    """Gaps in the path, m."""


def next_aim(pad: Pad, trace: Trace) -> tuple[Trace, Aim | Status]:
    """Where to touch next, or how tracing has ended.

    Call it once at the start, then with the trace that `after_touch` gives.
    """
    found: Aim | Status | None = None
    while found is None:
        if trace.path is None or trace.course is None:
            trace, found = _begin(trace)
        else:
            trace, found = _march(pad, trace, trace.path, trace.course)
    if isinstance(found, Aim) and trace.touches >= trace.slice.most_touches:
        return trace, "out_of_touches"
    return trace, found


def after_touch(trace: Trace, felt: Felt | None) -> Trace:
    """The trace, knowing what the last touch felt; None for a miss."""
    return replace(trace, felt=(*trace.felt, felt), touches=trace.touches + 1)


def _begin(trace: Trace) -> tuple[Trace, Aim | Status | None]:
    """Go on looking for the first arc."""
    wanted = trace.slice
    start = resume(lambda: begin(wanted.centre, wanted.radius, wanted.height), trace.felt)
    if isinstance(start, Aim):
        return trace, start
    felt, heading, stance, contact = start.result
    if felt is None:
        return trace, "no_arc" if contact else "no_contact"
    path = Path(felt.points, felt.normals, felt.across)
    course = course_at_end(path, heading)
    return replace(trace, path=path, course=course, stance=stance, felt=()), None


def _march(pad: Pad, trace: Trace, path: Path, course: Course) -> tuple[Trace, Aim | Status | None]:
    """Go on looking for the next arc."""
    stride = resume(lambda: extend(pad, path, course, trace.stance, trace.slice.height), trace.felt)
    if isinstance(stride, Aim):
        return trace, stride
    if stride.result is None:
        return trace, "stuck"
    return _with_stride(trace, path, stride.result)


def _with_stride(trace: Trace, path: Path, stride: Stride) -> tuple[Trace, Status | None]:
    """The trace with one more arc, and whether that has ended it."""
    ahead = np.concatenate([path.points[-1:], stride.new.points])
    gaps = _gaps(ahead)
    winding = _winding(path)
    if winding > AROUND:
        closing = _closing_point(ahead, path.points[0])
        if closing is not None:
            last = path.joined(stride.new.part(slice(0, closing)))
            ending = _gaps(np.concatenate([last.points[-1:], last.points[:1]]))
            closed = replace(
                trace, path=last, gaps=trace.gaps + _gaps(ahead[: closing + 1]) + ending
            )
            return closed, "closed"
    if winding > OVERRUN:
        return trace, "overrun"
    longer = path.joined(stride.new)
    return replace(
        trace,
        path=longer,
        course=course_at_end(longer, stride.heading),
        stance=stride.stance,
        felt=(),
        gaps=trace.gaps + gaps,
    ), None


def _gaps(points: Floats) -> tuple[float, ...]:
    lengths = np.linalg.norm(np.diff(points, axis=0), axis=1)
    return tuple(lengths[lengths > JOINED].tolist())


def _winding(path: Path) -> float:
    """Angle swept about the path's own middle, rad."""
    if len(path.points) <= LEAST_POINTS:
        return 0.0
    away = path.points[:, :2] - path.points[:, :2].mean(axis=0)
    angle = np.unwrap(np.arctan2(away[:, 1], away[:, 0]))
    return float(angle[-1] - angle[0])


def _closing_point(ahead: Floats, start: Floats) -> int | None:
    """How many of the new points come before the start; None if the start is not passed."""
    ways = np.diff(ahead[:, :2], axis=0)
    to_start = start[:2] - ahead[:-1, :2]
    share = np.einsum("ni,ni->n", to_start, ways) / np.maximum(
        np.einsum("ni,ni->n", ways, ways), 1e-30
    )
    nearest = ahead[:-1, :2] + np.clip(share, 0.0, 1.0)[:, None] * ways
    distance = np.linalg.norm(nearest - start[:2], axis=1)
    closest = int(distance.argmin())
    return closest if distance[closest] < CLOSED else None
