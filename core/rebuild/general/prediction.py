"""How far a general solid is off, as a function of the distance from what was touched.

Touches are left out in turn, and predicted from the others: what the solid is off by at a place
that lies so far from everything touched is what it was off by where a touch then came. A touch that
is left out is itself displaced by its pose error, which is taken off again. Beyond the farthest of
these distances nothing was ever checked: there the error is taken to grow with the distance itself.
An object that stands is continued below its lowest touches; how well that can be done is checked by
leaving out all walls that were touched within the same height above them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import ConvexHull, cKDTree

from palpate.core.arrays import Bools, Floats
from palpate.core.rebuild.contours import ContactPoints
from palpate.core.rebuild.general.dissection import Dissection
from palpate.core.rebuild.general.fitting import ImplicitFit, TouchedPoints, Weights, fit_implicit

FOLDS, FEW_FOLDS = 4, 2  # Of the touches; and how many of these are left out on the way
# Distances from touched points, in cells, between which errors are averaged.
EDGES = np.array([0.0, 0.3, 0.7, 1.2, 1.8, 2.6, 3.6, 5.0, 7.0])
LEAST_TOUCHES = 6  # In a class, for its mean to be believed
LOWEST = 0.5  # Percent of the points: those are not the height above which an object was touched
UPWARD = 0.5  # Upward part of the normals of floors and ledges, which nothing goes on below
LEAST_FOOT = 0.01  # Height of the lowest touches over the platform, cells: below is no foot
SURE = 1.64  # Standard errors added to a mean: 95 of 100 are below
GROWTH = 0.5  # Error over distance where nothing was checked
LEAST_SLOPE = 0.3  # Of the gradient
FARTHEST = 15.0e-3  # m
OPEN = 5.0e-3  # From every touch: what lies farther was not touched, m
# Error of a place that is left open over that of one that was touched later, at the same distance:
# what is left open is what is hard to reach. One more each so many m, and at most so many.
OPEN_WAY, MOST_OPEN_FACTOR = 2.5e-3, 4.5
FOOT_FACTOR = 2.5  # The same of what lies below the lowest touches
LEAN = 0.05  # How far an underside may be off that nobody touched, over the distance from touch
# What reaches so far beyond the convex hull of all that was touched is made up, m. Its error is
# what is over that, the bound so many times.
PROTRUDING, PROTRUDING_FACTOR = 1.0e-3, 1.5
GRID = 2.0e-3  # Of touched points one for each cube of this edge spans the hull, m
BLOCK = 1000  # Places that are held against all faces of it at a time
LEAST_ERROR = 10.0e-6  # Of a mesh beside its surface, m


@dataclass(frozen=True, slots=True, eq=False)
class DistanceErrors:
    """Root mean square errors by distance from touched points; in one unit of length."""

    distances: Floats  # Middles of the classes that were checked, ascending, (k,)
    errors: Floats  # Never falling, (k,)
    upper: Floats  # Their upper bounds of 95 %, (k,)
    alarm: float  # Root mean square error of all touches that were left out

    def at(self, distances: Floats, *, upper: bool = False) -> Floats:
        """Expected errors (n,) at distances (n,), or upper bounds of them."""
        errors = self.upper if upper else self.errors
        if not len(errors):
            return np.asarray(GROWTH * distances)
        beyond = np.maximum(distances - self.distances[-1], 0.0)
        return np.asarray(np.interp(distances, self.distances, errors) + GROWTH * beyond)


def touch_distances(contacts: ContactPoints, places: Floats) -> Floats:
    """Distances (n,) of places (n, 3) from the nearest touched point, m."""
    return np.asarray(cKDTree(contacts.points).query(places)[0])


def touch_squares(touched: ContactPoints, distances: Floats) -> Floats:
    """Of each touch, the mean square (t,) of the distances (n,) of its points from a solid, m^2.

    What is farther off than `FARTHEST` counts as that: how much farther says nothing.
    """
    found = np.minimum(distances, FARTHEST) ** 2
    _, touch, counts = np.unique(touched.touch, return_inverse=True, return_counts=True)
    return np.asarray(np.bincount(touch, found) / counts)


def open_factors(distances: Floats) -> Floats:
    """By how much bounds (n,) grow where nothing was touched within distances (n,), m."""
    return np.asarray(np.minimum(1.0 + distances / OPEN_WAY, MOST_OPEN_FACTOR))


def protrusions(touched: Floats, places: Floats) -> Floats:
    """How far places (n, 3) lie beyond the convex hull of touched points (k, 3), (n,), m, or 0."""
    _, first = np.unique(np.floor(touched / GRID), axis=0, return_index=True)
    beyond = np.zeros(len(places))
    if len(first) <= touched.shape[1]:
        return beyond
    faces = ConvexHull(touched[first], qhull_options="QJ").equations
    for begin in range(0, len(places), BLOCK):
        some = slice(begin, begin + BLOCK)
        beyond[some] = (places[some] @ faces[:, :3].T + faces[:, 3]).max(axis=1)
    return np.maximum(beyond, 0.0)


@dataclass(frozen=True, slots=True, eq=False)
class FootErrors:
    """Errors below the lowest touches of an object that stands, m."""

    lowest: float  # Height of these over the platform
    error: float  # Root mean square error at the platform

    def at(self, heights: Floats) -> Floats:
        """Expected errors (n,) at heights (n,) over the platform: as the square of the way down."""
        below = np.clip(self.lowest - heights, 0.0, self.lowest)
        return np.asarray(self.error * np.square(below / max(self.lowest, LEAST_ERROR)))

    def bounds(self, heights: Floats, distances: Floats) -> Floats:
        """Bounds (n,) of them at distances (n,) from touch: undersides may lean, or be hollow."""
        return np.asarray(np.hypot(FOOT_FACTOR * self.at(heights), LEAN * distances))


def held_out_errors(
    fit: ImplicitFit,
    points: TouchedPoints,
    coarse: Floats,
    weights: Weights,
    cell: float,
    *,
    folds: int = FOLDS,
    dissection: Dissection | None = None,
) -> DistanceErrors:
    """Errors by distance, m, of a fit; arguments as of `fit_implicit`.

    `cell`: edge of a cell, m. `folds`: how many quarters of the touches are left out in turn.
    """
    touches = len(fit.displacements)
    rng = np.random.default_rng(touches)
    fold = rng.permutation(touches) % FOLDS
    away, squares = np.full(len(points.places), np.nan), np.full(len(points.places), np.nan)
    for turn in range(folds):
        out = fold[points.touch] == turn
        if out.any() and not out.all():
            found = _left_out(fit, points, out, coarse, weights, dissection)
            away[out], squares[out] = found
    return _by_distance(points, away, squares, _pose_variance(fit, points), cell)


def foot_errors(
    fit: ImplicitFit,
    points: TouchedPoints,
    coarse: Floats,
    weights: Weights,
    cell: float,
    *,
    dissection: Dissection | None = None,
) -> FootErrors | None:
    """Errors below the lowest touches of an object that stands, m; arguments as `held_out_errors`.

    None if nothing was touched above them, or the object down to its foot.
    """
    lowest = float(np.percentile(points.places[:, 2], LOWEST))
    out = (points.places[:, 2] < 2.0 * lowest) & (points.normals[:, 2] < UPWARD)
    if lowest < LEAST_FOOT or not out.any() or out.all():
        return None
    _, squares = _left_out(fit, points, out, coarse, weights, dissection)
    down = 2.0 - points.places[out, 2] / lowest
    known = np.isfinite(squares)
    excess = max(float(squares[known].mean()) - _pose_variance(fit, points), 0.0)
    return FootErrors(lowest * cell, cell * float(np.sqrt(excess / np.mean(down[known] ** 4))))


def _left_out(
    fit: ImplicitFit,
    points: TouchedPoints,
    out: Bools,
    coarse: Floats,
    weights: Weights,
    dissection: Dissection | None,
) -> tuple[Floats, Floats]:
    """Of points that are left out, how far they lie from the others, and off, squared; cells."""
    kept = points.only(~out)
    start = ImplicitFit(
        fit.band, fit.control, fit.displacements, fit.weights[~out], fit.residuals[~out]
    )
    terms = fit.band, kept, coarse, weights
    touches = len(fit.displacements)
    other = fit_implicit(*terms, touches=touches, rounds=1, start=start, dissection=dissection)
    value, gradient = fit.band.evaluate(other.control, points.places[out])
    slope = np.maximum(np.linalg.norm(gradient, axis=1), LEAST_SLOPE)
    return np.asarray(cKDTree(kept.places).query(points.places[out])[0]), (value / slope) ** 2


def _pose_variance(fit: ImplicitFit, points: TouchedPoints) -> float:
    """Of displacements along the normals, as far as overlaps tell."""
    along = np.einsum("ij,ij->i", points.normals, fit.displacements[points.touch])
    return float(np.mean(along**2))


def _by_distance(
    points: TouchedPoints, away: Floats, squares: Floats, pose: float, cell: float
) -> DistanceErrors:
    known = np.isfinite(squares)
    classes = np.digitize(away[known], EDGES) - 1
    touch, square, distance = points.touch[known], squares[known], away[known]
    middles, means, upper = [], [], []
    for number in range(len(EDGES)):
        here = classes == number
        of_touch, counts = np.unique(touch[here], return_counts=True)
        if len(of_touch) < LEAST_TOUCHES:
            continue
        sums = np.bincount(np.searchsorted(of_touch, touch[here]), square[here])
        each = sums / counts
        mean = max(float(each.mean()) - pose, 0.0)
        middles.append(float(distance[here].mean()))
        means.append(mean)
        upper.append(mean + SURE * float(each.std()) / np.sqrt(len(each)))
    least = (LEAST_ERROR / cell) ** 2
    rising = np.sqrt(np.maximum.accumulate(means) + least) if means else np.zeros(0)
    above = np.sqrt(np.maximum.accumulate(upper) + least) if upper else np.zeros(0)
    alarm = float(np.sqrt(square.mean())) if len(square) else 0.0
    return DistanceErrors(np.array(middles) * cell, rising * cell, above * cell, alarm * cell)
