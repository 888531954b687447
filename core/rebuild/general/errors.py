"""Expected errors of a general solid, by the distance from touched points and by its bend.

The spline is the mean of a Gaussian process: its energy is the negative logarithm of a density, the
inverse of its equations is its covariance, including displacements of the touches. Draws from it
have the variance of the surface at places on it (Rue and Held, *Gaussian Markov random fields*,
2005, 2.3); its mean over places at the same distance from touched points is an error by distance,
which holds when a touch is added. The prior is the same everywhere, but objects have flat faces and
sharp edges. So errors grow with the bend of the surface about a place: by (1 + (k b)^2)^(1/2), with
k the `bend_weight` and b the largest angle between the normals there and 3 mm beside it (`bends`).
All errors are then calibrated by touches that are left out in turn: squared errors are multiplied
by the ratio of squared offsets to expected ones, its mean or, if larger, its scaled median. Each
ratio is limited: a touch that is the only one on an edge is far off, and not typical of the rest.

The fit can move whole faces together with all their touches (see `bends`), which touches that are
left out cannot show. But then touches seem displaced by more than their pose
error. The excess is a common error: it is added at all places, with a larger factor at edges, which
a spline rounds off however many touches lie there.

Touches that are left out lie far from the others. Where they agree better than usual, the object is
smoother than the prior, and errors grow less with the distance from touched points.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import scipy

from palpate.core.arrays import Floats
from palpate.core.rebuild.contours import ContactPoints
from palpate.core.rebuild.general.band import basis_values
from palpate.core.rebuild.general.bends import DEFAULT_BENDS, BendSettings, surface_bends
from palpate.core.rebuild.general.fitting import (
    Fitted,
    ImplicitFit,
    Solution,
    TouchedPoints,
    touch_middles,
)
from palpate.core.rebuild.general.leave_out import (
    LeaveOutSettings,
    LeftOut,
    leave_out,
    solved_exactly,
)
from palpate.reprs import readable


@dataclass(frozen=True, slots=True)
class ErrorSettings:
    """How expected errors and their bounds are computed.

    `bend_weight` was fitted to forty solids of nine scanned objects (fruit, boxes, cans, padlocks):
    the ratios of errors to those expected from the distance alone were 0.7, 0.8, 0.9, 1.1, 1.3,
    1.5, 2.1, 2.8 and 3.7 at bends of 0.03, 0.08, 0.15, 0.25, 0.4, 0.5, 0.7, 0.9 and 1.2 [rad].
    """

    n_draws: int = 32  # random splines from which variances are estimated
    min_slope: float = 0.3  # least norm of a gradient by which a value is divided for a distance
    max_value: float = 0.1  # [cells] distance by the spline, up to which places are on the surface
    min_error: float = 10e-6  # [m] error of a mesh of the surface, added in squares
    max_growth: float = 0.5  # of the error per distance from touched points
    touched_distance: float = 0.7  # [cells] from touched points; nearer places count as touched
    bend_weight: float = 4.1  # [1/rad] larger: larger errors at edges (k in the module text)
    bound_factor: float = 1.25  # bound of 95 % over the expected error
    # Places far from touched points are those that are hard to reach: the factor of the bound there
    # grows from 1 by 1 per `open_growth` of distance beyond `open_distance`, up to a limit.
    open_distance: float = 2.5e-3  # [m]
    open_growth: float = 2.5e-3  # [m]; larger grows more slowly
    max_open_factor: float = 1.5  # the limit
    # Between these bends the factor of the common error grows from 1 to `edge_factor`. Splines of
    # drawn boxes with sharp edges are off by 0.25 to 0.4 mm there, even with 230 touches.
    edge_bends: tuple[float, float] = (0.3, 0.8)  # [rad]
    edge_factor: float = 3.0
    calibrated_growth: float = 1.5  # ratio of touches, after which a draft is calibrated again
    # [cells] from touched points: borders of the distance classes in which errors are averaged.
    class_borders: tuple[float, ...] = (0.0, 0.3, 0.7, 1.2, 1.8, 2.6, 3.6, 5.0, 7.0, 10.0, 14.0)
    n_places: int = 512  # places at which draws are evaluated together: memory
    max_ratio: float = 10.0  # limit of a touch's squared offset over the expected one
    # Calibration (ratio of squared errors) of scanned objects, which have 0.4 to 0.9. With half of
    # it (balls, tori) errors far from touched points are half of those with all of it.
    usual_calibration: float = 0.6
    prior_touches: float = 8.0  # touches left out that the usual calibration counts as
    leave_out: LeaveOutSettings = field(default=LeaveOutSettings())


CHI_SQUARE_MEDIAN = 0.4549364  # Of one degree of freedom


@readable
@dataclass(frozen=True, slots=True, eq=False)
class SurfaceErrors:
    """Root mean square errors by distance from touched points and by the surface's bend, m."""

    distances: Floats  # Mean distance of each class, and the largest of all, rising, (k,)
    errors: Floats  # At these distances, where the surface is flat; never falling, (k,)
    places: Floats  # On the surface, about the origin of the cells, (n, 3)
    bends: Floats  # At these places [rad], (n,)
    common: float  # Error of all places, from displacements beyond the pose error
    held_out: float  # Root mean square offset of touches that were left out
    calibration: float  # Squared errors over those that the fit expects
    calibrated: int  # Number of touches when that was measured

    def at(
        self, places: Floats, distances: Floats, settings: ErrorSettings = ErrorSettings()
    ) -> tuple[Floats, Floats]:
        """Expected errors (n,) at places (n, 3) at distances (n,), and their bounds of 95 %."""
        bends = self.bends[scipy.spatial.cKDTree(self.places).query(places)[1]]
        beyond = settings.max_growth * np.maximum(distances - self.distances[-1], 0.0)
        errors = np.interp(distances, self.distances, self.errors) + beyond
        common = self.common * _edge_factors(bends, settings)
        errors = np.hypot(errors * np.sqrt(bend_factors(bends, settings.bend_weight)), common)
        opened = np.maximum(distances - settings.open_distance, 0.0) / settings.open_growth
        factors = settings.bound_factor * np.minimum(1.0 + opened, settings.max_open_factor)
        return errors, factors * errors


