"""Single points of a contour that are not at its height."""

from __future__ import annotations

import numpy as np

from palpate.core.arrays import Bools, Floats

MEDIAN = 0.6745
"""Median size of an error of deviation 1."""
REACH = 4
"""Points on either side; half of them may be wrong."""
CLEARLY = 6.0
"""Deviations from which on a point is away from the median of those beside it,"""
SPREAD = 3.0
"""and of the middle half of those beside it, for a contour may rise and fall,"""
LEAST = 1e-4
"""and of the perimeter: less does no harm."""
MOST = 0.15
"""Share of the points beyond which the contour itself is like that."""
LEAST_POINTS = 12


def stray_heights(z: Floats, perimeter: float) -> Bools:
    """Which points of a contour, by their z (n,) in order around, are far above or below it.

    A contour that is tilted or bent changes its height little by little: its points are
    in the middle of those beside them.
    """
    nothing = np.zeros(len(z), np.bool_)
    if len(z) < LEAST_POINTS:
        return nothing
    near = np.stack([np.roll(z, by) for by in range(-REACH, REACH + 1)])
    low, middle, high = np.quantile(near, [0.25, 0.5, 0.75], axis=0)
    off = np.abs(z - middle)
    scale = float(np.median(off)) / MEDIAN
    stray: Bools = off > np.maximum(SPREAD * (high - low), max(CLEARLY * scale, LEAST * perimeter))
    return nothing if stray.mean() > MOST else stray
