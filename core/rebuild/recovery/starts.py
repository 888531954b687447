"""Where the fits start, and how far each may go.

Sizes and place come from the extents along suggested axes and are kept near these: the distances
alone do not hold the size of a side that has few points. A taper and a bend are read off how the
widths and the middles of the points change along the axis.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from palpate.core.arrays import Floats
from palpate.core.rebuild.recovery.axes import suggested_axes
from palpate.core.rebuild.recovery.normal_distance import Warps
from palpate.core.shapes.superquadric import LARGEST_EXPONENT, LEAST_EXPONENT

LEAST_EXTENT = 5e-3
"""Of the points' diameter: what is thinner starts as thick as that."""
RIGID_SIZES, WARPED_SIZES = (0.5, 1.3), (0.3, 1.5)
"""Of half the extent along each axis: a taper widens by up to 2, a bend shows its sag."""
LARGEST_TURN = 0.8
"""Rad, of each component: the next start is nearer than that."""
RIGID_SHIFT, WARPED_SHIFT = 0.3, 0.4
"""Of the points' diameter."""
LARGEST_TAPER = 0.95
MOST_ANGLE = 2.2
"""Rad, by which a bend may turn an end."""
FIRST_ANGLE = 0.7
"""Rad, by which the bends that are tried besides the estimated one turn an end."""
STEEPEST_GUESS = 0.8
"""Largest widening to start from."""
Exponents = tuple[tuple[float, float], ...]
FREE_EXPONENTS: Exponents = ((1.0, 1.0), (0.2, 0.2), (1.8, 1.8))
"""Near a box the exponents' slopes vanish, near an octahedron there are creases: from round
neither is always found."""
BENT_EXPONENTS = FREE_EXPONENTS[:2]
"""Where each is started with six bends."""


class Starts(NamedTuple):
    """Starts with their bounds, see `normal_distance.RIGID` for the order of parameters."""

    parameters: Floats
    """(b, p)."""
    low: Floats
    high: Floats
    axes: Floats
    """(b, 3, 3)."""

    def take(self, which: slice | NDArray[np.intp]) -> Starts:
        """Some of them."""
        return Starts(*(part[which] for part in self))


def starts_of(points: Floats, warps: Warps, choice: Exponents | None) -> Starts:
    """All starts that points (n, 3), of diameter about 1, suggest.

    Parameters
    ----------
    points : (n, 3) array
        What the extents are taken from.
    warps : Warps
        What is fitted.
    choice : tuple of pairs
        Exponents that may not change, or None if they are fitted.
    """
    pairs = choice or (BENT_EXPONENTS if warps.bend else FREE_EXPONENTS)
    parts = [
        _starts_along(points, axes, warps, pair, choice is not None)
        for axes in suggested_axes(points)
        for pair in pairs
    ]
    return joined(parts)


def joined(parts: list[Starts]) -> Starts:
    """Starts of several kinds, one after the other."""
    return Starts(*(np.concatenate(part) for part in zip(*parts, strict=True)))


def _starts_along(
    points: Floats, axes: Floats, warps: Warps, exponents: tuple[float, float], fixed: bool
) -> Starts:
    """Starts along some axes."""
    places = points @ axes
    low, high = places.min(axis=0), places.max(axis=0)
    half, middle = np.maximum(0.5 * (high - low), LEAST_EXTENT), 0.5 * (low + high)
    tapers, bends = _guesses((places - middle) / half, half, warps)
    count = len(bends)
    # The extents of a bent solid show its sag, half of it to each side of its middle.
    sag = 0.5 * bends * half[2] ** 2
    size, place = np.tile(half, (count, 1)), np.tile(middle, (count, 1))
    size[:, :2] = np.maximum(size[:, :2] - 0.5 * np.abs(sag), WARPED_SIZES[0] * half[:2])
    place[:, :2] -= 0.5 * sag
    pair, none = np.tile(np.asarray(exponents), (count, 1)), np.zeros((count, 3))
    parts = [np.log(size), pair, none, place]
    parts += [tapers] * warps.taper + [bends] * warps.bend
    least, most = _bounds(half, middle, warps)
    if fixed:
        least[3:5] = most[3:5] = exponents
    return Starts(
        np.concatenate(parts, axis=1),
        np.tile(least, (count, 1)),
        np.tile(most, (count, 1)),
        np.tile(axes, (count, 1, 1)),
    )


def _bounds(half: Floats, middle: Floats, warps: Warps) -> tuple[Floats, Floats]:
    """Least and largest parameters, from half the extents along the axes and their middle."""
    warped = warps.taper or warps.bend
    sizes = WARPED_SIZES if warped else RIGID_SIZES
    shift = WARPED_SHIFT if warped else RIGID_SHIFT
    ends = np.array(
        [[LARGEST_TAPER] * 2 * warps.taper + [MOST_ANGLE / half[2]] * 2 * warps.bend]
    ).ravel()
    turn, pair = np.full(3, LARGEST_TURN), np.ones(2)
    least, most = (
        [np.log(sizes[0] * half), LEAST_EXPONENT * pair, -turn, middle - shift, -ends],
        [np.log(sizes[1] * half), LARGEST_EXPONENT * pair, turn, middle + shift, ends],
    )
    return np.concatenate(least), np.concatenate(most)


def _guesses(places: Floats, half: Floats, warps: Warps) -> tuple[Floats, Floats]:
    """Widenings and bends (k, 2) to start from; places are in half extents."""
    height = places[:, 2]
    powers = np.column_stack([np.ones_like(height), height, height * height])
    middles = np.linalg.lstsq(powers, places[:, :2], rcond=None)[0]
    widths = np.abs(places[:, :2] - powers @ middles)
    width, slope = np.linalg.lstsq(powers[:, :2], widths, rcond=None)[0]
    taper = np.clip(slope / np.maximum(width, LEAST_EXTENT), -STEEPEST_GUESS, STEEPEST_GUESS)
    if not warps.bend:
        guesses = np.stack([0.0 * taper, taper]) if warps.taper else np.zeros((1, 2))
        return guesses, np.zeros((len(guesses), 2))
    bend = 2.0 * middles[2] * half[:2] / half[2] ** 2
    limit = MOST_ANGLE / half[2]
    others = FIRST_ANGLE / half[2] * np.array([[1, 0], [-1, 0], [0, 1], [0, -1]])
    bends = np.concatenate([[np.clip(bend, -limit, limit)], np.zeros((1, 2)), others])
    tapers = np.zeros_like(bends)
    tapers[0] = taper
    return tapers, bends
