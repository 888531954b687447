"""The parameter along the axis of a surface through contours: latitude where it is round.

Towards a round end the radius falls like the root of the distance from it, with a slope that
no spline in the height can follow. In the latitude the height itself stands still there, and
the radius is smooth: that of an ellipsoid is a cosine.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.rebuild.skin.pace import Pace
from palpate.core.splines.basis import Basis
from palpate.core.splines.knots import CUBIC, averaged_knots

MOST_SITES = 128
"""Coefficients along the axis; of more contours some share a knot interval."""


@dataclass(frozen=True, slots=True)
class Latitude:
    """Parameter of the heights between two ends, each of which may be round.

    Where both are, the angle whose sine is the height; where one is, the root of the distance
    from it; where none is, the height. All are about 1 in size.
    """

    low: float
    """Height of the lower end, m."""
    high: float
    """Height of the upper end, m."""
    round: tuple[bool, bool]
    """Whether the surface closes there with a slope like a sphere's: below, above."""
    pace: Pace | None = None
    """How fast it runs, if not evenly in this."""

    def of(self, heights: Floats) -> Floats:
        """Latitudes (n,) of heights (n,), m; those beyond an end are taken to it."""
        above = np.clip((heights - self.low) / (self.high - self.low), 0.0, 1.0)
        below = np.clip((self.high - heights) / (self.high - self.low), 0.0, 1.0)
        match self.round:
            case (True, True):
                # From both distances: the sine's own inverse is blind next to an end.
                latitudes = 2.0 * np.arctan2(np.sqrt(above), np.sqrt(below)) - 0.5 * np.pi
            case (True, False):
                latitudes = np.sqrt(above)
            case (False, True):
                latitudes = -np.sqrt(below)
            case _:
                latitudes = above
        result: Floats = latitudes if self.pace is None else self.pace.of(latitudes)
        return result

    def height(self, latitudes: Floats, derivative: int = 0) -> Floats:
        """Heights (n,) of latitudes (n,), m, or their first or second derivative."""
        if self.pace is None:
            return self._height(latitudes, derivative)
        even = self.pace.value(latitudes)
        if derivative == 0:
            return self._height(even, 0)
        slope = self.pace.value(latitudes, 1)
        if derivative == 1:
            return slope * self._height(even, 1)
        bend = self.pace.value(latitudes, 2)
        return slope**2 * self._height(even, 2) + bend * self._height(even, 1)

    def _height(self, latitudes: Floats, derivative: int) -> Floats:
        """The same where the pace is even."""
        extent = self.high - self.low
        match self.round:
            case (True, True):
                half, angle = 0.5 * extent, latitudes + 0.5 * np.pi * derivative
                middle = 0.5 * (self.low + self.high)
                result: Floats = half * np.sin(angle) + (middle if derivative == 0 else 0.0)
                return result
            case (True, False):
                result = np.polyval(np.polyder([extent, 0.0, self.low], derivative), latitudes)
            case (False, True):
                result = np.polyval(np.polyder([-extent, 0.0, self.high], derivative), latitudes)
            case _:
                result = np.polyval(np.polyder([extent, self.low], derivative), latitudes)
        return result


def basis_along(sites: Floats, ends: tuple[float, float]) -> Basis:
    """Spline basis with which values at rising latitudes (n,) can be interpolated.

    Cubic, or of a lower degree where there are few sites; with knots that are averages of the
    sites. For a single site it is linear between two `ends` of the parameter.
    """
    if len(sites) == 1:
        low, high = ends
        return Basis(np.array([low, low, high, high]), 1)
    if len(sites) > MOST_SITES:
        shares = np.linspace(0.0, len(sites) - 1.0, MOST_SITES)
        sites = np.interp(shares, np.arange(len(sites)), sites)
    degree = min(CUBIC, len(sites) - 1)
    return Basis(averaged_knots(sites, degree), degree)
