"""A smooth surface through contours, and how far it can be trusted.

Contours that correspond, point by point, are the rows of a grid; a spline runs along its columns
and closes around its rows, both as smooth as the points ask for. Where the surface closes in a
point, it does so exactly.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from palpate.core.arrays import Bools, Floats, finite_array
from palpate.core.rebuild.skin.between_contours import BetweenContours, between_contours
from palpate.core.rebuild.skin.contour_fit import (
    ContourFit,
    fit_heights_or_round,
    fit_latitude,
    fit_rows,
)
from palpate.core.rebuild.skin.contour_rows import ContourRows, Pole, contour_rows
from palpate.core.rebuild.skin.contour_surface import ContourSurface
from palpate.core.rebuild.skin.outlying_points import set_aside
from palpate.core.rebuild.skin.smoother import Smoothed
from palpate.core.splines.basis import PeriodicBasis

SAFE_RMS, SAFE_MOST = 1.5, 4.0
"""Times the deviation: what root mean square and largest error stay below on nine of ten objects
without features narrower than the contours' spacing."""
STEPS_ALONG, STEPS_AROUND = 8, 48
"""Places between contours, and around, over which the deviation is averaged."""


class Health(NamedTuple):
    """Figures of the fit."""

    sigma: float
    """Estimate of the noise: standard deviation across the contours, m."""
    freedom: float
    """Degrees of freedom spent on each coordinate."""
    condition: float
    """Condition number of the matrix from coefficients to points and bending."""
    strengths: tuple[float, float]
    """Of smoothing along and around, against the mean weight of the points."""
    round: tuple[bool, bool]
    """Whether the surface runs into its ends below and above as into a sphere's."""
    merged: int
    """Contours that were averaged with one at the same height."""
    outlying: int
    """Points that were not used, for they stick out."""
    swing: float
    """How far the surface leaves the middle between contours, over how far these differ."""


class Uncertainty(NamedTuple):
    """The whole object in three numbers, m, if nothing on it is narrower than the spacing."""

    rms: float
    """What the root mean square error of the side stays below."""
    most: float
    """What the largest error stays below."""
    resolution: float
    """Half the largest spacing of the contours: what is narrower may have been missed."""


@dataclass(frozen=True, slots=True, eq=False)
class ContourSkin:
    """The surface."""

    surface: ContourSurface
    """Where it is."""
    size: float
    """Half the width of the contours, m."""
    smoothed: Smoothed
    """The fit, over the size."""
    between: BetweenContours
    """What it may miss between contours, over the size."""
    outlying: Bools
    """(m, K): which points were not used, by contours in order of height, merged ones as one."""
    spacing: float
    """Largest distance between contours, m."""
    health: Health
    """How the fit came about."""
    given: Given
    """From what."""

    def at(self, heights: ArrayLike, turns: ArrayLike, by: tuple[int, int] = (0, 0)) -> Floats:
        """Places in the plane (..., 2), m: see `ContourSurface.at`."""
        return self.surface.at(heights, turns, by)

    def deviation(self, heights: ArrayLike, turns: ArrayLike) -> Floats:
        """Standard deviation of the surface along its normal, m, on a grid (a, b).

        From the noise, and from what leaving out each contour would have cost. What nobody
        could know, such as features between two contours, is not in it.

        Parameters
        ----------
        heights, turns : (a,), (b,) arrays
            As for `at`.
        """
        heights = finite_array("heights", heights, (None,))
        latitudes = self.surface.latitude.of(heights)
        return self._deviation(latitudes, finite_array("turns", turns, (None,)))[0]

    def uncertainty(self) -> Uncertainty:
        """One number for the whole side, and what it does not tell."""
        sites, latitude = self.between.sites, self.surface.latitude
        breaks = sites if len(sites) > 1 else np.array(self.surface.along.domain)
        shares = (np.arange(STEPS_ALONG) + 0.5) / STEPS_ALONG
        latitudes = (breaks[:-1, None] + np.diff(breaks)[:, None] * shares).ravel()
        steps = np.repeat(np.diff(breaks), STEPS_ALONG)
        deviation, area = self._deviation(latitudes, np.arange(STEPS_AROUND) / STEPS_AROUND)
        area = area * steps[:, None]
        total = max(float(area.sum()), np.finfo(float).tiny)
        rms = float(np.sqrt((area * np.square(deviation)).sum() / total))
        spacing = self.spacing or latitude.high - latitude.low
        return Uncertainty(SAFE_RMS * rms, SAFE_MOST * float(deviation.max()), 0.5 * spacing)

    def update(self, height: float, row: ArrayLike) -> ContourSkin:
        """The surface through one contour (K, 2) more, m: a fit of all of them."""
        given = self.given
        return fit_contour_skin(
            np.append(given.heights, height),
            np.concatenate([given.grid, finite_array("row", row, given.grid.shape[1:])[None]]),
            low=self.surface.latitude.low,
            high=self.surface.latitude.high,
            pole=given.pole,
            noise=given.noise,
        )

    def _deviation(self, latitudes: Floats, turns: Floats) -> tuple[Floats, Floats]:
        """Along the normal, m, and the area per parameter, on a grid."""
        surface = self.surface
        inside = np.clip(latitudes, *surface.along.domain)
        below, above = (pole is not None for pole in self.given.places)
        inner = slice(int(below), surface.along.count - int(above))
        variance = np.square(self.health.sigma) * self.smoothed.variance(
            surface.along.matrix(inside)[:, inner],
            PeriodicBasis(surface.control.shape[1]).matrix(turns),
        )
        variance += np.square(self.size) * self.between.variance(latitudes, turns)
        up, round_ = surface.on_grid(inside, turns, (1, 0)), surface.on_grid(inside, turns, (0, 1))
        rise = surface.latitude.height(inside, 1)[:, None]
        level = rise * np.hypot(round_[..., 0], round_[..., 1])
        area = np.hypot(level, up[..., 0] * round_[..., 1] - up[..., 1] * round_[..., 0])
        upright = np.divide(level, area, out=np.zeros_like(area), where=area > 0.0)
        return np.sqrt(variance) * upright, area


