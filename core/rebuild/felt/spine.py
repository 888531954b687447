"""The object's axis: a smooth curve through the middles of its contours."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from palpate.core.arrays import Floats

MOST_DEGREE = 3


@dataclass(frozen=True, slots=True, eq=False)
class Spine:
    """x and y of the axis as polynomials of the height."""

    coefficients: Floats
    """(degree + 1, 2), highest power first, of the height mapped to -1 .. 1."""
    low: float
    """Height below which the axis is straight and upright, m."""
    high: float
    """Height above which it is."""

    def at(self, heights: Floats) -> Floats:
        """Places (n, 2) of the axis at heights (n,), m."""
        half = max(0.5 * (self.high - self.low), np.finfo(float).tiny)
        local = (np.clip(heights, self.low, self.high) - 0.5 * (self.low + self.high)) / half
        return np.stack([np.polyval(column, local) for column in self.coefficients.T], axis=-1)

    def slope(self, heights: Floats) -> Floats:
        """Derivatives (n, 2) of those places by the height; 0 where the axis is upright."""
        half = max(0.5 * (self.high - self.low), np.finfo(float).tiny)
        local = (heights - 0.5 * (self.low + self.high)) / half
        inside = np.abs(local) <= 1.0
        slopes = [np.polyval(np.polyder(column), local) for column in self.coefficients.T]
        return np.where(inside[:, None], np.stack(slopes, axis=-1) / half, 0.0)


def fit_spine(heights: Floats, middles: Floats) -> Spine:
    """Axis through the middles (n, 2) of contours at heights (n,), m.

    The degree is 3, or less where there are few contours.
    """
    low, high = float(heights.min()), float(heights.max())
    half = max(0.5 * (high - low), np.finfo(float).tiny)
    local = (heights - 0.5 * (low + high)) / half
    degree = min(MOST_DEGREE, len(np.unique(heights)) - 1)
    basis = np.vander(local, degree + 1)
    coefficients = np.linalg.lstsq(basis, middles, rcond=None)[0]
    return Spine(np.asarray(coefficients, np.float64), low, high)
