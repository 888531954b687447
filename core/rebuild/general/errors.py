"""How far a general solid is off, by the distance from what was touched and by how it is bent.

The spline is the mean of a Gaussian process: its energy is the negative logarithm of a density, the
inverse of its equations a covariance, displacements of the touches included. Draws from it tell how
much the surface varies at places on it (Rue and Held, *Gaussian Markov random fields*, 2005, 2.3);
averaged over places as far from every touched point they give an error by distance, which stays
true when a touch is added. What the energy believes of an object may be wrong: it is as smooth or
as rough everywhere, where objects have faces and edges. So errors grow with the bend of the surface
about a place: as (1 + (k b)^2)^(1/2) with the angle b between normals that lie `bend_reach` apart.
And all are scaled by how touches that are left out in turn are off, over how far they are expected
to be: by the mean of the ratios, or by their median if that says more. No touch counts for much:
those that alone know of an edge are far off, and say little of the rest.

Where an object has many edges the energy moves whole faces, and all their touches with them, which
no touch that is left out tells. But then touches seem displaced by more than the poses are said to
be off: what they are displaced over that counts as an error of all places alike, and more at the
edges, which a spline rounds off however many touches tell of them.

Touches that are left out lie far from the others. Where they agree better than usual the object is
smoother than the energy believes, and errors grow less with the distance from touch.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from palpate.core.arrays import Floats
from palpate.core.geometry import axes_across
from palpate.core.rebuild.contours import ContactPoints
from palpate.core.rebuild.general.band import basis_values
from palpate.core.rebuild.general.fitting import (
    Fitted,
    ImplicitFit,
    Solution,
    TouchedPoints,
    touch_middles,
)
from palpate.core.rebuild.general.leave_out import LeftOut, leave_out, solved_exactly
from palpate.reprs import readable


@dataclass(frozen=True, slots=True)
class ErrorSettings:
    """How errors are told.

    What bends weigh was fitted to forty solids of nine scanned objects: over what distance alone
    lets expect the errors were 0.7, 0.8, 0.9, 1.1, 1.3, 1.5, 2.1, 2.8 and 3.7 where the bend is
    0.03, 0.08, 0.15, 0.25, 0.4, 0.5, 0.7, 0.9 and 1.2, whether of fruit, boxes, cans or padlocks.
    """

    n_draws: int = 32  # of the spline
    min_slope: float = 0.3  # of the spline's gradient: a flatter one is no distance
    max_value: float = 0.1  # [cells] of the spline, at places that count as on the surface
    min_error: float = 10e-6  # [m] of a mesh beside its surface
    growth: float = 0.5  # largest error, over the distance from touch
    near: float = 0.7  # [cells] from touch: what counts as touched
    bend_reach: float = 3e-3  # [m] along the surface, over which its bend is an angle
    bend_weight: float = 4.1  # [1/rad] of a bend in the errors
    bound_factor: float = 1.25  # of a bound, over the expected error
    # What lies open is what is hard to reach: there bounds grow by 1 for each `open_growth` [m] of
    # distance beyond `open_distance` [m], up to `max_open_factor` times.
    open_distance: float = 2.5e-3
    open_growth: float = 2.5e-3
    max_open_factor: float = 1.5
    # The common error grows between these bends to `edge_factor` times its value. Drawn boxes with
    # sharp edges err by 0.25 to 0.4 mm there, even with 230 touches.
    edge_bends: tuple[float, float] = (0.3, 0.8)  # [rad]
    edge_factor: float = 3.0
    calibrated_growth: float = 1.5  # times as many touches: then a draft is calibrated again
    n_bend_directions: int = 6  # in which the surface is followed for its bend
    # [cells] from touched points: borders of the classes in which errors are averaged.
    class_borders: tuple[float, ...] = (0.0, 0.3, 0.7, 1.2, 1.8, 2.6, 3.6, 5.0, 7.0, 10.0, 14.0)
    n_places: int = 512  # at which draws are evaluated together
    max_ratio: float = 10.0  # of a touch's squared offset over the expected one, in their mean
    # What touches of scanned objects say (0.4 to 0.9) counts as so many of these touches do. With
    # half of it (balls, tori) errors far from touch are half of what the energy lets expect.
    usual_calibration: float = 0.6
    prior_touches: float = 8.0


ERRORS = ErrorSettings()
CHI_SQUARE_MEDIAN = 0.4549364  # Of one degree of freedom


@readable
@dataclass(frozen=True, slots=True, eq=False)
class SurfaceErrors:
    """Root mean square errors by distance from touched points and by the surface's bend, m."""

    distances: Floats  # Means of the classes and the largest, ascending, (k,)
    errors: Floats  # Where the surface is flat, never falling, (k,)
    places: Floats  # On the surface, from its origin, (n, 3)
    bends: Floats  # There, rad, (n,)
    common: float  # Of all places alike, as displacements of the touches tell
    held_out: float  # Root mean square offset of touches that were left out
    calibration: float  # Squared errors over those that the fit expected, by these touches
    calibrated: int  # How many touches there were then

    def at(self, places: Floats, distances: Floats) -> tuple[Floats, Floats]:
        """Expected errors (n,) at places (n, 3) at distances (n,), and their bounds of 95 %."""
        bends = self.bends[scipy.spatial.cKDTree(self.places).query(places)[1]]
        beyond = ERRORS.growth * np.maximum(distances - self.distances[-1], 0.0)
        errors = np.interp(distances, self.distances, self.errors) + beyond
        errors = np.hypot(errors * np.sqrt(bend_factors(bends)), self.common * _edge_factors(bends))
        opened = np.maximum(distances - ERRORS.open_distance, 0.0) / ERRORS.open_growth
        factors = ERRORS.bound_factor * np.minimum(1.0 + opened, ERRORS.max_open_factor)
        return errors, factors * errors


