"""Tracing one contour, touch by touch: the state and its step, and how the contour is followed.

The state is a value. It keeps the arcs touched since the last accepted one, over which the current
procedure is resumed. A procedure follows the contour to the next arc: straight ahead, around a
corner, over a gap, or from outside where the contour cannot be followed.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Literal, NamedTuple

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.explore.tracing.contour_path import (
    UPRIGHT,
    Gap,
    Heading,
    HeadingSettings,
    Path,
    Posture,
    Procedure,
    SliceArc,
    SliceSpec,
    TouchCommand,
    TouchSettings,
    heading_at_end,
    path_of,
    resume,
    travel_direction,
    winding,
)
from palpate.core.explore.tracing.gaps import GapSettings, probe_gaps
from palpate.core.explore.tracing.search import (
    FirstArc,
    NoArc,
    SearchSettings,
    Target,
    approach_from,
    search_arc,
    search_first_arc,
)
from palpate.core.touch import Pad

MAX_ROUNDING = 1e-9  # [approaches] excess over a whole number that is rounded down
# How tracing ended: "closed", the loop is whole; "occluded", it has gaps, or the pad is held off
# everywhere; "pole", the object ends below the slice; "stuck", there is no way on; "overrun", it
# goes in circles; "budget", the touches are spent; "no_contact", nothing was touched.
TraceStatus = Literal["closed", "occluded", "pole", "stuck", "overrun", "budget", "no_contact"]


@dataclass(frozen=True, slots=True, kw_only=True)
class ClosingSettings:
    """When a contour is closed, goes in circles, or goes round a pole."""

    min_winding: float = math.radians(260.0)  # [rad] about its own middle, for a loop to close
    max_winding: float = math.radians(420.0)  # [rad] beyond it an open contour goes in circles
    max_distance: float = 1.0 / 15.0  # [widths of the pad] of the new arc from the start
    min_steepness: float = 0.97  # median |z| of the path's normals, above which it lies on a pole
    pole_touches: int = 30  # after which a path within `pole_extent` is one around a pole
    pole_extent: float = 0.2  # [widths of the pad] largest side of such a path


@dataclass(frozen=True, slots=True, kw_only=True)
class FollowSettings:
    """How far the pad steps along a contour, and what it does where nothing lies ahead."""

    pad_step: float = 0.69  # [half widths of the pad] longest step
    contact_step: float = 1.05  # [half widths of the contact] longest step
    # [`SliceSpec.max_spacing`] added to half the first arc of a kept posture: its longest step.
    kept_step: float = 0.5
    min_bulge: float = 0.015  # [1 / widths of the pad] least sum of contour's and pad's curvature
    standoff: float = 0.2  # [widths of the pad] of a plain step
    min_ahead: float = 0.25 / 15.0  # [widths of the pad] of a new point from the path's end
    min_progress: float = 0.6 / 15.0  # [widths of the pad] of the farthest point from that end
    sharp_turn: float = 0.2  # [rad] beyond it, progress is measured along the new heading
    band_radius: float = 0.75  # [pitches] from a point, in which other touches widen its band
    max_reacquisitions: int = 4  # of one contour, beyond stretches that cannot be followed
    reacquire_step: float = math.radians(30.0)  # [rad] between approaches, at most


@dataclass(frozen=True, slots=True, kw_only=True)
class TracingSettings:
    """How a contour is traced."""

    touch: TouchSettings = field(default_factory=TouchSettings)
    search: SearchSettings = field(default_factory=SearchSettings)
    heading: HeadingSettings = field(default_factory=HeadingSettings)
    follow: FollowSettings = field(default_factory=FollowSettings)
    gaps: GapSettings = field(default_factory=GapSettings)
    closing: ClosingSettings = field(default_factory=ClosingSettings)


@dataclass(frozen=True, slots=True, eq=False)
class TraceGoal:
    """What is to be traced."""

    height: float  # [m] of the slice in the slicing frame
    centre: Floats  # (2,) [m] where the object's axis is expected
    radius: float  # [m] distance from which the pad approaches
    most_touches: int  # after which tracing gives up
    gap: float = 0.0  # [m] of the contour that may stay untouched between two touches


@dataclass(frozen=True, slots=True, eq=False)
class Trace:
    """A contour that is being traced."""

    goal: TraceGoal
    path: Path | None = None  # points so far; None until the first arc
    end_heading: Heading | None = None  # at the path's end; None until the first arc
    posture: Posture = UPRIGHT
    arcs_since: tuple[SliceArc | None, ...] = ()  # touched since the last accepted arc
    touches: int = 0  # made so far
    gaps: tuple[Gap, ...] = ()  # that could not be touched, in the direction of travel
    reacquisitions: int = 0  # stretches that could not be followed


def next_command(
    pad: Pad, trace: Trace, settings: TracingSettings = TracingSettings()
) -> tuple[Trace, TouchCommand | TraceStatus]:
    """Where to touch next, or how tracing ended: called first, then after each `after_touch`."""
    spec = SliceSpec(pad, trace.goal.height, trace.goal.gap, settings.touch)
    step: TouchCommand | TraceStatus | None = None
    while step is None:
        if trace.path is None or trace.end_heading is None:
            trace, step = _continue_search(spec, trace, settings)
        else:
            trace, step = _continue_following(spec, trace, trace.path, trace.end_heading, settings)
    if isinstance(step, TouchCommand):
        return trace, "budget" if trace.touches >= trace.goal.most_touches else step
    return trace, _final_status(trace, step, settings.closing)


def _continue_search(
    spec: SliceSpec, trace: Trace, settings: TracingSettings
) -> tuple[Trace, TouchCommand | TraceStatus | None]:
    """The search for the first arc, resumed."""
    goal = trace.goal
    start = resume(lambda: _first_stride(spec, goal, settings), trace.arcs_since)
    if isinstance(start, TouchCommand):
        return trace, start
    if not isinstance(start.result, Stride):
        return trace, start.result
    path, heading, posture, gaps, _ = start.result
    path = _with_bands_of_all(spec, path, trace.arcs_since, settings.follow)
    end = heading_at_end(path, heading, spec.width, settings.heading)
    trace = replace(trace, path=path, end_heading=end, posture=posture, gaps=gaps, arcs_since=())
    return trace, None


def _first_stride(
    spec: SliceSpec, goal: TraceGoal, settings: TracingSettings
) -> Procedure[Stride | NoArc]:
    """The first arc, its gaps probed."""
    start = yield from search_first_arc(spec, goal.centre, goal.radius, settings.search)
    if not isinstance(start, FirstArc):
        return start
    path, gaps = yield from probe_gaps(
        spec, path_of(start.arc), start.posture, settings.gaps, settings.search
    )
    return Stride(path, start.heading, start.posture, gaps)


def _continue_following(
    spec: SliceSpec, trace: Trace, path: Path, end_heading: Heading, settings: TracingSettings
) -> tuple[Trace, TouchCommand | TraceStatus | None]:
    """The search for the next arc, resumed."""
    stride = resume(
        lambda: _next_stride(spec, trace, path, end_heading, settings), trace.arcs_since
    )
    if isinstance(stride, TouchCommand):
        return trace, stride
    if stride.result is None:
        return trace, "stuck"
    return _with_stride(spec, trace, path, stride.result, settings)


def _next_stride(
    spec: SliceSpec, trace: Trace, path: Path, end_heading: Heading, settings: TracingSettings
) -> Procedure[Stride | None]:
    """The next arc: along the contour, or beyond what cannot be followed."""
    stride = yield from follow(spec, path, end_heading, trace.posture, settings)
    if stride is None and trace.reacquisitions < settings.follow.max_reacquisitions:
        goal = trace.goal
        return (yield from reacquire(spec, path, goal.centre, goal.radius, settings))
    return stride


def follow(
    spec: SliceSpec,
    path: Path,
    end_heading: Heading,
    posture: Posture,
    settings: TracingSettings = TracingSettings(),
) -> Procedure[Stride | None]:
    """One more arc of the contour, or None if there is no way on.

    The plain step comes first. If it touches nothing ahead, other attempts march around the corner;
    if it meets an arc beyond a gap, another heading is tried, and last of all the gap is probed.
    """
    plain = _plain_step(spec, end_heading, posture, settings.follow)
    attempts = deque([plain])
    nearest: Stride | None = None
    while attempts:
        attempt = attempts.popleft()
        target = _target(spec, path, end_heading, attempt, settings.follow)
        arc, posture = yield from search_arc(spec, posture, target, settings.search)
        new = None
        if arc is not None:
            new = _new_points(spec, path, end_heading, arc, attempt, settings.follow)
        if attempt is plain:
            # A kept posture is not turned into a hollow.
            over_gap = () if posture.is_kept else OVER_A_GAP
            attempts.extend(AROUND_A_CORNER if new is None else over_gap)
        if new is None:
            continue
        stride = Stride(new, end_heading.normal_azimuth + attempt.turn, posture)
        if nearest is None or _gap(path, stride) < _gap(path, nearest):
            nearest = stride
        if _gap(path, stride) <= spec.max_spacing or attempt.standoff is not None:
            break
    if nearest is None:
        return None
    return (yield from with_gaps_probed(spec, path, nearest, settings))


def _plain_step(
    spec: SliceSpec, end_heading: Heading, posture: Posture, settings: FollowSettings
) -> Attempt:
    """As far ahead as the new arc still joins the old one."""
    bulge = max(end_heading.curvature + spec.pad.dome, settings.min_bulge / spec.width)
    contact = math.sqrt(2.0 * posture.depth / bulge)
    distance = min(
        settings.pad_step * 0.5 * spec.width,
        settings.contact_step * contact,
        posture.half_contact + settings.kept_step * spec.max_spacing,
    )
    distance += spec.gap
    return Attempt(distance / spec.width, end_heading.curvature * distance)


def _target(
    spec: SliceSpec, path: Path, end_heading: Heading, attempt: Attempt, settings: FollowSettings
) -> Target:
    """Where an attempt looks for the contour; a hop is straight, a plain step or turn bends."""
    outward = np.array([end_heading.tangent[1], -end_heading.tangent[0]])
    bend = end_heading.curvature if attempt.standoff is None else 0.0
    distance = attempt.distance * spec.width
    place = (
        path.points[-1, :2] + distance * end_heading.tangent - 0.5 * bend * distance**2 * outward
    )
    standoff = (settings.standoff if attempt.standoff is None else attempt.standoff) * spec.width
    return Target(place, end_heading.normal_azimuth + attempt.turn, standoff, standoff)


def _new_points(
    spec: SliceSpec,
    path: Path,
    end_heading: Heading,
    arc: SliceArc,
    attempt: Attempt,
    settings: FollowSettings,
) -> Path | None:
    """The part of a touched arc that lies ahead of the path's end, if there is enough of it."""
    forward = end_heading.tangent
    if abs(attempt.turn) > settings.sharp_turn:
        forward = travel_direction(end_heading.normal_azimuth + attempt.turn)
    ahead = (arc.points[:, :2] - path.points[-1, :2]) @ forward
    is_new = ahead > settings.min_ahead * spec.width
    if not is_new.any() or ahead.max() <= settings.min_progress * spec.width:
        return None
    return path_of(arc).part(is_new)


