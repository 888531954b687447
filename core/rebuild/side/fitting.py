"""A smoothed grid of contours, in the parameter along the axis that suits it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from palpate.core.arrays import Floats, finite_array
from palpate.core.rebuild.side.smoothing import (
    DEFAULT_SMOOTHING,
    Smoothed,
    SmoothingAxis,
    SmoothingSettings,
    smooth,
    smoothing_axis,
)
from palpate.core.rebuild.side.surfaces import (
    AxialParameter,
    basis_along,
    reparametrisation_through,
)
from palpate.core.splines import Basis, PeriodicBasis, bending_along, bending_around

Poles = tuple[Floats | None, Floats | None]  # where a surface closes in a point, (2,) [m]


@dataclass(frozen=True, slots=True, kw_only=True)
class ContourFitSettings:
    """Which parameter along the axis contours are fitted in, and how cautiously."""

    max_around: int = 128  # largest number of coefficients around
    min_round_rows: int = 5  # rows and poles; with fewer, only ends with a pole are round
    caution: float = 1.2  # weight of a degree of freedom, if residuals are noise; larger, smoother
    min_caution_rows: int = 12  # rows that are needed to measure the likeness of residuals
    max_likeness: float = 0.25  # |correlation| of neighbouring rows' residuals that are noise
    # Rows with a larger swing (see `ContourFit.swing`) are fitted again in the arc length, which is
    # kept if it reduces the swing below a ratio. Smooth objects have a swing of about 0.25.
    max_swing: float = 0.5
    max_swing_ratio: float = 0.5
    # Powers of the arc length along the surface; lower ones are calmer where steps have many
    # lengths: Lee, *Choosing nodes in parametric curve interpolation*, 1989.
    powers: tuple[float, ...] = (1.0, 0.5, 0.25)
    # At least `min_rows` rows with a smaller swing are fitted in the arc length, too, which is kept
    # if it reduces their prediction error below a ratio.
    min_rows: int = 8
    max_error_ratio: float = 0.72
    min_error: float = 0.01  # rms error over the size; rows predicted better are not tried again
    smoothing: SmoothingSettings = DEFAULT_SMOOTHING


DEFAULT_CONTOUR_FIT = ContourFitSettings()


class ContourFit(NamedTuple):
    """A smoothed grid, and the basis of its coefficients."""

    axial_parameter: AxialParameter  # parameter along the axis
    caution: float  # of the choice of strengths
    along: Basis  # splines along it
    sites: Floats  # parameters (m,) of rows and poles, rising
    smoothed: Smoothed  # the rows, about the line between the poles
    control: Floats  # coefficients (n, k, 2), those of the poles among them
    axis: Floats  # places (m, 2) of the line between the poles at the rows; 0 without poles

    def fitted(self) -> Floats:
        """The smoothed rows, (m, k, 2)."""
        return self.smoothed.fitted + self.axis[:, None]

    def across(self, min_slope: float = 1e-9) -> Floats:
        """Outward unit vectors (m, k, 2) across the smoothed rows.

        They are 0 where a row is a point: its slope around, over the size, is below `min_slope`.
        """
        kept = self.smoothed.kept * self.smoothed.parts
        rows = self.smoothed.along.modes.shapes @ kept
        around = self.smoothed.around
        slopes = _periodic_slopes(len(around.modes.control), len(around.modes.shapes))
        slopes = slopes @ around.modes.control
        x, y = rows @ slopes.T
        length = np.hypot(x, y)
        moving = length > min_slope
        length = np.where(moving, length, 1.0)
        return np.stack([y / length * moving, -x / length * moving], axis=-1)

    def off(self, grid: Floats, across: Floats) -> Floats:
        """Distances (m, k) of rows from the fit along unit vectors `across`."""
        return np.asarray(np.einsum("mkd,mkd->mk", grid - self.fitted(), across))

    def swing(self, min_step: float = 0.05) -> float:
        """Largest distance of the fit from the middle between two rows, over that of the rows.

        `min_step`, a fraction of the size, is added to the latter: small swings are noise.
        """
        rows = self.along.matrix(self.sites) @ self.control.reshape(self.along.count, -1)
        middles = 0.5 * (self.sites[1:] + self.sites[:-1])
        between = self.along.matrix(middles) @ self.control.reshape(self.along.count, -1)
        if not len(middles):
            return 0.0
        steps = _longest(np.diff(rows, axis=0))
        beside = np.pad(steps, 1)
        near = np.maximum(steps, np.maximum(beside[2:], beside[:-2]))
        away = _longest(between - 0.5 * (rows[1:] + rows[:-1]))
        return float((away / (near + min_step)).max())

    def likeness(self, grid: Floats) -> float:
        """Correlation of neighbouring rows' residuals, of the rows (m, k, 2): noise has none."""
        off = self.off(grid, self.across())
        below, above = off[:-1], off[1:]
        size = np.sqrt(np.square(below).sum() * np.square(above).sum())
        return float((below * above).sum() / max(size, np.finfo(float).tiny))


