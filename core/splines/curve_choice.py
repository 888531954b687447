"""Which fit of a closed curve suits the points."""

from __future__ import annotations

from typing import Literal

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.splines.curve_fit import CurveFit, closed_places
from palpate.core.splines.curve_interpolation import interpolate_closed
from palpate.core.splines.curve_least_squares import LEAST_SMOOTHING, fit_closed
from palpate.core.splines.curve_parameters import gap_ratio
from palpate.core.splines.knots import CUBIC

Smoothing = float | Literal["auto", "gcv"] | None

LEAST_CONTROL = CUBIC + 1
MOST_CONTROL = 100
"""Control points that are chosen unasked; a system of so many takes some 5 ms."""
UNEVEN = 20.0
"""Longest gap between points over the shortest from which on they are uneven."""
CLEAN = 1e-9
"""Noise, over the curve's size, that is not worth smoothing."""
BIASED = 1.5
"""Residuals that exceed the noise between neighbours by this factor show what was smoothed away."""
RESAMPLED = 8
"""Points for each control point with which a curve through uneven ones is taken anew."""


def choose_fit(
    points: Floats, turns: Floats, count: int | None, smoothing: Smoothing, noise: float
) -> CurveFit:
    """The periodic fit that suits points (m, d) at parameters (m,), at least 2 of them.

    `count` and `smoothing` are as for `fit_closed_curve`; `noise` is what `local_noise` found.
    """
    chosen = count or int(np.clip(len(points) // 2, LEAST_CONTROL, MOST_CONTROL))
    if len(points) < 3:
        return fit_closed(points, turns, LEAST_CONTROL, LEAST_SMOOTHING)
    if smoothing == "gcv":
        return fit_closed(points, turns, chosen, None)
    if smoothing is not None and not isinstance(smoothing, str):
        return fit_closed(points, turns, chosen, float(smoothing))
    if smoothing == "auto" and noise > CLEAN:
        fit = fit_closed(points, turns, chosen, None)
        if count is not None or _deviation(points, fit) <= BIASED * noise:
            return fit
    if count is not None and gap_ratio(points) <= UNEVEN:
        return fit_closed(points, turns, count, LEAST_SMOOTHING)
    through = interpolate_closed(points, turns)
    if count is None:
        return through
    # Even knots would find nothing in the gaps: they get points of the curve through all.
    even = np.arange(RESAMPLED * count) / (RESAMPLED * count)
    places = closed_places(through.control, through.knots, even)
    return fit_closed(places, even, count, LEAST_SMOOTHING)._replace(parameters=turns)


def _deviation(points: Floats, fit: CurveFit) -> float:
    """Root mean square distance of the points from their places on the curve."""
    off = points - closed_places(fit.control, fit.knots, fit.parameters)
    return float(np.sqrt((off**2).sum(axis=1).mean()))
