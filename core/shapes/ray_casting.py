"""Intersections of rays with solids: guaranteed first roots, spans inside, clipping to a box.

If the second derivative of f is nowhere below -dip, then f lies above the parabola through its
value and slope at any place, and the parabola's first root is a step that cannot pass a root of f,
however thin the part below zero (`first_roots`). Where only bounds over intervals are known, the
caller gives such a parabola for each interval; intervals grow while they have no root, and shrink
to where the parabola fails (`guaranteed_first_roots`). Spans: Roth, *Ray casting for modeling
solids*, 1982.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Bools, Floats, Ints
from palpate.core.shapes.protocol import INSIDE, MISS, ImplicitShape

RaySelection = slice | Ints
# Places (m,) on selected rays to values and slopes (m,) of their functions.
RayFunction = Callable[[Floats, RaySelection], tuple[Floats, Floats]]
RayGap = tuple[Floats, Floats]  # begin and end (n,) of an interval without a root
MIN_DIRECTION = 1e-200  # replaces a direction of 0, so that no division is 0 / 0 or overflows
BOX_MARGIN = 1e-12  # fraction by which boxes are enlarged, so that they contain their faces


@dataclass(frozen=True, slots=True, kw_only=True)
class NewtonSettings:
    """Search for first roots of functions with bounded second derivatives."""

    # A ray along a flat face at a distance g needs about 1 / sqrt(g) steps.
    max_steps: int = 2000
    compaction: float = 0.6  # share of unfinished functions below which finished ones are dropped


@dataclass(frozen=True, slots=True, kw_only=True)
class MarchSettings:
    """Search for roots by intervals over which parabolas bound the functions."""

    max_steps: int = 2000
    growth: float = 4.0  # factor of the next interval after one without a root
    shrinkage: float = 0.125  # factor of an interval whose bound does not decide
    root_length: float = 4.0  # [tolerances] longest interval in which a root counts as found
    max_spans: int = 64  # of one ray; the surface behind the last is ignored
    min_span: float = 1e4  # [tolerances]; thinner spans, and gaps between them, are ignored


def ranges_of(starts: Floats, ends: Floats, roots: Callable[[Ints], Floats]) -> Floats:
    """Ranges (n,) of rays between ends; `roots` gives first roots of rays with some length."""
    ranges = np.full(len(starts), MISS)
    met: Ints = np.flatnonzero(starts <= ends).astype(np.int32)
    if len(met):
        first = roots(met)
        ranges[met] = np.where(first == 0.0, INSIDE, first)
    return ranges


def convex_spans(shape: ImplicitShape, origins: Floats, direction: Floats) -> Floats:
    """The single span of each ray in a convex solid, (n, 1, 2): by a cast from either side."""
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
    settings: MarchSettings = MarchSettings(),
) -> Floats:
    """Spans (n, k, 2) inside, from surface to surface, at most `max_spans`.

    `entering` and `leaving`: lower bounds of a function that is negative inside, and of its
    negative; before `starts` and after `ends` (n,) a ray is outside.
    """
    spans: list[Floats] = []
    min_length = settings.min_span * tolerance
    rows = np.flatnonzero(starts <= ends)
    places = starts[rows]
    for _ in range(settings.max_spans):
        if not len(rows):
            break
        begin = guaranteed_first_roots(
            _of_rays(entering, rows), places, ends[rows], tolerance, settings
        )
        met = begin < MISS
        rows, begin = rows[met], begin[met]
        inner = np.minimum(begin + min_length, ends[rows])
        end = guaranteed_first_roots(
            _of_rays(leaving, rows), inner, ends[rows], tolerance, settings
        )
        end = np.minimum(end, ends[rows])  # the solid ends with the ray's part
        thick = end > inner
        span = np.full((len(starts), 2), np.inf)
        span[rows[thick], 0] = np.where(begin == 0.0, INSIDE, begin)[thick]
        span[rows[thick], 1] = end[thick]
        spans.append(span)
        places = np.maximum(end, inner) + min_length
        active = places < ends[rows]
        rows, places = rows[active], places[active]
    if not spans:
        return np.full((len(starts), 1, 2), np.inf)
    return np.sort(np.stack(spans, axis=1), axis=1)


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
    settings: NewtonSettings = NewtonSettings(),
) -> Floats:
    """First place (n,) after `starts` where each function is not positive.

    The second derivatives lie between -`dip` and `rise` except in `gaps`, which are disjoint for
    each function and have no root. Returns (n,): `MISS` where there is no root within the
    tolerance, or none after `max_steps`; the start itself, bit for bit, where the function is not
    positive there.
    """
    roots = np.full(len(starts), MISS)
    places = starts
    for gap in gaps:
        places = _across(gap, places, places)
    rows: Ints = np.arange(len(starts), dtype=np.int32)
    which: RaySelection = slice(None)
    active = places <= ends
    with np.errstate(divide="ignore", over="ignore", invalid="ignore"):  # level: a step of inf
        for _ in range(settings.max_steps):
            n_active = np.count_nonzero(active)
            if n_active == 0:
                break
            if n_active < settings.compaction * len(active):
                which = rows = rows[active]
                places, ends = places[active], ends[active]
                gaps = tuple((begin[active], end[active]) for begin, end in gaps)
                active = np.ones(n_active, bool)
            value, slope = function(places, which)
            step = _safe_step(value, slope, dip)
            last = (step <= tolerance) | (rise * step * step <= -tolerance * slope)
            after = places + step
            if np.count_nonzero(last):
                arrived = active & last & (after <= ends)
                roots[rows[arrived]] = after[arrived]
                active = active & ~last
            for gap in gaps:
                after = _across(gap, places, after)
            active = active & (after <= ends)
            places = after
    return roots


def _across(gap: RayGap, before: Floats, after: Floats) -> Floats:
    begin, end = gap
    return np.where((before < end) & (after > begin), end, after)


def _safe_step(value: Floats, slope: Floats, dip: float) -> Floats:
    """Step to the first root of the bounding parabola, without cancellation; 0 if there already."""
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
    """Lower bounds of functions after a place: value - drop + slope s - dip s^2 / 2."""

    value: Floats  # of the functions, (n,)
    slope: Floats  # of the parabolas at the place, (n,)
    dip: Floats | float  # downward bend of the parabolas, not negative, (n,)
    length: Floats  # over which they hold, (n,); at most the requested one
    drop: Floats  # of the parabolas below the functions at the place, (n,)


def guaranteed_first_roots(
    below: MinorantFunction,
    starts: Floats,
    ends: Floats,
    tolerance: float,
    settings: MarchSettings = MarchSettings(),
) -> Floats:
    """First place (n,) after `starts` where each function is not positive.

    `below` gives lower bounds of the functions. Returns `MISS` where there is no root within the
    tolerance, or none after `max_steps`; the start itself, bit for bit, if it is not positive
    there.
    """
    roots = np.full(len(starts), MISS)
    rows: Ints = np.flatnonzero(starts <= ends).astype(np.int32)
    places, ends = starts[rows], ends[rows]
    length = ends - places
    for _ in range(settings.max_steps):
        if not len(rows):
            break
        length = np.minimum(length, ends - places)
        floor = below(places, length, rows)
        step, length, arrived = _next_step(floor, _first_root(floor), length, tolerance, settings)
        places = places + step
        roots[rows[arrived]] = places[arrived]
        active = ~arrived & (places < ends)
        if np.count_nonzero(active) < len(active):
            rows, places, ends = rows[active], places[active], ends[active]
            length = length[active]
    return roots


def _first_root(floor: Minorant) -> Floats:
    """Distance to the parabola's first root, without cancellation; infinite if there is none."""
    value, slope = floor.value - floor.drop, floor.slope
    with np.errstate(divide="ignore", over="ignore", invalid="ignore"):
        steep = np.sqrt(slope * slope + 2.0 * floor.dip * value)
        rising = np.where(np.asarray(floor.dip) > 0.0, (steep + slope) / floor.dip, np.inf)
        root = np.where(slope >= 0.0, rising, 2.0 * value / (steep - slope))
    root[np.isnan(root) | (value <= 0.0)] = 0.0  # nan: an infinite slope, which decides nothing
    return root


