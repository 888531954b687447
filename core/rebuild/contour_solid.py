"""A closed surface from contours that correspond: the skin through them, and their ends."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from palpate.core.arrays import Floats, finite_array
from palpate.core.rebuild.ends.ends import End, close_ends
from palpate.core.rebuild.felt.felt_fit import FeltFit
from palpate.core.rebuild.felt.felt_rows import FeltRows
from palpate.core.rebuild.skin.contour_skin import (
    ContourSkin,
    Uncertainty,
    fit_contour_skin,
    noise_of,
)
from palpate.core.rebuild.skin.contour_surface import SidePatch
from palpate.core.rebuild.skin.through_axis import runs_through_axis
from palpate.core.rebuild.slant import Slant
from palpate.core.rebuild.surface.surface import Surface, close_surface

POINT = 1e-9
"""Of the widest contour: one that is narrower is a point."""


@dataclass(frozen=True, slots=True, eq=False)
class ContourSolid:
    """A closed surface and how it came about."""

    surface: Surface
    skin: ContourSkin
    bottom: End
    top: End
    felt: FeltFit | None = None
    """How everything that was felt was fitted, where that took the place of the contours."""
    slant: Slant | None = None
    """All this is seen from the space in which both ends are level, if they are not."""

    def deviation(self, heights: Floats, turns: Floats) -> Floats:
        """Standard deviation of the side along its normal, m, on a grid (a, b).

        See `ContourSkin.deviation`; of what was felt, at each height the mean around.
        """
        if self.felt is None:
            return self.skin.deviation(heights, turns)
        levels = np.interp(heights, self.felt.band_heights, self.felt.band)
        deviation: Floats = np.repeat(levels[:, None], len(turns), axis=1)
        return deviation

    def uncertainty(self) -> Uncertainty:
        """What the error of the side stays below, and what is narrower than could be seen."""
        return self.skin.uncertainty() if self.felt is None else self.felt.uncertainty()


def close_contours(
    heights: Floats,
    grid: Floats,
    *,
    bottom: float | None = None,
    top: float | None = None,
    noise: float | None = None,
) -> ContourSolid:
    """The closed surface through contours.

    Parameters
    ----------
    heights : (m,) array
        Heights of the contours, ascending.
    grid : (m, k, 2) array
        Their points, counter-clockwise, corresponding. A first or last contour that is but a
        point counts as a touch of the end.
    bottom, top : float, optional
        Heights at which a touch found the ends; left out where nobody touched.
    noise : float, optional
        Standard deviation of a coordinate, in the same unit; estimated if left out.

    Raises
    ------
    ValueError
        As `close_ends` and `fit_contour_skin` do; or if there is but one contour, and both ends
        have not been touched.
    """
    heights = finite_array("heights", heights, (None,))
    grid = finite_array("grid", grid, (len(heights), None, 2))
    heights, grid, (bottom, top) = _points_as_touches(heights, grid, (bottom, top))
    if not len(heights) or (len(heights) == 1 and (bottom is None or top is None)):
        raise ValueError(
            f"heights must be at least 2 unless both ends were touched, got {len(heights)}"
        )
    seen = noise if noise is not None else _noise(heights, grid)
    ends = close_ends(heights, grid, bottom=bottom, top=top, noise=seen)
    return _between_ends(heights, grid, ends, noise)


def close_felt(rows: FeltRows) -> ContourSolid:
    """The closed surface through rows of a skin, which are passed exactly."""
    closed = _between_ends(rows.heights, rows.grid, rows.ends, 0.0)
    return replace(closed, felt=rows.fit, slant=rows.slant)


def _between_ends(
    heights: Floats, grid: Floats, ends: tuple[End, End], noise: float | None
) -> ContourSolid:
    skin = _skin(heights, grid, ends, noise)
    through = [end.round and runs_through_axis(skin.surface, end.rim, end.height) for end in ends]
    if any(through):
        bottom, top = (
            replace(end, apart=end.apart or one) for end, one in zip(ends, through, strict=True)
        )
        ends = bottom, top
        skin = _skin(heights, grid, ends, noise)
    below, above = (None if end.round else end for end in ends)
    side = SidePatch(skin.surface)
    return ContourSolid(close_surface(side, below, above), skin, *ends)


def _skin(heights: Floats, grid: Floats, ends: tuple[End, End], noise: float | None) -> ContourSkin:
    """The skin, which runs on to a point where an end is round, else ends at its last contour."""
    low, high = (end.rim if end.apart else end.height for end in ends)
    return fit_contour_skin(
        heights,
        grid,
        low=low,
        high=high,
        pole=[end.middle if end.round else False for end in ends],
        noise=noise,
    )


def _noise(heights: Floats, grid: Floats) -> float:
    """Standard deviation of a coordinate: an end can be told from contours only so far."""
    if len(heights) == 1:
        return 0.0
    return noise_of(heights, grid)


def _points_as_touches(
    heights: Floats, grid: Floats, touched: tuple[float | None, float | None]
) -> tuple[Floats, Floats, tuple[float | None, float | None]]:
    """Contours without those at the ends that are points; these say where the ends are."""
    width = np.ptp(grid, axis=1).max(axis=1, initial=0.0) if grid.shape[1] else np.zeros(0)
    wide = np.flatnonzero(width > POINT * width.max(initial=0.0))
    if not len(wide):
        return heights[:0], grid[:0], touched
    first, last = int(wide[0]), int(wide[-1])
    bottom = float(heights[0]) if first > 0 and touched[0] is None else touched[0]
    top = float(heights[-1]) if last < len(heights) - 1 and touched[1] is None else touched[1]
    return heights[first : last + 1], grid[first : last + 1], (bottom, top)
