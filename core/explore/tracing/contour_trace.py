"""Tracing one contour, touch by touch: the state and its step, and how the contour is followed.

The state is a value. What was touched since the last accepted arc is kept in it, and the procedure
under way is resumed over that. It follows the contour to one more arc ahead, around a corner, over
a gap, or meets it again from outside. A gap between touched points is probed in its middle, then
down the walls of the hollow that the pad has bridged, with an edge or a corner of it first, until
it is closed or known to stay.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.explore.tracing.contour_path import (
    DEEP_TOUCH_DEPTH,
    UPRIGHT,
    Gap,
    GapReason,
    Heading,
    Path,
    Posture,
    Procedure,
    SliceArc,
    SliceSpec,
    TouchCommand,
    heading_at_end,
    normal_azimuth,
    path_of,
    resume,
    travel_direction,
    winding,
)
from palpate.core.explore.tracing.search import (
    FirstArc,
    NoArc,
    Target,
    approach_from,
    search_arc,
    search_first_arc,
)
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
AHEAD = 0.25 / 15.0  # A new point must lie this far ahead of the last one; in widths of the pad
PROGRESS = 0.6 / 15.0  # And the farthest of them this far; in widths of the pad
PAD_STEP, CONTACT_STEP = 0.69, 1.05  # Longest step, in half widths of the pad and of the contact
# How far a kept posture may step beyond half of the arc that it touched first, in the distance of
# points that still join.
KEPT_STEP = 0.5
LEAST_BULGE = 0.015  # Of contour and pad together, in 1 / widths of the pad: nothing is flatter
STEP_STANDOFF = 0.2  # Of a plain touch, in widths of the pad
SHARP_TURN = 0.2  # Beyond this turn, progress is measured along the new heading, rad
REACQUIRE_STEP = math.radians(30.0)  # Between the directions that are tried, at most
ROUNDING = 1e-9  # Of a leap: a direction that is farther by less is not one more
# Ways of a probe before and past the gap's chord, in widths of the pad; longer gaps are probed from
# as far away as they are long.
GAP_STANDOFF, GAP_REACH = 6.0 / 15.0, 8.0 / 15.0
WITHIN = 0.25 / 15.0  # A point in the gap lies this far from both of its ends, in widths of the pad
SHORTER = 0.25  # A probe that leaves a gap shorter by less than this many pitches has not helped
STEEPEST = 1.3  # No pad is turned farther than this against the chord, rad
CORNER = 7.0 / 15.0  # Shift that leaves one row beyond the slice, at a corner; in widths of the pad
# Ways before and past the place, besides the gap's length; in widths of the pad.
WALL_STANDOFF, WALL_REACH = 9.0 / 15.0, 8.0 / 15.0


@dataclass(frozen=True, slots=True, eq=False)
class TraceGoal:
    """What is to be traced."""

    height: float  # Height of the slice in the slicing frame, m
    centre: Floats  # Where the object's axis is expected, (2,), m
    radius: float  # Distance from which the pad approaches, m
    most_touches: int  # Touches after which tracing gives up
    gap: float = 0.0  # Stretch of the contour that may stay untouched between two touches, m


@dataclass(frozen=True, slots=True, eq=False)
class Trace:
    """A contour under way."""

    slice: TraceGoal  # What is traced
    path: Path | None = None  # Points so far; None until the first arc
    end_heading: Heading | None = None  # Where the path is going at its end; None likewise
    posture: Posture = UPRIGHT  # How the pad is held
    arcs_since: tuple[SliceArc | None, ...] = ()  # What was touched since the last accepted arc
    touches: int = 0  # Touches made
    gaps: tuple[Gap, ...] = ()  # Stretches that could not be touched, in the direction of travel
    reacquisitions: int = 0  # Stretches that could not be followed


def next_command(pad: Pad, trace: Trace) -> tuple[Trace, TouchCommand | TraceStatus]:
    """Where to touch next, or how tracing ended: first, then with each `after_touch`."""
    spec = SliceSpec(pad, trace.slice.height, trace.slice.gap)
    found: TouchCommand | TraceStatus | None = None
    while found is None:
        if trace.path is None or trace.end_heading is None:
            trace, found = _go_on_searching(spec, trace)
        else:
            trace, found = _go_on_following(spec, trace, trace.path, trace.end_heading)
    if isinstance(found, TouchCommand):
        return trace, "budget" if trace.touches >= trace.slice.most_touches else found
    return trace, _final_status(trace, found)


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
    end = heading_at_end(path, heading, spec.width)
    trace = replace(trace, path=path, end_heading=end, posture=posture, gaps=gaps, arcs_since=())
    return trace, None


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
        return (yield from reacquire(spec, path, trace.slice.centre, trace.slice.radius))
    return stride


def follow(
    spec: SliceSpec, path: Path, end_heading: Heading, posture: Posture
) -> Procedure[Stride | None]:
    """One more arc of the contour, or None if there is no way on.

    The plain step comes first. If it touches nothing ahead, the corner is marched around; if it
    meets an arc beyond a gap, other headings are tried, and last of all the gap is probed.
    """
    plain = _plain_step(spec, end_heading, posture)
    attempts = deque([plain])
    beyond: Stride | None = None
    while attempts:
        attempt = attempts.popleft()
        target = _target(spec, path, end_heading, attempt)
        arc, posture = yield from search_arc(spec, posture, target)
        new = None if arc is None else _new_points(spec, path, end_heading, arc, attempt)
        if attempt is plain:
            # A kept posture is not turned into a hollow.
            over = () if posture.frozen else OVER_A_GAP
            attempts.extend(AROUND_A_CORNER if new is None else over)
        if new is None:
            continue
        stride = Stride(new, end_heading.normal_azimuth + attempt.turn, posture)
        if beyond is None or _gap(path, stride) < _gap(path, beyond):
            beyond = stride
        if _gap(path, stride) <= spec.joined or attempt.standoff > STEP_STANDOFF:
            break
    return None if beyond is None else (yield from with_gaps_probed(spec, path, beyond))


def _plain_step(spec: SliceSpec, end_heading: Heading, posture: Posture) -> Attempt:
    """As far ahead as the new arc still joins the old one."""
    bulge = max(end_heading.curvature + spec.pad.dome, LEAST_BULGE / spec.width)
    contact = math.sqrt(2.0 * posture.depth / bulge)
    way = min(
        PAD_STEP * 0.5 * spec.width,
        CONTACT_STEP * contact,
        posture.contact + KEPT_STEP * spec.joined,
    )
    way += spec.gap
    return Attempt(way / spec.width, end_heading.curvature * way, STEP_STANDOFF)


def _target(spec: SliceSpec, path: Path, end_heading: Heading, attempt: Attempt) -> Target:
    outward = np.array([end_heading.tangent[1], -end_heading.tangent[0]])
    bend = end_heading.curvature if attempt.standoff == STEP_STANDOFF else 0.0
    way = attempt.way * spec.width
    place = path.points[-1, :2] + way * end_heading.tangent - 0.5 * bend * way**2 * outward
    standoff = attempt.standoff * spec.width
    return Target(place, end_heading.normal_azimuth + attempt.turn, standoff, standoff)


def _new_points(
    spec: SliceSpec, path: Path, end_heading: Heading, arc: SliceArc, attempt: Attempt
) -> Path | None:
    """The part of a touched arc that lies ahead of the path's end, if there is enough of it."""
    forward = end_heading.tangent
    if abs(attempt.turn) > SHARP_TURN:
        forward = travel_direction(end_heading.normal_azimuth + attempt.turn)
    ahead = (arc.points[:, :2] - path.points[-1, :2]) @ forward
    new = ahead > AHEAD * spec.width
    if not new.any() or ahead.max() <= PROGRESS * spec.width:
        return None
    return path_of(arc).part(new)


