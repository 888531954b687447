"""Leave-one-out prediction of contours from their neighbours, and contours that contradict it.

Contours are compared across their curves: how points are spaced along a contour, where it begins
and how many points it has is no difference of shape. Each contour is predicted by Lagrange's
weights from two neighbours on either side. A wrong contour spoils its own prediction and those of
its neighbours by known shares; edges and steps of the object do not have this pattern.
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


@dataclass(frozen=True, slots=True)
class SlidingSettings:
    """How places slide along their curves to where those of the neighbours predict them.

    All curves slide at once. Where they are off by d and -d in turn, Lagrange's weights predict
    -5/3 d: whole slides would leave -5/3 d and diverge, half slides leave -1/3 d.
    """

    n_sweeps: int = 8  # in each of which all curves slide
    damping: float = 0.5  # fraction of a slide made in one sweep; diverges from 0.75 on
    max_step: float = 0.02  # [turns] of a place in one sweep


def slide_along_curves(
    heights: Floats,
    fine: Floats,
    turns: Floats,
    passive: int | None = None,
    settings: SlidingSettings = SlidingSettings(),
) -> Floats:
    """Places (M, K, 2) of curves that differ from the neighbours' places only across the curves.

    The curves (M, n, 2) are at rising heights (M,), their corresponding places at `turns` (M, K).
    The spacing of points along a contour shifts its places along the curve, which is no difference
    of shape. The `passive` contour influences no other: a wrong contour would displace the places
    of its neighbours.
    """
    weights, count = neighbour_weights(heights), fine.shape[1]
    if passive is not None:
        active = np.arange(len(heights)) != passive
        weights = weights.copy()
        weights[active, passive] = 0.0
        weights[np.ix_(active, active)] = neighbour_weights(heights[active])
    tangents = 0.5 * count * (np.roll(fine, -1, axis=1) - np.roll(fine, 1, axis=1))
    grid = chord_places(fine, turns)
    for _ in range(settings.n_sweeps):
        speed = chord_places(tangents, turns)
        square = (speed**2).sum(axis=2)
        along = ((np.tensordot(weights, grid, 1) - grid) * speed).sum(axis=2)
        slide = np.divide(along, square, out=np.zeros_like(along), where=square > 0.0)
        turns = turns + np.clip(settings.damping * slide, -settings.max_step, settings.max_step)
        grid = chord_places(fine, turns)
    return grid


@dataclass(frozen=True, slots=True)
class InterpolationSettings:
    """How far a curve may leave the contour between its points.

    Half of the points are predicted from the other half, at twice the spacing. The error grows with
    the spacing to the power `order`: 4 for a cubic of dense points, 2 for points that are sparse.
    """

    order: float = 2.0  # larger ones give smaller bounds
    min_points: int = 6  # of fewer, half make no curve: their bound is infinite
    certainty: float = 3.0  # bound over the root mean square error


def interpolation_errors(
    loops: Sequence[ContourCurve], settings: InterpolationSettings = InterpolationSettings()
) -> Floats:
    """Bounds (M,) [m] of the error of curves between their points; infinite for few points."""
    return np.array([_interpolation_error(loop, settings) for loop in loops])


def _interpolation_error(loop: ContourCurve, settings: InterpolationSettings) -> float:
    points, count = loop.points, len(loop.points)
    if count < settings.min_points:
        return np.inf
    chords = np.linalg.norm(np.roll(points, -1, axis=0) - points, axis=1)
    turns = np.concatenate([[0.0], np.cumsum(chords)[:-1]]) / chords.sum()
    errors = np.empty(count)
    for first in (0, 1):
        kept, left_out = slice(first, None, 2), slice(1 - first, None, 2)
        begin = turns[kept][0]
        fit = interpolate_closed(points[kept], turns[kept] - begin)
        places = closed_curve_points(fit.control, fit.knots, np.mod(turns[left_out] - begin, 1.0))
        errors[left_out] = np.linalg.norm(places - points[left_out], axis=1)
    gaps = chords + np.roll(chords, 1)  # in which each point was left out
    share = chords / np.minimum(gaps, np.roll(gaps, -1))
    between = np.maximum(errors, np.roll(errors, -1)) * share**settings.order
    return settings.certainty * float(np.sqrt(np.average(between**2, weights=chords)))


def neighbour_weights(heights: Floats, n_each_side: int = 2) -> Floats:
    """Weights (M, M) that predict contours at rising heights (M,): ``weights @ rows``.

    Lagrange's, from the `n_each_side` nearest contours below and above; for the first and the last
    contour from one more on the only side. Rows sum to 1; they are 0 with fewer than 2 other
    contours.
    """
    return _weights(tuple(heights.tolist()), n_each_side)


@lru_cache(maxsize=64)
def _weights(levels: tuple[float, ...], n_each_side: int) -> Floats:
    """`neighbour_weights`, read-only, computed once for each stack."""
    heights, count = np.array(levels), len(levels)
    rows = np.arange(count)
    weights = np.zeros((count, count))
    for row in range(count):
        below, above = rows[:row], rows[row + 1 :]
        width = n_each_side if len(below) and len(above) else n_each_side + 1
        near = np.concatenate([below[-width:], above[:width]])
        if len(near) >= 2:
            weights[row, near] = lagrange_weights(heights[near], levels[row])
    weights.setflags(write=False)
    return weights


def lagrange_weights(nodes: Floats, place: float = 0.0) -> Floats:
    """Weights (..., k) of values at nodes (..., k) in their polynomial's value at a place."""
    apart = nodes[..., :, None] - nodes[..., None, :]
    is_other = np.broadcast_to(~np.eye(nodes.shape[-1], dtype=bool), apart.shape)
    ahead = np.broadcast_to((place - nodes)[..., None, :], apart.shape)
    factors = np.divide(ahead, apart, out=np.ones_like(apart), where=is_other)
    return np.asarray(factors.prod(axis=-1))


