"""A smooth surface through contours, single outliers left out, and how far it can be trusted.

Contours that correspond, point by point, are the rows of a grid; a spline runs along its columns
and closes around its rows, both as smooth as the points ask for. Where the surface closes in a
point, it does so exactly. A smooth surface bends around a single wrong point, while a feature is
seen by several points of several contours: points that stick out are replaced by what the fit
predicts of them and fitted again, until that no longer changes.
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
from palpate.core.rebuild.side.side import SAFE_MOST, SAFE_RMS, Uncertainty
from palpate.core.rebuild.side.smoothing import BetweenContours, Smoothed, between_contours
from palpate.core.rebuild.side.surfaces import LoftPatch
from palpate.core.splines import PeriodicBasis
from palpate.reprs import readable

BANDS, BAND_TURNS = 25, 8  # Heights of the deviation's band, and turns of its average
STEPS_ALONG, STEPS_AROUND = 8, 48  # Places between contours, and around, of the mean deviation
SUSPECT = 1.5  # Residuals over the noise between neighbours from which on points are suspected
STICKING = 5.0  # Deviations from which on a point sticks out of its neighbourhood
KEPT_OUT, TAKEN_OUT = 3.5, 6.0  # Deviations above which a point stays out, is newly left out
LONELY = 2.2  # Times those of the points beside it, by which a point newly left out sticks out
ROUNDS, REVIEWS = 15, (2, 4, 6)  # Fits at most, and those after which outliers are judged anew
SETTLED = 0.01  # Of the noise: a change between fits that matters no more
NEAR_ROWS = 2  # Contours on either side whose like deviations are the object's
MOST = 0.15  # Share of the points beyond which the object sticks out: edges do, of exact points
LEAST_SPARE = 0.05  # Least share of the points' freedom that is taken as left
Fit = Callable[[Floats], fitting.ContourFit]


class LoftHealth(NamedTuple):
    """Figures of the fit."""

    sigma: float  # Estimate of the noise: standard deviation across the contours, m
    freedom: float  # Degrees of freedom spent on each coordinate
    condition: float  # Condition number of the matrix from coefficients to points and bending
    strengths: tuple[float, float]  # Of smoothing along and around, over the points' mean weight
    round: tuple[bool, bool]  # Whether the ends below and above are run into as a sphere's
    outlying: int  # Points that were not used, for they stick out
    swing: float  # How far the surface leaves the middle between contours, over their difference


@readable
@dataclass(frozen=True, slots=True, eq=False)
class ContourLoft:
    """The side through contours, and how far it can be trusted."""

    patch: LoftPatch  # Where it is
    size: float  # Half the width of the contours, m
    smoothed: Smoothed  # The fit, over the size
    between: BetweenContours  # What it may miss between contours, over the size
    outlying: Bools  # (m, K): points that were not used
    spacing: float  # Largest distance between contours, m
    health: LoftHealth  # How the fit came about
    closed: tuple[bool, bool]  # Whether it closes in points below and above

    def deviation(self, heights: ArrayLike, turns: ArrayLike) -> Floats:
        """Standard deviation of the surface along its normal, m, at heights (a,) and turns (b,).

        From the noise, and from what leaving out each contour would have cost. What nobody could
        know, such as features between two contours, is not in it.
        """
        heights = finite_array("heights", heights, (None,))
        parameters = self.patch.axial_parameter.of(heights)
        return self._deviation(parameters, finite_array("turns", turns, (None,)))[0]

    @property
    def sigma(self) -> float:
        """Standard deviation of a point across the contours, m."""
        return self.health.sigma

    @property
    def scatter(self) -> float:
        """The same: contours tell nothing of poses."""
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
        """The deviation (a, b), which is told along normals."""
        return self.deviation(heights, turns)

    def band(self) -> tuple[Floats, Floats]:
        """Heights (n,), and the root mean square of the deviation around at each."""
        heights = np.linspace(*self.patch.reach, BANDS)
        deviation = self.deviation(heights, np.arange(BAND_TURNS) / BAND_TURNS)
        return heights, np.sqrt(np.mean(deviation**2, axis=1))

    def reached(self, rim: float, upper: bool) -> Floats:
        """The height up to which it was touched: its last one, `rim`."""
        return np.array([rim])

    def uncertainty(self) -> Uncertainty:
        """One number for the whole side, and what it does not tell."""
        sites, axial_parameter = self.between.sites, self.patch.axial_parameter
        breaks = sites if len(sites) > 1 else np.array(self.patch.basis.domain)
        shares = (np.arange(STEPS_ALONG) + 0.5) / STEPS_ALONG
        parameters = (breaks[:-1, None] + np.diff(breaks)[:, None] * shares).ravel()
        steps = np.repeat(np.diff(breaks), STEPS_ALONG)
        deviation, area = self._deviation(parameters, np.arange(STEPS_AROUND) / STEPS_AROUND)
        area = area * steps[:, None]
        total = max(float(area.sum()), np.finfo(float).tiny)
        rms = float(np.sqrt((area * np.square(deviation)).sum() / total))
        spacing = self.spacing or axial_parameter.high - axial_parameter.low
        return Uncertainty(SAFE_RMS * rms, SAFE_MOST * float(deviation.max()), 0.5 * spacing)

    def _deviation(self, parameters: Floats, turns: Floats) -> tuple[Floats, Floats]:
        """Along the normal, m, and the area per parameter, on a grid."""
        patch = self.patch
        inside = np.clip(parameters, *patch.basis.domain)
        below, above = self.closed
        inner = slice(int(below), patch.basis.count - int(above))
        variance = np.square(self.health.sigma) * self.smoothed.variance(
            patch.basis.matrix(inside)[:, inner],
            PeriodicBasis(patch.control.shape[1]).matrix(turns),
        )
        variance += np.square(self.size) * self.between.variance(parameters, turns)
        up, round_ = (patch.by_parameters(inside, turns, by) for by in ((1, 0), (0, 1)))
        rise = patch.axial_parameter.height(inside, 1)[:, None]
        level = rise * np.hypot(round_[..., 0], round_[..., 1])
        area = np.hypot(level, up[..., 0] * round_[..., 1] - up[..., 1] * round_[..., 0])
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
) -> ContourLoft:
    """Fit a surface through contours at heights (M,), grid (M, K, 2), m.

    They rise; their points run counter-clockwise, at least 4, and correspond: column j at the turn
    j / K. `low` and `high` are the heights of the object's ends, m, or of what is to be taken as
    such, beyond the contours; `pole` tells where the surface closes in a point there, below and
    above, m, if it does. `noise` is the standard deviation of a coordinate, m, if it is known;
    otherwise it is estimated. Of 0, no point is left out. Raises ValueError if shapes do not fit, a
    number is not finite, there are too few points, a contour lies outside, or a pole on a contour.
    """
    rows = fitting.contour_rows(heights, grid, low, high, pole)
    scaled = None if noise is None else noise / rows.size
    fit = fitting.fit_rows(rows, low, high, scaled)

    def again(points: Floats) -> fitting.ContourFit:
        moved = rows._replace(grid=points)
        return fitting.fit_axial_parameter(moved, fit.axial_parameter, scaled, fit.caution)

    if noise == 0.0:  # who knows that there is no noise knows that no point is wrong
        used, outlying = rows.grid, np.zeros(rows.grid.shape[:2], np.bool_)
    else:
        used, fit, outlying = without_outliers(rows.grid, fit, again, scaled or 0.0)
    return _loft(rows._replace(grid=used), fit, outlying, scaled)


def without_outliers(
    grid: Floats, fit: fitting.ContourFit, again: Fit, noise: float
) -> tuple[Floats, fitting.ContourFit, Bools]:
    """Leave out single points that stick out of a grid (m, k, 2), if residuals suggest any.

    None is off by less than `noise`, if known, lets expect of the farthest. `again` fits other
    points like `fit` did these. Returned are the grid with those points replaced by what the fit
    predicts of them, the fit to it, and which points they are, (m, k).
    """
    across = fit.across()
    off = fit.off(grid, across)
    sigma = np.sqrt(np.square(off).sum() / fit.smoothed.spare)
    nothing = np.zeros(off.shape, np.bool_)
    if not np.abs(off).max() > STICKING * noise:
        return grid, fit, nothing
    # The noise across, from each point's distance to the cubic through four.
    one, two = (np.roll(grid, n, 1) + np.roll(grid, -n, 1) for n in (1, 2))
    beside = np.einsum("mkd,mkd->mk", grid - (4.0 * one - two) / 6.0, across)
    if grid.shape[1] < 8 or not sigma > SUSPECT * (probable_error_sigma(beside) / CUBIC_GAIN):
        return grid, fit, nothing
    outlying = local_outliers(off)
    if not outlying.any() or outlying.all(axis=1).any() or outlying.mean() > MOST:
        return grid, fit, nothing
    used, all_of_them = _bridged(grid, outlying), fit
    for number in range(ROUNDS):
        fit = again(used)
        off = fit.off(grid, across)
        share = max(fit.smoothed.spare / off.size, LEAST_SPARE)
        if number in REVIEWS:
            outlying = _reviewed(off, outlying, share)
            if outlying.mean() > MOST:
                return grid, all_of_them, nothing
        noise = np.sqrt(np.square(off[~outlying]).mean() / share)
        following = np.where(outlying[..., None], fit.fitted(), grid)
        change = np.abs(following - used).max()
        used = following
        if number > REVIEWS[-1] and change < SETTLED * noise:
            break
    return used, again(used), outlying


def local_outliers(off: Floats) -> Bools:
    """Points that stick out, by distances (m, k) from a surface, where others do not."""
    before, after = (np.stack([np.roll(off, way * n, -1) for n in (1, 2, 3)]) for way in (1, -1))
    # Less the median of five guesses by the points beside, of which one wrong spoils two at most.
    guesses = [*(0.5 * (before + after)), 2.0 * before[0] - before[1], 2.0 * after[0] - after[1]]
    alone = _less_neighbours(off - np.median(guesses, axis=0))
    size = np.abs(alone)
    column = np.median(size, axis=0)
    column = np.median([np.roll(column, 1), column, np.roll(column, -1)], axis=0)
    scale = np.maximum(np.median(size), np.maximum(column, np.median(size, axis=1)[:, None]))
    return np.asarray(size > STICKING / PROBABLE_ERROR * scale)


def _bridged(grid: Floats, outlying: Bools) -> Floats:
    """With the points that stick out put between their neighbours around the contour."""
    bridged = grid.copy()
    turns = np.arange(grid.shape[1])
    for row in np.flatnonzero(outlying.any(axis=1)):
        out, kept = outlying[row], ~outlying[row]
        for axis in range(grid.shape[2]):
            values = grid[row, kept, axis]
            bridged[row, out, axis] = np.interp(turns[out], turns[kept], values, period=len(turns))
    return bridged


def _reviewed(off: Floats, outlying: Bools, share: float) -> Bools:
    """Which points stick out of a better fit."""
    alone = _less_neighbours(off, outlying)
    noise = probable_error_sigma(alone[~outlying]) / np.sqrt(share)
    size = np.where(outlying, 0.0, np.abs(alone))
    beside = np.maximum(np.roll(size, 1, 1), np.roll(size, -1, 1))
    stay = outlying & (np.abs(off) > KEPT_OUT * noise)
    new = (np.abs(alone) > TAKEN_OUT * noise) & (np.abs(alone) > LONELY * beside)
    found: Bools = stay | new
    found &= ~found.all(axis=1, keepdims=True)
    return found


def _less_neighbours(off: Floats, outlying: Bools | None = None) -> Floats:
    """Less the median over the contours next to each, which is the object's."""
    reach = min(NEAR_ROWS, (len(off) - 1) // 2)
    calm = off if outlying is None else np.where(outlying, 0.0, off)
    padded = np.pad(calm, ((reach, reach), (0, 0)), mode="reflect")
    near = np.stack([padded[row : row + len(off)] for row in range(2 * reach + 1)])
    return off.copy() if reach == 0 else np.asarray(off - np.median(near, axis=0))


def _loft(
    rows: fitting.ContourRows, fit: fitting.ContourFit, outlying: Bools, noise: float | None
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
        between=between_contours(fit.sites, rows.with_poles, around, sigma),
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


def noise_of(heights: Floats, grid: Floats) -> float:
    """Standard deviation across contours (M, K, 2), m, by a fit between the outer two."""
    low, high = float(heights.min()), float(heights.max())
    rows = fitting.contour_rows(heights, grid, low, high, (None, None))
    fit = fitting.fit_heights_or_round(rows, low, high)
    return rows.size * _sigma(rows, fit, fit.smoothed.spare)


def _sigma(rows: fitting.ContourRows, fit: fitting.ContourFit, spare: float) -> float:
    """Standard deviation of the rows across the fit, in their unit."""
    off = fit.off(rows.grid, fit.across())
    return float(np.sqrt(np.square(off).sum() / spare))