def _gap(path: Path, stride: Stride) -> float:
    return float(np.linalg.norm(stride.new.points[0] - path.points[-1]))


def reacquire(
    spec: SliceSpec, path: Path, centre: Floats, radius: float
) -> Procedure[Stride | None]:
    """The contour met again beyond a stretch that cannot be followed, or None.

    Approaches come from ever farther round, the last from where the contour began; then the stretch
    between is probed like any gap. `centre` (2,), `radius`: as of `approach_from`, m.
    """
    first, last = path.points[0, :2] - centre, path.points[-1, :2] - centre
    from_ = math.atan2(last[1], last[0])
    left = (math.atan2(first[1], first[0]) - from_) % (2.0 * math.pi)
    reacquisitions = max(math.ceil(left / REACQUIRE_STEP - ROUNDING), 1)
    for number in range(1, reacquisitions + 1):
        azimuth = from_ + left * number / reacquisitions
        found = yield from approach_from(spec, centre, radius, azimuth)
        if isinstance(found, FirstArc):
            stride = Stride(path_of(found.arc), found.heading, found.posture, reacquired=True)
            return (yield from with_gaps_probed(spec, path, stride))
    return None


def with_gaps_probed(spec: SliceSpec, path: Path, stride: Stride) -> Procedure[Stride]:
    """A stride of which every gap has been probed."""
    chain = path.part(slice(-1, None)).joined(stride.new)
    chain, gaps = yield from probe_gaps(spec, chain, stride.posture)
    return stride._replace(new=chain.part(slice(1, None)), gaps=gaps)