def bend_factors(bends: Floats) -> Floats:
    """Squared errors where the surface is bent by so much, rad, over those where it is flat."""
    return np.asarray(1.0 + (ERRORS.bend_weight * bends) ** 2)


def _edge_factors(bends: Floats) -> Floats:
    """Factors (n,) of the common error at places with these bends (n,) [rad]."""
    return np.asarray(np.interp(bends, ERRORS.edge_bends, (1.0, ERRORS.edge_factor)))


def touch_distances(contacts: ContactPoints, places: Floats) -> Floats:
    """Distances (n,) of places (n, 3) from the nearest touched point, m."""
    return np.asarray(scipy.spatial.cKDTree(contacts.points).query(places)[0])


def surface_errors(
    fitted: Fitted, before: SurfaceErrors | None = None
) -> tuple[ImplicitFit, SurfaceErrors]:
    """The fit, solved exactly, its errors, and those of touches that are left out, m.

    `before`: of a fit of most of these touches, whose calibration still holds.
    """
    cell, solution = fitted.spline.cell, fitted.solution
    reach = ERRORS.bend_reach / cell
    count = len(fitted.spline.fit.displacements)
    if before is None or count > ERRORS.calibrated_growth * before.calibrated:
        left = leave_out(solution, count=int(fitted.points.touch.max()) + 1)
        solution, covariance = left.solution, left.covariance
        touched = touch_middles(fitted.points.places, fitted.points.touch)[left.touches]
        scale = calibration(left, bend_factors(surface_bends(solution.fit, touched, reach)))
        held_out = cell * float(np.sqrt(left.squares.mean()))
    else:
        solution, covariance = solved_exactly(solution)
        scale, held_out, count = before.calibration, before.held_out, before.calibrated
    places = _surface_places(solution.fit)
    bends = surface_bends(solution.fit, places, reach)
    distances = np.asarray(scipy.spatial.cKDTree(fitted.points.places).query(places)[0])
    variances = scale * _variances(solution, covariance, places)
    middles, errors = _by_distance(distances, variances, cell)
    errors = _smoother(errors, scale)
    alone = solution.fit.displacements
    if fitted.shared is not None:
        alone = fitted.shared.without(alone)
    common = cell * _common_error(alone, fitted.points, fitted.weights.pose)
    return solution.fit, SurfaceErrors(
        cell * middles, cell * errors, cell * places, bends, common, held_out, scale, count
    )


