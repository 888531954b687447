"""Single points that stick out of a grid: found against their neighbours, and left out of a fit.

A smooth surface bends around a single wrong point; a feature of the object is felt by several
points of several contours. The points that stick out are replaced by what the fit says of them
and fitted again, until that no longer changes: the fit without them, for which the grid need
not have holes.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from palpate.core.arrays import Bools, Floats
from palpate.core.rebuild.skin.contour_fit import ContourFit

SUSPECT = 1.5
"""Residuals over the noise between neighbours from which on points are suspected."""
STICKING = 5.0
"""Deviations from which on a point sticks out of its neighbourhood."""
KEPT_OUT, TAKEN_OUT = 3.5, 6.0
"""Residuals, in deviations, above which a point stays out and is newly left out."""
LONELY = 2.2
"""Times those of the points beside it, by which a point must stick out to be newly left out."""
ROUNDS, REVIEWS = 15, (2, 4, 6)
"""Fits at most, and those after which it is judged anew which points stick out."""
SETTLED = 0.01
"""Of the noise: a change between fits that matters no more."""
NEAR_ROWS = 2
"""Contours on either side whose like deviations are the object's."""
MEDIAN = 0.6745
"""Median size of an error of deviation 1."""
CUBIC_GAIN = float(np.sqrt(1.0 + 34.0 / 36.0))
"""Deviation of a point from the cubic through two neighbours on either side, of its noise."""
MOST = 0.15
"""Share of the points beyond which it is the object that sticks out: edges do, of exact points."""
LEAST_SPARE = 0.05
"""Least share of the points' freedom that is taken as left."""

Fit = Callable[[Floats], ContourFit]


def set_aside(grid: Floats, fit: ContourFit, again: Fit) -> tuple[Floats, ContourFit, Bools]:
    """Leave out single points that stick out, if the residuals of a fit suggest any.

    Parameters
    ----------
    grid : (m, k, 2) array
        Points.
    fit : ContourFit
        Fit to all of them.
    again : callable
        The same fit to other points.

    Returns
    -------
    grid : (m, k, 2) array
        With those points replaced by what the fit says.
    fit : ContourFit
        Fit to it.
    outlying : (m, k) array of bool
        Those points.
    """
    across = fit.across()
    off = _off(grid, fit, across)
    sigma = np.sqrt(np.square(off).sum() / fit.smoothed.spare)
    nothing = np.zeros(off.shape, np.bool_)
    if grid.shape[1] < 8 or not sigma > SUSPECT * _noise_between_neighbours(grid, across):
        return grid, fit, nothing
    outlying = sticking_out(off)
    if not outlying.any() or outlying.all(axis=1).any() or outlying.mean() > MOST:
        return grid, fit, nothing
    used, all_of_them = _bridged(grid, outlying), fit
    for number in range(ROUNDS):
        fit = again(used)
        off = _off(grid, fit, across)
        share = max(fit.smoothed.spare / off.size, LEAST_SPARE)
        if number in REVIEWS:
            outlying = _reviewed(off, outlying, share)
            if outlying.mean() > MOST:
                return grid, all_of_them, nothing
        noise = np.sqrt(np.square(off[~outlying]).mean() / share)
        following = np.where(outlying[..., None], fit.fitted(), grid)
        change = np.abs(following - used).max()
        used = following
        if number > REVIEWS[-1] and change < SETTLED * noise:
            break
    return used, again(used), outlying


def sticking_out(off: Floats) -> Bools:
    """Points that stick out of their contour where the contours next to it do not.

    Parameters
    ----------
    off : (m, k) array
        Distance of each point from a smooth surface.
    """
    alone = _less_neighbours(unforetold(off))
    size = np.abs(alone)
    column = np.median(size, axis=0)
    column = np.median([np.roll(column, 1), column, np.roll(column, -1)], axis=0)
    scale = np.maximum(np.median(size), np.maximum(column, np.median(size, axis=1)[:, None]))
    outlying: Bools = size > STICKING / MEDIAN * scale
    return outlying


def unforetold(off: Floats) -> Floats:
    """What the points beside each along the last axis, around a contour, do not foretell of it.

    They foretell the median of five guesses, of which one wrong point spoils two at most.
    """
    before, after = (np.stack([np.roll(off, way * n, -1) for n in (1, 2, 3)]) for way in (1, -1))
    guesses = [*(0.5 * (before + after)), 2.0 * before[0] - before[1], 2.0 * after[0] - after[1]]
    left: Floats = off - np.median(guesses, axis=0)
    return left


def _reviewed(off: Floats, outlying: Bools, share: float) -> Bools:
    """Which points stick out of a better fit."""
    alone = _less_neighbours(off, outlying)
    noise = np.median(np.abs(alone[~outlying])) / MEDIAN / np.sqrt(share)
    size = np.where(outlying, 0.0, np.abs(alone))
    beside = np.maximum(np.roll(size, 1, 1), np.roll(size, -1, 1))
    stay = outlying & (np.abs(off) > KEPT_OUT * noise)
    new = (np.abs(alone) > TAKEN_OUT * noise) & (np.abs(alone) > LONELY * beside)
    found: Bools = stay | new
    found &= ~found.all(axis=1, keepdims=True)
    return found


def _less_neighbours(off: Floats, outlying: Bools | None = None) -> Floats:
    """Less the median over the contours next to each, which is the object's."""
    reach = min(NEAR_ROWS, (len(off) - 1) // 2)
    calm = off if outlying is None else np.where(outlying, 0.0, off)
    padded = np.pad(calm, ((reach, reach), (0, 0)), mode="reflect")
    near = np.stack([padded[row : row + len(off)] for row in range(2 * reach + 1)])
    if reach == 0:
        return off.copy()
    less: Floats = off - np.median(near, axis=0)
    return less


def _noise_between_neighbours(grid: Floats, across: Floats) -> float:
    """Deviation of the noise across, from each point's distance to the cubic through four."""
    one, two = (np.roll(grid, n, 1) + np.roll(grid, -n, 1) for n in (1, 2))
    off = np.einsum("mkd,mkd->mk", grid - (4.0 * one - two) / 6.0, across)
    return float(np.median(np.abs(off))) / MEDIAN / CUBIC_GAIN


def _off(grid: Floats, fit: ContourFit, across: Floats) -> Floats:
    """Distances across from a fit, (m, k)."""
    off: Floats = np.einsum("mkd,mkd->mk", grid - fit.fitted(), across)
    return off


def _bridged(grid: Floats, outlying: Bools) -> Floats:
    """With the points that stick out put between their neighbours around the contour."""
    bridged = grid.copy()
    turns = np.arange(grid.shape[1])
    for row in np.flatnonzero(outlying.any(axis=1)):
        out, kept = outlying[row], ~outlying[row]
        for axis in range(grid.shape[2]):
            values = grid[row, kept, axis]
            bridged[row, out, axis] = np.interp(turns[out], turns[kept], values, period=len(turns))
    return bridged
