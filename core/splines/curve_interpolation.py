"""The periodic cubic spline through given points, as a B-spline."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import CubicSpline

from palpate.core.arrays import Floats
from palpate.core.splines.curve_fit import CurveFit


def interpolate_closed(points: Floats, parameters: Floats) -> CurveFit:
    """Closed cubic through points (m, d), at least 3, at increasing parameters (m,) from 0.

    Knots lie at the parameters, so that the system is diagonally dominant however the points
    are spaced; with even knots and as many points it may be singular.
    """
    count = len(points)
    around = np.append(parameters, 1.0)
    # One more coordinate: with signs that alternate the control points are the farthest off,
    # and so show the condition in the maximum norm.
    signs = np.where(np.arange(count) % 2, -1.0, 1.0)
    wanted = np.column_stack([points, signs])
    spline = CubicSpline(around, np.vstack([wanted, wanted[:1]]), bc_type="periodic")
    knots = closed_knots(parameters)
    before, after = knots[2 : count + 2] - knots[1 : count + 1], np.diff(knots)[2 : count + 2]
    # The control point of the knot t between its neighbours t - a and t + b is the blossom
    # f(t - a, t, t + b). The first belongs to the last parameter.
    order = (np.arange(count) - 1) % count
    value, slope, bend = (spline(parameters[order], derivative) for derivative in range(3))
    control = value + ((after - before) / 3.0)[:, None] * slope
    control -= (after * before / 6.0)[:, None] * bend
    return CurveFit(
        control=control[:, :-1],
        knots=knots,
        parameters=parameters,
        condition=float(np.abs(control[:, -1]).max()),
        effective=float(count),
        smoothing=0.0,
    )


def closed_knots(parameters: Floats) -> Floats:
    """Knots (n + 7,) of a closed cubic with breaks (n,), at least 3, from 0 up to below 1."""
    count = len(parameters)
    turns = np.concatenate([parameters + turn for turn in (-1.0, 0.0, 1.0, 2.0)])
    return turns[count - 3 : 2 * count + 4]
