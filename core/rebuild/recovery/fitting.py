"""Recovery of a superquadric from points, the best of many fits: Fung, 1999, (2.10).

The text minimises the root of the volume times (F - 1). That has the unit of a length to the
power 1.5, weighs points by the square of their distance, and prefers small solids only as long
as it matters least; here the first-order distance along the normal is minimised, within bounds
that the extents of the points set. The text starts once, from the moments; here all orders of
the axes, and more, are started. All starts take a few steps; those that have come farthest are
solved to their ends; the smallest solid of those that fit best is polished. With outliers, a
robust loss leads to the neighbourhood, and plain least squares over the points near the solid
end it.
"""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from palpate.core import shapes
from palpate.core.arrays import MAD_TO_SIGMA, Bools, Floats, Ints, finite_array, positive
from palpate.core.least_squares import Loss, cauchy_loss, levenberg_marquardt, linear_loss
from palpate.core.poses import principal_axes
from palpate.core.rebuild.recovery import report
from palpate.core.rebuild.recovery.distances import Warps, distances_alone, normal_distances

FARTHEST = 1e150  # m: squares beyond it overflow
FIRST_STEPS, SECOND_STEPS, NEXT_STEPS, LAST_STEPS = 4, 6, 60, 200
DROPPED, FEWEST = 3, 48  # Of starts that go on after the first steps: one in so many, at least
KEPT, KEPT_ROBUST = 4, 8  # Starts that are solved to the end
TURN = slice(5, 8)  # Where the rotation vector is among the parameters
MANY = 200  # Points among which the best start is found; all of them end it
ROUGH, FINE = 1e-6, 1e-9  # Tolerances: see `levenberg_marquardt`
SCALES = (0.02, 0.01)  # Of the points' diameter: distances beyond which a robust loss grows slowly
TRIMMED = (0.15, 0.3, 0.45)  # Shares of outlying points that the extents may leave out
FAR = 3.0  # Standard deviations beyond which a point is an outlier
ALIKE = 1e-6  # Share of its cost by which a fit must be worse than another to be another
LEEWAY = 1.1  # Times the least cost: no more than chance makes of it with some fifty points
REFITS = 6
EXACT = 1e-13  # Of the points' diameter: residuals of this size are roundings
LEAST_NOISE = 1e-9  # Of the points' diameter
LEAST_EXTENT = 5e-3  # Of the points' diameter: what is thinner starts as thick as that
# Of half the extent along each axis: a taper widens by up to 2, a bend shows its sag.
RIGID_SIZES, WARPED_SIZES = (0.5, 1.3), (0.3, 1.5)
LARGEST_TURN = 0.8  # Rad, of each component: the next start is nearer than that
RIGID_SHIFT, WARPED_SHIFT = 0.3, 0.4  # Of the points' diameter
LARGEST_TAPER = 0.95
MOST_ANGLE = 2.2  # Rad, by which a bend may turn an end
FIRST_ANGLE = 0.7  # Rad, by which the bends that are tried besides the estimated one turn an end
STEEPEST_GUESS = 0.8  # Largest widening to start from
Exponents = tuple[tuple[float, float], ...]
# Near a box the exponents' slopes vanish, near an octahedron there are creases: from round neither
# is always found.
FREE_EXPONENTS: Exponents = ((1.0, 1.0), (0.2, 0.2), (1.8, 1.8))
BENT_EXPONENTS = FREE_EXPONENTS[:2]  # Where each is started with six bends
SWEEPS = 6  # Of plane rotations; each is exact, and three or four end it
HALF = np.sqrt(0.5)
EIGHTH_TURN: Floats = np.array([[HALF, -HALF, 0.0], [HALF, HALF, 0.0], [0.0, 0.0, 1.0]])
# Rotations that make each of three axes the z axis.
ORDERS: Floats = np.stack([np.eye(3)[:, order] for order in ([0, 1, 2], [1, 2, 0], [2, 0, 1])])