def _next_step(
    floor: Minorant, root: Floats, requested: Floats, tolerance: float, settings: MarchSettings
) -> tuple[Floats, Floats, Bools]:
    """Step, length of the next interval, and whether the place is a root."""
    length, min_length = floor.length, settings.root_length * tolerance
    free = root > length
    close = ~free & (root <= tolerance)
    short = length <= min_length
    dropped = floor.drop > 0.0
    there = floor.value <= 0.0
    arrived = there | (close & short & ~dropped)
    blind = close & ~there & (~short | dropped)
    step = np.where(there, 0.0, np.minimum(root, length))
    # A short interval that is undecided is passed: a root there shows behind it.
    step = np.where(blind, np.where(short, length, 0.0), step)
    # A bound may hold over less than the requested length, which is then kept.
    grown = np.where(length < requested, requested, settings.growth * requested)
    after = np.where(free, grown, 2.0 * step)
    shorter = np.where(dropped, np.maximum(settings.shrinkage * length, min_length), min_length)
    after = np.where(blind, np.where(short, settings.growth * length, shorter), after)
    return step, after, arrived


def clip_to_box(origins: Floats, direction: Floats, half: Floats) -> tuple[Floats, Floats]:
    """Ranges at which parallel rays enter and leave a box about the origin.

    `origins` (3, n): of the rays, by coordinate [m]. `direction` (3,): their direction. `half`
    (3,): half the box's edges [m]. Returns `starts`, `ends` (n,): at least 0; the start of a ray
    that misses the box is after its end.
    """
    slowness = 1.0 / np.where(np.abs(direction) < MIN_DIRECTION, MIN_DIRECTION, direction)
    middle = origins * -slowness[:, None]
    halfway = (np.abs(slowness) * half * (1.0 + BOX_MARGIN))[:, None]
    x, y, z = middle - halfway
    starts = np.maximum(np.maximum(x, y), np.maximum(z, 0.0))
    x, y, z = middle + halfway
    return starts, np.minimum(np.minimum(x, y), z)


# Places, lengths and indices (n,) of some functions to their lower bounds.
MinorantFunction = Callable[[Floats, Floats, Ints], Minorant]
