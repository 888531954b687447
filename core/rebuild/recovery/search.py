"""The best of many fits that are solved side by side.

All starts take a few steps; those that have come farthest are solved to their ends; the smallest
solid of those that fit best is polished. With outliers, a robust loss leads to the neighbourhood,
and plain least squares over the points that are near the solid end it. Of very many points, some
are enough to find the neighbourhood.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from palpate.core.arrays import Bools, Floats, Ints
from palpate.core.least_squares import Loss, cauchy, linear, minimise
from palpate.core.rebuild.recovery.fold import folds
from palpate.core.rebuild.recovery.normal_distance import Warps, distances_alone, normal_distances
from palpate.core.rebuild.recovery.outliers import outlyingness
from palpate.core.rebuild.recovery.starts import Exponents, Starts, joined, starts_of
from palpate.core.rotation import rotations_of_vectors
from palpate.core.shapes.superquadric_measures import volume

FIRST_STEPS, SECOND_STEPS, NEXT_STEPS, LAST_STEPS = 4, 6, 60, 200
DROPPED, FEWEST = 3, 48
"""One in so many starts goes on after the first steps, but at least this many."""
KEPT, KEPT_ROBUST = 4, 8
"""Starts that are solved to the end."""
TURN = slice(5, 8)
"""Where the rotation vector is among the parameters."""
MANY = 200
"""Points among which the best start is found; all of them end it."""
ROUGH, FINE = 1e-6, 1e-9
"""Tolerances: see `minimise`."""
SCALES = (0.02, 0.01)
"""Of the points' diameter: distances beyond which a robust loss grows slowly."""
TRIMMED = (0.15, 0.3, 0.45)
"""Shares of the outlying points that the extents of starts may leave out."""
FAR = 3.0
"""Standard deviations beyond which a point is an outlier."""
MAD = 1.4826
"""Standard deviation over the median of the absolute values, for the normal distribution."""
ALIKE = 1e-6
"""Share of its cost by which a fit must be worse than another to be another."""
LEEWAY = 1.1
"""Times the least cost: no more than chance makes of it with some fifty points."""
REFITS = 6
EXACT = 1e-13
"""Of the points' diameter: residuals of this size are roundings."""
LEAST_NOISE = 1e-9
"""Of the points' diameter."""


class Found(NamedTuple):
    """The best fit."""

    parameters: Floats
    """(p,), see `normal_distance.RIGID`."""
    axes: Floats
    """(3, 3): what its rotation vector turns."""
    inliers: Bools
    """(n,)."""
    converged: bool
    folded: bool
    """True if no start led to a solid that its bend does not fold; this one does."""
    bounded: bool
    """True if a size, the place, a widening or the bend is at the end of what its start allows."""
    starts: int
    """Starts tried."""
    steps: int
    """Steps tried by the fit that was taken, those of its first stage left out."""

    def turned_axes(self) -> Floats:
        """The solid's axes (3, 3)."""
        result: Floats = self.axes @ rotations_of_vectors(self.parameters[None, 5:8])[0]
        return result

    def place(self) -> Floats:
        """Where the solid's middle is, (3,)."""
        result: Floats = self.axes @ self.parameters[8:11]
        return result


def search(points: Floats, warps: Warps, choice: Exponents | None) -> Found:
    """Fit points (n, 3), of diameter about 1, that have no outliers."""
    starts, some = starts_of(points, warps, choice), _some(points)
    first, costs = _narrowed(some, starts, warps, linear)
    best = first.starts.take(_distinct(costs)[:KEPT])
    fits, folded = _unfolded(_smallest(*_solved(some, best, warps, linear, NEXT_STEPS)), warps)
    return _ended(points, fits, warps, np.ones(len(points), bool), folded, len(starts.axes))


def search_among_outliers(
    points: Floats, warps: Warps, choice: Exponents | None, noise: float | None
) -> Found:
    """Fit points (n, 3) of which some have nothing to do with the solid.

    `noise` is the standard deviation of the others, in the same unit, if it is known.
    """
    apart = outlyingness(points)
    starts = joined(
        [
            starts_of(points[apart <= np.quantile(apart, 1.0 - share)], warps, choice)
            for share in TRIMMED
        ]
    )
    rough, fine = (cauchy(max(scale, noise or 0.0)) for scale in SCALES)
    some = _some(points)
    first = _narrowed(some, starts, warps, rough)[0].starts
    distances = distances_alone(first.parameters, some, first.axes, warps)
    best = first.take(_distinct(fine(distances**2)[0].sum(axis=1))[:KEPT_ROBUST])
    fits, folded = _unfolded(_solved(some, best, warps, fine, NEXT_STEPS)[0], warps)
    inliers, fits = _refitted(points, fits, warps, noise)
    return _ended(points, fits, warps, inliers, folded, len(starts.axes))


def _some(points: Floats) -> Floats:
    """Not too many of points (n, 3), in no order that they may have; the same ones each time."""
    if len(points) <= MANY:
        return points
    result: Floats = points[np.random.default_rng(0).permutation(len(points))[:MANY]]
    return result


