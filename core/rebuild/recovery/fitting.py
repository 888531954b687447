"""Recovery of a superquadric from points, the best of many fits: Fung, 1999, (2.10).

The thesis minimises the root of the volume times (F - 1), which has the unit of a length to the
power 1.5, weighs points by the square of their distance, and prefers small solids only far from the
optimum. Here the first-order distance along the normal is minimised, within bounds from the extents
of the points. The thesis starts once, from the moments; here fits start from all orders of several
axes. All starts take a few steps; the best are solved; the smallest solid of those that fit equally
well is polished. With outliers, a robust loss comes first, then least squares over the points near
the solid.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from palpate.core import shapes
from palpate.core.arrays import MAD_TO_SIGMA, Bools, Floats, Ints, finite_array, positive
from palpate.core.least_squares import Loss, cauchy_loss, levenberg_marquardt, linear_loss
from palpate.core.poses import principal_axes
from palpate.core.rebuild.recovery import report
from palpate.core.rebuild.recovery.distances import Warps, distances_alone, normal_distances

Exponents = tuple[tuple[float, float], ...]
MAX_COORDINATE = 1e150  # [m]: squares beyond it overflow
ROTATION = slice(5, 8)  # columns of the rotation vector among the parameters
COS_45 = np.sqrt(0.5)
EIGHTH_TURN: Floats = np.array([[COS_45, -COS_45, 0.0], [COS_45, COS_45, 0.0], [0.0, 0.0, 1.0]])


@dataclass(frozen=True, slots=True, kw_only=True)
class StartSettings:
    """Where fits start, and how far parameters may go from there.

    Sizes are fractions of half the extent of the points along each axis, lower and upper bound: a
    taper widens by up to 2, and a bend adds its sag to the extent.
    """

    # Round, box and octahedron: from round alone neither a box, where slopes by the exponents
    # vanish, nor an octahedron, which has creases, is always found.
    exponents: Exponents = ((1.0, 1.0), (0.2, 0.2), (1.8, 1.8))
    n_bent_exponents: int = 2  # the first of these are tried with a bend, from six bends each
    min_extent: float = 5e-3  # fraction of the points' diameter: thinner ones start so thick
    rigid_sizes: tuple[float, float] = (0.5, 1.3)
    warped_sizes: tuple[float, float] = (0.3, 1.5)  # with a taper or a bend
    rigid_shift: float = 0.3  # fraction of the points' diameter, of each coordinate
    warped_shift: float = 0.4
    max_turn: float = 0.8  # [rad] of each component: another start is nearer than that
    max_taper: float = 0.95
    max_first_taper: float = 0.8  # at the start
    max_bend_angle: float = 2.2  # [rad] by which a bend turns an end
    first_bend_angle: float = 0.7  # [rad] of bends that start besides the estimated one


@dataclass(frozen=True, slots=True, kw_only=True)
class SearchSettings:
    """How many starts go on for how many steps of Levenberg and Marquardt."""

    n_points: int = 200  # among which the best start is found; all points are used at the end
    first_steps: int = 4  # of all starts
    second_steps: int = 6  # of the better ones
    drop_ratio: int = 3  # number of starts over the number that takes the second steps
    min_kept: int = 48  # starts, at least, that take the second steps
    n_solved: int = 4  # starts that are solved
    solve_steps: int = 60
    polish_steps: int = 200  # of the best fit
    tolerance: float = 1e-6  # see `levenberg_marquardt`
    polish_tolerance: float = 1e-9
    rounding: float = 1e-13  # fraction of the points' diameter: smaller residuals are rounding
    same_cost: float = 1e-6  # fraction of the cost: fits that differ by less are one solid
    max_cost_ratio: float = 1.1  # over the least cost, of fits as good: chance among 50 points


@dataclass(frozen=True, slots=True, kw_only=True)
class RobustSettings:
    """How a solid is found among outliers."""

    trimmed: tuple[float, ...] = (0.15, 0.3, 0.45)  # shares of points that extents may leave out
    loss_scales: tuple[float, float] = (0.02, 0.01)  # fraction of the diameter: first and second
    n_solved: int = 8  # starts that are solved
    outlier_sigmas: float = 3.0  # standard deviations from the solid
    n_refits: int = 6  # to the points near the solid
    min_noise: float = 1e-9  # fraction of the points' diameter


@dataclass(frozen=True, slots=True, kw_only=True)
class RecoverySettings:
    """All settings of `recover`."""

    starts: StartSettings = StartSettings()
    search: SearchSettings = SearchSettings()
    robust: RobustSettings = RobustSettings()
    report: report.ReportSettings = field(default_factory=report.ReportSettings)


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
    settings: RecoverySettings = RecoverySettings(),
) -> report.Recovery:
    """Fit a superquadric to points on its surface.

    `points` (n, 3) [m]: at least 11, and 2 more for a taper and for a bend. `taper` and `bend`:
    whether these are fitted; else there is none. `outliers`: whether some of the points, up to
    about a third, may lie off the surface, which takes two to three times as long. `choice`:
    "thesis" selects the exponents from those of sphere, box and cylinder, see `CHOICES`. `noise`:
    standard deviation of the points [m], if it is known. Always returns a result: if the points
    cannot be fitted, `Recovery.warnings` says why. Raises ValueError if points are not finite, not
    of shape (n, 3) or so large that their squares overflow, the noise is not positive, or the
    choice is unknown.
    """
    places = finite_array("points", points, (None, 3))
    far = float(np.abs(places).max(initial=0.0))
    if far > MAX_COORDINATE:
        raise ValueError(
            f"points must lie within {MAX_COORDINATE:g} m, got a coordinate of {far:g} m"
        )
    if noise is not None:
        positive("noise", noise, "m")
    if choice not in (None, "thesis"):
        raise ValueError(f"choice must be 'thesis' or None, got {choice!r}")
    warps = Warps(bool(taper), bool(bend))
    warning = report.degeneracy(places, warps.total)
    if warning is not None:
        return report.unfitted(places, warps, warning)
    core = report.core_of(places, max(settings.robust.trimmed)) if outliers else None
    scaled = report.scaled_down(places, core)
    pairs = None if choice is None else tuple(report.CHOICES.values())
    spread = None if noise is None else min(noise, scaled.unit) / scaled.unit
    if outliers:
        result = search_among_outliers(scaled.points, warps, pairs, spread, settings)
    else:
        result = search(scaled.points, warps, pairs, settings)
    chosen = choice is not None
    return report.reported(scaled, warps, result, spread, settings.report, chosen=chosen)


def search_among_outliers(
    points: Floats,
    warps: Warps,
    choice: Exponents | None,
    noise: float | None,
    settings: RecoverySettings,
) -> report.SearchResult:
    """Fit points (n, 3) of which some are not on the solid; `noise` is that of the inliers."""
    apart = report.outlyingness(points)
    robust, solve_steps = settings.robust, settings.search.solve_steps
    cores = (points[apart <= np.quantile(apart, 1.0 - share)] for share in robust.trimmed)
    starts = joined([starts_of(core, warps, choice, settings.starts) for core in cores])
    rough, fine = (cauchy_loss(max(scale, noise or 0.0)) for scale in robust.loss_scales)
    some = _subset(points, settings.search.n_points)
    first = _better_part(some, starts, warps, rough, settings.search)[0].starts
    distances = distances_alone(first.parameters, some, first.axes, warps)
    costs = fine(distances**2)[0].sum(axis=1)
    best = first.take(_distinct(costs, settings.search.same_cost)[: robust.n_solved])
    fits = _solved(some, best, warps, fine, solve_steps, settings.search)[0]
    fits, folded = _best_unfolded(fits, warps)
    inliers, fits = _refitted(points, fits, warps, noise, settings)
    return _polished(points, fits, warps, inliers, folded, len(starts.axes), settings.search)


def _refitted(
    points: Floats, fits: _Fits, warps: Warps, noise: float | None, settings: RecoverySettings
) -> tuple[Bools, _Fits]:
    """One fit, repeated with the points that are near it until these are the same."""
    robust, search = settings.robust, settings.search
    inliers = np.ones(len(points), bool)
    for turn in range(robust.n_refits):
        starts = fits.starts
        distances = np.abs(distances_alone(starts.parameters, points, starts.axes, warps)[0])
        kept = distances[inliers]
        left = np.sqrt(len(kept) / max(len(kept) - warps.total, 1))
        spread = noise or MAD_TO_SIGMA * float(np.median(kept)) * float(left)
        near = distances <= robust.outlier_sigmas * max(spread, robust.min_noise)
        if near.sum() <= warps.total or (turn > 0 and np.array_equal(near, inliers)):
            break
        inliers = near
        fits = _solved(points[inliers], starts, warps, linear_loss, search.solve_steps, search)[0]
    return inliers, fits


def search(
    points: Floats, warps: Warps, choice: Exponents | None, settings: RecoverySettings
) -> report.SearchResult:
    """Fit points (n, 3), of diameter about 1, that have no outliers."""
    steps = settings.search
    starts, some = (
        starts_of(points, warps, choice, settings.starts),
        _subset(points, steps.n_points),
    )
    first, costs = _better_part(some, starts, warps, linear_loss, steps)
    best = first.starts.take(_distinct(costs, steps.same_cost)[: steps.n_solved])
    solved, costs = _solved(some, best, warps, linear_loss, steps.solve_steps, steps)
    fits, folded = _best_unfolded(_smallest_first(solved, costs, steps.max_cost_ratio), warps)
    inliers = np.ones(len(points), bool)
    return _polished(points, fits, warps, inliers, folded, len(starts.axes), steps)


def starts_of(
    points: Floats, warps: Warps, choice: Exponents | None, settings: StartSettings
) -> Starts:
    """All starts for points (n, 3) of diameter 1; exponents of a `choice` stay fixed."""
    count = settings.n_bent_exponents if warps.bend else None
    pairs = choice or settings.exponents[:count]
    fixed = choice is not None
    pairs_of_axes = ((axes, pair) for axes in suggested_axes(points) for pair in pairs)
    return joined(
        [_starts_along(points, axes, warps, pair, fixed, settings) for axes, pair in pairs_of_axes]
    )


def _starts_along(
    points: Floats,
    axes: Floats,
    warps: Warps,
    exponents: tuple[float, float],
    fixed: bool,
    settings: StartSettings,
) -> Starts:
    """Starts along some axes."""
    places = points @ axes
    low, high = places.min(axis=0), places.max(axis=0)
    half, middle = np.maximum(0.5 * (high - low), settings.min_extent), 0.5 * (low + high)
    tapers, bends = _guesses((places - middle) / half, half, warps, settings)
    count = len(bends)
    sag = 0.5 * bends * half[2] ** 2  # it adds to the extent, half to each side
    size, place = np.tile(half, (count, 1)), np.tile(middle, (count, 1))
    least_size = settings.warped_sizes[0] * half[:2]
    size[:, :2] = np.maximum(size[:, :2] - 0.5 * np.abs(sag), least_size)
    place[:, :2] -= 0.5 * sag
    pair, no_turn = np.tile(np.asarray(exponents), (count, 1)), np.zeros((count, 3))
    parts = [np.log(size), pair, no_turn, place]
    parts += [tapers] * warps.taper + [bends] * warps.bend
    least, most = _bounds(half, middle, warps, settings)
    if fixed:
        least[3:5] = most[3:5] = exponents
    return Starts(
        np.concatenate(parts, axis=1),
        np.tile(least, (count, 1)),
        np.tile(most, (count, 1)),
        np.tile(axes, (count, 1, 1)),
    )


def _guesses(
    places: Floats, half: Floats, warps: Warps, settings: StartSettings
) -> tuple[Floats, Floats]:
    """Tapers and bends (k, 2) to start from; `places` are in half extents."""
    height = places[:, 2]
    powers = np.column_stack([np.ones_like(height), height, height * height])
    middles = np.linalg.lstsq(powers, places[:, :2], rcond=None)[0]
    widths = np.abs(places[:, :2] - powers @ middles)
    width, slope = np.linalg.lstsq(powers[:, :2], widths, rcond=None)[0]
    most = settings.max_first_taper
    taper = np.clip(slope / np.maximum(width, settings.min_extent), -most, most)
    if not warps.bend:
        guesses = np.stack([0.0 * taper, taper]) if warps.taper else np.zeros((1, 2))
        return guesses, np.zeros((len(guesses), 2))
    bend = 2.0 * middles[2] * half[:2] / half[2] ** 2
    limit, first = settings.max_bend_angle / half[2], settings.first_bend_angle / half[2]
    sideways = first * np.array([[1, 0], [-1, 0], [0, 1], [0, -1]])
    bends = np.concatenate([[np.clip(bend, -limit, limit)], np.zeros((1, 2)), sideways])
    tapers = np.zeros_like(bends)
    tapers[0] = taper
    return tapers, bends


def _bounds(
    half: Floats, middle: Floats, warps: Warps, settings: StartSettings
) -> tuple[Floats, Floats]:
    """Lower and upper bounds of the parameters, from the half extents and their middle."""
    warped = warps.taper or warps.bend
    sizes = settings.warped_sizes if warped else settings.rigid_sizes
    shift = settings.warped_shift if warped else settings.rigid_shift
    tapers = [settings.max_taper] * 2 * warps.taper
    ends = np.array(tapers + [settings.max_bend_angle / half[2]] * 2 * warps.bend)
    turn, pair = np.full(3, settings.max_turn), np.ones(2)
    least, most = (
        [np.log(sizes[0] * half), shapes.MIN_EXPONENT * pair, -turn, middle - shift, -ends],
        [np.log(sizes[1] * half), shapes.MAX_EXPONENT * pair, turn, middle + shift, ends],
    )
    return np.concatenate(least), np.concatenate(most)


def suggested_axes(points: Floats) -> Floats:
    """Axes (12, 3, 3) of starts: principal, turned by 45 degrees, of extreme fourth moments."""
    centred = points - points.mean(axis=0)
    principal = principal_axes(centred)
    most = _quartic_axes(centred, principal, largest=True)
    least = _quartic_axes(centred, principal, largest=False)
    upright = np.stack([principal, most, least])[:, None] @ ORDERS
    return np.concatenate([upright[0], upright[0] @ EIGHTH_TURN, upright[1], upright[2]])


def _quartic_axes(centred: Floats, axes: Floats, *, largest: bool, n_sweeps: int = 6) -> Floats:
    """Axes with the largest or smallest sum of fourth powers of coordinates.

    They are turned two at a time, each time to the exact optimum: three or four sweeps converge.
    """
    sign = 1.0 if largest else -1.0
    for _ in range(n_sweeps):
        for i, j in ((0, 1), (1, 2), (0, 2)):
            x, y = centred @ axes[:, i], centred @ axes[:, j]
            u, v = x * x - y * y, 2.0 * x * y
            angle = 0.25 * np.arctan2(sign * 2.0 * float(u @ v), sign * float(u @ u - v @ v))
            turn = np.eye(3)
            turn[[i, j], [i, j]] = np.cos(angle)
            turn[i, j], turn[j, i] = -np.sin(angle), np.sin(angle)
            axes = axes @ turn
    return axes


def joined(parts: list[Starts]) -> Starts:
    """Several sets of starts as one."""
    return Starts(*(np.concatenate(part) for part in zip(*parts, strict=True)))


def _subset(points: Floats, most: int) -> Floats:
    """At most `most` of points (n, 3), drawn at random with a fixed seed."""
    if len(points) <= most:
        return points
    return np.asarray(points[np.random.default_rng(0).permutation(len(points))[:most]])


def _better_part(
    points: Floats, starts: Starts, warps: Warps, loss: Loss, settings: SearchSettings
) -> tuple[_Fits, Floats]:
    """Fits after the first and the second steps, without the worse starts; and their costs."""
    fits, costs = _solved(points, starts, warps, loss, settings.first_steps, settings)
    count = max(len(costs) // settings.drop_ratio, settings.min_kept)
    better = fits.starts.take(_distinct(costs, settings.same_cost)[:count])
    return _solved(points, better, warps, loss, settings.second_steps, settings)


def _distinct(costs: Floats, same_cost: float) -> NDArray[np.intp]:
    """Numbers of fits, best first; of those with the same cost, which are one solid, the first."""
    order = np.argsort(costs, kind="stable")
    ascending = costs[order]
    apart = np.diff(ascending, prepend=-np.inf) > same_cost * ascending
    return np.asarray(order[apart])


def _best_unfolded(fits: _Fits, warps: Warps) -> tuple[_Fits, bool]:
    """The best fit that its bend does not fold, else the best fit; and whether that is folded."""
    if not warps.bend:
        return fits.take(slice(1)), False
    folded = [folds(parameters, warps) for parameters in fits.starts.parameters]
    best = folded.index(False) if False in folded else 0
    return fits.take(slice(best, best + 1)), folded[best]


def _smallest_first(fits: _Fits, costs: Floats, max_cost_ratio: float) -> _Fits:
    """Fits as good as the best first, by volume: larger solids fit with thin rims, too."""
    alike = costs <= max_cost_ratio * costs[0]
    volumes = [
        shapes.superquadric_volume(np.exp(solid[:3]), solid[3:5]) if near else np.inf
        for solid, near in zip(fits.starts.parameters, alike, strict=True)
    ]
    return fits.take(np.argsort(volumes, kind="stable"))


def _polished(
    points: Floats,
    fits: _Fits,
    warps: Warps,
    inliers: Bools,
    folded: bool,
    tried: int,
    settings: SearchSettings,
) -> report.SearchResult:
    """One fit, solved to the last digits; its rotation is no longer bounded."""
    starts = fits.starts
    low, high = starts.low.copy(), starts.high.copy()
    low[:, ROTATION], high[:, ROTATION] = -np.inf, np.inf
    starts = starts._replace(low=low, high=high)
    steps, tolerance = settings.polish_steps, settings.polish_tolerance
    last = _solved(points[inliers], starts, warps, linear_loss, steps, settings, tolerance)[0]
    parameters, low, high, axes = (part[0] for part in last.starts)
    if not folded and warps.bend:
        folded = folds(parameters, warps)
    at_bound = (parameters <= low) | (parameters >= high)
    at_bound[3:5] = False  # the exponents of a box and an octahedron are good bounds
    converged, bounded = bool(last.converged[0]), bool(at_bound.any())
    steps = int(fits.steps[0] + last.steps[0])
    return report.SearchResult(parameters, axes, inliers, converged, folded, bounded, tried, steps)


def _solved(
    points: Floats,
    starts: Starts,
    warps: Warps,
    loss: Loss,
    steps: int,
    settings: SearchSettings,
    tolerance: float | None = None,
) -> tuple[_Fits, Floats]:
    """Fits after some steps from their starts, best first, and their costs."""

    def problem(parameters: Floats, rows: Ints) -> tuple[Floats, Floats]:
        return normal_distances(parameters, points, starts.axes[rows], warps)

    ends = levenberg_marquardt(
        problem,
        starts.parameters,
        starts.low,
        starts.high,
        loss=loss,
        steps=steps,
        min_residual=settings.rounding * float(np.sqrt(len(points))),
        tolerance=settings.tolerance if tolerance is None else tolerance,
    )
    best = np.argsort(ends.cost, kind="stable")
    moved = starts._replace(parameters=ends.parameters).take(best)
    return _Fits(moved, ends.steps[best], ends.converged[best]), ends.cost[best]


def folds(parameters: Floats, warps: Warps) -> bool:
    """Whether the bend squeezes the inner side to nothing, or closes the axis to a ring."""
    bend = parameters[warps.bend_columns]
    taper = parameters[warps.taper_columns] if warps.taper else np.zeros(2)
    base = shapes.Superquadric(np.exp(parameters[:3]), parameters[3:5])
    curvature = float(np.hypot(*bend))
    return curvature > shapes.largest_curvature(base, taper, float(np.arctan2(bend[1], bend[0])))


class _Fits(NamedTuple):
    """Unfinished fits, best first."""

    starts: Starts  # with the current parameters
    steps: Ints
    converged: Bools

    def take(self, which: slice | NDArray[np.intp]) -> _Fits:
        return _Fits(self.starts.take(which), self.steps[which], self.converged[which])


class Starts(NamedTuple):
    """Starts with their bounds; `distances.N_RIGID` has the order of parameters."""

    parameters: Floats  # (b, p)
    low: Floats
    high: Floats
    axes: Floats  # (b, 3, 3)

    def take(self, which: slice | NDArray[np.intp]) -> Starts:
        """A selection of the starts."""
        return Starts(*(part[which] for part in self))
