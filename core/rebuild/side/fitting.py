"""A smoothed grid of contours, in the parameter along the axis that suits it."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from palpate.core.arrays import Floats, finite_array
from palpate.core.rebuild.side.smoothing import (
    Smoothed,
    SmoothingAxis,
    smooth,
    smoothing_axis,
)
from palpate.core.rebuild.side.surfaces import (
    AxialParameter,
    basis_along,
    reparametrisation_through,
)
from palpate.core.splines import Basis, PeriodicBasis, bending_along, bending_around

MOST_AROUND = 128  # Coefficients around
LEAST_ROWS = 5  # With fewer rows and poles only ends with a pole can be round
CAUTION = 1.2  # Of the choice of strengths, where residuals of rows do not resemble each other
MANY_ROWS, ALIKE = 12, 0.25  # Rows from which on that is told, correlation above which they do
# Swing from which on rows are tried in another parameter, and how much of it may be left then. Of
# smooth objects it stays below a quarter or so, however few rows there are.
SWINGS, CALMER = 0.5, 0.5
# Of the way along the surface; less of it is calmer where steps are of many lengths: Lee, *Choosing
# nodes in parametric curve interpolation*, 1989.
POWERS = (1.0, 0.5, 0.25)
SLIGHT = 0.05  # Of the size: swings below half of that are noise
STILL = 1e-9  # Slope around, over the size, of a contour that is a point
# Rows from which on the way along the surface is tried as the parameter without need, and how much
# better it must predict rows.
LEAST_PACED, FAR_BETTER = 8, 0.72
PREDICTED = 0.01  # Of the size: rows that are predicted as well as this lie close enough together
LEAST_TURNS = 4
Poles = tuple[Floats | None, Floats | None]  # Where a surface closes in a point, (2,), m


class ContourFit(NamedTuple):
    """A smoothed grid and what its coefficients belong to."""

    axial_parameter: AxialParameter  # Parameter along the axis
    caution: float  # Of the choice of strengths
    along: Basis  # Splines along it
    sites: Floats  # Parameters (m,) of rows and poles, rising
    smoothed: Smoothed  # The smoothing, of the rows about the line between the poles
    control: Floats  # Coefficients (n, k, 2), those of the poles among them
    axis: Floats  # Places (m, 2) of the line between the poles at the rows; 0 without poles

    def fitted(self) -> Floats:
        """The smoothed rows, (m, k, 2)."""
        return self.smoothed.fitted + self.axis[:, None]

    def across(self) -> Floats:
        """Unit vectors (m, k, 2) across the smoothed rows, outwards; 0 where a row is a point."""
        kept = self.smoothed.kept * self.smoothed.parts
        rows = self.smoothed.along.modes.shapes @ kept
        around = self.smoothed.around
        slopes = _periodic_slopes(len(around.modes.shapes)) @ around.modes.control
        x, y = rows @ slopes.T
        length = np.hypot(x, y)
        moving = length > STILL
        length = np.where(moving, length, 1.0)
        return np.stack([y / length * moving, -x / length * moving], axis=-1)

    def off(self, grid: Floats, across: Floats) -> Floats:
        """Distances of rows from the fit along unit vectors across, (m, k)."""
        return np.asarray(np.einsum("mkd,mkd->mk", grid - self.fitted(), across))

    def swing(self) -> float:
        """How far it leaves the middle between two rows, at most, over how far these differ."""
        rows = self.along.matrix(self.sites) @ self.control.reshape(self.along.count, -1)
        middles = 0.5 * (self.sites[1:] + self.sites[:-1])
        between = self.along.matrix(middles) @ self.control.reshape(self.along.count, -1)
        if not len(middles):
            return 0.0
        steps = _longest(np.diff(rows, axis=0))
        beside = np.pad(steps, 1)
        near = np.maximum(steps, np.maximum(beside[2:], beside[:-2]))
        away = _longest(between - 0.5 * (rows[1:] + rows[:-1]))
        return float((away / (near + SLIGHT)).max())

    def likeness(self, grid: Floats) -> float:
        """Correlation of neighbouring rows' residuals, given the rows (m, k, 2): noise has none."""
        off = self.off(grid, self.across())
        below, above = off[:-1], off[1:]
        size = np.sqrt(np.square(below).sum() * np.square(above).sum())
        return float((below * above).sum() / max(size, np.finfo(float).tiny))


@lru_cache(maxsize=8)
def _periodic_slopes(count: int) -> Floats:
    periodic = PeriodicBasis(min(count, MOST_AROUND))
    slopes: Floats = periodic.matrix(np.arange(count) / count, 1).toarray()
    slopes.setflags(write=False)
    return slopes


def _longest(rows: Floats) -> Floats:
    """The longest vector (m,) in rows (m, 2 k) of x and y in turn."""
    return np.asarray(np.hypot(rows[:, ::2], rows[:, 1::2]).max(axis=1))


