"""Points around a closed curve in order, and ways to fit a cubic to them: through, or smoothed.

Smoothing is chosen by generalised cross-validation (Craven and Wahba, 1979) in the basis of Demmler
and Reinsch, in which the points' weight is the identity and the bending is diagonal, so that
coefficients, residuals and degrees of freedom for any strength are sums.
"""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from palpate.core.arrays import Floats, Ints
from palpate.core.splines.bases import CUBIC, Basis, PeriodicBasis, periodic_knots

Smoothing = float | Literal["auto", "gcv"] | None
LEAST_CONTROL = CUBIC + 1
MOST_CONTROL = 100  # Control points that are chosen unasked; a system of so many takes some 5 ms
UNEVEN_GAP_RATIO = 20.0  # Longest gap over the shortest, from which on points are uneven
CLEAN = 1e-9  # Noise, over the curve's size, that is not worth smoothing
BIASED = 1.5  # Residuals that exceed the noise by this factor show what was smoothed away
RESAMPLED = 8  # Points for each control point with which a curve through uneven ones is taken anew
LEAST_SMOOTHING = 1e-5  # Always there: the system is definite wherever points are missing
MOST_SMOOTHING = 1e9  # More changes nothing: the curve has long become a point
MOVES = 3  # Times that parameters move to the nearest points, if nothing is smoothed
STRENGTHS: Floats = np.logspace(-8.0, 3.0, 67)  # That are tried, against the mean weight
UNSEEN = 1e-12  # Share of its weight by which a mode must be seen to be estimated
RIDGE = 1e-13  # Added, so that the system's factor exists where nothing is seen or bends
Parametrisation = Literal["auto", "chord", "centripetal", "even"]
CORNER = np.pi / 3  # A point at which the polygon turns farther is a corner, rad
MOST_CORNERS = 0.2  # Of the points: where more of them turn like that, it is noise, not corners
EVEN_GAP = 2.0  # Longest chord over the usual one, at most, of points at equal distances;
EVEN_MIDDLE = 1.25  # and of the middle half: only across corners chords are short
MAX_EVEN_CHORD = 1.25  # Times the upper quartile: a longer chord is a gap, for no corner makes one
SAME = 1e-12  # Points nearer to each other, as a share of the curve's size, are one
ROUNDING = 64 * float(np.finfo(float).eps)  # Of the coordinates: points that spread less are one
LARGEST = float(np.finfo(float).max)
MOST_MOVE = 0.45  # Of the gap to a neighbour: two points that move towards each other do not meet


