"""Points around a closed curve in order, and fits of a cubic to them: interpolating or smoothed.

Smoothing is chosen by generalised cross-validation (Craven and Wahba, 1979) in the basis of Demmler
and Reinsch, in which the points' weight is the identity and the bending is diagonal, so that
coefficients, residuals and degrees of freedom for any strength are sums.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from palpate.core.arrays import Floats, Ints
from palpate.core.splines.bases import CUBIC, Basis, PeriodicBasis, periodic_knots

Smoothing = float | Literal["auto", "gcv"] | None
Parametrisation = Literal["auto", "chord", "centripetal", "even"]
MIN_CONTROL = CUBIC + 1
ROUNDING = 64 * float(np.finfo(float).eps)  # relative; points that spread less are one
LARGEST = float(np.finfo(float).max)


@dataclass(frozen=True, slots=True, kw_only=True)
class CurveFitSettings:
    """Choices of a closed curve: how many control points, and how strongly they are smoothed.

    Lengths are fractions of the curve's size; the smoothing is the weight of the bending against
    the mean weight of the points.
    """

    max_control: int = 100  # points, where no count is given; their system takes 5 ms
    max_gap_ratio: float = 20.0  # longest chord over the shortest; above it points are uneven
    min_noise: float = 1e-9  # smaller noise is not smoothed by default
    max_residual_ratio: float = 1.5  # residual over noise; if larger, smoothing lost shape
    n_resampled: int = 8  # even points for each control point, in place of uneven ones
    min_smoothing: float = 1e-5  # keeps the system definite where points are missing
    max_smoothing: float = 1e9  # more has no effect: the curve is a point
    # Decimal logarithms of the first and the last strength of cross-validation, and their number.
    strengths: tuple[float, float, int] = (-8.0, 3.0, 67)
    n_moves: int = 3  # of parameters to the nearest places of the curve, without smoothing
    max_move: float = 0.45  # of the gap to a neighbour, so that two points do not meet


@dataclass(frozen=True, slots=True, kw_only=True)
class ChordSettings:
    """Detection of corners, and of points at equal distances, from the chords of a curve."""

    corner_angle: float = np.pi / 3  # [rad] turn of the polygon at a corner
    max_corner_share: float = 0.2  # of the points; more such turns are noise
    # Points are at equal distances unless a ratio is larger. Chords across corners are shorter.
    max_to_tenth: float = 2.0  # longest chord over the lower tenth
    max_quartile_ratio: float = 1.25  # upper quartile over the lower
    max_to_quartile: float = 1.25  # longest chord over the upper quartile; a longer one is a gap


DEFAULT_CURVE_FIT = CurveFitSettings()


def choose_closed_fit(
    points: Floats,
    turns: Floats,
    count: int | None,
    smoothing: Smoothing,
    noise: float,
    settings: CurveFitSettings = DEFAULT_CURVE_FIT,
) -> CurveFit:
    """Periodic fit to points (m, d) at parameters (m,), at least 2 of them.

    `count` and `smoothing` are as for `fit_closed_curve`; `noise` is that of `local_noise`.
    """

    def fit(places: Floats, at: Floats, n_control: int, strength: float | None) -> CurveFit:
        return fit_closed_least_squares(places, at, n_control, strength, settings)

    n_chosen = count or int(np.clip(len(points) // 2, MIN_CONTROL, settings.max_control))
    if len(points) < 3:
        return fit(points, turns, MIN_CONTROL, settings.min_smoothing)
    if smoothing == "gcv":
        return fit(points, turns, n_chosen, None)
    if smoothing is not None and not isinstance(smoothing, str):
        return fit(points, turns, n_chosen, float(smoothing))
    if smoothing == "auto" and noise > settings.min_noise:
        smooth = fit(points, turns, n_chosen, None)
        offsets = points - closed_curve_points(smooth.control, smooth.knots, smooth.parameters)
        residual = np.sqrt((offsets**2).sum(axis=1).mean())
        if count is not None or residual <= settings.max_residual_ratio * noise:
            return smooth
    if count is not None and gap_ratio(points) <= settings.max_gap_ratio:
        return fit(points, turns, count, settings.min_smoothing)
    through = interpolate_closed(points, turns)
    if count is None:
        return through
    # Even knots have no points in the gaps: points of the interpolating curve replace all.
    n_points = settings.n_resampled * count
    even = np.arange(n_points) / n_points
    places = closed_curve_points(through.control, through.knots, even)
    return fit(places, even, count, settings.min_smoothing)._replace(parameters=turns)


class CurveFit(NamedTuple):
    """A closed cubic B-spline fitted to points."""

    control: Floats  # (n, d)
    knots: Floats  # (n + 7,), over 0 to 1; the first 3 control points are repeated
    parameters: Floats  # (m,), of the points, in turns
    condition: float  # condition number of the matrix from control points to points and bending
    effective: float  # degrees of freedom for each coordinate
    smoothing: float  # weight of the bending against the mean weight of the points


def closed_curve_points(
    control: Floats, knots: Floats, turns: Floats, derivative: int = 0
) -> Floats:
    """Points (k, d) of a closed cubic, or derivatives, at parameters (k,) from 0 to 1."""
    middle = control.mean(axis=0)  # small rounding errors for a small curve far away
    wound = np.vstack([control, control[:CUBIC]]) - middle
    values: Floats = Basis(knots, CUBIC).matrix(turns, derivative) @ wound
    return values if derivative else values + middle


def interpolate_closed(points: Floats, parameters: Floats) -> CurveFit:
    """Closed cubic through points (m, d), at least 3, at increasing parameters (m,) from 0.

    Knots lie at the parameters, so that the system is diagonally dominant for any spacing of the
    points; with even knots and as many points it may be singular.
    """
    count = len(points)
    # One more coordinate: alternating signs have the largest control points, which are the
    # condition number in the maximum norm.
    signs = np.where(np.arange(count) % 2, -1.0, 1.0)
    wanted = np.column_stack([points, signs])
    after = np.diff(parameters, append=1.0)[:, None]
    before = np.roll(after, 1, axis=0)
    chords = (np.roll(wanted, -1, axis=0) - wanted) / after
    slopes = _closed_slopes(after[:, 0], chords)
    bends = (6.0 * chords - 4.0 * slopes - 2.0 * np.roll(slopes, -1, axis=0)) / after
    # The control point of the knot t between its neighbours t - a and t + b is the blossom
    # f(t - a, t, t + b). The first belongs to the last parameter.
    control = wanted + (after - before) / 3.0 * slopes - after * before / 6.0 * bends
    control = np.roll(control, 1, axis=0)
    return CurveFit(
        control=control[:, :-1],
        knots=closed_knots(parameters),
        parameters=parameters,
        condition=float(np.abs(control[:, -1]).max()),
        effective=float(count),
        smoothing=0.0,
    )


def _closed_slopes(steps: Floats, chords: Floats) -> Floats:
    """Slopes (n, d) of the closed cubic spline with steps (n,) and slopes of its chords (n, d).

    At each knot the second derivatives of both sides are equal: de Boor, *A practical guide to
    splines*, 1978, chapter IV. The entries outside the three diagonals are a product of two vectors
    (Sherman and Morrison, 1950). Not scipy's spline: its import takes longer than a hundred fits.
    """
    before = np.roll(steps, 1)
    right = 3.0 * (steps[:, None] * np.roll(chords, 1, axis=0) + before[:, None] * chords)
    middle = 2.0 * (steps + before)
    first, last = steps[0], before[-1]  # entries in the two corners
    rows = np.zeros((3, len(steps)))
    rows[0, 1:], rows[1], rows[2, :-1] = before[:-1], middle, steps[1:]
    rows[1, 0] += middle[0]
    rows[1, -1] += first * last / middle[0]
    column = np.zeros((len(steps), 1))
    column[0], column[-1] = -middle[0], last
    sides = np.hstack([right, column])
    solved = scipy.linalg.solve_banded((1, 1), rows, sides, check_finite=False)
    plain, correction = solved[:, :-1], solved[:, -1]
    ratio = -first / middle[0]  # the product's other factor is (1, 0, ..., 0, ratio)
    amount = (plain[0] + ratio * plain[-1]) / (1.0 + correction[0] + ratio * correction[-1])
    return np.asarray(plain - correction[:, None] * amount)


def closed_knots(parameters: Floats) -> Floats:
    """Knots (n + 7,) of a closed cubic with breaks (n,), at least 3, from 0 up to below 1."""
    count = len(parameters)
    turns = np.concatenate([parameters + turn for turn in (-1.0, 0.0, 1.0, 2.0)])
    return turns[count - 3 : 2 * count + 4]


def fit_closed_least_squares(
    points: Floats,
    parameters: Floats,
    count: int,
    smoothing: float | None,
    settings: CurveFitSettings = DEFAULT_CURVE_FIT,
) -> CurveFit:
    """Closed cubic of `count` control points, at least 4.

    `points` (m, d): around the curve. `parameters` (m,): increasing, in turns. `count`: control
    points. `smoothing`: weight of the bending against the mean weight of the points, clipped to the
    range of the settings; None chooses it by cross-validation.
    """
    periodic = PeriodicBasis(count)
    bending = _bending(count)
    if smoothing is None:
        basis = _dense(periodic, parameters)[0]
        strength = choose_smoothing(basis, bending, points, settings.strengths)
    else:
        strength = smoothing
    strength = min(max(strength, settings.min_smoothing), settings.max_smoothing)
    # For noisy points the nearest places on the curve are no better parameters.
    is_smoothed = smoothing is None or smoothing > settings.min_smoothing
    n_moves = 0 if is_smoothed else settings.n_moves
    for move in range(n_moves + 1):
        basis, slopes = _dense(periodic, parameters)
        weight = basis.T @ basis
        mean = np.trace(weight) / count
        factor = scipy.linalg.cho_factor(weight / mean + strength * bending)
        control = scipy.linalg.cho_solve(factor, basis.T @ points / mean)
        if move < n_moves:
            places, along = basis @ control, slopes @ control
            parameters = moved_parameters(parameters, points, places, along, settings.max_move)
    eigenvalues = np.linalg.eigvalsh(weight / mean + strength * bending)
    return CurveFit(
        control=control,
        knots=periodic_knots(count),
        parameters=np.mod(parameters, 1.0),
        condition=float(np.sqrt(eigenvalues[-1] / eigenvalues[0])),
        effective=float(np.trace(scipy.linalg.cho_solve(factor, weight / mean))),
        smoothing=strength,
    )


def _bending(count: int) -> Floats:
    """Sum of the squared second differences around the circle, over its mean diagonal."""
    second = np.roll(np.eye(count), 1, axis=1) - 2.0 * np.eye(count)
    second += np.roll(np.eye(count), -1, axis=1)
    return second.T @ second / 6.0


def choose_smoothing(
    basis: Floats,
    bending: Floats,
    points: Floats,
    strengths: tuple[float, float, int] = DEFAULT_CURVE_FIT.strengths,
) -> float:
    """The smoothing of the least generalised cross-validation score (Craven and Wahba, 1979).

    `strengths`: decimal logarithms of the first and the last that is tried, and their number.
    """
    count, tried = len(points), np.logspace(*strengths)
    weight = basis.T @ basis
    weight /= np.trace(weight) / len(weight)
    modes = demmler_reinsch(weight, bending, basis)
    parts = modes.shapes.T @ points
    unfitted = float(((points - modes.shapes @ parts) ** 2).sum())
    squares = unfitted + modes.lost(tried) ** 2 @ (parts**2).sum(axis=1)
    freedom = np.maximum(1.0 - modes.kept(tried).sum(axis=1) / count, 1.0 / count)
    return float(tried[np.argmin(squares / freedom**2)])


def _dense(periodic: PeriodicBasis, parameters: Floats) -> Floats:
    """Basis functions and their derivatives, dense (2, m, n): for so few, sparse is slower."""
    local = periodic.nonzero(parameters, 1)
    dense = np.zeros((2, len(parameters), periodic.count))
    rows = np.arange(len(parameters))[:, None]
    dense[:, rows, local.columns() % periodic.count] = local.values
    return dense


def moved_parameters(
    parameters: Floats, points: Floats, places: Floats, slopes: Floats, max_move: float = 0.45
) -> Floats:
    """Parameters after the step of Fung, 1999, (4.40), clipped so that none passes a neighbour.

    `max_move`: fraction of the gap to a neighbour, below 0.5.
    """
    squares = np.einsum("md,md->m", slopes, slopes)
    wanted = np.einsum("md,md->m", points - places, slopes)
    step = np.divide(wanted, squares, out=np.zeros_like(wanted), where=squares > 0.0)
    ahead = np.diff(parameters, append=parameters[0] + 1.0)
    step = np.clip(step, -max_move * np.roll(ahead, 1), max_move * ahead)
    return np.asarray(parameters + step)


class Modes(NamedTuple):
    """Combinations of basis functions that stay uncoupled at any strength of smoothing."""

    shapes: Floats  # values at the points (m, r), orthonormal columns
    control: Floats  # coefficients (n, r): ``shapes`` is the basis times them
    stiffness: Floats  # (r,): smoothing by s keeps ``1 / (1 + s stiffness)``

    def kept(self, strengths: Floats) -> Floats:
        """Fraction of each mode that smoothing by strengths (s,) keeps, (s, r)."""
        return 1.0 / (1.0 + strengths[:, None] * self.stiffness)

    def lost(self, strengths: Floats) -> Floats:
        """Fraction that is not kept, (s, r), to full relative precision."""
        stiff = strengths[:, None] * self.stiffness
        return stiff / (1.0 + stiff)


def demmler_reinsch(
    weight: Floats,
    bending: Floats,
    basis: Floats,
    *,
    min_weight: float = 1e-12,
    ridge: float = 1e-13,
) -> Modes:
    """Modes of points and a penalty.

    Demmler and Reinsch, 1975: the modes v solve ``G v = mu (G + B) v``, G the weight ``basis.T @
    basis`` over its mean diagonal, B the bending in the same measure: unlike ``B v = w G v`` this
    is well conditioned for any points. Modes with a share of weight ``mu`` below `min_weight` are
    dropped. `ridge` is added to ``G + B``, so that it has a Cholesky factor.
    """
    mu, control = scipy.linalg.eigh(weight, weight + bending + ridge * np.eye(len(weight)))
    mu = np.clip(mu, 0.0, 1.0)
    control, mu = control[:, mu > min_weight], mu[mu > min_weight]
    shapes = basis @ control
    length = np.linalg.norm(shapes, axis=0)
    return Modes(shapes / length, control / length, (1.0 - mu) / mu)


def curve_parameters(
    points: Floats, kind: Parametrisation, settings: ChordSettings = ChordSettings()
) -> Floats:
    """Parameters (m,) of points (m, d) around a closed curve; the first is 0.

    In proportion to the chords between neighbours, (4.28), or to their square roots, (4.18) of
    Fung, 1999; both with the chord that closes the curve, which the text leaves out. "auto" takes
    square roots where a few of the points are corners: there chords overshoot. "even" takes equal
    steps where the points are at equal distances along the curve (chords across corners are
    shorter), and chords otherwise.
    """
    chords = np.linalg.norm(np.roll(points, -1, axis=0) - points, axis=1)
    if kind == "even" and are_even_chords(chords, settings=settings):
        return np.arange(len(points)) / len(points)
    if kind == "centripetal" or (kind == "auto" and _has_corners(points, settings)):
        chords = np.sqrt(chords)
    ends = np.cumsum(chords)
    return np.asarray(np.concatenate([[0.0], ends[:-1]]) / ends[-1])


def are_even_chords(
    chords: Floats, reach: int = 1, settings: ChordSettings = ChordSettings()
) -> bool:
    """Whether chords (m,) are those of points at equal distances along a curve, with corners.

    Each chord spans `reach` points: a gap lengthens all chords across it, where noise and an
    outlier lengthen single ones. Their median counts.
    """
    tenth, lower, upper = np.quantile(chords, [0.1, 0.25, 0.75])
    across = np.median([np.roll(chords, by) for by in range(reach)], axis=0)
    has_gap = (
        chords.max() > settings.max_to_tenth * tenth
        or across.max() > settings.max_to_quartile * upper
    )
    return bool(not has_gap and upper <= settings.max_quartile_ratio * lower)


def _has_corners(points: Floats, settings: ChordSettings) -> bool:
    back, ahead = points - np.roll(points, 1, axis=0), np.roll(points, -1, axis=0) - points
    along = np.einsum("md,md->m", back, ahead)
    lengths = np.linalg.norm(back, axis=1) * np.linalg.norm(ahead, axis=1)
    corners = np.count_nonzero(along < np.cos(settings.corner_angle) * lengths)
    return bool(0 < corners <= settings.max_corner_share * len(points))


def gap_ratio(points: Floats) -> float:
    """The longest chord of a closed polygon (m, d) over its shortest."""
    chords = np.linalg.norm(np.roll(points, -1, axis=0) - points, axis=1)
    return float(chords.max() / chords.min())


class ClosedPoints(NamedTuple):
    """Points around a closed curve, each different from the next."""

    points: Floats  # (m, d), less the middle and over the size, within 1/2 of 0
    rows: Ints  # (m,): their rows in the input
    middle: Floats  # (d,) [m]
    size: float  # [m] longest side of the points' box; 0 where they are one point
    dropped: int  # rows that were not finite


def order_closed_points(points: Floats, min_distance: float = 1e-12) -> ClosedPoints:
    """Drop rows that are not finite or repeated; centre, scale, and order the others.

    The order begins at the point that is last in lexicographic order, and runs counter-clockwise
    (seen along the axis along which the curve's area is largest). It does not depend, to the last
    bit, on the first point and the direction of the input. `min_distance`: fraction of the size;
    closer neighbours are one point. Raises ValueError if no row is finite, or their spread exceeds
    the range of numbers.
    """
    if points.ndim != 2 or points.shape[1] not in (2, 3):
        raise ValueError(f"points must have shape (any, 2) or (any, 3), got {points.shape}")
    rows = np.flatnonzero(np.isfinite(points).all(axis=1)).astype(np.int32)
    dropped = len(points) - len(rows)
    if not len(rows):
        raise ValueError(f"points must have at least one finite row, got {len(points)} rows")
    finite = points[rows]
    low, high = finite.min(axis=0), finite.max(axis=0)
    middle = 0.5 * low + 0.5 * high  # of the box: the rounding of a mean depends on the order
    size = 2.0 * float(np.max(0.5 * high - 0.5 * low))
    if size == np.inf:
        raise ValueError(f"points must spread less than {LARGEST:g} m, got {low} to {high} m")
    if size <= ROUNDING * float(np.abs(finite).max()):
        return ClosedPoints(np.zeros((1, points.shape[1])), rows[:1], middle, 0.0, dropped)
    scaled = (finite - middle) / size
    order = np.flatnonzero((scaled != np.roll(scaled, 1, axis=0)).any(axis=1))
    order = order[_canonical(scaled[order])]
    ahead = np.linalg.norm(scaled[order] - np.roll(scaled[order], -1, axis=0), axis=1)
    order = order[ahead > min_distance]
    return ClosedPoints(scaled[order], rows[order], middle, size, dropped)


def _canonical(points: Floats) -> Ints:
    """Order (m,) that does not depend on the first point and the direction of the input."""
    count = len(points)
    around = np.arange(count)
    order = np.lexsort(points.T[::-1])
    differs = (points[order[1:]] != points[order[:-1]]).any(axis=1)
    rank = np.zeros(count, np.int64)
    rank[order[1:]] = np.cumsum(differs)
    onwards = (_begin(rank) + around) % count
    backwards = (count - 1 - _begin(rank[::-1]) - around) % count
    best = max(onwards, backwards, key=lambda order: rank[order].tolist())
    normal = area_vector(points[best])
    if normal[np.argmax(np.abs(normal))] < 0.0:
        best = best[-around]
    return best.astype(np.int32)


def _begin(rank: NDArray[np.int64]) -> int:
    """First index for which the ranks (m,), read around, are last in lexicographic order.

    Ties are decided by the ranks that follow, of which twice as many are compared each time.
    """
    reach = 1
    while reach < len(rank) and np.count_nonzero(rank == rank.max()) > 1:
        rank = rank * len(rank) + np.roll(rank, -reach)
        rank = np.unique(rank, return_inverse=True)[1]
        reach *= 2
    return int(rank.argmax())


def area_vector(points: Floats) -> Floats:
    """Normal of a closed polygon (m, d), as long as its area: (1,) for d = 2, (3,) for d = 3."""
    following = np.roll(points, -1, axis=0)
    if points.shape[1] == 2:
        twice = points[:, 0] * following[:, 1] - points[:, 1] * following[:, 0]
        return np.array([0.5 * twice.sum()])
    return np.asarray(0.5 * np.cross(points, following).sum(axis=0))
