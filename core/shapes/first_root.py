"""First roots of functions that bend downwards no more than is known.

If the second derivative of f is nowhere below -dip, then f lies above the parabola through
its value and slope at any place, and the parabola's first root is a step that cannot pass a
root of f, however thin the part below zero. Where f falls, the step tends to Newton's and
converges as fast. With a dip of 0 (a convex f) it is Newton's step, and a slope of 0 or more
proves that there is no root.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from palpate.core.arrays import Floats, Ints
from palpate.core.shapes.protocol import MISS

Which = slice | Ints
Function = Callable[[Floats, Which], tuple[Floats, Floats]]
"""Places (m,) on those of the functions that are named: values and slopes (m,)."""
Gap = tuple[Floats, Floats]
"""Begin and end (n,) of an interval in which each function is known to have no root."""

MOST_STEPS = 2000
"""A handful does, but along a flat face, a gap g away, it takes some 1 / sqrt(g) steps."""
FEW = 0.6
"""Functions that are done are carried along until the others are fewer than this share."""


def first_roots(
    function: Function,
    starts: Floats,
    ends: Floats,
    tolerance: float,
    dip: float = 0.0,
    rise: float = np.inf,
    gaps: tuple[Gap, ...] = (),
) -> Floats:
    """First place (n,) from `starts` on where each function is not positive.

    Parameters
    ----------
    function : function
        Gives values and slopes.
    starts, ends : (n,) arrays
        Where to begin and to stop.
    tolerance : float
        How exactly a root is wanted, in the unit of the places.
    dip, rise : float
        The second derivatives lie between -`dip` and `rise`.
    gaps : tuple of gaps
        Where nothing needs to be looked for, and the two bounds need not hold. No two of a
        function may meet.

    Returns
    -------
    (n,) array
        `MISS` where there is no root, or none was found in 2000 steps. The start itself, to
        the bit, where the function is not positive there.
    """
    found = np.full(len(starts), MISS)
    places = starts
    for gap in gaps:
        places = _across(gap, places, places)
    rows: Ints = np.arange(len(starts), dtype=np.int32)
    which: Which = slice(None)
    going = places <= ends
    with np.errstate(divide="ignore", over="ignore", invalid="ignore"):  # level: a step of inf
        for _ in range(MOST_STEPS):
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


def _across(gap: Gap, before: Floats, after: Floats) -> Floats:
    """Places after a step, at the gap's end where the step begins or ends in it or passes it."""
    begin, end = gap
    result: Floats = np.where((before < end) & (after > begin), end, after)
    return result
