"""Where rays meet solids: first roots that cannot be passed, spans inside, and clipping to a box.

If the second derivative of f is nowhere below -dip, then f lies above the parabola through its
value and slope at any place, and the parabola's first root is a step that cannot pass a root of f,
however thin the part below zero (`first_roots`). Where only bounds over intervals are known, the
caller gives such a parabola for the stretch that is asked about; stretches grow while they prove
free, and shrink to where the parabola failed (`guaranteed_first_roots`). Spans: Roth, *Ray casting
for modeling solids*, 1982.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Bools, Floats, Ints
from palpate.core.shapes.protocol import INSIDE, MISS, ImplicitShape

MOST_SPANS = 64  # On one ray; the surface behind the last is not seen
NUDGE = 1e4  # Tolerances; spans that are thinner, and gaps between them, are left out
RaySelection = slice | Ints
# Places (m,) on those of the functions that are named: values and slopes (m,).
RayFunction = Callable[[Floats, RaySelection], tuple[Floats, Floats]]
RayGap = tuple[Floats, Floats]  # Begin and end (n,) of an interval that is known to have no root
MOST_NEWTON_STEPS = 2000  # Along a flat face, a gap g away, it takes some 1 / sqrt(g) steps
FEW = 0.6  # Functions that are done are carried along until the others are fewer than this share
MOST_MARCH_STEPS = 2000
GROWTH = 4.0  # A stretch that was free is followed by one this many times as long
SHRINKAGE = 0.125  # Of a stretch over which nothing could be told
CLOSE = 4.0  # A root is believed where it is seen over a stretch this many tolerances long
LEAST_DIRECTION = 1e-200  # Stands for a direction of 0, so that no division is 0 / 0 or overflows
ROOM = 1e-12  # Share by which the box is widened: what lies in its faces is in it


def ranges_of(starts: Floats, ends: Floats, roots: Callable[[Ints], Floats]) -> Floats:
    """Range (n,) of rays with these ends: `roots` gives first roots of those that have a length."""
    ranges = np.full(len(starts), MISS)
    met: Ints = np.flatnonzero(starts <= ends).astype(np.int32)
    if len(met):
        found = roots(met)
        ranges[met] = np.where(found == 0.0, INSIDE, found)
    return ranges


def convex_spans(shape: ImplicitShape, origins: Floats, direction: Floats) -> Floats:
    """The one span of each ray in a convex solid, (n, 1, 2): a cast forwards and one back."""
    low, high = shape.enclosure()
    farthest = np.where(direction > 0.0, high, low) @ direction
    size = float(np.linalg.norm(high - low))
    spans = np.full((len(origins), 1, 2), np.inf)
    begin = shape.cast(origins, direction, np.inf)
    met = np.flatnonzero(begin < MISS)
    origins, begin = origins[met], begin[met]
    far = farthest - origins @ direction + 0.01 * size
    end = far - shape.cast(origins + far[:, None] * direction, -direction, np.inf)
    thick = (end > np.maximum(begin, 0.0)) & np.isfinite(end)
    spans[met[thick], 0] = np.column_stack([begin, end])[thick]
    return spans


def marched_spans(
    entering: MinorantFunction,
    leaving: MinorantFunction,
    starts: Floats,
    ends: Floats,
    tolerance: float,
) -> Floats:
    """Spans (n, k, 2), at most 64, found by going from surface to surface.

    `entering` and `leaving`: bounds from below of a function that is negative inside, and of its
    negative; outside `starts` and `ends` (n,) a ray is outside.
    """
    found: list[Floats] = []
    rows = np.flatnonzero(starts <= ends)
    places = starts[rows]
    for _ in range(MOST_SPANS):
        if not len(rows):
            break
        begin = guaranteed_first_roots(_of_rays(entering, rows), places, ends[rows], tolerance)
        met = begin < MISS
        rows, begin = rows[met], begin[met]
        within = np.minimum(begin + NUDGE * tolerance, ends[rows])
        end = guaranteed_first_roots(_of_rays(leaving, rows), within, ends[rows], tolerance)
        end = np.minimum(end, ends[rows])  # what ends the part ends the solid
        thick = end > within
        span = np.full((len(starts), 2), np.inf)
        span[rows[thick], 0] = np.where(begin == 0.0, INSIDE, begin)[thick]
        span[rows[thick], 1] = end[thick]
        found.append(span)
        places = np.maximum(end, within) + NUDGE * tolerance
        going = places < ends[rows]
        rows, places = rows[going], places[going]
    if not found:
        return np.full((len(starts), 1, 2), np.inf)
    return np.sort(np.stack(found, axis=1), axis=1)


def _of_rays(below: MinorantFunction, rows: np.ndarray) -> MinorantFunction:
    return lambda places, lengths, which: below(places, lengths, rows[which])


def first_roots(
    function: RayFunction,
    starts: Floats,
    ends: Floats,
    tolerance: float,
    dip: float = 0.0,
    rise: float = np.inf,
    gaps: tuple[RayGap, ...] = (),
) -> Floats:
    """First place (n,) from `starts` on where each function is not positive.

    The second derivatives lie between -`dip` and `rise`, but for `gaps`, of which no two of a
    function may meet, and in which there is no root. Returns (n,), `MISS` where there is no root to
    the tolerance, or none was found in 2000 steps; the start itself, to the bit, where the function
    is not positive there.
    """
    found = np.full(len(starts), MISS)
    places = starts
    for gap in gaps:
        places = _across(gap, places, places)
    rows: Ints = np.arange(len(starts), dtype=np.int32)
    which: RaySelection = slice(None)
    going = places <= ends
    with np.errstate(divide="ignore", over="ignore", invalid="ignore"):  # level: a step of inf
        for _ in range(MOST_NEWTON_STEPS):
            left = np.count_nonzero(going)
            if left == 0:
                break
            if left < FEW * len(going):
                which = rows = rows[going]
                places, ends = places[going], ends[going]
                gaps = tuple((begin[going], end[going]) for begin, end in gaps)
                going = np.ones(left, bool)
            value, slope = function(places, which)
            step = _safe_step(value, slope, dip)
            last = (step <= tolerance) | (rise * step * step <= -tolerance * slope)
            after = places + step
            if np.count_nonzero(last):
                arrived = going & last & (after <= ends)
                found[rows[arrived]] = after[arrived]
                going = going & ~last
            for gap in gaps:
                after = _across(gap, places, after)
            going = going & (after <= ends)
            places = after
    return found


def _across(gap: RayGap, before: Floats, after: Floats) -> Floats:
    begin, end = gap
    return np.where((before < end) & (after > begin), end, after)


def _safe_step(value: Floats, slope: Floats, dip: float) -> Floats:
    """To the first root of the parabola below, in the form that does not cancel; else 0."""
    if dip == 0.0:
        step = 2.0 * value / (np.abs(slope) - slope)
    else:
        steep = np.sqrt(slope * slope + 2.0 * dip * value)
        step = np.where(slope > 0.0, (steep + slope) / dip, 2.0 * value / (steep - slope))
    there = value <= 0.0
    if np.count_nonzero(there):
        step[there] = 0.0
    return step


class Minorant(NamedTuple):
    """Parabolas below functions, from a place on: value - drop + slope s - dip s^2 / 2."""

    value: Floats  # Of the functions, (n,)
    slope: Floats  # How the parabolas begin to rise, (n,)
    dip: Floats | float  # How much they bend downwards, not negative, (n,)
    length: Floats  # How far they hold, (n,); at most as far as was asked
    drop: Floats  # How far below the functions they begin, (n,)


def guaranteed_first_roots(
    below: MinorantFunction, starts: Floats, ends: Floats, tolerance: float
) -> Floats:
    """First place (n,) from `starts` on where each function is not positive.

    `below` gives parabolas below the functions. `MISS` where there is no root to the tolerance, or
    none in 2000 steps; the start itself, to the bit, if it is not positive there.
    """
    found = np.full(len(starts), MISS)
    rows: Ints = np.flatnonzero(starts <= ends).astype(np.int32)
    places, ends = starts[rows], ends[rows]
    asked = ends - places
    for _ in range(MOST_MARCH_STEPS):
        if not len(rows):
            break
        asked = np.minimum(asked, ends - places)
        floor = below(places, asked, rows)
        step, asked, arrived = _judged(floor, _first_root(floor), asked, tolerance)
        places = places + step
        found[rows[arrived]] = places[arrived]
        going = ~arrived & (places < ends)
        if np.count_nonzero(going) < len(going):
            rows, places, ends, asked = rows[going], places[going], ends[going], asked[going]
    return found


def _first_root(floor: Minorant) -> Floats:
    """Way to the parabola's first root, in the form that does not cancel; infinite if none."""
    value, slope = floor.value - floor.drop, floor.slope
    with np.errstate(divide="ignore", over="ignore", invalid="ignore"):
        steep = np.sqrt(slope * slope + 2.0 * floor.dip * value)
        rising = np.where(np.asarray(floor.dip) > 0.0, (steep + slope) / floor.dip, np.inf)
        root = np.where(slope >= 0.0, rising, 2.0 * value / (steep - slope))
    root[np.isnan(root) | (value <= 0.0)] = 0.0  # nan: an infinite slope, nothing can be told
    return root


