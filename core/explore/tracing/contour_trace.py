"""Tracing one contour, touch by touch: the state and its one step.

The state is a value. What was touched since the last accepted arc is kept in it, and the
procedure that is under way is resumed over that (see `commands`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.explore.tracing.contour_path import (
    UPRIGHT,
    Gap,
    Heading,
    Path,
    Posture,
    Procedure,
    SliceArc,
    SliceSpec,
    TouchCommand,
    heading_at_end,
    path_of,
    resume,
    winding,
)
from palpate.core.explore.tracing.following import Stride, follow, probe_gaps, reacquire
from palpate.core.explore.tracing.search import FirstArc, NoArc, search_first_arc
from palpate.core.touch import Pad

# How tracing ended: the loop is whole; it has gaps, or the pad is held off all of it; the object
# ends below the slice; there is no way on; it goes in circles; the touches are spent; nothing was
# touched.
TraceStatus = Literal["closed", "occluded", "pole", "stuck", "overrun", "budget", "no_contact"]
AROUND = math.radians(260.0)  # A loop can only close after winding this far about its own middle
OVERRUN = math.radians(420.0)  # Winding this far without closing is going in circles
# The loop is closed when the new arc passes the start at this distance, in widths of the pad.
CLOSED = 1.0 / 15.0
VERTICAL = 0.97  # A surface whose normals are steeper than this has left the slice, or nearly


# A path that is no longer than this, in widths of the pad, after so many touches goes round a pole
# that one touch has touched.
TINY, MANY = 0.2, 30
SAME = 0.75  # A touch has met a point's column again where it has met one this near, in pitches
MOST_REACQUISITIONS = 4  # Stretches that cannot be followed, on one contour


@dataclass(frozen=True, slots=True, eq=False)
class TraceGoal:
    """What is to be traced."""

    height: float  # Height of the slice in the slicing frame, m
    centre: Floats  # Where the object's axis is expected, (2,), m
    radius: float  # Distance from which the pad approaches, m
    most_touches: int  # Touches after which tracing gives up


@dataclass(frozen=True, slots=True, eq=False)
class Trace:
    """A contour under way."""

    slice: TraceGoal  # What is traced
    path: Path | None = None  # Points so far; None until the first arc
    end_heading: Heading | None = (
        None  # Where the path is going at its end; None until the first arc
    )
    posture: Posture = UPRIGHT  # How the pad is held
    arcs_since: tuple[SliceArc | None, ...] = ()  # What was touched since the last accepted arc
    touches: int = 0  # Touches made
    gaps: tuple[Gap, ...] = ()  # Stretches that could not be touched, in the direction of travel
    reacquisitions: int = 0  # Stretches that could not be followed


def next_command(pad: Pad, trace: Trace) -> tuple[Trace, TouchCommand | TraceStatus]:
    """Where to touch next, or how tracing has ended.

    Call it once at the start, then with the trace that `after_touch` gives.
    """
    spec = SliceSpec(pad, trace.slice.height)
    found: TouchCommand | TraceStatus | None = None
    while found is None:
        if trace.path is None or trace.end_heading is None:
            trace, found = _go_on_searching(spec, trace)
        else:
            trace, found = _go_on_following(spec, trace, trace.path, trace.end_heading)
    if isinstance(found, TouchCommand):
        return trace, "budget" if trace.touches >= trace.slice.most_touches else found
    return trace, _final_status(trace, found)


def after_touch(trace: Trace, arc: SliceArc | None) -> Trace:
    """The trace, knowing what the last touch touched; None for a miss."""
    return replace(trace, arcs_since=(*trace.arcs_since, arc), touches=trace.touches + 1)


def _go_on_searching(
    spec: SliceSpec, trace: Trace
) -> tuple[Trace, TouchCommand | TraceStatus | None]:
    """Go on looking for the first arc."""
    wanted = trace.slice
    start = resume(lambda: _first(spec, wanted), trace.arcs_since)
    if isinstance(start, TouchCommand):
        return trace, start
    if not isinstance(start.result, Stride):
        return trace, start.result
    path, heading, posture, gaps, _ = start.result
    path = _touched_again(spec, path, trace.arcs_since)
    end_heading = heading_at_end(path, heading, spec.width)
    return replace(
        trace, path=path, end_heading=end_heading, posture=posture, gaps=gaps, arcs_since=()
    ), None


def _first(spec: SliceSpec, wanted: TraceGoal) -> Procedure[Stride | NoArc]:
    """The first arc, its gaps probed."""
    start = yield from search_first_arc(spec, wanted.centre, wanted.radius)
    if not isinstance(start, FirstArc):
        return start
    path, gaps = yield from probe_gaps(spec, path_of(start.arc), start.posture)
    return Stride(path, start.heading, start.posture, gaps)


def _go_on_following(
    spec: SliceSpec, trace: Trace, path: Path, end_heading: Heading
) -> tuple[Trace, TouchCommand | TraceStatus | None]:
    """Go on looking for the next arc."""
    stride = resume(lambda: _onwards(spec, trace, path, end_heading), trace.arcs_since)
    if isinstance(stride, TouchCommand):
        return trace, stride
    if stride.result is None:
        return trace, "stuck"
    return _with_stride(spec, trace, path, stride.result)


def _onwards(
    spec: SliceSpec, trace: Trace, path: Path, end_heading: Heading
) -> Procedure[Stride | None]:
    """The next arc: along the contour, or beyond what cannot be followed."""
    stride = yield from follow(spec, path, end_heading, trace.posture)
    if stride is None and trace.reacquisitions < MOST_REACQUISITIONS:
        stride = yield from reacquire(spec, path, trace.slice.centre, trace.slice.radius)
        return None if stride is None else stride._replace(reacquired=True)
    return stride


def _with_stride(
    spec: SliceSpec, trace: Trace, path: Path, stride: Stride
) -> tuple[Trace, TraceStatus | None]:
    """The trace with one more arc, and whether that has ended it."""
    longer = _touched_again(spec, path.joined(stride.new), trace.arcs_since)
    swept = winding(longer.points)
    if swept > AROUND:
        closing = _closing_point(spec, path, stride.new)
        if closing is not None:
            last = longer.part(slice(0, len(path.points) + closing))
            gaps = _gaps_up_to(stride, closing, path.points[0])
            trace = replace(trace, path=last, gaps=trace.gaps + gaps)
            return trace, "closed"
    if swept > OVERRUN:
        return trace, "overrun"
    if trace.touches > MANY and np.ptp(longer.points, axis=0).max() < TINY * spec.width:
        return trace, "pole"
    return replace(
        trace,
        path=longer,
        end_heading=heading_at_end(longer, stride.heading, spec.width),
        posture=stride.posture,
        arcs_since=(),
        gaps=trace.gaps + stride.gaps,
        reacquisitions=trace.reacquisitions + stride.reacquired,
    ), None


def _touched_again(spec: SliceSpec, path: Path, arcs: Sequence[SliceArc | None]) -> Path:
    """The path, its bands as wide as all of these touches have touched."""
    for one in arcs:
        path = path if one is None else path.with_bands_of(one, SAME * spec.pad.pitch)
    return path


def _closing_point(spec: SliceSpec, path: Path, new: Path) -> int | None:
    """How many of the new points come before the start; None if the start is not passed."""
    ahead, start = np.concatenate([path.points[-1:], new.points]), path.points[0]
    ways = np.diff(ahead[:, :2], axis=0)
    to_start = start[:2] - ahead[:-1, :2]
    share = np.einsum("ni,ni->n", to_start, ways) / np.maximum(
        np.einsum("ni,ni->n", ways, ways), 1e-30
    )
    nearest = ahead[:-1, :2] + np.clip(share, 0.0, 1.0)[:, None] * ways
    distance = np.linalg.norm(nearest - start[:2], axis=1)
    closest = int(distance.argmin())
    return closest if distance[closest] < CLOSED * spec.width else None


def _gaps_up_to(stride: Stride, closing: int, start: Floats) -> tuple[Gap, ...]:
    """A closing stride's gaps; the one that the start lies in ends there."""
    order = {point.tobytes(): number for number, point in enumerate(stride.new.points)}
    gaps = [(order[gap.end.tobytes()], gap) for gap in stride.gaps]
    before = [gap for number, gap in gaps if number < closing]
    return (*before, *(gap._replace(end=start) for number, gap in gaps if number == closing))


def _final_status(trace: Trace, status: TraceStatus) -> TraceStatus:
    """The status, knowing what was touched."""
    if status == "closed":
        return "occluded" if trace.gaps else "closed"
    if status in ("stuck", "overrun") and trace.path is not None:
        steep = float(np.median(np.abs(trace.path.normals[:, 2])))
        return "pole" if steep > VERTICAL else status
    return status
