"""A closed cubic with few, evenly spaced knots, nearest to points in the least squares."""

from __future__ import annotations

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from palpate.core.arrays import Floats
from palpate.core.splines.basis import PeriodicBasis
from palpate.core.splines.curve_fit import CurveFit
from palpate.core.splines.curve_parameters import moved_parameters
from palpate.core.splines.curve_smoothing import choose_smoothing
from palpate.core.splines.knots import periodic_knots

LEAST_SMOOTHING = 1e-5
"""Always there: it keeps the system positive definite wherever points are missing."""
MOST_SMOOTHING = 1e9
"""More changes nothing: the curve has long become a point, and the system loses its digits."""
MOVES = 3
"""Times that parameters are moved to the nearest points of the curve, if nothing is smoothed."""


def fit_closed(points: Floats, parameters: Floats, count: int, smoothing: float | None) -> CurveFit:
    """Closed cubic of `count` control points, at least 4.

    Parameters
    ----------
    points : (m, d) array
        Around the curve.
    parameters : (m,) array
        Increasing, in turns.
    count : int
        Control points.
    smoothing : float or None
        Weight of the bending against the mean weight of the points; None chooses it by
        cross-validation. It is never below `LEAST_SMOOTHING` nor above `MOST_SMOOTHING`.
    """
    periodic = PeriodicBasis(count)
    bending = _bending(count)
    if smoothing is None:
        strength = choose_smoothing(_dense(periodic, parameters)[0], bending, points)
    else:
        strength = smoothing
    strength = min(max(strength, LEAST_SMOOTHING), MOST_SMOOTHING)
    # Of noisy points the nearest places on the curve say nothing of where they belong.
    moves = MOVES if smoothing is not None and smoothing <= LEAST_SMOOTHING else 0
    for move in range(moves + 1):
        basis, slopes = _dense(periodic, parameters)
        weight = basis.T @ basis
        mean = np.trace(weight) / count
        factor = cho_factor(weight / mean + strength * bending)
        control = cho_solve(factor, basis.T @ points / mean)
        if move < moves:
            places, along = basis @ control, slopes @ control
            parameters = moved_parameters(parameters, points, places, along)
    seen = np.linalg.eigvalsh(weight / mean + strength * bending)
    return CurveFit(
        control=control,
        knots=periodic_knots(count),
        parameters=np.mod(parameters, 1.0),
        condition=float(np.sqrt(seen[-1] / seen[0])),
        effective=float(np.trace(cho_solve(factor, weight / mean))),
        smoothing=strength,
    )


def _dense(periodic: PeriodicBasis, parameters: Floats) -> Floats:
    """Basis functions and their derivatives, (2, m, n): so few that sparse ones are slower."""
    local = periodic.nonzero(parameters, 1)
    dense = np.zeros((2, len(parameters), periodic.count))
    rows = np.arange(len(parameters))[:, None]
    dense[:, rows, local.columns() % periodic.count] = local.values
    return dense


def _bending(count: int) -> Floats:
    """Sum of the squared second differences around the circle, over its mean diagonal."""
    second = np.roll(np.eye(count), 1, axis=1) - 2.0 * np.eye(count)
    second += np.roll(np.eye(count), -1, axis=1)
    form: Floats = second.T @ second / 6.0
    return form