class _Fits(NamedTuple):
    """Fits under way, best first."""

    starts: Starts
    """Their parameters are where the fits have come to."""
    steps: Ints
    converged: Bools

    def take(self, which: slice | NDArray[np.intp]) -> _Fits:
        return _Fits(self.starts.take(which), self.steps[which], self.converged[which])


def _narrowed(points: Floats, starts: Starts, warps: Warps, loss: Loss) -> tuple[_Fits, Floats]:
    """The better part of the fits after their first steps, best first, and what they cost."""
    fits, costs = _solved(points, starts, warps, loss, FIRST_STEPS)
    better = _distinct(costs)[: max(len(costs) // DROPPED, FEWEST)]
    return _solved(points, fits.starts.take(better), warps, loss, SECOND_STEPS)


def _solved(
    points: Floats,
    starts: Starts,
    warps: Warps,
    loss: Loss,
    steps: int,
    tolerance: float = ROUGH,
) -> tuple[_Fits, Floats]:
    """Fits after some steps from their starts, best first, and what they cost."""

    def problem(parameters: Floats, rows: Ints) -> tuple[Floats, Floats]:
        return normal_distances(parameters, points, starts.axes[rows], warps)

    ends = minimise(
        problem,
        starts.parameters,
        starts.low,
        starts.high,
        loss=loss,
        steps=steps,
        enough=EXACT * float(np.sqrt(len(points))),
        tolerance=tolerance,
    )
    best = np.argsort(ends.cost, kind="stable")
    moved = starts._replace(parameters=ends.parameters).take(best)
    return _Fits(moved, ends.steps[best], ends.converged[best]), ends.cost[best]


def _distinct(costs: Floats) -> NDArray[np.intp]:
    """Which fits to go on with, best first: of those that cost the same, one.

    They are one solid, described in several ways.
    """
    order = np.argsort(costs, kind="stable")
    ascending = costs[order]
    apart = np.diff(ascending, prepend=-np.inf) > ALIKE * ascending
    result: NDArray[np.intp] = order[apart]
    return result


def _smallest(fits: _Fits, costs: Floats) -> _Fits:
    """The fits, those first that are as good as the best, of these the smallest solid first.

    Points on a thin rim are met as well by a larger solid with corners beyond them. Fung, 1999,
    wants the least volume of (2.10) for the same reason.
    """
    alike = costs <= LEEWAY * costs[0]
    volumes = [
        volume(np.exp(one[:3]), one[3:5]) if near else np.inf
        for one, near in zip(fits.starts.parameters, alike, strict=True)
    ]
    return fits.take(np.argsort(volumes, kind="stable"))


def _unfolded(fits: _Fits, warps: Warps) -> tuple[_Fits, bool]:
    """The best fit whose solid is not folded by its bend; the best of all if there is none."""
    if not warps.bend:
        return fits.take(slice(1)), False
    folded = [folds(one, warps) for one in fits.starts.parameters]
    which = folded.index(False) if False in folded else 0
    return fits.take(slice(which, which + 1)), folded[which]


def _refitted(
    points: Floats, fits: _Fits, warps: Warps, noise: float | None
) -> tuple[Bools, _Fits]:
    """One fit, fitted again and again to the points that are near it."""
    inliers = np.ones(len(points), bool)
    for turn in range(REFITS):
        starts = fits.starts
        distances = np.abs(distances_alone(starts.parameters, points, starts.axes, warps)[0])
        spread = noise or _spread(distances[inliers], warps.total)
        near = distances <= FAR * max(spread, LEAST_NOISE)
        if near.sum() <= warps.total or (turn > 0 and np.array_equal(near, inliers)):
            break
        inliers = near
        fits = _solved(points[inliers], starts, warps, linear, NEXT_STEPS)[0]
    return inliers, fits


def _spread(distances: Floats, fitted: int) -> float:
    """Standard deviation of the points that a fit of some parameters left these distances."""
    left = max(len(distances) - fitted, 1)
    return MAD * float(np.median(distances)) * float(np.sqrt(len(distances) / left))


def _ended(
    points: Floats, fits: _Fits, warps: Warps, inliers: Bools, folded: bool, tried: int
) -> Found:
    """One fit, solved to the last digits; its turn need no longer keep it apart from others."""
    starts = fits.starts
    low, high = starts.low.copy(), starts.high.copy()
    low[:, TURN], high[:, TURN] = -np.inf, np.inf
    starts = starts._replace(low=low, high=high)
    last = _solved(points[inliers], starts, warps, linear, LAST_STEPS, FINE)[0]
    parameters, low, high, axes = (part[0] for part in last.starts)
    if not folded and warps.bend:
        folded = folds(parameters, warps)
    at_end = (parameters <= low) | (parameters >= high)
    at_end[3:5] = False  # a box and an octahedron are good ends
    return Found(
        parameters,
        axes,
        inliers,
        bool(last.converged[0]),
        folded,
        bool(at_end.any()),
        tried,
        int(fits.steps[0] + last.steps[0]),
    )
