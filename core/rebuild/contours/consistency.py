"""Contours that their neighbours contradict, and those that may be features.

Each contour is predicted from two neighbours on either side (leave one out, Lagrange's weights);
a wrong one spoils its own prediction and its neighbours' by known shares, which edges and steps
of the object do not.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from palpate.core.arrays import Bools, Floats, finite_array

LEAST_SLICES = 9  # A bad contour spoils five predictions: fewer slices do not tell good ones
USUAL = 0.2  # Quantile of the errors that stands for good contours: three bad ones spoil half
CLEARLY = 6.0  # A bad contour is off by more than so many times that error,
LEAST_OFF = 0.02  # and by more than this share of the mean distance from the middles
# Of that: a contour is looked at only if its own prediction is off by more. It would be by 0.7, but
# a second bad one within 4 may take most of it away.
OWN = 0.2
# Of what the neighbours' predictions are off, squared, along the way in which a contour is: if more
# is left when it is put right, the object itself is like that. Its edges leave 0.05, its steps
# 0.12.
UNEXPLAINED = 0.02
UNEXPLAINED_NEAR = 0.01  # Where another within 4 is bad as well: two explain more
UNEXPLAINED_END = 0.003  # Next to lowest and highest: objects that round off leave 0.01
PAIRED = (2, 3, 4)  # Two bad contours so far apart spoil each other's test, and are tried together
FAR = 0.1  # Of the mean radius: a contour that is off by less does little harm
CANDIDATE_CLEARLY = 4.0  # Times what its neighbours are off without it, that one must be off
# With fewer nothing is left to compare with. Of three the middle one may well be the widest; one
# that is narrower than both others, or aside, is a candidate.
CANDIDATE_LEAST_SLICES = 4
ALIKE = 0.05  # Root mean square difference of two shapes of radius 1 that are alike
EACH_SIDE = 2  # Neighbours below and above that tell of a contour


class InconsistentContours(NamedTuple):
    """What the test found."""

    bad: Bools  # (M,): which contours to leave out
    off: Floats  # (M,): by how much each of these is off, root mean square, m; 0 for the others
    usual: float  # By how much good contours differ from what their neighbours predict, m


def inconsistent_contours(heights: ArrayLike, grid: ArrayLike) -> InconsistentContours:
    """Find contours that contradict their neighbours.

    Of contours (M, K, 2) at rising heights (M,), matched place by place, m. A wrong one's own
    prediction and those of its neighbours are off by known shares of its displacement; an edge, a
    step or a zigzag of the object itself leaves other shares. But what a single contour has
    touched, a groove narrower than twice the spacing, is no different from a contour gone wrong.
    The lowest and the highest contour are never bad: beyond them nothing tells how the object
    rounds off. None is bad where there are fewer than 9, or so many bad, more than one in five or
    so, that nothing tells how good ones fare.

    Raises ValueError if a shape is wrong, a number not finite, or the heights do not rise.
    """
    heights = finite_array("heights", heights, (None,))
    grid = finite_array("grid", grid, (len(heights), None, 2))
    if not (np.diff(heights) > 0.0).all():
        raise ValueError(f"heights must rise, got {heights.tolist()} m")
    count = len(heights)
    bad = np.zeros(count, dtype=bool)
    if count < LEAST_SLICES:
        return InconsistentContours(bad, np.zeros(count), 0.0)
    shares, errors = _predictions(heights, grid)
    usual = float(np.quantile(_rms(errors), USUAL))
    size = float(_rms((grid - grid.mean(axis=1, keepdims=True)).reshape(count, -1)).mean())
    least = max(CLEARLY * usual, LEAST_OFF * size)
    while found := _worst(shares, errors, bad, least):
        bad[list(found)] = True
    off = np.zeros(count)
    if bad.any():
        off[bad] = _rms(_solve(shares[:, bad], errors))
    return InconsistentContours(bad, off, usual)


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
    looked_at = ~beside & (_rms(errors) > OWN * least)
    candidates = [row for row in range(1, count - 1) if looked_at[row]]
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
    return np.asarray(np.sqrt(2.0 * (rows**2).mean(axis=1)))


class FeatureCandidate(NamedTuple):
    """A contour that is used, though it is unlike its neighbours."""

    which: int  # Of the given contours
    height: float  # m
    off: float  # By how much it is unlike what they tell of it, root mean square, m


def neighbour_misfits(heights: Floats, grid: Floats) -> Floats:
    """By how much contours are unlike their neighbours, (M,), m; 0 where they are not clearly so.

    Of contours (M, K, 2) at rising heights (M,), matched place by place, m, one is put away, and
    the others are predicted from each other: where they agree far better than with it, it may have
    gone wrong, or have touched something by itself. The first and the last are candidates only if
    they are wider or farther aside than the others tell: an object may round off beyond them.
    """
    count = len(heights)
    found = np.zeros(count)
    middles = grid.mean(axis=1)
    radii = np.linalg.norm(grid - middles[:, None], axis=2).mean(axis=1)
    radius = float(radii.mean())
    if count < CANDIDATE_LEAST_SLICES:
        if count == CANDIDATE_LEAST_SLICES - 1:
            aside = np.linalg.norm(middles[1] - neighbour_weights(heights)[1] @ middles)
            off = max(float(aside), float(radii[[0, 2]].min() - radii[1]))
            found[1] = off if off > FAR * radius else 0.0
        return found
    missed = _rms_length(np.tensordot(neighbour_weights(heights), grid, 1) - grid)
    for row in np.flatnonzero(missed > FAR * radius):
        others = np.arange(count) != row
        rest = np.tensordot(neighbour_weights(heights[others]), grid[others], 1) - grid[others]
        usual = float(_rms_length(rest[1:-1]).max())
        if row in (0, count - 1):
            missed[row] = _beyond(heights, grid, int(row))
        if missed[row] > max(CANDIDATE_CLEARLY * usual, FAR * radius):
            found[row] = missed[row]
    # What is next to a wrong contour is unlike it as well: only the worst of neighbours counts.
    for row in np.argsort(-found):
        if found[row] > 0.0:
            beside = found[max(row - 1, 0) : row + 2]
            beside[beside < found[row]] = 0.0
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


def look_like_features(grid: Floats, star: Bools, bad: Bools) -> Bools:
    """Which bad contours (M,) look as if the object were like that: its shape in another size.

    A groove that one contour alone has touched is such a contour, and so is one wrong in scale.
    """
    middles = grid.mean(axis=1, keepdims=True)
    away = grid - middles
    shapes = away / np.sqrt((away**2).sum(axis=2).mean(axis=1))[:, None, None]
    good = np.flatnonzero(~bad)
    found = np.zeros(len(grid), np.bool_)
    for row in np.flatnonzero(bad & star):
        near = good[np.argmin(np.abs(good - row))]
        found[row] = float(_rms_length((shapes[row] - shapes[near])[None])[0]) < ALIKE
    return found


def _rms_length(apart: Floats) -> Floats:
    """Root mean square length (M,) of differences (M, K, 2)."""
    return np.asarray(np.sqrt((apart**2).sum(axis=2).mean(axis=1)))


def neighbour_weights(heights: Floats) -> Floats:
    """Weights (M, M) that predict contours at rising heights (M,): ``weights @ rows``.

    Lagrange's weights of the polynomial through the two nearest contours below and the two above,
    or as many as there are; at either end through the three nearest ones. Rows sum to 1; they are 0
    where there are fewer than 2 others.
    """
    return _weights(tuple(heights.tolist()))


@lru_cache(maxsize=64)
def _weights(levels: tuple[float, ...]) -> Floats:
    """The same, once for each stack; not to be written to."""
    heights, count = np.array(levels), len(levels)
    every = np.arange(count)
    weights = np.zeros((count, count))
    for row in range(count):
        below, above = every[:row], every[row + 1 :]
        if not len(below) or not len(above):
            near = np.concatenate([below[-EACH_SIDE - 1 :], above[: EACH_SIDE + 1]])
        else:
            near = np.concatenate([below[-EACH_SIDE:], above[:EACH_SIDE]])
        if len(near) >= 2:
            weights[row, near] = _lagrange(heights[near], levels[row])
    weights.setflags(write=False)
    return weights


def _lagrange(nodes: Floats, place: float) -> Floats:
    """Weights (k,) of values at the nodes (k,) in the polynomial's value at a place."""
    apart = nodes[:, None] - nodes
    others = ~np.eye(len(nodes), dtype=bool)
    shares = np.divide(place - nodes, apart, out=np.ones_like(apart), where=others)
    return np.asarray(shares.prod(axis=1))