def choose_closed_fit(
    points: Floats, turns: Floats, count: int | None, smoothing: Smoothing, noise: float
) -> CurveFit:
    """The periodic fit that suits points (m, d) at parameters (m,), at least 2 of them.

    `count` and `smoothing` are as for `fit_closed_curve`; `noise` is what `local_noise` found.
    """
    chosen = count or int(np.clip(len(points) // 2, LEAST_CONTROL, MOST_CONTROL))
    if len(points) < 3:
        return fit_closed_least_squares(points, turns, LEAST_CONTROL, LEAST_SMOOTHING)
    if smoothing == "gcv":
        return fit_closed_least_squares(points, turns, chosen, None)
    if smoothing is not None and not isinstance(smoothing, str):
        return fit_closed_least_squares(points, turns, chosen, float(smoothing))
    if smoothing == "auto" and noise > CLEAN:
        fit = fit_closed_least_squares(points, turns, chosen, None)
        off = points - closed_curve_points(fit.control, fit.knots, fit.parameters)
        if count is not None or np.sqrt((off**2).sum(axis=1).mean()) <= BIASED * noise:
            return fit
    if count is not None and gap_ratio(points) <= UNEVEN_GAP_RATIO:
        return fit_closed_least_squares(points, turns, count, LEAST_SMOOTHING)
    through = interpolate_closed(points, turns)
    if count is None:
        return through
    # Even knots would find nothing in the gaps: they get points of the curve through all.
    even = np.arange(RESAMPLED * count) / (RESAMPLED * count)
    places = closed_curve_points(through.control, through.knots, even)
    return fit_closed_least_squares(places, even, count, LEAST_SMOOTHING)._replace(parameters=turns)


class CurveFit(NamedTuple):
    """A closed cubic B-spline that was fitted to points."""

    control: Floats  # (n, d)
    knots: Floats  # (n + 7,), over 0 to 1; the first 3 control points come again
    parameters: Floats  # (m,), those of the points, in turns
    condition: float  # Condition number of the matrix from control points to points and bending
    effective: float  # Degrees of freedom that were spent on each coordinate
    smoothing: float  # Weight of the bending against the mean weight of the points


def closed_curve_points(
    control: Floats, knots: Floats, turns: Floats, derivative: int = 0
) -> Floats:
    """Points (k, d) of a closed cubic, or derivatives, at parameters (k,) from 0 to 1."""
    middle = control.mean(axis=0)  # So that little is rounded where a curve is small and far away
    wound = np.vstack([control, control[:CUBIC]]) - middle
    values: Floats = Basis(knots, CUBIC).matrix(turns, derivative) @ wound
    return values if derivative else values + middle


def interpolate_closed(points: Floats, parameters: Floats) -> CurveFit:
    """Closed cubic through points (m, d), at least 3, at increasing parameters (m,) from 0.

    Knots lie at the parameters, so that the system is diagonally dominant however the points are
    spaced; with even knots and as many points it may be singular.
    """
    count = len(points)
    # One more coordinate: with signs that alternate the control points are the farthest off,
    # and so show the condition in the maximum norm.
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

    At each knot the bends of both sides are one: de Boor, *A practical guide to splines*, 1978,
    chapter IV. What leaves the three diagonals is one product (Sherman and Morrison, 1950). Own
    code: scipy's spline takes longer to be imported than a hundred curves to be fitted.
    """
    before = np.roll(steps, 1)
    right = 3.0 * (steps[:, None] * np.roll(chords, 1, axis=0) + before[:, None] * chords)
    middle = 2.0 * (steps + before)
    first, last = steps[0], before[-1]  # Of the first row, in the last column, and the other way
    rows = np.zeros((3, len(steps)))
    rows[0, 1:], rows[1], rows[2, :-1] = before[:-1], middle, steps[1:]
    rows[1, 0] += middle[0]
    rows[1, -1] += first * last / middle[0]
    column = np.zeros((len(steps), 1))
    column[0], column[-1] = -middle[0], last
    found = scipy.linalg.solve_banded((1, 1), rows, np.hstack([right, column]), check_finite=False)
    plain, beside = found[:, :-1], found[:, -1]
    share = -first / middle[0]  # Of the last row in the product's other factor; the first has 1
    along = (plain[0] + share * plain[-1]) / (1.0 + beside[0] + share * beside[-1])
    return np.asarray(plain - beside[:, None] * along)


def closed_knots(parameters: Floats) -> Floats:
    """Knots (n + 7,) of a closed cubic with breaks (n,), at least 3, from 0 up to below 1."""
    count = len(parameters)
    turns = np.concatenate([parameters + turn for turn in (-1.0, 0.0, 1.0, 2.0)])
    return turns[count - 3 : 2 * count + 4]


def fit_closed_least_squares(
    points: Floats, parameters: Floats, count: int, smoothing: float | None
) -> CurveFit:
    """Closed cubic of `count` control points, at least 4.

    `points` (m, d): around the curve. `parameters` (m,): increasing, in turns. `count`: control
    points. `smoothing`: weight of the bending against the mean weight of the points; None chooses
    it by cross-validation. It is never below `LEAST_SMOOTHING` nor above `MOST_SMOOTHING`.
    """
    periodic = PeriodicBasis(count)
    bending = _bending(count)
    if smoothing is None:
        strength = choose_smoothing(_dense(periodic, parameters)[0], bending, points)
    else:
        strength = smoothing
    strength = min(max(strength, LEAST_SMOOTHING), MOST_SMOOTHING)
    # Of noisy points the nearest places on the curve say nothing of where they belong.
    moves = MOVES if smoothing is not None and smoothing <= LEAST_SMOOTHING else 0
    for move in range(moves + 1):
        basis, slopes = _dense(periodic, parameters)
        weight = basis.T @ basis
        mean = np.trace(weight) / count
        factor = scipy.linalg.cho_factor(weight / mean + strength * bending)
        control = scipy.linalg.cho_solve(factor, basis.T @ points / mean)
        if move < moves:
            places, along = basis @ control, slopes @ control
            parameters = moved_parameters(parameters, points, places, along)
    seen = np.linalg.eigvalsh(weight / mean + strength * bending)
    return CurveFit(
        control=control,
        knots=periodic_knots(count),
        parameters=np.mod(parameters, 1.0),
        condition=float(np.sqrt(seen[-1] / seen[0])),
        effective=float(np.trace(scipy.linalg.cho_solve(factor, weight / mean))),
        smoothing=strength,
    )


def _bending(count: int) -> Floats:
    """Sum of the squared second differences around the circle, over its mean diagonal."""
    second = np.roll(np.eye(count), 1, axis=1) - 2.0 * np.eye(count)
    second += np.roll(np.eye(count), -1, axis=1)
    return second.T @ second / 6.0


def choose_smoothing(basis: Floats, bending: Floats, points: Floats) -> float:
    """The smoothing of the least generalised cross-validation score (Craven and Wahba, 1979)."""
    count = len(points)
    weight = basis.T @ basis
    weight /= np.trace(weight) / len(weight)
    modes = demmler_reinsch(weight, bending, basis)
    parts = modes.shapes.T @ points
    beyond = float(((points - modes.shapes @ parts) ** 2).sum())
    squares = beyond + modes.lost(STRENGTHS) ** 2 @ (parts**2).sum(axis=1)
    spare = np.maximum(1.0 - modes.kept(STRENGTHS).sum(axis=1) / count, 1.0 / count)
    return float(STRENGTHS[np.argmin(squares / spare**2)])


def _dense(periodic: PeriodicBasis, parameters: Floats) -> Floats:
    """Basis functions and their derivatives, (2, m, n): so few that sparse ones are slower."""
    local = periodic.nonzero(parameters, 1)
    dense = np.zeros((2, len(parameters), periodic.count))
    rows = np.arange(len(parameters))[:, None]
    dense[:, rows, local.columns() % periodic.count] = local.values
    return dense


def moved_parameters(parameters: Floats, points: Floats, places: Floats, slopes: Floats) -> Floats:
    """Parameters after the step of Fung, 1999, (4.40), which never takes one past a neighbour."""
    squares = np.einsum("md,md->m", slopes, slopes)
    wanted = np.einsum("md,md->m", points - places, slopes)
    step = np.divide(wanted, squares, out=np.zeros_like(wanted), where=squares > 0.0)
    ahead = np.diff(parameters, append=parameters[0] + 1.0)
    step = np.clip(step, -MOST_MOVE * np.roll(ahead, 1), MOST_MOVE * ahead)
    return np.asarray(parameters + step)


class Modes(NamedTuple):
    """Combinations of basis functions that do not mix, however strongly one smooths."""

    shapes: Floats  # Their values at the points (m, r), orthonormal columns
    control: Floats  # Their coefficients (n, r): ``shapes`` is the basis times them
    stiffness: Floats  # (r,): smoothing by s keeps ``1 / (1 + s stiffness)``

    def kept(self, strengths: Floats) -> Floats:
        """Share of each mode that smoothing by strengths (s,) keeps, (s, r)."""
        return 1.0 / (1.0 + strengths[:, None] * self.stiffness)

    def lost(self, strengths: Floats) -> Floats:
        """What is not kept, (s, r), to full precision however little it is."""
        stiff = strengths[:, None] * self.stiffness
        return stiff / (1.0 + stiff)


def demmler_reinsch(weight: Floats, bending: Floats, basis: Floats) -> Modes:
    """Modes of points and a penalty.

    Demmler and Reinsch, 1975: the modes v solve ``G v = mu (G + B) v``, G the weight ``basis.T @
    basis`` over its mean diagonal, B the bending in the same measure: unlike ``B v = w G v`` this
    is well conditioned however the points lie; what none sees drops out.
    """
    seen, control = scipy.linalg.eigh(weight, weight + bending + RIDGE * np.eye(len(weight)))
    seen = np.clip(seen, 0.0, 1.0)
    control, seen = control[:, seen > UNSEEN], seen[seen > UNSEEN]
    shapes = basis @ control
    length = np.linalg.norm(shapes, axis=0)
    return Modes(shapes / length, control / length, (1.0 - seen) / seen)


def curve_parameters(points: Floats, kind: Parametrisation) -> Floats:
    """Parameters (m,) of points (m, d) around a closed curve; the first is 0.

    In proportion to the chords between neighbours, (4.28), or to their square roots, (4.18) of
    Fung, 1999; both with the chord that closes the curve, which the text leaves out. "auto" takes
    square roots where a few of the points are corners: there chords overshoot. "even" takes equal
    steps where the points were measured at equal distances along the curve, which a chord across a
    corner tells too short, and chords otherwise.
    """
    chords = np.linalg.norm(np.roll(points, -1, axis=0) - points, axis=1)
    if kind == "even" and are_even_chords(chords):
        return np.arange(len(points)) / len(points)
    if kind == "centripetal" or (kind == "auto" and _has_corners(points)):
        chords = np.sqrt(chords)
    ends = np.cumsum(chords)
    return np.asarray(np.concatenate([[0.0], ends[:-1]]) / ends[-1])


def are_even_chords(chords: Floats, reach: int = 1) -> bool:
    """Whether chords (m,) are those of points at equal distances along a curve, with corners.

    Each goes to the point so many ahead: a gap lengthens all `reach` chords across it, where noise
    and a point that strays lengthen single ones. Their median counts.
    """
    tenth, quarter, most = np.quantile(chords, [0.1, 0.25, 0.75])
    across = np.median([np.roll(chords, by) for by in range(reach)], axis=0)
    no_gap = chords.max() <= EVEN_GAP * tenth and across.max() <= MAX_EVEN_CHORD * most
    return bool(no_gap and most <= EVEN_MIDDLE * quarter)


def _has_corners(points: Floats) -> bool:
    back, ahead = points - np.roll(points, 1, axis=0), np.roll(points, -1, axis=0) - points
    along = np.einsum("md,md->m", back, ahead)
    lengths = np.linalg.norm(back, axis=1) * np.linalg.norm(ahead, axis=1)
    corners = np.count_nonzero(along < np.cos(CORNER) * lengths)
    return bool(0 < corners <= MOST_CORNERS * len(points))


def gap_ratio(points: Floats) -> float:
    """The longest chord of a closed polygon (m, d) over its shortest."""
    chords = np.linalg.norm(np.roll(points, -1, axis=0) - points, axis=1)
    return float(chords.max() / chords.min())


STRENGTHS.setflags(write=False)


class ClosedPoints(NamedTuple):
    """Points around a closed curve, each different from the next."""

    points: Floats  # (m, d), about the middle and over the size, so that all lie within 1/2 of 0
    rows: Ints  # (m,): which of the given points they are
    middle: Floats  # (d,), m
    size: float  # Longest side of the box around the points, m; 0 where they are one point
    dropped: int  # Rows that were not finite


def order_closed_points(points: Floats) -> ClosedPoints:
    """Drop what is not finite or comes twice, centre, scale, and put in order.

    From the point that comes last in alphabetical order, counter-clockwise (seen along that axis
    from which the curve is broadest): begun anywhere, either way, the same to the last bit. Raises
    ValueError if no row is finite, or they spread farther than a number can say.
    """
    if points.ndim != 2 or points.shape[1] not in (2, 3):
        raise ValueError(f"points must have shape (any, 2) or (any, 3), got {points.shape}")
    rows = np.flatnonzero(np.isfinite(points).all(axis=1)).astype(np.int32)
    dropped = len(points) - len(rows)
    if not len(rows):
        raise ValueError(f"points must have at least one finite row, got {len(points)} rows")
    found = points[rows]
    low, high = found.min(axis=0), found.max(axis=0)
    middle = 0.5 * low + 0.5 * high  # Of the box: a mean would round otherwise in another order
    size = 2.0 * float(np.max(0.5 * high - 0.5 * low))
    if size == np.inf:
        raise ValueError(f"points must spread less than {LARGEST:g} m, got {low} to {high} m")
    if size <= ROUNDING * float(np.abs(found).max()):
        return ClosedPoints(np.zeros((1, points.shape[1])), rows[:1], middle, 0.0, dropped)
    scaled = (found - middle) / size
    order = np.flatnonzero((scaled != np.roll(scaled, 1, axis=0)).any(axis=1))
    order = order[_canonical(scaled[order])]
    ahead = np.linalg.norm(scaled[order] - np.roll(scaled[order], -1, axis=0), axis=1)
    order = order[ahead > SAME]
    return ClosedPoints(scaled[order], rows[order], middle, size, dropped)


def _canonical(points: Floats) -> Ints:
    """Order (m,) that is the same however the points were begun and whichever way they run."""
    count = len(points)
    around = np.arange(count)
    order = np.lexsort(points.T[::-1])
    other = (points[order[1:]] != points[order[:-1]]).any(axis=1)
    rank = np.zeros(count, np.int64)
    rank[order[1:]] = np.cumsum(other)
    onwards = (_begin(rank) + around) % count
    backwards = (count - 1 - _begin(rank[::-1]) - around) % count
    best = max(onwards, backwards, key=lambda way: rank[way].tolist())
    normal = area_vector(points[best])
    if normal[np.argmax(np.abs(normal))] < 0.0:
        best = best[-around]
    return best.astype(np.int32)


def _begin(rank: NDArray[np.int64]) -> int:
    """Where to begin so that the ranks (m,), read around, come last in alphabetical order.

    Where several places may do, what follows decides, and twice as much of it each time.
    """
    reach = 1
    while reach < len(rank) and np.count_nonzero(rank == rank.max()) > 1:
        rank = rank * len(rank) + np.roll(rank, -reach)
        rank = np.unique(rank, return_inverse=True)[1]
        reach *= 2
    return int(rank.argmax())


def area_vector(points: Floats) -> Floats:
    """Normal of a closed polygon (m, d) as long as its area: (1,) in 2 dimensions, (3,) in 3."""
    following = np.roll(points, -1, axis=0)
    if points.shape[1] == 2:
        twice = points[:, 0] * following[:, 1] - points[:, 1] * following[:, 0]
        return np.array([0.5 * twice.sum()])
    return np.asarray(0.5 * np.cross(points, following).sum(axis=0))
