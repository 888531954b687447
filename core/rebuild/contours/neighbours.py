"""What neighbours predict of a contour, where along it they do, and contours that they contradict.

Contours are compared across their curves: how points are spaced along a contour, where it begins
and how many points it has is no difference of shape. Each is predicted from two neighbours on
either side (leave one out, Lagrange's weights); a wrong one spoils its own prediction and its
neighbours' by known shares, which edges and steps of the object do not.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.polynomial import Polynomial

from palpate.core.arrays import Bools, Floats
from palpate.core.rebuild.contours.curves import ContourCurve, chord_places
from palpate.core.splines import closed_curve_points, interpolate_closed

EACH_SIDE = 2  # Neighbours below and above that tell of a contour
# Of contours that are contradicted.
LEAST_SLICES = 9  # A bad contour spoils five predictions: fewer slices do not tell good ones
USUAL = 0.2  # Quantile of the errors that stands for good contours: three bad ones spoil half
CLEARLY = 4.2  # A bad contour is off, across its curve, by more than so many times that error,
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


@dataclass(frozen=True, slots=True)
class SlidingSettings:
    """How places slide along their curves to where those of the neighbours predict them.

    The predictions of all curves change at once, so that whole steps would diverge: the slide of
    every other curve is answered by -5/3 of it, and a step of half a slide leaves a third of that.
    """

    n_sweeps: int = 8
    damping: float = 0.5  # fraction of a slide that one sweep makes
    max_step: float = 0.02  # [turns], of one sweep


def slid_grid(
    heights: Floats,
    fine: Floats,
    turns: Floats,
    alone: int | None = None,
    settings: SlidingSettings = SlidingSettings(),
) -> Floats:
    """Places (M, K, 2) of curves that differ from their neighbours' across the curves alone.

    Of curves (M, n, 2) at rising heights (M,), from turns (M, K) that correspond. How points are
    spaced along a contour moves its places along the curve, which is no difference of shape. The
    contour `alone` moves no other: one that is wrong would drag its neighbours' places along.
    """
    weights, count = neighbour_weights(heights), fine.shape[1]
    if alone is not None:
        others = np.arange(len(heights)) != alone
        weights = weights.copy()
        weights[others, alone] = 0.0
        weights[np.ix_(others, others)] = neighbour_weights(heights[others])
    ahead = 0.5 * count * (np.roll(fine, -1, axis=1) - np.roll(fine, 1, axis=1))
    grid = chord_places(fine, turns)
    for _ in range(settings.n_sweeps):
        speed = chord_places(ahead, turns)
        square = (speed**2).sum(axis=2)
        along = ((np.tensordot(weights, grid, 1) - grid) * speed).sum(axis=2)
        slide = np.divide(along, square, out=np.zeros_like(along), where=square > 0.0)
        turns = turns + np.clip(settings.damping * slide, -settings.max_step, settings.max_step)
        grid = chord_places(fine, turns)
    return grid


@dataclass(frozen=True, slots=True)
class InterpolationSettings:
    """How far a curve may leave the contour between its points.

    Half of the points are predicted from the others. The error falls with the `order` of the
    spacing: 4 for a cubic where points are dense, 2 where they hardly tell the shape.
    """

    order: float = 2.0
    min_points: int = 6  # of a contour: half as many must make a curve
    certainty: float = 3.0  # of that error's root mean square: what is no difference of shape


def interpolation_errors(
    loops: Sequence[ContourCurve], settings: InterpolationSettings = InterpolationSettings()
) -> Floats:
    """What curves (M,) may be off between their points, (M,), m; infinite where too few tell."""
    return np.array([_interpolation_error(loop, settings) for loop in loops])


def _interpolation_error(loop: ContourCurve, settings: InterpolationSettings) -> float:
    points, count = loop.points, len(loop.points)
    if count < settings.min_points:
        return np.inf
    chords = np.linalg.norm(np.roll(points, -1, axis=0) - points, axis=1)
    turns = np.concatenate([[0.0], np.cumsum(chords)[:-1]]) / chords.sum()
    missed = np.empty(count)
    for first in (0, 1):
        kept, out = slice(first, None, 2), slice(1 - first, None, 2)
        begin = turns[kept][0]
        fit = interpolate_closed(points[kept], turns[kept] - begin)
        places = closed_curve_points(fit.control, fit.knots, np.mod(turns[out] - begin, 1.0))
        missed[out] = np.linalg.norm(places - points[out], axis=1)
    wide = chords + np.roll(chords, 1)  # the gap in which each point was left out
    share = chords / np.minimum(wide, np.roll(wide, -1))
    between = np.maximum(missed, np.roll(missed, -1)) * share**settings.order
    return settings.certainty * float(np.sqrt(np.average(between**2, weights=chords)))


def neighbour_weights(heights: Floats) -> Floats:
    """Weights (M, M) that predict contours at rising heights (M,): ``weights @ rows``.

    Lagrange's, by the two nearest contours below and above; at either end by the three nearest.
    Rows sum to 1; they are 0 where there are fewer than 2 others.
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
            weights[row, near] = lagrange_weights(heights[near], levels[row])
    weights.setflags(write=False)
    return weights