@dataclass(frozen=True, slots=True, kw_only=True)
class InconsistencySettings:
    """When a contour contradicts its neighbours; tuned on profiles with edges, steps and noise.

    The residual is what remains of the squared errors of the predictions, in the direction in which
    the contour is off, when the contour is put right. Edges of the object leave 0.05, its steps
    0.12; next to the lowest and highest contour, objects that round off leave 0.01.
    """

    n_each_side: int = 2  # neighbours below and above that predict a contour
    # In smaller stacks no contour is bad: each bad one spoils five predictions.
    min_contours: int = 9
    # Quantile of all errors that is taken for the error of a good contour. It is low because three
    # bad contours spoil half of all predictions.
    usual_quantile: float = 0.2
    # A bad contour exceeds both thresholds with its error.
    min_error_ratio: float = 4.2  # over the error of a good contour
    min_error: float = 0.02  # fraction of the mean radius
    # Fraction of the larger threshold: contours whose own prediction errs by less are not tested.
    # 0.7 suffices for a single bad contour; a second one within 4 may hide most of its error.
    min_own_error: float = 0.2
    max_residual: float = 0.02  # fraction of the squared errors; smaller ones spare more contours
    max_residual_near_bad: float = 0.01  # where another contour within 4 is bad, too
    max_residual_near_end: float = 0.003  # of the second and the last but one contour


class InconsistentContours(NamedTuple):
    """Contours that contradict their neighbours."""

    bad: Bools  # (M,): contours to leave out
    offsets: Floats  # (M,) [m]: root mean square error of each bad contour; 0 for the good ones


