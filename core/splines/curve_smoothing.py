"""How much to smooth: generalised cross-validation, with no further system to solve.

In the basis of Demmler and Reinsch both the points' weight and the bending are diagonal, so
that residuals and degrees of freedom for any smoothing are sums.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import eigh

from palpate.core.arrays import Floats

STRENGTHS: Floats = np.logspace(-8.0, 3.0, 67)
"""Smoothings that are tried, against the mean weight of the points."""
STRENGTHS.setflags(write=False)
UNSEEN = 1e-12
"""Share of its weight by which a mode must be seen in the points to be estimated from them."""


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
    Craven and Wahba, *Smoothing noisy data with spline functions*, 1979. The modes v solve
    ``G v = mu (G + B) v``, G the points' weight and B the bending, each over its mean
    diagonal: unlike ``B v = w G v`` this is well conditioned however the points lie.
    """
    count = len(points)
    weight = basis.T @ basis
    weight /= np.trace(weight) / len(weight)
    seen, modes = eigh(weight, weight + bending)
    seen = np.clip(seen, 0.0, 1.0)
    modes, seen = modes[:, seen > UNSEEN], seen[seen > UNSEEN]
    shapes = basis @ modes
    shapes /= np.linalg.norm(shapes, axis=0)
    parts = shapes.T @ points
    beyond = float(((points - shapes @ parts) ** 2).sum())
    kept = seen / (seen + STRENGTHS[:, None] * (1.0 - seen))
    squares = beyond + (1.0 - kept) ** 2 @ (parts**2).sum(axis=1)
    spare = np.maximum(1.0 - kept.sum(axis=1) / count, 1.0 / count)
    return float(STRENGTHS[np.argmin(squares / spare**2)])
