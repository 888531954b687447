"""First roots of functions of which only bounds over intervals are known.

Asked for a stretch of a ray, the caller gives a parabola that lies below the function all
along it. Up to the parabola's first root the function has none, so no step can pass a root.
Stretches grow while they prove free, and shrink to where the parabola failed; near a simple
root the steps tend to Newton's if the parabola tends to the tangent.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Bools, Floats, Ints
from palpate.core.shapes.protocol import MISS

MOST_STEPS = 2000
GROWTH = 4.0
"""A stretch that was free is followed by one this many times as long."""
SHRINKAGE = 0.125
"""Of a stretch over which nothing could be told."""
CLOSE = 4.0
"""A root is believed where it is seen over a stretch this many tolerances long."""


class Floor(NamedTuple):
    """Parabolas below functions, from a place on: value - drop + slope s - dip s^2 / 2."""

    value: Floats
    """Of the functions, (n,)."""
    slope: Floats
    """How the parabolas begin to rise, (n,)."""
    dip: Floats | float
    """How much they bend downwards, not negative, (n,)."""
    length: Floats
    """How far they hold, (n,); at most as far as was asked."""
    drop: Floats
    """How far below the functions they begin, (n,)."""


Below = Callable[[Floats, Floats, Ints], Floor]
"""Places, lengths and numbers (n,) of some of the functions: what lies below them."""


def certain_first_roots(below: Below, starts: Floats, ends: Floats, tolerance: float) -> Floats:
    """First place (n,) from `starts` on where each function is not positive.

    Parameters
    ----------
    below : function
        Gives parabolas below the functions.
    starts, ends : (n,) arrays
        Where to begin and to stop, finite.
    tolerance : float
        How exactly a root is wanted, in the unit of the places.

    Returns
    -------
    (n,) array
        `MISS` where there is no root, or none was found in 2000 steps. The start itself, to
        the bit, where the function is not positive there.
    """
    found = np.full(len(starts), MISS)
    rows: Ints = np.flatnonzero(starts <= ends).astype(np.int32)
    places, ends = starts[rows], ends[rows]
    asked = ends - places
    for _ in range(MOST_STEPS):
        if not len(rows):
            break
        asked = np.minimum(asked, ends - places)
        floor = below(places, asked, rows)
        root = _first_root(floor)
        step, asked, arrived = _judged(floor, root, asked, tolerance)
        places = places + step
        found[rows[arrived]] = places[arrived]
        going = ~arrived & (places < ends)
        if np.count_nonzero(going) < len(going):
            rows, places, ends, asked = rows[going], places[going], ends[going], asked[going]
    return found


def _judged(
    floor: Floor, root: Floats, asked: Floats, tolerance: float
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
    shorter = np.where(
        dropped, np.maximum(SHRINKAGE * length, CLOSE * tolerance), CLOSE * tolerance
    )
    after = np.where(blind, np.where(short, GROWTH * length, shorter), after)
    return step, after, arrived


def _first_root(floor: Floor) -> Floats:
    """Way to the parabola's first root, in the form that does not cancel; infinite if none."""
    value, slope = floor.value - floor.drop, floor.slope
    with np.errstate(divide="ignore", over="ignore", invalid="ignore"):
        steep = np.sqrt(slope * slope + 2.0 * floor.dip * value)
        rising = np.where(np.asarray(floor.dip) > 0.0, (steep + slope) / floor.dip, np.inf)
        root = np.where(slope >= 0.0, rising, 2.0 * value / (steep - slope))
    root[np.isnan(root) | (value <= 0.0)] = 0.0  # nan: an infinite slope, nothing can be told
    return root