def inconsistent_contours(
    heights: Floats,
    grid: Floats,
    uncertain: Floats | None = None,
    settings: InconsistencySettings = InconsistencySettings(),
) -> InconsistentContours:
    """Find contours that contradict their neighbours.

    `grid` (M, K, 2): matched places [m] of contours at rising heights (M,). A contour whose error
    is at most `uncertain` (M,) [m] is good. A groove narrower than twice the spacing, which only
    one contour touched, cannot be told from a wrong contour. The lowest and the highest contour are
    never bad, for nothing beyond them shows how the object rounds off. No contour is bad where
    there are fewer than `settings.min_contours`, or so many are wrong (about more than a fifth)
    that the error of good contours is unknown.
    """
    count = len(heights)
    bad = np.zeros(count, dtype=bool)
    if count < settings.min_contours:
        return InconsistentContours(bad, np.zeros(count))
    weights = neighbour_weights(heights, settings.n_each_side)
    spread = np.sqrt(1.0 + (weights**2).sum(axis=1))
    # Influence (M, M) of contours on predictions, and errors (M, 2 K) of predictions. Both are
    # divided by the error's standard deviation for noise of 1.
    shares = (weights - np.eye(count)) / spread[:, None]
    errors = shares @ grid.reshape(count, -1)
    usual = float(np.quantile(_rms(errors), settings.usual_quantile))
    size = float(_rms((grid - grid.mean(axis=1, keepdims=True)).reshape(count, -1)).mean())
    limit = max(settings.min_error_ratio * usual, settings.min_error * size)
    allowed = np.full(count, limit) if uncertain is None else np.maximum(uncertain, limit)
    while rows := _next_bad(shares, errors, bad, allowed, settings):
        bad[list(rows)] = True
    offsets = np.zeros(count)
    if bad.any():
        offsets[bad] = _rms(_displacements(shares[:, bad], errors))
    return InconsistentContours(bad, offsets)


def _next_bad(
    shares: Floats, errors: Floats, bad: Bools, allowed: Floats, settings: InconsistencySettings
) -> tuple[int, ...]:
    """The next bad contour besides the known ones, or else a pair of them; empty if none is."""
    count = len(errors)
    known = np.linalg.qr(shares[:, bad])[0]
    columns = shares - known @ (known.T @ shares)
    errors = errors - known @ (known.T @ errors)
    beside = bad | np.roll(bad, 1) | np.roll(bad, -1)
    tested = ~beside & (_rms(errors) > settings.min_own_error * allowed)
    candidates = [row for row in range(1, count - 1) if tested[row]]
    singles = [(row,) for row in candidates]
    # Two bad contours that share predictions spoil each other's test, and are tested together.
    distances = range(2, 2 * settings.n_each_side + 1)
    pairs = [(row, row + distance) for distance in distances for row in candidates]
    pairs = [pair for pair in pairs if pair[1] in candidates]
    for sets in (singles, pairs):
        gains = [_gain(shares, columns, errors, bad, rows, allowed, settings) for rows in sets]
        if gains and max(gains) > 0.0:
            return sets[int(np.argmax(gains))]
    return ()


def _gain(
    shares: Floats,
    columns: Floats,
    errors: Floats,
    bad: Bools,
    rows: tuple[int, ...],
    allowed: Floats,
    settings: InconsistencySettings,
) -> float:
    """Decrease of the squared errors if these contours are put right; 0 if they are not bad."""
    influence = columns[:, rows]
    offsets = _displacements(influence, errors)
    if (_rms(offsets) <= allowed[list(rows)]).any():
        return 0.0
    remaining = errors - influence @ offsets
    reach = 2 * settings.n_each_side
    for row, offset in zip(rows, offsets, strict=True):
        near = bad[max(row - reach, 0) : row + reach + 1].any() or len(rows) > 1
        max_residual = settings.max_residual_near_bad if near else settings.max_residual
        if row in (1, len(errors) - 2):
            max_residual = settings.max_residual_near_end
        share = shares[:, row]
        spoilt = np.flatnonzero(share)  # predictions
        rest = remaining[spoilt] @ offset / (offset @ offset)  # in the direction of the offset
        if (rest**2).sum() > max_residual * ((rest + share[spoilt]) ** 2).sum():
            return 0.0
    return float((errors**2).sum() - (remaining**2).sum())


def _displacements(columns: Floats, errors: Floats) -> Floats:
    """Displacements (n, 2 K) of contours that minimise the errors of the predictions."""
    return np.asarray(np.linalg.lstsq(columns, errors, rcond=None)[0], np.float64)


def _rms(rows: Floats) -> Floats:
    """Root mean square distance (M,) of rows (M, 2 K) of x and y."""
    return np.asarray(np.sqrt(2.0 * (rows**2).mean(axis=1)))


class FeatureCandidate(NamedTuple):
    """A contour that is used, though it is unlike its neighbours."""

    which: int  # number of the contour as it was given
    height: float  # [m]
    off: float  # root mean square difference from its neighbours' prediction [m]