def recover(
    points: ArrayLike,
    *,
    taper: bool = False,
    bend: bool = False,
    outliers: bool = False,
    choice: Literal["thesis"] | None = None,
    noise: float | None = None,
) -> report.Recovery:
    """Fit a superquadric to points on its surface.

    `points` (n, 3): m. At least 11, and 2 more for a taper and for a bend. `taper` and `bend`:
    whether these are fitted; otherwise there is none. `outliers`: whether some of the points, up to
    about a third, may not lie on the surface. It costs two to three times as much. `choice`:
    whether the exponents are only chosen from sphere, box and cylinder, see `CHOICES`. `noise`:
    standard deviation of the points, m, if it is known. Returns always: what could not be fitted
    says so in `Recovery.warnings`. Raises ValueError if points are not finite, not of shape (n, 3)
    or so far away that their squares overflow, the noise is not positive, or the choice is unknown.
    """
    places = finite_array("points", points, (None, 3))
    far = float(np.abs(places).max(initial=0.0))
    if far > FARTHEST:
        raise ValueError(f"points must lie within {FARTHEST:g} m, got a coordinate of {far:g} m")
    if noise is not None:
        positive("noise", noise, "m")
    if choice not in (None, "thesis"):
        raise ValueError(f"choice must be 'thesis' or None, got {choice!r}")
    warps = Warps(bool(taper), bool(bend))
    warning = report.degeneracy(places, warps.total)
    if warning is not None:
        return report.unfitted(places, warps, warning)
    scaled = report.scaled_down(places, report.core_of(places, max(TRIMMED)) if outliers else None)
    pairs = None if choice is None else tuple(report.CHOICES.values())
    spread = None if noise is None else min(noise, scaled.unit) / scaled.unit
    if outliers:
        found = search_among_outliers(scaled.points, warps, pairs, spread)
    else:
        found = search(scaled.points, warps, pairs)
    return report.reported(scaled, warps, found, spread, chosen=choice is not None)


def search_among_outliers(
    points: Floats, warps: Warps, choice: Exponents | None, noise: float | None
) -> report.SearchResult:
    """Fit points (n, 3) of which some are not on the solid; `noise` is that of the others."""
    apart = report.outlyingness(points)
    cores = (points[apart <= np.quantile(apart, 1.0 - share)] for share in TRIMMED)
    starts = joined([starts_of(core, warps, choice) for core in cores])
    rough, fine = (cauchy_loss(max(scale, noise or 0.0)) for scale in SCALES)
    some = _some(points)
    first = _narrowed(some, starts, warps, rough)[0].starts
    distances = distances_alone(first.parameters, some, first.axes, warps)
    best = first.take(_distinct(fine(distances**2)[0].sum(axis=1))[:KEPT_ROBUST])
    fits, folded = _unfolded(_solved(some, best, warps, fine, NEXT_STEPS)[0], warps)
    inliers, fits = _refitted(points, fits, warps, noise)
    return _ended(points, fits, warps, inliers, folded, len(starts.axes))


def _refitted(
    points: Floats, fits: _Fits, warps: Warps, noise: float | None
) -> tuple[Bools, _Fits]:
    """One fit, fitted again and again to the points that are near it."""
    inliers = np.ones(len(points), bool)
    for turn in range(REFITS):
        starts = fits.starts
        distances = np.abs(distances_alone(starts.parameters, points, starts.axes, warps)[0])
        kept = distances[inliers]
        left = np.sqrt(len(kept) / max(len(kept) - warps.total, 1))
        spread = noise or MAD_TO_SIGMA * float(np.median(kept)) * float(left)
        near = distances <= FAR * max(spread, LEAST_NOISE)
        if near.sum() <= warps.total or (turn > 0 and np.array_equal(near, inliers)):
            break
        inliers = near
        fits = _solved(points[inliers], starts, warps, linear_loss, NEXT_STEPS)[0]
    return inliers, fits


def search(points: Floats, warps: Warps, choice: Exponents | None) -> report.SearchResult:
    """Fit points (n, 3), of diameter about 1, that have no outliers."""
    starts, some = starts_of(points, warps, choice), _some(points)
    first, costs = _narrowed(some, starts, warps, linear_loss)
    best = first.starts.take(_distinct(costs)[:KEPT])
    fits, folded = _unfolded(_smallest(*_solved(some, best, warps, linear_loss, NEXT_STEPS)), warps)
    return _ended(points, fits, warps, np.ones(len(points), bool), folded, len(starts.axes))