def _gap(path: Path, stride: Stride) -> float:
    """Distance from the path's end to a stride [m]."""
    return float(np.linalg.norm(stride.new.points[0] - path.points[-1]))


def reacquire(
    spec: SliceSpec,
    path: Path,
    centre: Floats,
    radius: float,
    settings: TracingSettings = TracingSettings(),
) -> Procedure[Stride | None]:
    """The contour met again beyond a stretch that cannot be followed, or None.

    Approaches come from ever farther round, the last from where the contour began; then the stretch
    between is probed like any gap. `centre` (2,), `radius`: as of `approach_from` [m].
    """
    first, last = path.points[0, :2] - centre, path.points[-1, :2] - centre
    start = math.atan2(last[1], last[0])
    remaining = (math.atan2(first[1], first[0]) - start) % (2.0 * math.pi)
    n_steps = remaining / settings.follow.reacquire_step
    n_approaches = max(math.ceil(n_steps - MAX_ROUNDING), 1)
    for number in range(1, n_approaches + 1):
        azimuth = start + remaining * number / n_approaches
        met = yield from approach_from(spec, centre, radius, azimuth, settings.search)
        if isinstance(met, FirstArc):
            new = path_of(met.arc)
            stride = Stride(new, met.heading, met.posture, is_reacquired=True)
            return (yield from with_gaps_probed(spec, path, stride, settings))
    return None


