"""The object's axis: a smooth curve through the middles of its contours."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import CubicSpline

from palpate.core.arrays import Floats

MOST_DEGREE = 3
MISSES = 0.01
"""Of the height: where a middle lies farther off the polynomial, the axis is a spline instead."""


@dataclass(frozen=True, slots=True, eq=False)
class Spine:
    """x and y of the axis as polynomials of the height, or as cubic splines of it."""

    coefficients: Floats
    """(degree + 1, 2), highest power first, of the height mapped to -1 .. 1."""
    low: float
    """Height below which the axis is straight and upright, m."""
    high: float
    """Height above which it is."""
    bent: CubicSpline | None = None
    """Takes the polynomials' place, of the height in m."""

    def at(self, heights: Floats) -> Floats:
        """Places (n, 2) of the axis at heights (n,), m."""
        if self.bent is not None:
            return np.asarray(self.bent(np.clip(heights, self.low, self.high)))
        half = max(0.5 * (self.high - self.low), np.finfo(float).tiny)
        local = (np.clip(heights, self.low, self.high) - 0.5 * (self.low + self.high)) / half
        return np.stack([np.polyval(column, local) for column in self.coefficients.T], axis=-1)

    def slope(self, heights: Floats) -> Floats:
        """Derivatives (n, 2) of those places by the height; 0 where the axis is upright."""
        half = max(0.5 * (self.high - self.low), np.finfo(float).tiny)
        local = (heights - 0.5 * (self.low + self.high)) / half
        inside = np.abs(local) <= 1.0
        if self.bent is not None:
            return np.where(inside[:, None], self.bent(heights, 1), 0.0)
        slopes = [np.polyval(np.polyder(column), local) for column in self.coefficients.T]
        return np.where(inside[:, None], np.stack(slopes, axis=-1) / half, 0.0)


def fit_spine(heights: Floats, middles: Floats) -> Spine:
    """Axis through the middles (n, 2) of contours at heights (n,), m.

    The degree is 3, or less where there are few contours. What is bent more than that, as the stem
    of a banana, has a spline for its axis.
    """
    low, high = float(heights.min()), float(heights.max())
    half = max(0.5 * (high - low), np.finfo(float).tiny)
    local = (heights - 0.5 * (low + high)) / half
    degree = min(MOST_DEGREE, len(np.unique(heights)) - 1)
    basis = np.vander(local, degree + 1)
    coefficients = np.linalg.lstsq(basis, middles, rcond=None)[0]
    spine = Spine(np.asarray(coefficients, np.float64), low, high)
    missed = float(np.linalg.norm(spine.at(heights) - middles, axis=1).max())
    levels, first = np.unique(heights, return_index=True)
    if missed <= MISSES * (high - low) or len(levels) <= MOST_DEGREE + 1:
        return spine
    return replace(spine, bent=CubicSpline(levels, middles[first], bc_type="natural"))
