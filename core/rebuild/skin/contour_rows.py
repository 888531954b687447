"""Contours as the rows of a grid, made ready for a fit: in order, merged, about their middle."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from palpate.core.arrays import Floats, Ints, finite_array
from palpate.core.plane.area_centroid import area_centroids

LEAST_TURNS = 4
SAME_HEIGHT = 1e-3
"""Of the mean spacing: rows at heights nearer to each other are one."""
LEAN_ROWS = 3
"""Outermost contours whose middles say which way the axis leans."""

Pole = bool | ArrayLike
"""Whether a surface closes in a point: where the axis leads, or at a place (2,), m."""


class ContourRows(NamedTuple):
    """M contours of K points in a unit of their own."""

    heights: Floats
    """(M,), rising, m."""
    grid: Floats
    """(M, K, 2), about `middle`, over `size`."""
    weights: Floats
    """(M,): of how many given contours each is the mean."""
    owner: Ints
    """The row of each given contour."""
    poles: tuple[Floats | None, Floats | None]
    """Places (2,) of the poles below and above, if there are any, in the unit of the grid."""
    middle: Floats
    """(2,), m."""
    size: float
    """Largest coordinate about the middle, m."""

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
    heights: ArrayLike, grid: ArrayLike, low: float, high: float, pole: Sequence[Pole]
) -> ContourRows:
    """Rows of a grid, sorted by height; those at one height are averaged.

    Raises
    ------
    ValueError
        If shapes do not fit, a number is not finite, there is no contour or fewer than 4 points
        around, or a contour lies outside `low` to `high`, or at an end that is to be a pole.
    """
    heights = finite_array("heights", heights, (None,))
    grid = finite_array("grid", grid, (len(heights), None, 2))
    if not len(heights):
        raise ValueError("heights must be at least one, got none")
    if grid.shape[1] < LEAST_TURNS:
        raise ValueError(f"grid must have {LEAST_TURNS} points around or more, got {grid.shape[1]}")
    if not (np.isfinite([low, high]).all() and low < high):
        raise ValueError(f"low must be below high and both finite, got {low:g} and {high:g} m")
    closed = tuple(np.ndim(one) > 0 or bool(one) for one in pole)
    order = np.argsort(heights, kind="stable")
    spacing = np.diff(heights[order])
    mean = spacing.sum() / max(len(spacing), 1)
    owner = np.empty(len(heights), np.int32)
    owner[order] = np.concatenate([[0], np.cumsum(spacing > SAME_HEIGHT * mean)])
    weights = np.bincount(owner).astype(np.float64)
    merged = np.bincount(owner, heights) / weights
    _check_range(merged, low, high, closed)
    middle = 0.5 * (grid.min(axis=(0, 1)) + grid.max(axis=(0, 1)))
    size = float(np.abs(grid - middle).max()) or 1.0
    rows = np.zeros((len(weights), *grid.shape[1:]))
    np.add.at(rows, owner, (grid - middle) / size)
    rows /= weights[:, None, None]
    poles = [
        _pole(one, height, merged[end], rows[end], middle, size)
        for one, height, end in zip(
            pole, (low, high), (slice(None, LEAN_ROWS), slice(-LEAN_ROWS, None)), strict=True
        )
    ]
    return ContourRows(merged, rows, weights, owner, (poles[0], poles[1]), middle, size)


def _check_range(heights: Floats, low: float, high: float, closed: tuple[bool, ...]) -> None:
    lowest, highest = float(heights[0]), float(heights[-1])
    if lowest < low or highest > high:
        raise ValueError(
            f"heights must lie from low {low:g} to high {high:g} m, got {lowest:g} to {highest:g}"
        )
    for shut, gap, name in ((closed[0], lowest - low, "low"), (closed[1], high - highest, "high")):
        if shut and not gap > 0.0:
            raise ValueError(f"a pole must lie beyond the last contour, got both at {name}")


def _pole(
    pole: Pole, height: float, heights: Floats, rows: Floats, middle: Floats, size: float
) -> Floats | None:
    """Place of a pole: as given, or where the middles of the nearest contours lead."""
    if np.ndim(pole):
        return (finite_array("pole", pole, (2,)) - middle) / size
    if not pole:
        return None
    middles = area_centroids(rows)
    away = heights - heights.mean()
    spread = float(away @ away)
    lean = away @ (middles - middles.mean(axis=0)) / spread if spread > 0.0 else np.zeros(2)
    place: Floats = middles.mean(axis=0) + (height - heights.mean()) * lean
    return place