def probe_gaps(
    spec: SliceSpec, chain: Path, posture: Posture
) -> Procedure[tuple[Path, tuple[Gap, ...]]]:
    """Probe every gap between neighbouring points of a chain.

    `chain`: points in the order of travel, its gaps not yet probed. `posture`: how the pad was held
    at the chain's end. Returns the chain with what lies between its points, and the gaps left.
    """
    gaps: list[Gap] = []
    last = len(chain.points) - 1
    while last > 0:  # from the end, so that what is put in moves no gap that is still to come
        ends = chain.part(slice(last - 1, last + 1))
        start, end = ends.points
        if np.linalg.norm(end - start) <= spec.joined:
            last -= 1
            continue
        between, reason = yield from _probe(spec, ends, posture)
        if between is None:
            gaps.append(Gap(start, end, reason))
            last -= 1
            continue
        before, after = chain.part(slice(None, last)), chain.part(slice(last, None))
        chain = before.joined(between).joined(after)
        last += len(between.points)
    return chain, tuple(reversed(gaps))


def _probe(
    spec: SliceSpec, ends: Path, posture: Posture
) -> Procedure[tuple[Path | None, GapReason]]:
    """What is touched between two points: by a plain touch, a deep one, by the pad's edges."""
    start, end = ends.points
    deep = UPRIGHT._replace(tilt=posture.tilt, shift=posture.shift, depth=DEEP_TOUCH_DEPTH)
    chord = end[:2] - start[:2]
    length = float(np.linalg.norm(chord))
    target = Target(
        start[:2] + 0.5 * chord,
        normal_azimuth(chord),
        max(GAP_STANDOFF * spec.width, length),
        max(GAP_REACH * spec.width, length),
    )
    arc, _ = yield from search_arc(spec, posture, target)
    between = _between(spec, start, end, arc)
    if arc is None or between is not None:
        return between, "missed"
    for command in (target.command(deep), *probe_walls(spec, ends.points, ends.normals)):
        arc = yield command
        between = _between(spec, start, end, arc)
        if between is not None:
            break
    return between, "bridged"


def _between(spec: SliceSpec, start: Floats, end: Floats, arc: SliceArc | None) -> Path | None:
    """The part of an arc that lies in a gap, if it shortens the gap."""
    if arc is None or not len(arc.points):
        return None
    chord = end[:2] - start[:2]
    length = float(np.linalg.norm(chord))
    along = (arc.points[:, :2] - start[:2]) @ chord / length
    inside = (along > WITHIN * spec.width) & (along < length - WITHIN * spec.width)
    if not inside.any():
        return None
    stretch = path_of(arc).part(inside)
    ways = np.diff(np.concatenate([start[None], stretch.points, end[None]]), axis=0)
    longest = float(np.linalg.norm(ways, axis=1).max())
    whole = float(np.linalg.norm(end - start))
    return stretch if longest < whole - SHORTER * spec.pad.pitch else None


