"""How fast the parameter along the axis runs: by the way along the surface, where heights mislead.

Contours on either side of a step lie close together and differ much. A spline in the height
swings far out there, for it takes the step's slope for its neighbours'; in the length of the way
along the surface there is no such slope.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate.core.arrays import Floats


@dataclass(frozen=True, slots=True, eq=False)
class Pace:
    """A rising function with a continuous slope, and its inverse, through given places.

    Notes
    -----
    Gregory and Delbourgo, *Piecewise rational quadratic interpolation to monotonic data*, 1982:
    within each step the inverse is the root of a quadratic.
    """

    even: Floats
    """(m,): rising values at the places."""
    paced: Floats
    """(m,): the places, rising."""
    slopes: Floats
    """(m,): of the values by the places, positive."""

    def of(self, even: Floats) -> Floats:
        """Places (n,) of values (n,); those beyond the ends are taken to them."""
        value = np.clip(even, self.even[0], self.even[-1])
        step = self._step(self.even, value)
        rise, run, mean, begin, more = self._terms(step)
        share = (value - self.even[step]) / rise
        # share (mean + more t (1 - t)) = mean t^2 + begin t (1 - t) in t.
        square = mean - begin + share * more
        linear = begin - share * more
        constant = -share * mean
        root = np.sqrt(np.maximum(linear**2 - 4.0 * square * constant, 0.0))
        way = 2.0 * constant / -(linear + root)
        places: Floats = self.paced[step] + run * np.clip(way, 0.0, 1.0)
        return places

    def value(self, paced: Floats, derivative: int = 0) -> Floats:
        """Values (n,) at places (n,), or their first or second derivative."""
        place = np.clip(paced, self.paced[0], self.paced[-1])
        step = self._step(self.paced, place)
        rise, run, mean, begin, more = self._terms(step)
        t = (place - self.paced[step]) / run
        over, under = mean * t**2 + begin * t * (1.0 - t), mean + more * t * (1.0 - t)
        share = over / under
        if derivative == 0:
            return np.asarray(self.even[step] + rise * share)
        under_slope = more * (1.0 - 2.0 * t)
        slope = (2.0 * mean * t + begin * (1.0 - 2.0 * t) - share * under_slope) / under
        if derivative == 1:
            return np.asarray(rise / run * slope)
        bend = 2.0 * (mean - begin) - 2.0 * slope * under_slope + 2.0 * share * more
        return np.asarray(rise / run**2 * bend / under)

    def _step(self, knots: Floats, places: Floats) -> NDArray[np.intp]:
        return np.clip(np.searchsorted(knots, places, "right") - 1, 0, len(knots) - 2)

    def _terms(self, step: NDArray[np.intp]) -> tuple[Floats, Floats, Floats, Floats, Floats]:
        """Rise, run, mean slope and first slope of steps, and how the slopes exceed the mean."""
        rise, run = np.diff(self.even)[step], np.diff(self.paced)[step]
        mean = rise / run
        begin, end = self.slopes[step], self.slopes[step + 1]
        return rise, run, mean, begin, begin + end - 2.0 * mean


def pace_through(even: Floats, lengths: Floats) -> Pace:
    """The pace with steps of given lengths (m - 1,) between values (m,), both rising.

    It spans what the values do. Its slopes are those of Fritsch and Butland, *A method for
    constructing local monotone piecewise cubic interpolants*, 1984.
    """
    places = np.concatenate([[0.0], np.cumsum(lengths)])
    paced = even[0] + (even[-1] - even[0]) * places / places[-1]
    means, runs = np.diff(even) / np.diff(paced), np.diff(paced)
    near, far = 2.0 * runs[1:] + runs[:-1], runs[1:] + 2.0 * runs[:-1]
    inner = (near + far) / (near / means[:-1] + far / means[1:])
    slopes = np.concatenate([means[:1], inner, means[-1:]])
    return Pace(even, paced, slopes)