def starts_of(points: Floats, warps: Warps, choice: Exponents | None) -> Starts:
    """All starts that extents of points (n, 3) of diameter 1 suggest; `choice` may not change."""
    pairs = choice or (BENT_EXPONENTS if warps.bend else FREE_EXPONENTS)
    fixed = choice is not None
    tried = ((axes, pair) for axes in suggested_axes(points) for pair in pairs)
    return joined([_starts_along(points, axes, warps, pair, fixed) for axes, pair in tried])


def _starts_along(
    points: Floats, axes: Floats, warps: Warps, exponents: tuple[float, float], fixed: bool
) -> Starts:
    """Starts along some axes."""
    places = points @ axes
    low, high = places.min(axis=0), places.max(axis=0)
    half, middle = np.maximum(0.5 * (high - low), LEAST_EXTENT), 0.5 * (low + high)
    tapers, bends = _guesses((places - middle) / half, half, warps)
    count = len(bends)
    sag = 0.5 * bends * half[2] ** 2  # A bent solid shows its sag, half to each side
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


def _bounds(half: Floats, middle: Floats, warps: Warps) -> tuple[Floats, Floats]:
    """Least and largest parameters, from half the extents along the axes and their middle."""
    warped = warps.taper or warps.bend
    sizes = WARPED_SIZES if warped else RIGID_SIZES
    shift = WARPED_SHIFT if warped else RIGID_SHIFT
    ends = np.array([LARGEST_TAPER] * 2 * warps.taper + [MOST_ANGLE / half[2]] * 2 * warps.bend)
    turn, pair = np.full(3, LARGEST_TURN), np.ones(2)
    least, most = (
        [np.log(sizes[0] * half), shapes.MIN_EXPONENT * pair, -turn, middle - shift, -ends],
        [np.log(sizes[1] * half), shapes.MAX_EXPONENT * pair, turn, middle + shift, ends],
    )
    return np.concatenate(least), np.concatenate(most)


def suggested_axes(points: Floats) -> Floats:
    """Axes (12, 3, 3) to start in: principal, turned by 45 degrees, of extreme fourth moments."""
    centred = points - points.mean(axis=0)
    principal = principal_axes(centred)
    most = _quartic_axes(centred, principal, largest=True)
    least = _quartic_axes(centred, principal, largest=False)
    upright = np.stack([principal, most, least])[:, None] @ ORDERS
    return np.concatenate([upright[0], upright[0] @ EIGHTH_TURN, upright[1], upright[2]])


def _quartic_axes(centred: Floats, axes: Floats, *, largest: bool) -> Floats:
    """Turn axes, two at a time, until the sum of fourth powers of coordinates is extreme."""
    way = 1.0 if largest else -1.0
    for _ in range(SWEEPS):
        for i, j in ((0, 1), (1, 2), (0, 2)):
            x, y = centred @ axes[:, i], centred @ axes[:, j]
            u, v = x * x - y * y, 2.0 * x * y
            angle = 0.25 * np.arctan2(way * 2.0 * float(u @ v), way * float(u @ u - v @ v))
            turn = np.eye(3)
            turn[[i, j], [i, j]] = np.cos(angle)
            turn[i, j], turn[j, i] = -np.sin(angle), np.sin(angle)
            axes = axes @ turn
    return axes


def joined(parts: list[Starts]) -> Starts:
    """Starts of several kinds, one after the other."""
    return Starts(*(np.concatenate(part) for part in zip(*parts, strict=True)))


def _some(points: Floats) -> Floats:
    """Not too many of points (n, 3), in no order that they may have; the same ones each time."""
    if len(points) <= MANY:
        return points
    return np.asarray(points[np.random.default_rng(0).permutation(len(points))[:MANY]])