def probe_walls(spec: SliceSpec, ends: Floats, normals: Floats) -> list[TouchCommand]:
    """Touches that follow the walls of a gap inwards from its ends, the likeliest first."""
    return [
        _along_wall(spec, ends, normals[number], number, way)
        for way in WALL_POSTURES
        for number in (0, 1)
    ]


def _along_wall(
    spec: SliceSpec, ends: Floats, normal: Floats, number: int, way: WallPosture
) -> TouchCommand:
    """One touch: the pad's edge beyond one end, its body outside the hollow."""
    chord = ends[1, :2] - ends[0, :2]
    length, across = float(np.linalg.norm(chord)), normal_azimuth(chord)
    wall = math.remainder(math.atan2(normal[1], normal[0]) - across, 2.0 * math.pi)
    inwards = 1.0 if number == 0 else -1.0
    heading = across + max(-STEEPEST, min(STEEPEST, way.along * wall))
    beyond = inwards * min(way.advance * spec.width, 0.5 * length)
    place = ends[number, :2] + beyond * travel_direction(across + wall)
    place = place - inwards * 0.5 * spec.width * travel_direction(heading)
    shift = CORNER * spec.width * float(np.sign(way.tilt))
    return TouchCommand(
        place,
        heading,
        WALL_STANDOFF * spec.width + length,
        max(WALL_REACH * spec.width, length),
        Posture(way.tilt, shift, DEEP_TOUCH_DEPTH),
    )


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
            return replace(trace, path=last, gaps=trace.gaps + gaps), "closed"
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
    squares = np.maximum(np.einsum("ni,ni->n", ways, ways), 1e-30)
    share = np.einsum("ni,ni->n", to_start, ways) / squares
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


def after_touch(trace: Trace, arc: SliceArc | None) -> Trace:
    """The trace, knowing what the last touch touched; None for a miss."""
    return replace(trace, arcs_since=(*trace.arcs_since, arc), touches=trace.touches + 1)


class Stride(NamedTuple):
    """A found continuation of the path."""

    new: Path  # Points ahead of the path's end
    heading: float  # Azimuth of the outward normal with which they were touched, rad
    posture: Posture  # How the pad was held
    gaps: tuple[Gap, ...] = ()  # Stretches from the path's end on that could not be touched
    reacquired: bool = False  # True if the contour was lost but was met again from outside


class Attempt(NamedTuple):
    """One way to go on from the path's end; lengths in widths of the pad."""

    way: float  # Distance ahead
    turn: float  # Turn of the heading, rad
    standoff: float  # Distance from which the pad starts


class WallPosture(NamedTuple):
    """One way to hold the pad against a wall."""

    # Share of the wall's turn against the chord that the pad is turned: a pad quite along the wall
    # meets the other rim first.
    along: float
    # How far beyond the last touched point the edge is set, along the wall; in widths of the pad.
    advance: float
    tilt: float  # Of the pad: 0 for an edge, else its upper or its lower corner comes first, rad


# Convex turns on the spot, concave ones, then hops ahead from farther away.
AROUND_A_CORNER = tuple(
    [Attempt(0.0, math.radians(turn), STEP_STANDOFF) for turn in (50, 25, 75, 100, -25, -50)]
    + [Attempt(4 / 15, 0.0, 8 / 15), Attempt(8 / 15, 0.0, 10 / 15)]
    + [Attempt(8 / 15, math.radians(30), 10 / 15), Attempt(12 / 15, 0.0, 12 / 15)]
)
# One turn on the spot, into the hollow that the pad may have bridged; more turns find less than
# they cost, for the gap's middle is probed in any case.
OVER_A_GAP = (Attempt(0.0, math.radians(-25), STEP_STANDOFF),)
# The likeliest first; each is tried at both ends. Chosen on slots, wedges and dents.
WALL_POSTURES = (
    WallPosture(0.9, 0.22, 0.0),
    WallPosture(0.9, 0.22, 0.7),
    WallPosture(0.9, 0.22, -0.7),
    WallPosture(0.7, 0.1, 0.0),
    WallPosture(0.5, 0.35, 0.5),
    WallPosture(0.5, 0.35, -0.5),
)