@lru_cache(maxsize=8)
def _periodic_slopes(n_around: int, count: int) -> Floats:
    """Derivatives (count, n_around) of the periodic basis at even turns."""
    slopes: Floats = PeriodicBasis(n_around).matrix(np.arange(count) / count, 1).toarray()
    slopes.setflags(write=False)
    return slopes


def _longest(rows: Floats) -> Floats:
    """Length (m,) of the longest vector in rows (m, 2 k), which alternate x and y."""
    return np.asarray(np.hypot(rows[:, ::2], rows[:, 1::2]).max(axis=1))


def fit_rows(
    rows: ContourRows,
    low: float,
    high: float,
    noise: float | None,
    settings: ContourFitSettings = DEFAULT_CONTOUR_FIT,
) -> ContourFit:
    """Fit rows in the height, the latitude, or round only at poles, whichever predicts rows best.

    Each end by itself is not chosen by the rows: that costs more than it gains. Rows that swing, or
    are predicted badly, are tried in the arc length along the surface as well. `low` and `high` are
    the heights of the ends [m]; `noise` is a coordinate's standard deviation in the unit of the
    rows, if it is known.
    """
    below, above = (pole is not None for pole in rows.poles)
    trials = [(below, above)]
    if len(rows.heights) + below + above >= settings.min_round_rows:
        trials += [both for both in ((False, False), (True, True)) if both != trials[0]]
    candidates = [AxialParameter(low, high, ends) for ends in trials]

    def by_length(power: float) -> ContourFit:
        parameters = [reparametrised(rows, candidate, power) for candidate in candidates]
        return _best_cautious(rows, parameters, noise, settings)

    fit = _best_cautious(rows, candidates, noise, settings)
    swing = fit.swing()
    if not swing <= settings.max_swing:
        calmest = min(map(by_length, settings.powers), key=ContourFit.swing)
        return calmest if calmest.swing() < settings.max_swing_ratio * swing else fit
    error = _prediction_error(fit)
    is_close = error**2 / np.sqrt(rows.grid.shape[1]) < settings.min_error
    if len(rows.heights) < settings.min_rows or is_close:
        return fit
    paced = by_length(1.0)
    return paced if _prediction_error(paced) < settings.max_error_ratio * error else fit


def _best_cautious(
    rows: ContourRows,
    candidates: list[AxialParameter],
    noise: float | None,
    settings: ContourFitSettings,
) -> ContourFit:
    """The best of some parameters, with caution where the residuals of rows are not alike."""
    if noise is None and len(rows.heights) >= settings.min_caution_rows:
        fit = _best_predicting(rows, candidates, noise, settings.caution, settings)
        if abs(fit.likeness(rows.grid)) < settings.max_likeness:
            return fit
    return _best_predicting(rows, candidates, noise, 1.0, settings)


def reparametrised(
    rows: ContourRows, axial_parameter: AxialParameter, power: float
) -> AxialParameter:
    """The parameter, changed to steps from row to row that are a power of the arc length."""
    low, high, grid = axial_parameter.low, axial_parameter.high, rows.grid
    places = axial_parameter.of(np.concatenate([[low], rows.heights, [high]]))
    first, last = (
        grid[end, None] if pole is None else np.broadcast_to(pole, grid[:1].shape)
        for end, pole in zip((0, -1), rows.poles, strict=True)
    )
    apart = np.diff(np.concatenate([first, grid, last]), axis=0)
    across = np.sqrt(np.square(apart).sum(axis=2).mean(axis=1))
    rise = np.diff(places) * (high - low) / (places[-1] - places[0]) / rows.size
    distinct = np.diff(places) > 0.0
    kept = np.concatenate([[True], distinct])
    lengths = np.hypot(rise, across)[distinct] ** power
    through = reparametrisation_through(places[kept], lengths)
    return replace(axial_parameter, reparametrisation=through)


def fit_heights_or_round(
    rows: ContourRows,
    low: float,
    high: float,
    settings: ContourFitSettings = DEFAULT_CONTOUR_FIT,
) -> ContourFit:
    """Fit rows in the height or the latitude, without regard to poles, swing and likeness."""
    both = [AxialParameter(low, high, ends) for ends in ((False, False), (True, True))]
    candidates = both if len(rows.heights) >= settings.min_round_rows else both[:1]
    return _best_predicting(rows, candidates, None, 1.0, settings)


def _best_predicting(
    rows: ContourRows,
    candidates: list[AxialParameter],
    noise: float | None,
    caution: float,
    settings: ContourFitSettings,
) -> ContourFit:
    """The fit with the least prediction error."""
    how = noise, caution, settings
    fits = [fit_axial_parameter(rows, candidate, *how) for candidate in candidates]
    return min(fits, key=_prediction_error)