def bend_factors(bends: Floats, weight: float) -> Floats:
    """Ratios (n,) of squared errors at bends (n,) [rad] to those where the surface is flat."""
    return np.asarray(1.0 + (weight * bends) ** 2)


def _edge_factors(bends: Floats, settings: ErrorSettings) -> Floats:
    """Factors (n,) of the common error at places with these bends (n,) [rad]."""
    return np.asarray(np.interp(bends, settings.edge_bends, (1.0, settings.edge_factor)))


def touch_distances(contacts: ContactPoints, places: Floats) -> Floats:
    """Distances (n,) of places (n, 3) from the nearest touched point, m."""
    return np.asarray(scipy.spatial.cKDTree(contacts.points).query(places)[0])


def surface_errors(
    fitted: Fitted,
    before: SurfaceErrors | None = None,
    settings: ErrorSettings = ErrorSettings(),
    bending: BendSettings = DEFAULT_BENDS,
) -> tuple[ImplicitFit, SurfaceErrors]:
    """The fit, solved exactly, and its expected errors, calibrated by touches left out [m].

    `before`: errors of a fit of most of these touches; its calibration is kept if it still holds.
    """
    cell, solution, band = fitted.spline.cell, fitted.solution, fitted.solution.fit.band
    count = len(fitted.spline.fit.displacements)
    if before is None or count > settings.calibrated_growth * before.calibrated:
        left = leave_out(solution, settings.leave_out, int(fitted.points.touch.max()) + 1)
        solution, covariance = left.solution, left.covariance
        touched = touch_middles(fitted.points.places, fitted.points.touch)[left.touches]
        touched_bends = surface_bends(band, solution.fit.control, touched, cell, bending)
        scale = calibration(left, bend_factors(touched_bends, settings.bend_weight), settings)
        held_out = cell * float(np.sqrt(left.squares.mean()))
    else:
        solution, covariance = solved_exactly(solution, settings.leave_out)
        scale, held_out, count = before.calibration, before.held_out, before.calibrated
    places = _surface_places(solution.fit, settings)
    bends = surface_bends(band, solution.fit.control, places, cell, bending)
    distances = np.asarray(scipy.spatial.cKDTree(fitted.points.places).query(places)[0])
    variances = scale * _variances(solution, covariance, places, settings)
    middles, errors = _by_distance(distances, variances, cell, settings)
    errors = _with_calibrated_growth(errors, scale / settings.usual_calibration)
    alone = solution.fit.displacements
    if fitted.shared is not None:
        alone = fitted.shared.without(alone)
    common = cell * _common_error(alone, fitted.points, fitted.weights.pose)
    return solution.fit, SurfaceErrors(
        cell * middles, cell * errors, cell * places, bends, common, held_out, scale, count
    )