@dataclass(frozen=True, slots=True, kw_only=True)
class MisfitSettings:
    """When a contour that is used counts as unlike its neighbours."""

    # Of one contour fewer only the middle one is judged: a misfit if it is narrower than both
    # others or lies aside of them, not if it is the widest. In smaller stacks none is judged.
    min_contours: int = 4
    min_error_ratio: float = 4.0  # over the others' largest error where it is left out
    min_error: float = 0.1  # fraction of the mean radius: less does little harm


def neighbour_misfits(
    heights: Floats, grid: Floats, settings: MisfitSettings = MisfitSettings()
) -> Floats:
    """How much contours are unlike their neighbours, (M,) [m]; 0 where they are not clearly so.

    `grid` (M, K, 2): matched places [m] of contours at rising heights (M,). Each contour is left
    out, and the others are predicted from each other: where they agree far better than with it, it
    may be wrong, or have touched a feature that no other contour did. The first and the last
    contour count only if they are wider or farther aside than predicted, for an object may round
    off there.
    """
    count = len(heights)
    middles = grid.mean(axis=1)
    radii = np.linalg.norm(grid - middles[:, None], axis=2).mean(axis=1)
    min_misfit = settings.min_error * float(radii.mean())
    misfits = np.zeros(count)
    if count < settings.min_contours:
        if count == settings.min_contours - 1:
            aside = np.linalg.norm(middles[1] - neighbour_weights(heights)[1] @ middles)
            misfit = max(float(aside), float(radii[[0, 2]].min() - radii[1]))
            misfits[1] = misfit if misfit > min_misfit else 0.0
        return misfits
    errors = _rms_length(np.tensordot(neighbour_weights(heights), grid, 1) - grid)
    for row in np.flatnonzero(errors > min_misfit):
        kept = np.arange(count) != row
        rest = np.tensordot(neighbour_weights(heights[kept]), grid[kept], 1) - grid[kept]
        usual = float(_rms_length(rest[1:-1]).max())
        if row in (0, count - 1):
            errors[row] = _end_misfit(heights, middles, radii, int(row))
        if errors[row] > max(settings.min_error_ratio * usual, min_misfit):
            misfits[row] = errors[row]
    # A wrong contour makes its neighbours unlike it as well: only the worst of them is kept.
    for row in np.argsort(-misfits):
        if misfits[row] > 0.0:
            beside = misfits[max(row - 1, 0) : row + 2]
            beside[beside < misfits[row]] = 0.0
    return misfits


def _end_misfit(heights: Floats, middles: Floats, radii: Floats, row: int) -> float:
    """How much wider, or farther aside, the first or last contour is than a line predicts [m]."""
    near = np.arange(1, 4) if row == 0 else np.arange(row - 3, row)
    radius, *place = (
        Polynomial.fit(heights[near], values[near], 1)(heights[row])
        for values in (radii, *middles.T)
    )
    wider = float(radii[row] - max(radius, radii[near].max()))
    return max(wider, float(np.linalg.norm(middles[row] - np.array(place))), 0.0)


def may_be_features(
    grid: Floats, star: Bools, bad: Bools, max_shape_difference: float = 0.05
) -> Bools:
    """Bad contours (M,) that have the shape of the nearest good one, in another size.

    `max_shape_difference`: root mean square, of both shapes scaled to a radius of 1. Only contours
    that are `star`-shaped are compared.
    """
    away = grid - grid.mean(axis=1, keepdims=True)
    shapes = away / np.sqrt((away**2).sum(axis=2).mean(axis=1))[:, None, None]
    good = np.flatnonzero(~bad)
    alike = np.zeros(len(grid), np.bool_)
    for row in np.flatnonzero(bad & star):
        near = good[np.argmin(np.abs(good - row))]
        difference = float(_rms_length((shapes[row] - shapes[near])[None])[0])
        alike[row] = difference < max_shape_difference
    return alike


def _rms_length(vectors: Floats) -> Floats:
    """Root mean square length (M,) of vectors (M, K, 2)."""
    return np.asarray(np.sqrt((vectors**2).sum(axis=2).mean(axis=1)))
