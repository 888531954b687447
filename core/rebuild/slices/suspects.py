"""Contours of which nobody can tell whether they went wrong or the object is like that."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Bools, Floats
from palpate.core.rebuild.correspondence.leave_one_out import neighbour_weights

FAR = 0.1
"""Of the mean radius: a contour that is off by less does little harm."""
CLEARLY = 4.0
"""Times what its neighbours are off once it is put away, by which a contour must be off."""
LEAST_SLICES = 4
"""With fewer nothing is left to compare with. Of three the middle one may well be the widest;
one that is narrower than both others, or aside, is suspicious."""
ALIKE = 0.05
"""Root mean square difference of two shapes of radius 1 that are alike."""


class Suspect(NamedTuple):
    """A contour that is used, though it is unlike its neighbours."""

    which: int
    """Of the given contours."""
    height: float
    """m."""
    off: float
    """By how much it is unlike what they tell of it, root mean square, m."""


def suspicious(heights: Floats, grid: Floats) -> Floats:
    """By how much contours are unlike their neighbours, (M,), m; 0 where they are not clearly so.

    A contour is put away, and the others are predicted from each other: where they agree far
    better than with it, it may have gone wrong, or have felt something by itself. The first
    and the last are suspicious only if they are wider or farther aside than the others tell:
    an object may round off beyond them.

    Parameters
    ----------
    heights : (M,) array
        Rising, m.
    grid : (M, K, 2) array
        Contours, matched place by place, m.
    """
    count = len(heights)
    found = np.zeros(count)
    middles = grid.mean(axis=1)
    radii = np.linalg.norm(grid - middles[:, None], axis=2).mean(axis=1)
    radius = float(radii.mean())
    if count < LEAST_SLICES:
        if count == LEAST_SLICES - 1:
            aside = np.linalg.norm(middles[1] - neighbour_weights(heights)[1] @ middles)
            off = max(float(aside), float(radii[[0, 2]].min() - radii[1]))
            found[1] = off if off > FAR * radius else 0.0
        return found
    missed = _rms(np.tensordot(neighbour_weights(heights), grid, 1) - grid)
    for row in np.flatnonzero(missed > FAR * radius):
        others = np.arange(count) != row
        rest = np.tensordot(neighbour_weights(heights[others]), grid[others], 1) - grid[others]
        usual = float(_rms(rest[1:-1]).max())
        if row in (0, count - 1):
            missed[row] = _beyond(heights, grid, int(row))
        if missed[row] > max(CLEARLY * usual, FAR * radius):
            found[row] = missed[row]
    # What is next to a wrong contour is unlike it as well: only the worst of neighbours counts.
    for row in np.argsort(-found):
        if found[row] > 0.0:
            beside = found[max(row - 1, 0) : row + 2]
            beside[beside < found[row]] = 0.0
    return found


def perhaps_features(grid: Floats, star: Bools, bad: Bools) -> Bools:
    """Which bad contours (M,) look as if the object were like that: its shape in another size.

    A groove that one contour alone has felt is such a contour, and so is one that is wrong in
    scale.
    """
    middles = grid.mean(axis=1, keepdims=True)
    away = grid - middles
    shapes = away / np.sqrt((away**2).sum(axis=2).mean(axis=1))[:, None, None]
    good = np.flatnonzero(~bad)
    found = np.zeros(len(grid), np.bool_)
    for row in np.flatnonzero(bad & star):
        near = good[np.argmin(np.abs(good - row))]
        found[row] = float(_rms((shapes[row] - shapes[near])[None])[0]) < ALIKE
    return found


def _beyond(heights: Floats, grid: Floats, row: int) -> float:
    """How much wider, or farther aside, the first or last contour is than the others tell."""
    middles = grid.mean(axis=1)
    radii = np.linalg.norm(grid - middles[:, None], axis=2).mean(axis=1)
    near = np.arange(1, 4) if row == 0 else np.arange(row - 3, row)
    line = np.polynomial.Polynomial.fit(heights[near], radii[near], 1)
    wider = float(radii[row] - max(line(heights[row]), radii[near].max()))
    places = [
        np.polynomial.Polynomial.fit(heights[near], middles[near, axis], 1)(heights[row])
        for axis in (0, 1)
    ]
    return max(wider, float(np.linalg.norm(middles[row] - np.array(places))), 0.0)


def _rms(apart: Floats) -> Floats:
    """Root mean square length (M,) of differences (M, K, 2)."""
    lengths: Floats = np.sqrt((apart**2).sum(axis=2).mean(axis=1))
    return lengths