def with_gaps_probed(
    spec: SliceSpec, path: Path, stride: Stride, settings: TracingSettings = TracingSettings()
) -> Procedure[Stride]:
    """A stride of which every gap has been probed."""
    chain = path.part(slice(-1, None)).followed_by(stride.new)
    chain, gaps = yield from probe_gaps(spec, chain, stride.posture, settings.gaps, settings.search)
    return stride._replace(new=chain.part(slice(1, None)), gaps=gaps)


def _with_stride(
    spec: SliceSpec, trace: Trace, path: Path, stride: Stride, settings: TracingSettings
) -> tuple[Trace, TraceStatus | None]:
    """The trace with one more arc, and whether that has ended it."""
    closing, follow_settings = settings.closing, settings.follow
    longer = path.followed_by(stride.new)
    longer = _with_bands_of_all(spec, longer, trace.arcs_since, follow_settings)
    swept = winding(longer.points)
    if swept > closing.min_winding:
        n_before = _points_before_start(spec, path, stride.new, closing)
        if n_before is not None:
            last = longer.part(slice(0, len(path.points) + n_before))
            gaps = _gaps_up_to(stride, n_before, path.points[0])
            return replace(trace, path=last, gaps=trace.gaps + gaps), "closed"
    if swept > closing.max_winding:
        return trace, "overrun"
    extent = np.ptp(longer.points, axis=0).max()
    if trace.touches > closing.pole_touches and extent < closing.pole_extent * spec.width:
        return trace, "pole"
    return replace(
        trace,
        path=longer,
        end_heading=heading_at_end(longer, stride.heading, spec.width, settings.heading),
        posture=stride.posture,
        arcs_since=(),
        gaps=trace.gaps + stride.gaps,
        reacquisitions=trace.reacquisitions + stride.is_reacquired,
    ), None