def _prediction_error(fit: ContourFit) -> float:
    """Error of the inner rows' prediction by the others: a mean of roots, robust to steps."""
    inner = fit.smoothed.missed[1:-1]
    return float(np.sqrt(inner).mean()) if len(inner) else fit.smoothed.score


def fit_axial_parameter(
    rows: ContourRows,
    axial_parameter: AxialParameter,
    noise: float | None,
    caution: float = 1.0,
    settings: ContourFitSettings = DEFAULT_CONTOUR_FIT,
) -> ContourFit:
    """Fit rows in one parameter along the axis; `noise` and `caution` are those of `smooth`."""
    below, above = rows.poles
    ends = axial_parameter.of(np.array([axial_parameter.low, axial_parameter.high]))
    places = axial_parameter.of(rows.heights)
    sites = np.concatenate([ends[:1][: below is not None], places, ends[1:][: above is not None]])
    along = basis_along(sites, (float(ends[0]), float(ends[1])))
    inner = slice(int(below is not None), along.count - int(above is not None))
    matrix = along.matrix(places).toarray()
    root = bending_along(along, 1 if len(sites) == 1 else 2)
    line = _pole_line(along, below, above)
    smoothed = smooth(
        rows.grid - (matrix @ line)[:, None],
        smoothing_axis(matrix[:, inner], root[:, inner], settings.smoothing),
        around_axis(rows.grid.shape[1], settings.max_around, settings.smoothing),
        noise=noise,
        caution=caution,
        settings=settings.smoothing,
    )
    control = np.repeat(line[:, None], smoothed.around.weight.shape[0], axis=1)
    control[inner] += smoothed.coefficients
    return ContourFit(axial_parameter, caution, along, sites, smoothed, control, matrix @ line)


def _pole_line(along: Basis, below: Floats | None, above: Floats | None) -> Floats:
    """Coefficients (n, 2) of the line between the poles; adding it changes no bending."""
    start, end = below if below is not None else above, above if above is not None else below
    if start is None or end is None:
        return np.zeros((along.count, 2))
    greville = along.greville()
    share = (greville - greville[0]) / (greville[-1] - greville[0])
    return np.asarray(start + share[:, None] * (end - start))


@lru_cache(maxsize=8)
def around_axis(count: int, max_around: int, settings: SmoothingSettings) -> SmoothingAxis:
    """Axis around of a grid with `count` even turns."""
    periodic = PeriodicBasis(min(count, max_around))
    basis = periodic.matrix(np.arange(count) / count).toarray()
    return smoothing_axis(basis, bending_around(periodic.count), settings)


class ContourRows(NamedTuple):
    """M contours of K points in a unit of their own."""

    heights: Floats  # (M,), rising [m]
    grid: Floats  # (M, K, 2), about `middle`, over `size`
    poles: Poles  # below and above, in the unit of the grid
    middle: Floats  # (2,) [m]
    size: float  # largest coordinate about the middle [m]

    @property
    def spacing(self) -> float:
        """Largest distance between neighbours [m]; 0 of a single contour."""
        return float(np.diff(self.heights).max(initial=0.0))

    @property
    def with_poles(self) -> Floats:
        """The grid with one more row for each pole: K times its place."""
        below, above = (
            self.grid[:0] if pole is None else np.broadcast_to(pole, (1, *self.grid.shape[1:]))
            for pole in self.poles
        )
        return np.concatenate([below, self.grid, above])


def contour_rows(
    heights: ArrayLike, grid: ArrayLike, low: float, high: float, pole: Poles
) -> ContourRows:
    """Rows of a grid at rising heights.

    Raises ValueError if shapes do not fit, a number is not finite, heights do not rise, or a
    contour lies outside `low` to `high`, or at an end that is a pole.
    """
    heights = finite_array("heights", heights, (None,))
    grid = finite_array("grid", grid, (len(heights), None, 2))
    if not (np.diff(heights) > 0.0).all():
        raise ValueError(f"heights must rise, got {heights.tolist()}")
    lowest, highest = float(heights[0]), float(heights[-1])
    if lowest < low or highest > high:
        raise ValueError(
            f"heights must lie from low {low:g} to high {high:g} m, got {lowest:g} to {highest:g}"
        )
    gaps = (lowest - low, high - highest)
    for place, gap, name in zip(pole, gaps, ("low", "high"), strict=True):
        if place is not None and not gap > 0.0:
            raise ValueError(f"a pole must lie beyond the last contour, got both at {name}")
    middle = 0.5 * (grid.min(axis=(0, 1)) + grid.max(axis=(0, 1)))
    size = float(np.abs(grid - middle).max()) or 1.0
    rows = (grid - middle) / size
    below, above = (
        None if place is None else (finite_array("pole", place, (2,)) - middle) / size
        for place in pole
    )
    return ContourRows(heights, rows, (below, above), middle, size)