def _judged(
    floor: Minorant, root: Floats, asked: Floats, tolerance: float
) -> tuple[Floats, Floats, Bools]:
    """How far to go, how far to ask from there, and who has arrived."""
    length = floor.length
    free = root > length
    close = ~free & (root <= tolerance)
    short = length <= CLOSE * tolerance
    dropped = floor.drop > 0.0
    there = floor.value <= 0.0
    arrived = there | (close & short & ~dropped)
    blind = close & ~there & (~short | dropped)
    step = np.where(there, 0.0, np.minimum(root, length))
    # Over a stretch as short as that, what could not be ruled out is passed, and seen behind.
    step = np.where(blind, np.where(short, length, 0.0), step)
    # A floor may hold less far than was asked; the next may be asked as far again.
    after = np.where(free, np.where(length < asked, asked, GROWTH * asked), 2.0 * step)
    least = CLOSE * tolerance
    shorter = np.where(dropped, np.maximum(SHRINKAGE * length, least), least)
    after = np.where(blind, np.where(short, GROWTH * length, shorter), after)
    return step, after, arrived


def clip_to_box(origins: Floats, direction: Floats, half: Floats) -> tuple[Floats, Floats]:
    """Where parallel rays enter and leave a box about the origin.

    `origins` (3, n): where the rays start, by coordinate, m. `direction` (3,): their direction.
    `half` (3,): half the box's edges, m. Returns `starts`, `ends` (n,): ranges, at least 0; a ray
    that misses the box starts after its end.
    """
    slowness = 1.0 / np.where(np.abs(direction) < LEAST_DIRECTION, LEAST_DIRECTION, direction)
    middle = origins * -slowness[:, None]
    halfway = (np.abs(slowness) * half * (1.0 + ROOM))[:, None]
    x, y, z = middle - halfway
    starts = np.maximum(np.maximum(x, y), np.maximum(z, 0.0))
    x, y, z = middle + halfway
    return starts, np.minimum(np.minimum(x, y), z)


# Places, lengths and numbers (n,) of some of the functions: what lies below them.
MinorantFunction = Callable[[Floats, Floats, Ints], Minorant]