def _common_error(displacements: Floats, points: TouchedPoints, pose: float) -> float:
    """By how much touches are displaced along their normals over what their poses may be, cells."""
    along = np.einsum("ni,ni->n", points.normals, displacements[points.touch])
    means = np.bincount(points.touch, along) / np.maximum(np.bincount(points.touch), 1)
    return float(np.sqrt(max(float(np.mean(means**2)) - pose**2, 0.0)))


def _by_distance(distances: Floats, variances: Floats, cell: float) -> tuple[Floats, Floats]:
    """Means of the classes of distance and the largest one, (k,), and errors there, (k,), cells."""
    # Far from touches nothing holds the spline, and the object no less.
    touched = float(np.median(variances[distances <= max(ERRORS.near, float(distances.min()))]))
    variances = np.minimum(variances, (np.sqrt(touched) + ERRORS.growth * distances) ** 2)
    classes = np.digitize(distances, ERRORS.class_borders) - 1
    members = [classes == number for number in np.unique(classes)]
    middles = [*(distances[here].mean() for here in members), distances.max()]
    means = [variances[here].mean() for here in members]
    rising = np.maximum.accumulate([*means, means[-1]])
    return np.array(middles), np.sqrt(rising + (ERRORS.min_error / cell) ** 2)


def _smoother(errors: Floats, scale: float) -> Floats:
    """Errors by distance, whose growth is reduced where `scale` is below the usual calibration."""
    growing = min(scale / ERRORS.usual_calibration, 1.0)
    return np.asarray(np.sqrt(errors[0] ** 2 + growing * (errors**2 - errors[0] ** 2)))


def surface_bends(fit: ImplicitFit, places: Floats, reach: float) -> Floats:
    """Largest angle (n,) between the normals at places (n, 3) and `reach` beside them, cells; rad.

    Where the band ends nothing is known of it, which counts as flat.
    """
    bends = np.zeros(len(places))
    normals = _unit_gradients(fit, places)
    known = np.isfinite(normals).all(axis=1)
    places, normals = places[known], normals[known]
    axes = axes_across(normals)
    least = np.ones(len(places))  # cosine
    for turn in np.linspace(0.0, 2.0 * np.pi, ERRORS.n_bend_directions, endpoint=False):
        beside = places + reach * (np.cos(turn) * axes[:, 0] + np.sin(turn) * axes[:, 1])
        there = _unit_gradients(fit, beside)
        least = np.fmin(least, np.einsum("ni,ni->n", normals, there))
    bends[known] = np.arccos(np.clip(least, -1.0, 1.0))
    return bends


def _unit_gradients(fit: ImplicitFit, places: Floats) -> Floats:
    """Unit vectors (n, 3) along the spline's gradient; NaN beyond the band."""
    gradient = fit.band.evaluate(fit.control, places)[1]
    return np.asarray(gradient / np.linalg.norm(gradient, axis=1, keepdims=True))


def calibration(left: LeftOut, factors: Floats) -> float:
    """Squared errors over those that a fit expects, as the touches that were left out tell.

    That they agree better than usual may be chance: so what is usual counts as well, as by a
    conjugate prior of a variance. `factors` (k,): of what is expected, where the surface is bent.
    """
    ratios = left.squares / (factors * left.expected)
    median = float(np.median(ratios)) / CHI_SQUARE_MEDIAN
    measured = max(median, float(np.minimum(ratios, ERRORS.max_ratio).mean()))
    known = len(ratios) / (len(ratios) + ERRORS.prior_touches)
    return max(measured, known * measured + (1.0 - known) * ERRORS.usual_calibration)


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
    number, offsets = band.locate(places)
    variances = np.empty(len(places))
    for begin in range(0, len(places), ERRORS.n_places):
        some = slice(begin, begin + ERRORS.n_places)
        rows = basis_values(offsets[some])
        values = np.einsum("kl,kld->kd", rows, draws[band.local[number[some]]])
        variances[some] = np.square(values).mean(axis=1)
    return np.asarray(variances / slope**2)


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
