"""How far a general solid is off, by the distance from what was touched.

The spline is the mean of a Gaussian process: its energy is the negative logarithm of a density, the
inverse of its equations a covariance, displacements of the touches included. Draws from it tell how
much the surface varies at places on it (Rue and Held, *Gaussian Markov random fields*, 2005, 2.3);
averaged over places as far from every touched point they give an error by distance, which stays
true when a touch is added. What the energy believes of an object may be wrong: it is smoother, or
rougher. So the errors are scaled by how touches that are left out in turn are off, over how far
they are expected to be: by the mean of the ratios, or by their median if that says more. No touch
counts for much: those that alone know of an edge are far off, and say little of the rest.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from palpate.core.arrays import Floats
from palpate.core.rebuild.contours import ContactPoints
from palpate.core.rebuild.general.band import basis_rows
from palpate.core.rebuild.general.fitting import Fitted, ImplicitFit, Solution
from palpate.core.rebuild.general.leave_out import (
    LeftOut,
    displacement_covariance,
    leave_out,
)
from palpate.reprs import readable


@dataclass(frozen=True, slots=True)
class ErrorSettings:
    """How errors are told.

    With a bound's factor of 1.25 the bound held in all but two of some thirty runs of scans, both
    of a banana, 1.04 and 1.18 of it; so it is a little more.
    """

    n_draws: int = 64  # of the spline
    min_slope: float = 0.3  # of the spline's gradient: a flatter one is no distance
    max_value: float = 0.1  # [cells] of the spline, at places that count as on the surface
    min_error: float = 10e-6  # [m] of a mesh beside its surface
    growth: float = 0.5  # largest error, over the distance from touch
    near: float = 0.7  # [cells] from touch: what counts as touched
    bound_factor: float = 1.4  # of a bound, over the expected error
    # What lies open is what is hard to reach: there bounds grow by 1 for each `open_growth` [m] of
    # distance beyond `open_distance` [m], up to `max_open_factor` times.
    open_distance: float = 2.5e-3
    open_growth: float = 2.5e-3
    max_open_factor: float = 2.0
    calibrated_growth: float = 1.5  # times as many touches: then a draft is calibrated again
    max_ratio: float = 10.0  # of a touch's squared offset over the expected one, in their mean
    prior_touches: float = 8.0  # that are as far off as expected, counted with those left out


ERRORS = ErrorSettings()
# Distances from touched points, in cells, between which errors are averaged.
EDGES = np.array([0.0, 0.3, 0.7, 1.2, 1.8, 2.6, 3.6, 5.0, 7.0, 10.0, 14.0, np.inf])
CHI_SQUARE_MEDIAN = 0.4549364  # Of one degree of freedom
BLOCK = 512  # Places at which draws are looked at together


@readable
@dataclass(frozen=True, slots=True, eq=False)
class DistanceErrors:
    """Root mean square errors by distance from touched points, m."""

    distances: Floats  # Middles of the classes, ascending, (k,)
    errors: Floats  # Never falling, (k,)
    held_out: float  # Root mean square offset of touches that were left out
    calibration: float  # Squared errors over those that the fit expected, by these touches
    calibrated: int  # How many touches there were then

    def at(self, distances: Floats) -> Floats:
        """Expected errors (n,) at distances (n,)."""
        beyond = np.maximum(distances - self.distances[-1], 0.0)
        return np.asarray(
            np.interp(distances, self.distances, self.errors) + ERRORS.growth * beyond
        )

    def bounds(self, distances: Floats) -> Floats:
        """Bounds of 95 % (n,) of the errors at distances (n,)."""
        opened = np.maximum(distances - ERRORS.open_distance, 0.0) / ERRORS.open_growth
        factors = ERRORS.bound_factor * np.minimum(1.0 + opened, ERRORS.max_open_factor)
        return np.asarray(factors * self.at(distances))


def touch_distances(contacts: ContactPoints, places: Floats) -> Floats:
    """Distances (n,) of places (n, 3) from the nearest touched point, m."""
    return np.asarray(scipy.spatial.cKDTree(contacts.points).query(places)[0])


def distance_errors(fitted: Fitted, before: DistanceErrors | None = None) -> DistanceErrors:
    """The errors of a fit by distance, and how far touches that are left out are off, m.

    `before`: of a fit of most of these touches, whose calibration still holds.
    """
    cell, solution = fitted.spline.cell, fitted.solution
    count = len(fitted.spline.fit.displacements)
    if before is None or count > ERRORS.calibrated_growth * before.calibrated:
        left = leave_out(solution)
        solution, covariance = left.solution, left.covariance
        scale, held_out = calibration(left), cell * float(np.sqrt(left.squares.mean()))
    else:
        covariance = displacement_covariance(solution)
        scale, held_out, count = before.calibration, before.held_out, before.calibrated
    places = _surface_places(fitted.spline.fit)
    distances = np.asarray(scipy.spatial.cKDTree(fitted.points.places).query(places)[0])
    squares = scale * _variances(solution, covariance, places)
    # Far from touches nothing holds the spline, and the object no less.
    touched = float(np.median(squares[distances <= max(ERRORS.near, float(distances.min()))]))
    squares = np.minimum(squares, (np.sqrt(touched) + ERRORS.growth * distances) ** 2)
    classes = np.digitize(distances, EDGES) - 1
    middles, errors = [], []
    for number in np.unique(classes):
        here = classes == number
        middles.append(float(distances[here].mean()))
        errors.append(float(squares[here].mean()))
    least = (ERRORS.min_error / cell) ** 2
    rising = np.sqrt(np.maximum.accumulate(errors) + least)
    return DistanceErrors(cell * np.array(middles), cell * rising, held_out, scale, count)


def calibration(left: LeftOut) -> float:
    """Squared errors over those that a fit expects, as the touches that were left out tell.

    That they agree better than expected may be chance: `prior_touches` that agree as expected are
    counted with them, as by a conjugate prior of a variance.
    """
    ratios = left.squares / left.expected
    median = float(np.median(ratios)) / CHI_SQUARE_MEDIAN
    found = max(median, float(np.minimum(ratios, ERRORS.max_ratio).mean()))
    known = len(ratios) / (len(ratios) + ERRORS.prior_touches)
    return max(found, 1.0 + known * (found - 1.0))


def _surface_places(fit: ImplicitFit) -> Floats:
    """Places (n, 3) on the surface, one from the middle of each cell that it passes near, cells."""
    places = np.asarray(fit.band.cells + 0.5, np.float64)
    for _ in range(2):
        value, gradient = fit.band.evaluate(fit.control, places)
        square = np.maximum((gradient**2).sum(axis=1), ERRORS.min_slope**2)
        places = np.asarray(places - (value / square)[:, None] * gradient)
        places = places[np.isfinite(places).all(axis=1)]
    reached = np.abs(fit.band.evaluate(fit.control, places)[0]) < ERRORS.max_value
    return places[reached]


def _variances(solution: Solution, covariance: Floats, places: Floats) -> Floats:
    """Variance (n,) of the surface at places (n, 3) on it, cells^2; as of `_draws`."""
    band, control = solution.fit.band, solution.fit.control
    draws = _draws(solution, covariance)
    gradient = band.evaluate(control, places)[1]
    slope = np.maximum(np.linalg.norm(gradient, axis=1), ERRORS.min_slope)
    number, within = band.locate(places)
    found = np.empty(len(places))
    for begin in range(0, len(places), BLOCK):
        some = slice(begin, begin + BLOCK)
        rows = basis_rows(within[some])[0]
        values = np.einsum("kl,kld->kd", rows, draws[band.local[number[some]]])
        found[some] = np.square(values).mean(axis=1)
    return np.asarray(found / slope**2)


def _draws(solution: Solution, covariance: Floats) -> Floats:
    """Control values (n, d) less their mean, displacements of this covariance drawn with them.

    With a covariance (0, 0) displacements are held.
    """
    rng, count = np.random.default_rng(0), ERRORS.n_draws
    if not len(covariance):
        return solution.factor.draws(rng.normal(size=(len(solution.right), count)))
    symmetric = 0.5 * (covariance + covariance.T)
    moved = np.linalg.cholesky(symmetric) @ rng.normal(size=(len(covariance), count))
    free = solution.factor.draws(rng.normal(size=(len(solution.right), count)))
    return np.asarray(free - solution.factor.solve(np.asarray(solution.coupling() @ moved)))