class Given(NamedTuple):
    """What a skin was fitted to."""

    heights: Floats
    """(M,), m."""
    grid: Floats
    """(M, K, 2), m."""
    pole: tuple[Pole, Pole]
    """Whether it closes in points below and above."""
    noise: float | None
    """Standard deviation of a coordinate, m, if it was known."""
    places: tuple[Floats | None, Floats | None]
    """Places (2,) of those points."""


def fit_contour_skin(
    heights: ArrayLike,
    grid: ArrayLike,
    *,
    low: float,
    high: float,
    pole: Sequence[Pole] = (False, False),
    noise: float | None = None,
) -> ContourSkin:
    """Fit a surface through contours.

    Parameters
    ----------
    heights : (M,) array
        Of the contours, in any order, m; those at one height are averaged.
    grid : (M, K, 2) array
        Their points, m, at even turns, corresponding: column j of each lies at the turn j / K.
        Counter-clockwise, at least 4.
    low, high : float
        Heights of the object's ends, m, or of what is to be taken as such; the contours lie
        between.
    pole : pair of bool or (2,) arrays
        Whether the surface closes in a point there, below and above: where the axis leads, or
        at a place, m.
    noise : float or None
        Standard deviation of a coordinate, m, if it is known; otherwise it is estimated. Of 0,
        no point is left out.

    Raises
    ------
    ValueError
        If shapes do not fit, a number is not finite, there are too few points, a contour lies
        outside, or a pole on a contour.
    """
    rows = contour_rows(heights, grid, low, high, pole)
    scaled = None if noise is None else noise / rows.size
    fit = fit_rows(rows, low, high, scaled)

    def again(points: Floats) -> ContourFit:
        return fit_latitude(rows._replace(grid=points), fit.latitude, scaled, fit.caution)

    if noise == 0.0:  # who knows that there is no noise knows that no point is wrong
        used, outlying = rows.grid, np.zeros(rows.grid.shape[:2], np.bool_)
    else:
        used, fit, outlying = set_aside(rows.grid, fit, again)
    given = Given(
        finite_array("heights", heights, (None,)),
        finite_array("grid", grid, (None, None, 2)),
        (pole[0], pole[1]),
        noise,
        rows.poles,
    )
    return _skin(rows._replace(grid=used), fit, outlying, given)


def noise_of(heights: Floats, grid: Floats) -> float:
    """Standard deviation across contours (M, K, 2), m, by a fit between the outer two."""
    low, high = float(heights.min()), float(heights.max())
    rows = contour_rows(heights, grid, low, high, (False, False))
    fit = fit_heights_or_round(rows, low, high)
    return rows.size * _sigma(rows, fit, fit.smoothed.spare)


def _sigma(rows: ContourRows, fit: ContourFit, spare: float) -> float:
    """Standard deviation of the rows across the fit, in their unit."""
    off = np.einsum("mkd,mkd->mk", rows.grid - fit.fitted(), fit.across())
    return float(np.sqrt((rows.weights[:, None] * np.square(off)).sum() / spare))


def _skin(rows: ContourRows, fit: ContourFit, outlying: Bools, given: Given) -> ContourSkin:
    """What a fit says in the contours' own unit."""
    across = fit.across()
    spare = max(fit.smoothed.spare - float(outlying.sum()), 0.5 * fit.smoothed.spare)
    sigma = _sigma(rows, fit, spare)
    if given.noise is not None:
        sigma = given.noise / rows.size
    beside = tuple(int(pole is not None) for pole in rows.poles)
    around = np.pad(across, (beside, (0, 0), (0, 0)))
    smoothed = fit.smoothed
    return ContourSkin(
        surface=ContourSurface(fit.latitude, fit.along, rows.size * fit.control, rows.middle),
        size=rows.size,
        smoothed=smoothed,
        between=between_contours(fit.sites, rows.with_poles, around, sigma),
        outlying=outlying,
        spacing=rows.spacing,
        health=Health(
            sigma=rows.size * sigma,
            freedom=smoothed.freedom,
            condition=smoothed.condition,
            strengths=smoothed.strengths,
            round=fit.latitude.round,
            merged=len(rows.owner) - len(rows.heights),
            outlying=int(outlying.sum()),
            swing=fit.swing(),
        ),
        given=given,
    )