def _common_error(displacements: Floats, points: TouchedPoints, pose: float) -> float:
    """Root mean square displacement along normals beyond the pose error, of all touches [cells]."""
    along = np.einsum("ni,ni->n", points.normals, displacements[points.touch])
    means = np.bincount(points.touch, along) / np.maximum(np.bincount(points.touch), 1)
    return float(np.sqrt(max(float(np.mean(means**2)) - pose**2, 0.0)))


def _by_distance(
    distances: Floats, variances: Floats, cell: float, settings: ErrorSettings
) -> tuple[Floats, Floats]:
    """Mean distance of each class and the largest of all, (k,), and errors there, (k,) [cells]."""
    # Far from touched points the spline is free, but an object departs no faster than `max_growth`.
    near = distances <= max(settings.touched_distance, float(distances.min()))
    touched = float(np.median(variances[near]))
    variances = np.minimum(variances, (np.sqrt(touched) + settings.max_growth * distances) ** 2)
    classes = np.digitize(distances, settings.class_borders) - 1
    members = [classes == number for number in np.unique(classes)]
    middles = [*(distances[here].mean() for here in members), distances.max()]
    means = [variances[here].mean() for here in members]
    rising = np.maximum.accumulate([*means, means[-1]])
    return np.array(middles), np.sqrt(rising + (settings.min_error / cell) ** 2)


def _with_calibrated_growth(errors: Floats, ratio: float) -> Floats:
    """Errors by distance, whose growth is reduced if calibration over the usual one is below 1."""
    growing = min(ratio, 1.0)
    return np.asarray(np.sqrt(errors[0] ** 2 + growing * (errors**2 - errors[0] ** 2)))


def calibration(left: LeftOut, factors: Floats, settings: ErrorSettings) -> float:
    """Ratio of squared errors to those that a fit expects, from the touches that were left out.

    A ratio below the usual one may be chance: it is averaged with the usual one, as with a
    conjugate prior of a variance. `factors` (k,) multiply what is expected, for the bend there.
    """
    ratios = left.squares / (factors * left.expected)
    median = float(np.median(ratios)) / CHI_SQUARE_MEDIAN
    measured = max(median, float(np.minimum(ratios, settings.max_ratio).mean()))
    known = len(ratios) / (len(ratios) + settings.prior_touches)
    return max(measured, known * measured + (1.0 - known) * settings.usual_calibration)


def _surface_places(fit: ImplicitFit, settings: ErrorSettings) -> Floats:
    """Places (n, 3) on the surface [cells], each projected from the middle of a cell near to it."""
    places = np.asarray(fit.band.cells + 0.5, np.float64)
    for _ in range(2):
        value, gradient = fit.band.evaluate(fit.control, places)
        square = np.maximum((gradient**2).sum(axis=1), settings.min_slope**2)
        places = np.asarray(places - (value / square)[:, None] * gradient)
        places = places[np.isfinite(places).all(axis=1)]
    reached = np.abs(fit.band.evaluate(fit.control, places)[0]) < settings.max_value
    return places[reached]


def _variances(
    solution: Solution, covariance: Floats, places: Floats, settings: ErrorSettings
) -> Floats:
    """Variance (n,) of the surface at places (n, 3) on it [cells^2], over random draws."""
    band, control = solution.fit.band, solution.fit.control
    draws = _draws(solution, covariance, settings.n_draws)
    gradient = band.evaluate(control, places)[1]
    slope = np.maximum(np.linalg.norm(gradient, axis=1), settings.min_slope)
    number, offsets = band.locate(places)
    variances = np.empty(len(places))
    for begin in range(0, len(places), settings.n_places):
        some = slice(begin, begin + settings.n_places)
        rows = basis_values(offsets[some])
        values = np.einsum("kl,kld->kd", rows, draws[band.local[number[some]]])
        variances[some] = np.square(values).mean(axis=1)
    return np.asarray(variances / slope**2)


def _draws(solution: Solution, covariance: Floats, count: int) -> Floats:
    """Draws (n, `count`) of control values about the fit, with displacements of this covariance.

    With an empty covariance, displacements are those of the fit.
    """
    rng = np.random.default_rng(0)
    if not len(covariance):
        return solution.factor.draws(rng.normal(size=(len(solution.right), count)))
    symmetric = 0.5 * (covariance + covariance.T)
    moved = np.linalg.cholesky(symmetric) @ rng.normal(size=(len(covariance), count))
    free = solution.factor.draws(rng.normal(size=(len(solution.right), count)))
    return np.asarray(free - solution.factor.solve(np.asarray(solution.coupling() @ moved)))
