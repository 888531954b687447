"""What smoothing presses down: how much a surface through contours bends, along and around.

Each penalty is given by a root, a matrix whose product with the coefficients has the penalty as
its sum of squares.
"""

from __future__ import annotations

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.splines.basis import Basis

NODES, WEIGHTS = np.polynomial.legendre.leggauss(2)
"""Exact for the square of a cubic's second derivative."""


def bending_along(basis: Basis, order: int = 2) -> Floats:
    """Root (r, count) of the integral of a spline's squared derivative of an order, 1 or 2."""
    breaks = np.unique(basis.knots)
    half = 0.5 * np.diff(breaks)
    places = ((breaks[:-1] + half)[:, None] + half[:, None] * NODES).ravel()
    weights = (half[:, None] * WEIGHTS).ravel()
    root: Floats = np.sqrt(weights)[:, None] * basis.matrix(places, order).toarray()
    return root


def bending_around(count: int) -> Floats:
    """Root (count, count) of the bending of a closed curve, beyond that of an ellipse.

    Second differences of what remains of the control points when points and ellipses are taken
    out: constants and the first harmonic cost nothing, so that a smoothed circle keeps its size
    however strongly it is smoothed.
    """
    unit = np.eye(count)
    before, after = np.roll(unit, 1, axis=1), np.roll(unit, -1, axis=1)
    beyond = before - 2.0 * np.cos(2.0 * np.pi / count) * unit + after
    root: Floats = (before - 2.0 * unit + after) @ beyond
    return root