def _with_bands_of_all(
    spec: SliceSpec, path: Path, arcs: Sequence[SliceArc | None], settings: FollowSettings
) -> Path:
    """The path, its bands widened by what each of these arcs has touched."""
    for arc in arcs:
        if arc is not None:
            path = path.with_bands_of(arc, settings.band_radius * spec.pad.pitch)
    return path


def _points_before_start(
    spec: SliceSpec, path: Path, new: Path, settings: ClosingSettings
) -> int | None:
    """How many of the new points come before the start; None if the start is not passed."""
    ahead, start = np.concatenate([path.points[-1:], new.points]), path.points[0]
    steps = np.diff(ahead[:, :2], axis=0)
    to_start = start[:2] - ahead[:-1, :2]
    squares = np.maximum(np.einsum("ni,ni->n", steps, steps), 1e-30)  # never divided by 0
    share = np.einsum("ni,ni->n", to_start, steps) / squares  # of each step, nearest to the start
    nearest = ahead[:-1, :2] + np.clip(share, 0.0, 1.0)[:, None] * steps
    distance = np.linalg.norm(nearest - start[:2], axis=1)
    closest = int(distance.argmin())
    return closest if distance[closest] < settings.max_distance * spec.width else None


def _gaps_up_to(stride: Stride, n_before: int, start: Floats) -> tuple[Gap, ...]:
    """Gaps of a closing stride; the one in which the start lies ends there."""
    order = {point.tobytes(): number for number, point in enumerate(stride.new.points)}
    gaps = [(order[gap.end.tobytes()], gap) for gap in stride.gaps]
    before = [gap for number, gap in gaps if number < n_before]
    return (*before, *(gap._replace(end=start) for number, gap in gaps if number == n_before))


def _final_status(trace: Trace, status: TraceStatus, settings: ClosingSettings) -> TraceStatus:
    """The status, knowing what was touched."""
    if status == "closed":
        return "occluded" if trace.gaps else "closed"
    if status in ("stuck", "overrun") and trace.path is not None:
        vertical = float(np.median(np.abs(trace.path.normals[:, 2])))
        return "pole" if vertical > settings.min_steepness else status
    return status


def after_touch(trace: Trace, arc: SliceArc | None) -> Trace:
    """The trace after a touch of an arc; None for a miss."""
    return replace(trace, arcs_since=(*trace.arcs_since, arc), touches=trace.touches + 1)


class Stride(NamedTuple):
    """A continuation of the path."""

    new: Path  # points ahead of the path's end
    heading: float  # [rad] azimuth of the outward normal with which they were touched
    posture: Posture
    gaps: tuple[Gap, ...] = ()  # from the path's end on, that could not be touched
    is_reacquired: bool = False  # whether the contour was lost and met again from outside


class Attempt(NamedTuple):
    """A touch that may continue the path from its end."""

    distance: float  # [widths of the pad] ahead
    turn: float  # [rad] of the heading
    standoff: float | None = None  # [widths of the pad] of a hop; None: that of a plain step


# Convex turns on the spot, concave ones, then hops ahead from farther away.
AROUND_A_CORNER = tuple(
    [Attempt(0.0, math.radians(turn)) for turn in (50, 25, 75, 100, -25, -50)]
    + [Attempt(4 / 15, 0.0, 8 / 15), Attempt(8 / 15, 0.0, 10 / 15)]
    + [Attempt(8 / 15, math.radians(30), 10 / 15), Attempt(12 / 15, 0.0, 12 / 15)]
)
# One turn on the spot, into the hollow that the pad may have bridged; more turns find less than
# they cost, for the gap's middle is probed in any case.
OVER_A_GAP = (Attempt(0.0, math.radians(-25)),)
