"""Contours that went wrong: those that their neighbours agree against."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from palpate.core.arrays import Bools, Floats, finite_array
from palpate.core.rebuild.correspondence.leave_one_out import neighbour_weights

LEAST_SLICES = 9
"""A bad contour spoils five predictions: with fewer, nothing tells how good contours fare."""
USUAL = 0.2
"""Quantile of the prediction errors that stands for good contours: three bad ones spoil half."""
CLEARLY = 6.0
"""A bad contour is off by more than so many times that error,"""
LEAST_OFF = 0.02
"""and by more than this share of the mean distance from the middles: less does little harm."""
OWN = 0.2
"""Of that: a contour is looked at only if its own prediction is off by more. It would be by 0.7,
but a second bad one within 4 may take most of it away."""
UNEXPLAINED = 0.02
"""Of what the neighbours' predictions are off, squared, along the way in which a contour is: if
more is left when it is put right, the object itself is like that. Its edges leave 0.05, its steps
0.12."""
UNEXPLAINED_NEAR = 0.01
"""The same where another contour within 4 is bad as well, for two together explain more."""
UNEXPLAINED_END = 0.003
"""The same next to the lowest and the highest, where an object that rounds off leaves 0.01."""
PAIRED = (2, 3, 4)
"""Two bad contours so far apart spoil each other's test, and are tried together."""


class BadContours(NamedTuple):
    """What the test found."""

    bad: Bools
    """(M,): which contours to leave out."""
    off: Floats
    """(M,): by how much each of these is off, root mean square, m; 0 for the others."""
    usual: float
    """By how much good contours differ from what their neighbours predict, m."""


def bad_contours(heights: ArrayLike, grid: ArrayLike) -> BadContours:
    """Find contours that contradict their neighbours.

    Each contour is predicted from two neighbours on either side. If one of them is wrong by
    some displacement, its own prediction and those of its neighbours are off by known shares
    of that; where they are, it is bad. An edge, a step or a zigzag of the object itself leaves
    other shares. But what a single contour has seen, a groove narrower than twice the spacing,
    is no different from a contour gone wrong. The lowest and the highest contour are never
    bad: beyond them nothing tells how the object rounds off.

    Parameters
    ----------
    heights : (M,) array
        Rising, m.
    grid : (M, K, 2) array
        Contours, matched place by place, m.

    Returns
    -------
    BadContours
        None is bad where there are fewer than 9, or where so many are bad, more than one in
        five or so, that nothing tells how good ones fare.

    Raises
    ------
    ValueError
        If a shape is wrong, a number not finite, or the heights do not rise.
    """
    heights = finite_array("heights", heights, (None,))
    grid = finite_array("grid", grid, (len(heights), None, 2))
    if not (np.diff(heights) > 0.0).all():
        raise ValueError(f"heights must rise, got {heights.tolist()} m")
    count = len(heights)
    bad = np.zeros(count, dtype=bool)
    if count < LEAST_SLICES:
        return BadContours(bad, np.zeros(count), 0.0)
    shares, errors = _predictions(heights, grid)
    usual = float(np.quantile(_rms(errors), USUAL))
    size = float(_rms((grid - grid.mean(axis=1, keepdims=True)).reshape(count, -1)).mean())
    least = max(CLEARLY * usual, LEAST_OFF * size)
    while found := _worst(shares, errors, bad, least):
        bad[list(found)] = True
    off = np.zeros(count)
    if bad.any():
        off[bad] = _rms(_solve(shares[:, bad], errors))
    return BadContours(bad, off, usual)


def _predictions(heights: Floats, grid: Floats) -> tuple[Floats, Floats]:
    """What moves predictions (M, M), and by how much they are off (M, 2 K), in one's noise."""
    weights = neighbour_weights(heights)
    spread = np.sqrt(1.0 + (weights**2).sum(axis=1))
    shares = (weights - np.eye(len(heights))) / spread[:, None]
    return shares, shares @ grid.reshape(len(heights), -1)


def _worst(shares: Floats, errors: Floats, bad: Bools, least: float) -> tuple[int, ...]:
    """The contour, or else the two, that are bad besides those already found; none if no other."""
    count = len(errors)
    removed = np.linalg.qr(shares[:, bad])[0]
    columns = shares - removed @ (removed.T @ shares)
    errors = errors - removed @ (removed.T @ errors)
    beside = bad | np.roll(bad, 1) | np.roll(bad, -1)
    suspect = ~beside & (_rms(errors) > OWN * least)
    candidates = [row for row in range(1, count - 1) if suspect[row]]
    singles = [(row,) for row in candidates]
    pairs = [(row, row + apart) for apart in PAIRED for row in candidates]
    pairs = [pair for pair in pairs if pair[1] in candidates]
    for sets in (singles, pairs):
        gains = [_gain(shares, columns, errors, bad, rows, least) for rows in sets]
        if gains and max(gains) > 0.0:
            return sets[int(np.argmax(gains))]
    return ()


def _gain(
    shares: Floats, columns: Floats, errors: Floats, bad: Bools, rows: tuple[int, ...], least: float
) -> float:
    """Squared error that goes away if these contours are put right; 0 if they are not bad."""
    free = columns[:, rows]
    off = _solve(free, errors)
    if _rms(off).min() <= least:
        return 0.0
    left = errors - free @ off
    for row, one in zip(rows, off, strict=True):
        near = bad[max(row - PAIRED[-1], 0) : row + PAIRED[-1] + 1].any()
        allowed = UNEXPLAINED_NEAR if near or len(rows) > 1 else UNEXPLAINED
        allowed = UNEXPLAINED_END if row in (1, len(errors) - 2) else allowed
        # What is left along the way in which this contour is off, over that way's length.
        share = shares[:, row]
        seen = np.flatnonzero(share)
        rest = left[seen] @ one / (one @ one)
        if (rest**2).sum() > allowed * ((rest + share[seen]) ** 2).sum():
            return 0.0
    return float((errors**2).sum() - (left**2).sum())


def _solve(columns: Floats, errors: Floats) -> Floats:
    """Displacements (n, 2 K) of contours under which predictions are least off."""
    return np.asarray(np.linalg.lstsq(columns, errors, rcond=None)[0], np.float64)


def _rms(rows: Floats) -> Floats:
    """Root mean square distance (M,) that rows (M, 2 K) of x and y stand for."""
    lengths: Floats = np.sqrt(2.0 * (rows**2).mean(axis=1))
    return lengths