def lagrange_weights(nodes: Floats, place: float = 0.0) -> Floats:
    """Weights (..., k) of values at nodes (..., k) in their polynomial's value at a place."""
    apart = nodes[..., :, None] - nodes[..., None, :]
    others = np.broadcast_to(~np.eye(nodes.shape[-1], dtype=bool), apart.shape)
    ahead = np.broadcast_to((place - nodes)[..., None, :], apart.shape)
    return np.asarray(np.divide(ahead, apart, out=np.ones_like(apart), where=others).prod(axis=-1))


class InconsistentContours(NamedTuple):
    """What the test found."""

    bad: Bools  # (M,): which contours to leave out
    off: Floats  # (M,): by how much each of these is off, root mean square, m; 0 for the others


def inconsistent_contours(
    heights: Floats, grid: Floats, uncertain: Floats | None = None
) -> InconsistentContours:
    """Find contours that contradict their neighbours.

    Of contours (M, K, 2) at rising heights (M,), matched place by place, m; a contour that is off
    by no more than its `uncertain` (M,), m, is none. What a single contour
    has touched, a groove narrower than twice the spacing, is no different from a contour gone
    wrong. The lowest and the highest contour are never bad: beyond them nothing tells how the
    object rounds off. None is bad where there are fewer than 9, or so many bad, more than one in
    five or so, that nothing tells how good ones fare.
    """
    count = len(heights)
    bad = np.zeros(count, dtype=bool)
    if count < LEAST_SLICES:
        return InconsistentContours(bad, np.zeros(count))
    weights = neighbour_weights(heights)
    spread = np.sqrt(1.0 + (weights**2).sum(axis=1))
    # What moves predictions (M, M), and by how much they are off (M, 2 K), in one's noise.
    shares = (weights - np.eye(count)) / spread[:, None]
    errors = shares @ grid.reshape(count, -1)
    usual = float(np.quantile(_rms(errors), USUAL))
    size = float(_rms((grid - grid.mean(axis=1, keepdims=True)).reshape(count, -1)).mean())
    least = max(CLEARLY * usual, LEAST_OFF * size)
    allowed = np.full(count, least) if uncertain is None else np.maximum(uncertain, least)
    while found := _worst(shares, errors, bad, allowed):
        bad[list(found)] = True
    off = np.zeros(count)
    if bad.any():
        off[bad] = _rms(_solve(shares[:, bad], errors))
    return InconsistentContours(bad, off)


def _worst(shares: Floats, errors: Floats, bad: Bools, least: Floats) -> tuple[int, ...]:
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
    shares: Floats,
    columns: Floats,
    errors: Floats,
    bad: Bools,
    rows: tuple[int, ...],
    least: Floats,
) -> float:
    """Squared error that goes away if these contours are put right; 0 if they are not bad."""
    free = columns[:, rows]
    off = _solve(free, errors)
    if (_rms(off) <= least[list(rows)]).any():
        return 0.0
    left = errors - free @ off
    for row, one in zip(rows, off, strict=True):
        near = bad[max(row - PAIRED[-1], 0) : row + PAIRED[-1] + 1].any()
        allowed = UNEXPLAINED_NEAR if near or len(rows) > 1 else UNEXPLAINED
        allowed = UNEXPLAINED_END if row in (1, len(errors) - 2) else allowed
        share = shares[:, row]  # What is left along the way in which this contour is off
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
            missed[row] = _beyond(heights, middles, radii, int(row))
        if missed[row] > max(CANDIDATE_CLEARLY * usual, FAR * radius):
            found[row] = missed[row]
    # What is next to a wrong contour is unlike it as well: only the worst of neighbours counts.
    for row in np.argsort(-found):
        if found[row] > 0.0:
            beside = found[max(row - 1, 0) : row + 2]
            beside[beside < found[row]] = 0.0
    return found


def _beyond(heights: Floats, middles: Floats, radii: Floats, row: int) -> float:
    """How much wider, or farther aside, the first or last contour is than the others tell."""
    near = np.arange(1, 4) if row == 0 else np.arange(row - 3, row)
    radius, *place = (
        Polynomial.fit(heights[near], values[near], 1)(heights[row])
        for values in (radii, *middles.T)
    )
    wider = float(radii[row] - max(radius, radii[near].max()))
    return max(wider, float(np.linalg.norm(middles[row] - np.array(place))), 0.0)


def look_like_features(grid: Floats, star: Bools, bad: Bools) -> Bools:
    """Which bad contours (M,) look as if the object were like that: its shape in another size."""
    away = grid - grid.mean(axis=1, keepdims=True)
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