def _narrowed(points: Floats, starts: Starts, warps: Warps, loss: Loss) -> tuple[_Fits, Floats]:
    """The better part of the fits after their first steps, best first, and what they cost."""
    fits, costs = _solved(points, starts, warps, loss, FIRST_STEPS)
    better = _distinct(costs)[: max(len(costs) // DROPPED, FEWEST)]
    return _solved(points, fits.starts.take(better), warps, loss, SECOND_STEPS)


def _distinct(costs: Floats) -> NDArray[np.intp]:
    """Which fits to go on with, best first; of those that cost the same, one solid, one."""
    order = np.argsort(costs, kind="stable")
    ascending = costs[order]
    apart = np.diff(ascending, prepend=-np.inf) > ALIKE * ascending
    return np.asarray(order[apart])


def _unfolded(fits: _Fits, warps: Warps) -> tuple[_Fits, bool]:
    """The best fit whose solid is not folded by its bend; the best of all if there is none."""
    if not warps.bend:
        return fits.take(slice(1)), False
    folded = [folds(one, warps) for one in fits.starts.parameters]
    which = folded.index(False) if False in folded else 0
    return fits.take(slice(which, which + 1)), folded[which]


def _smallest(fits: _Fits, costs: Floats) -> _Fits:
    """Those first that are as good as the best, the smallest first: thin rims fit others."""
    alike = costs <= LEEWAY * costs[0]
    volumes = [
        shapes.superquadric_volume(np.exp(one[:3]), one[3:5]) if near else np.inf
        for one, near in zip(fits.starts.parameters, alike, strict=True)
    ]
    return fits.take(np.argsort(volumes, kind="stable"))


def _ended(
    points: Floats, fits: _Fits, warps: Warps, inliers: Bools, folded: bool, tried: int
) -> report.SearchResult:
    """One fit, solved to the last digits; its turn need no longer keep it apart from others."""
    starts = fits.starts
    low, high = starts.low.copy(), starts.high.copy()
    low[:, TURN], high[:, TURN] = -np.inf, np.inf
    starts = starts._replace(low=low, high=high)
    last = _solved(points[inliers], starts, warps, linear_loss, LAST_STEPS, FINE)[0]
    parameters, low, high, axes = (part[0] for part in last.starts)
    if not folded and warps.bend:
        folded = folds(parameters, warps)
    at_end = (parameters <= low) | (parameters >= high)
    at_end[3:5] = False  # a box and an octahedron are good ends
    converged, bounded = bool(last.converged[0]), bool(at_end.any())
    steps = int(fits.steps[0] + last.steps[0])
    return report.SearchResult(parameters, axes, inliers, converged, folded, bounded, tried, steps)


def _solved(
    points: Floats, starts: Starts, warps: Warps, loss: Loss, steps: int, tolerance: float = ROUGH
) -> tuple[_Fits, Floats]:
    """Fits after some steps from their starts, best first, and what they cost."""

    def problem(parameters: Floats, rows: Ints) -> tuple[Floats, Floats]:
        return normal_distances(parameters, points, starts.axes[rows], warps)

    ends = levenberg_marquardt(
        problem,
        starts.parameters,
        starts.low,
        starts.high,
        loss=loss,
        steps=steps,
        min_residual=EXACT * float(np.sqrt(len(points))),
        tolerance=tolerance,
    )
    best = np.argsort(ends.cost, kind="stable")
    moved = starts._replace(parameters=ends.parameters).take(best)
    return _Fits(moved, ends.steps[best], ends.converged[best]), ends.cost[best]


def folds(parameters: Floats, warps: Warps) -> bool:
    """True if the inner side is squeezed to nothing, or the axis closed to a ring."""
    bend = parameters[warps.bend_columns]
    taper = parameters[warps.taper_columns] if warps.taper else np.zeros(2)
    base = shapes.Superquadric(np.exp(parameters[:3]), parameters[3:5])
    curvature = float(np.hypot(*bend))
    return curvature > shapes.largest_curvature(base, taper, float(np.arctan2(bend[1], bend[0])))


class _Fits(NamedTuple):
    """Fits under way, best first."""

    starts: Starts  # Their parameters are where the fits have come to
    steps: Ints
    converged: Bools

    def take(self, which: slice | NDArray[np.intp]) -> _Fits:
        return _Fits(self.starts.take(which), self.steps[which], self.converged[which])


class Starts(NamedTuple):
    """Starts with their bounds, see `distances.RIGID` for the order of parameters."""

    parameters: Floats  # (b, p)
    low: Floats
    high: Floats
    axes: Floats  # (b, 3, 3)

    def take(self, which: slice | NDArray[np.intp]) -> Starts:
        """Some of them."""
        return Starts(*(part[which] for part in self))
