"""How much to smooth a closed curve: generalised cross-validation, with no system to solve."""

from __future__ import annotations

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.splines.demmler_reinsch import demmler_reinsch

STRENGTHS: Floats = np.logspace(-8.0, 3.0, 67)
"""Smoothings that are tried, against the mean weight of the points."""
STRENGTHS.setflags(write=False)


def choose_smoothing(basis: Floats, bending: Floats, points: Floats) -> float:
    """The smoothing with the least generalised cross-validation score.

    Parameters
    ----------
    basis : (m, n) array
        Basis functions at the points' parameters.
    bending : (n, n) array
        Quadratic form of the penalty.
    points : (m, d) array
        What is fitted.

    Notes
    -----
    Craven and Wahba, *Smoothing noisy data with spline functions*, 1979.
    """
    count = len(points)
    weight = basis.T @ basis
    weight /= np.trace(weight) / len(weight)
    modes = demmler_reinsch(weight, bending, basis)
    parts = modes.shapes.T @ points
    beyond = float(((points - modes.shapes @ parts) ** 2).sum())
    squares = beyond + modes.lost(STRENGTHS) ** 2 @ (parts**2).sum(axis=1)
    kept = modes.kept(STRENGTHS)
    spare = np.maximum(1.0 - kept.sum(axis=1) / count, 1.0 / count)
    return float(STRENGTHS[np.argmin(squares / spare**2)])
