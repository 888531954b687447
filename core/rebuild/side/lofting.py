"""A smooth surface through contours without single outliers, and its uncertainty.

Contours whose points correspond are the rows of a grid; a spline runs along its columns and closes
around its rows, both smoothed by cross-validation. Where the surface closes in a point, it does so
exactly. A smooth surface bends around a single wrong point, while a feature is measured by several
points of several contours: outliers are replaced by the prediction of the fit, and fitted again,
until that no longer changes.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from palpate.core.arrays import PROBABLE_ERROR, Bools, Floats, finite_array, probable_error_sigma
from palpate.core.rebuild.contours import CUBIC_GAIN
from palpate.core.rebuild.side import fitting
from palpate.core.rebuild.side.side import DEFAULT_ERROR_BOUND, ErrorBoundSettings, Uncertainty
from palpate.core.rebuild.side.smoothing import (
    DEFAULT_BETWEEN,
    BetweenContours,
    BetweenSettings,
    Smoothed,
    between_contours,
)
from palpate.core.rebuild.side.surfaces import LoftPatch
from palpate.core.splines import PeriodicBasis
from palpate.reprs import readable

Refit = Callable[[Floats], fitting.ContourFit]


@dataclass(frozen=True, slots=True, kw_only=True)
class OutlierSettings:
    """Which single points are left out of a loft.

    Deviations are in standard deviations of the noise, from the median residual.
    """

    min_points: int = 8  # of a contour
    min_noise_ratio: float = 1.5  # residuals over the noise of neighbours, to look for outliers
    min_first_deviation: float = 5.0  # of an outlier of the first fit; larger finds fewer
    min_kept_deviation: float = 3.5  # of an outlier that stays one
    min_new_deviation: float = 6.0  # of a new outlier of a later fit
    min_neighbour_ratio: float = 2.2  # of a new outlier's deviation over that of the points beside
    max_fits: int = 15  # without the outliers, until they settle
    reviewed_fits: tuple[int, ...] = (2, 4, 6)  # numbers of fits after which outliers are revised
    tolerance: float = 0.01  # fraction of the noise, of changes after which no more fits follow
    n_near_rows: int = 2  # contours on either side, whose median residual is not an outlier's
    max_fraction: float = 0.15  # of the points; more are no outliers but, say, an edge
    min_spare: float = 0.05  # least degrees of freedom that are left, over the number of points


@dataclass(frozen=True, slots=True, kw_only=True)
class LoftSettings:
    """How contours are lofted."""

    fit: fitting.ContourFitSettings = fitting.DEFAULT_CONTOUR_FIT
    outliers: OutlierSettings = OutlierSettings()
    between: BetweenSettings = DEFAULT_BETWEEN


class LoftHealth(NamedTuple):
    """Figures of the fit."""

    sigma: float  # estimated noise: standard deviation across the contours [m]
    freedom: float  # degrees of freedom spent on each coordinate
    condition: float  # condition number of the matrix from coefficients to points and bending
    strengths: tuple[float, float]  # of smoothing along and around, over the points' mean weight
    round: tuple[bool, bool]  # whether the ends below and above are a sphere's
    outlying: int  # number of outliers
    swing: float  # distance from the middle between contours, over the distance of these


@readable
@dataclass(frozen=True, slots=True, eq=False)
class ContourLoft:
    """The side through contours, and its uncertainty."""

    patch: LoftPatch  # where it is
    size: float  # half the width of the contours [m]
    smoothed: Smoothed  # the fit, over the size
    between: BetweenContours  # its error between contours, over the size
    outlying: Bools  # (m, K): outliers, which were not used
    spacing: float  # largest distance between contours [m]
    health: LoftHealth  # figures of the fit
    closed: tuple[bool, bool]  # whether it closes in points below and above

    def deviation(self, heights: ArrayLike, turns: ArrayLike) -> Floats:
        """Standard deviation of the surface along its normal [m], at heights (a,) and turns (b,).

        From the noise, and from the error of predicting each contour from the others. Features
        between two contours are not in it.
        """
        heights = finite_array("heights", heights, (None,))
        parameters = self.patch.axial_parameter.of(heights)
        return self._deviation(parameters, finite_array("turns", turns, (None,)))[0]

    @property
    def sigma(self) -> float:
        """Standard deviation of a point across the contours [m]."""
        return self.health.sigma

    @property
    def scatter(self) -> float:
        """As `sigma`, since contours do not show errors of poses [m]."""
        return self.health.sigma

    @property
    def figures(self) -> dict[str, float]:
        """Figures of the fit, by name."""
        health = self.health
        return {
            "sigma": health.sigma,
            "degrees_of_freedom": health.freedom,
            "condition": health.condition,
            "swing": health.swing,
            "reparametrised": float(self.patch.axial_parameter.reparametrisation is not None),
        }

    def normal_deviation(self, heights: Floats, turns: Floats, steep: Floats) -> Floats:
        """The deviation (a, b), which is along normals."""
        return self.deviation(heights, turns)

    def band(self, n_heights: int = 25, n_turns: int = 8) -> tuple[Floats, Floats]:
        """Heights (n,), and the root mean square of the deviation around at each."""
        heights = np.linspace(*self.patch.reach, n_heights)
        deviation = self.deviation(heights, np.arange(n_turns) / n_turns)
        return heights, np.sqrt(np.mean(deviation**2, axis=1))

    def reached(self, rim: float, upper: bool) -> Floats:
        """Height (1,) up to which it was touched: its last one, `rim`."""
        return np.array([rim])

    def uncertainty(
        self,
        settings: ErrorBoundSettings = DEFAULT_ERROR_BOUND,
        n_along: int = 8,
        n_around: int = 48,
    ) -> Uncertainty:
        """Bounds of its error, and the width of features that may be missed.

        By the deviation at `n_along` places between two contours and `n_around` around.
        """
        sites, axial_parameter = self.between.sites, self.patch.axial_parameter
        breaks = sites if len(sites) > 1 else np.array(self.patch.basis.domain)
        fractions = (np.arange(n_along) + 0.5) / n_along
        parameters = (breaks[:-1, None] + np.diff(breaks)[:, None] * fractions).ravel()
        steps = np.repeat(np.diff(breaks), n_along)
        deviation, area = self._deviation(parameters, np.arange(n_around) / n_around)
        area = area * steps[:, None]
        total = max(float(area.sum()), np.finfo(float).tiny)
        rms = float(np.sqrt((area * np.square(deviation)).sum() / total))
        most = float(deviation.max())
        spacing = self.spacing or axial_parameter.high - axial_parameter.low
        return Uncertainty(settings.rms_factor * rms, settings.max_factor * most, 0.5 * spacing)

    def _deviation(self, parameters: Floats, turns: Floats) -> tuple[Floats, Floats]:
        """Deviation along the normal [m], and the area per parameter, on a grid."""
        patch = self.patch
        inside = np.clip(parameters, *patch.basis.domain)
        below, above = self.closed
        inner = slice(int(below), patch.basis.count - int(above))
        variance = np.square(self.health.sigma) * self.smoothed.variance(
            patch.basis.matrix(inside)[:, inner],
            PeriodicBasis(patch.control.shape[1]).matrix(turns),
        )
        variance += np.square(self.size) * self.between.variance(parameters, turns)
        along, around = (patch.by_parameters(inside, turns, by) for by in ((1, 0), (0, 1)))
        rise = patch.axial_parameter.height(inside, 1)[:, None]
        level = rise * np.hypot(around[..., 0], around[..., 1])
        area = np.hypot(level, along[..., 0] * around[..., 1] - along[..., 1] * around[..., 0])
        upright = np.divide(level, area, out=np.zeros_like(area), where=area > 0.0)
        return np.sqrt(variance) * upright, area


def fit_contour_loft(
    heights: ArrayLike,
    grid: ArrayLike,
    *,
    low: float,
    high: float,
    pole: fitting.Poles = (None, None),
    noise: float | None = None,
    settings: LoftSettings = LoftSettings(),
) -> ContourLoft:
    """Fit a surface through contours at heights (M,), grid (M, K, 2) [m].

    Heights rise; points run counter-clockwise and correspond: column j lies at the turn j / K.
    `low` and `high` are the heights of the object's ends [m], or of assumed ones, beyond the
    contours; `pole` holds the places where the surface closes in a point there, below and above
    [m], None where it does not. `noise` is the standard deviation of a coordinate [m], estimated if
    left out; if it is 0, no point is an outlier. Raises ValueError if shapes do not fit, a number
    is not finite, heights do not rise, a contour lies outside, a pole lies at a contour, or the
    noise is negative.
    """
    rows = fitting.contour_rows(heights, grid, low, high, pole)
    scaled = None if noise is None else noise / rows.size
    fit = fitting.fit_rows(rows, low, high, scaled, settings.fit)

    def refit(points: Floats) -> fitting.ContourFit:
        moved, how = rows._replace(grid=points), (scaled, fit.caution, settings.fit)
        return fitting.fit_axial_parameter(moved, fit.axial_parameter, *how)

    if noise == 0.0:  # without noise no point is wrong
        used, outlying = rows.grid, np.zeros(rows.grid.shape[:2], np.bool_)
    else:
        limit = scaled or 0.0
        used, fit, outlying = without_outliers(rows.grid, fit, refit, limit, settings.outliers)
    return _loft(rows._replace(grid=used), fit, outlying, scaled, settings.between)


def without_outliers(
    grid: Floats, fit: fitting.ContourFit, refit: Refit, noise: float, settings: OutlierSettings
) -> tuple[Floats, fitting.ContourFit, Bools]:
    """Leave single outliers out of a grid (m, k, 2), if residuals suggest any.

    `noise` is the known standard deviation, or 0; points that are off by no more than it explains
    stay. `refit` fits other points like `fit` did these. Returned are the grid with outliers
    replaced by the prediction of the fit, the fit to it, and the mask (m, k) of outliers.
    """
    across = fit.across()
    off = fit.off(grid, across)
    none = grid, fit, np.zeros(off.shape, np.bool_)
    sigma = np.sqrt(np.square(off).sum() / fit.smoothed.spare)
    if not np.abs(off).max() > settings.min_first_deviation * noise:
        return none
    # The noise across, from each point's distance to the cubic through four.
    near, far = (np.roll(grid, n, 1) + np.roll(grid, -n, 1) for n in (1, 2))
    beside = np.einsum("mkd,mkd->mk", grid - (4.0 * near - far) / 6.0, across)
    between = probable_error_sigma(beside) / CUBIC_GAIN
    if grid.shape[1] < settings.min_points or not sigma > settings.min_noise_ratio * between:
        return none
    outlying = local_outliers(off, settings)
    is_many = outlying.mean() > settings.max_fraction
    if not outlying.any() or outlying.all(axis=1).any() or is_many:
        return none
    used = _interpolated(grid, outlying)
    for number in range(settings.max_fits):
        refitted = refit(used)
        off = refitted.off(grid, across)
        spare = max(refitted.smoothed.spare / off.size, settings.min_spare)
        if number in settings.reviewed_fits:
            outlying = _reviewed(off, outlying, spare, settings)
            if outlying.mean() > settings.max_fraction:
                return none
        noise = np.sqrt(np.square(off[~outlying]).mean() / spare)
        before = used
        used = np.where(outlying[..., None], refitted.fitted(), grid)
        is_settled = np.abs(used - before).max() < settings.tolerance * noise
        if number > settings.reviewed_fits[-1] and is_settled:
            break
    return used, refit(used), outlying


def local_outliers(off: Floats, settings: OutlierSettings) -> Bools:
    """Mask of points that are far from a surface, at distances (m, k), unlike their neighbours."""
    before, after = (np.stack([np.roll(off, sign * n, -1) for n in (1, 2, 3)]) for sign in (1, -1))
    # Less the median of five guesses by the points beside, of which a wrong one spoils two at most.
    guesses = [*(0.5 * (before + after)), 2.0 * before[0] - before[1], 2.0 * after[0] - after[1]]
    alone = _less_neighbours(off - np.median(guesses, axis=0), settings)
    size = np.abs(alone)
    column = np.median(size, axis=0)
    column = np.median([np.roll(column, 1), column, np.roll(column, -1)], axis=0)
    scale = np.maximum(np.median(size), np.maximum(column, np.median(size, axis=1)[:, None]))
    return np.asarray(size > settings.min_first_deviation / PROBABLE_ERROR * scale)


def _interpolated(grid: Floats, outlying: Bools) -> Floats:
    """The grid with outliers moved between their neighbours around the contour."""
    moved = grid.copy()
    turns = np.arange(grid.shape[1])
    for row in np.flatnonzero(outlying.any(axis=1)):
        out, kept = outlying[row], ~outlying[row]
        for axis in range(grid.shape[2]):
            values = grid[row, kept, axis]
            moved[row, out, axis] = np.interp(turns[out], turns[kept], values, period=len(turns))
    return moved


def _reviewed(off: Floats, outlying: Bools, spare: float, settings: OutlierSettings) -> Bools:
    """Mask of the outliers of a better fit; `spare` is the fraction of its freedom that is left."""
    alone = _less_neighbours(off, settings, outlying)
    noise = probable_error_sigma(alone[~outlying]) / np.sqrt(spare)
    size = np.where(outlying, 0.0, np.abs(alone))
    beside = np.maximum(np.roll(size, 1, 1), np.roll(size, -1, 1))
    stay = outlying & (np.abs(off) > settings.min_kept_deviation * noise)
    new = np.abs(alone) > settings.min_new_deviation * noise
    new &= np.abs(alone) > settings.min_neighbour_ratio * beside
    reviewed: Bools = stay | new
    reviewed &= ~reviewed.all(axis=1, keepdims=True)
    return reviewed


def _less_neighbours(
    off: Floats, settings: OutlierSettings, outlying: Bools | None = None
) -> Floats:
    """Distances (m, k) less their median over the contours next to each, which is the object's."""
    reach = min(settings.n_near_rows, (len(off) - 1) // 2)
    calm = off if outlying is None else np.where(outlying, 0.0, off)
    padded = np.pad(calm, ((reach, reach), (0, 0)), mode="reflect")
    near = np.stack([padded[row : row + len(off)] for row in range(2 * reach + 1)])
    return off.copy() if reach == 0 else np.asarray(off - np.median(near, axis=0))


def _loft(
    rows: fitting.ContourRows,
    fit: fitting.ContourFit,
    outlying: Bools,
    noise: float | None,
    settings: BetweenSettings,
) -> ContourLoft:
    """A fit in the contours' own unit."""
    across = fit.across()
    spare = max(fit.smoothed.spare - float(outlying.sum()), 0.5 * fit.smoothed.spare)
    sigma = _sigma(rows, fit, spare) if noise is None else noise
    closed = rows.poles[0] is not None, rows.poles[1] is not None
    around = np.pad(across, (closed, (0, 0), (0, 0)))
    smoothed, control = fit.smoothed, rows.size * fit.control
    return ContourLoft(
        patch=LoftPatch(fit.axial_parameter, fit.along, control, rows.middle),
        size=rows.size,
        smoothed=smoothed,
        between=between_contours(fit.sites, rows.with_poles, around, sigma, settings),
        outlying=outlying,
        spacing=rows.spacing,
        health=LoftHealth(
            sigma=rows.size * sigma,
            freedom=smoothed.freedom,
            condition=smoothed.condition,
            strengths=smoothed.strengths,
            round=fit.axial_parameter.round,
            outlying=int(outlying.sum()),
            swing=fit.swing(),
        ),
        closed=closed,
    )


def contour_noise(
    heights: Floats,
    grid: Floats,
    settings: fitting.ContourFitSettings = fitting.DEFAULT_CONTOUR_FIT,
) -> float:
    """Standard deviation across contours (M, K, 2) [m], by a fit between the outer two."""
    low, high = float(heights.min()), float(heights.max())
    rows = fitting.contour_rows(heights, grid, low, high, (None, None))
    fit = fitting.fit_heights_or_round(rows, low, high, settings)
    return rows.size * _sigma(rows, fit, fit.smoothed.spare)


def _sigma(rows: fitting.ContourRows, fit: fitting.ContourFit, spare: float) -> float:
    """Standard deviation of the rows across the fit, in their unit."""
    off = fit.off(rows.grid, fit.across())
    return float(np.sqrt(np.square(off).sum() / spare))