def fit_rows(rows: ContourRows, low: float, high: float, noise: float | None) -> ContourFit:
    """Fit rows in the height, or in the latitude, with which they agree better.

    The third way is to be round only where there is a pole. Each end by itself is not left to the
    rows to decide: there the choice costs more than it gains. `low` and `high` are the ends'
    heights, m; `noise` is a coordinate's deviation in the unit of the rows, if it is known.
    """
    below, above = (pole is not None for pole in rows.poles)
    trials = [(below, above)]
    if len(rows.heights) + below + above >= LEAST_ROWS:
        trials += [both for both in ((False, False), (True, True)) if both != trials[0]]
    candidates = [AxialParameter(low, high, ends) for ends in trials]
    fit = _careful(rows, candidates, noise)
    swing = fit.swing()
    if swing <= SWINGS:  # to follow the way along the surface must predict rows far better
        error = _prediction_error(fit)
        if len(rows.heights) < LEAST_PACED or error**2 / np.sqrt(rows.grid.shape[1]) < PREDICTED:
            return fit
        mapped = _careful(rows, [reparametrised(rows, one, 1.0) for one in candidates], noise)
        return mapped if _prediction_error(mapped) < FAR_BETTER * error else fit
    attempts = [
        _careful(rows, [reparametrised(rows, one, power) for one in candidates], noise)
        for power in POWERS
    ]
    mapped = min(attempts, key=ContourFit.swing)
    return mapped if mapped.swing() < CALMER * swing else fit


def _careful(
    rows: ContourRows, candidates: list[AxialParameter], noise: float | None
) -> ContourFit:
    """The best of some parameters, with caution where noise is not shared by rows."""
    if noise is None and len(rows.heights) >= MANY_ROWS:
        fit = _best(rows, candidates, noise, CAUTION)
        if abs(fit.likeness(rows.grid)) < ALIKE:
            return fit
    return _best(rows, candidates, noise, 1.0)


def reparametrised(
    rows: ContourRows, axial_parameter: AxialParameter, power: float
) -> AxialParameter:
    """The same parameter, but running by a power of the way from row to row along the surface."""
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


def fit_heights_or_round(rows: ContourRows, low: float, high: float) -> ContourFit:
    """Fit rows in the height or the latitude, whatever their poles, steps and shared noise."""
    both = [AxialParameter(low, high, ends) for ends in ((False, False), (True, True))]
    return _best(rows, both if len(rows.heights) >= LEAST_ROWS else both[:1], None, 1.0)


def _best(
    rows: ContourRows, candidates: list[AxialParameter], noise: float | None, caution: float
) -> ContourFit:
    fits = [fit_axial_parameter(rows, one, noise, caution) for one in candidates]
    return min(fits, key=_prediction_error)


def _prediction_error(fit: ContourFit) -> float:
    """By how much the others predict the inner rows wrongly: a mean of roots, for steps."""
    inner = fit.smoothed.missed[1:-1]
    return float(np.sqrt(inner).mean()) if len(inner) else fit.smoothed.score


def fit_axial_parameter(
    rows: ContourRows, axial_parameter: AxialParameter, noise: float | None, caution: float = 1.0
) -> ContourFit:
    """Fit rows in a given parameter; `caution` is that of `smooth`."""
    below, above = rows.poles
    ends = axial_parameter.of(np.array([axial_parameter.low, axial_parameter.high]))
    places = axial_parameter.of(rows.heights)
    sites = np.concatenate([ends[:1][: below is not None], places, ends[1:][: above is not None]])
    along = basis_along(sites, (float(ends[0]), float(ends[1])))
    inner = slice(int(below is not None), along.count - int(above is not None))
    matrix = along.matrix(places).toarray()
    root = bending_along(along, 1 if len(sites) == 1 else 2)
    line = _line(along, below, above)
    smoothed = smooth(
        rows.grid - (matrix @ line)[:, None],
        smoothing_axis(matrix[:, inner], root[:, inner]),
        around_axis(rows.grid.shape[1]),
        noise=noise,
        caution=caution,
    )
    control = np.repeat(line[:, None], smoothed.around.weight.shape[0], axis=1)
    control[inner] += smoothed.coefficients
    return ContourFit(axial_parameter, caution, along, sites, smoothed, control, matrix @ line)


def _line(along: Basis, below: Floats | None, above: Floats | None) -> Floats:
    """Coefficients (n, 2) of the line between the poles; it bends nothing."""
    start, end = below if below is not None else above, above if above is not None else below
    if start is None or end is None:
        return np.zeros((along.count, 2))
    greville = along.greville()
    share = (greville - greville[0]) / (greville[-1] - greville[0])
    return np.asarray(start + share[:, None] * (end - start))


@lru_cache(maxsize=8)
def around_axis(count: int) -> SmoothingAxis:
    """The axis around of a grid with so many even turns."""
    periodic = PeriodicBasis(min(count, MOST_AROUND))
    basis = periodic.matrix(np.arange(count) / count).toarray()
    return smoothing_axis(basis, bending_around(periodic.count))


class ContourRows(NamedTuple):
    """M contours of K points in a unit of their own."""

    heights: Floats  # (M,), rising, m
    grid: Floats  # (M, K, 2), about `middle`, over `size`
    poles: Poles  # Below and above, in the unit of the grid
    middle: Floats  # (2,), m
    size: float  # Largest coordinate about the middle, m

    @property
    def spacing(self) -> float:
        """Largest distance between neighbours, m; 0 if there is one."""
        return float(np.diff(self.heights).max(initial=0.0))

    @property
    def with_poles(self) -> Floats:
        """The grid with a row of K times its place for each pole."""
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
    contour lies outside `low` to `high`, or at an end that is to be a pole.
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
    for one, gap, name in zip(pole, gaps, ("low", "high"), strict=True):
        if one is not None and not gap > 0.0:
            raise ValueError(f"a pole must lie beyond the last contour, got both at {name}")
    middle = 0.5 * (grid.min(axis=(0, 1)) + grid.max(axis=(0, 1)))
    size = float(np.abs(grid - middle).max()) or 1.0
    rows = (grid - middle) / size
    below, above = (
        None if one is None else (finite_array("pole", one, (2,)) - middle) / size for one in pole
    )
    return ContourRows(heights, rows, (below, above), middle, size)
