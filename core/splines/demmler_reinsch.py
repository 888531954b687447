"""Smoothing made diagonal: the basis of Demmler and Reinsch.

In it the points' weight is the identity and the bending is diagonal, so that coefficients,
residuals and degrees of freedom for any strength of smoothing are sums.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.linalg import eigh

from palpate.core.arrays import Floats

UNSEEN = 1e-12
"""Share of its weight by which a mode must be seen in the points to be estimated from them."""
RIDGE = 1e-13
"""Added to the system, so that its factor exists wherever nothing is seen and nothing bends."""


class Modes(NamedTuple):
    """Combinations of basis functions that do not mix, however strongly one smooths."""

    shapes: Floats
    """Their values at the points (m, r), orthonormal columns."""
    control: Floats
    """Their coefficients (n, r): ``shapes`` is the basis times them."""
    stiffness: Floats
    """(r,), not negative: smoothing by a strength keeps ``1 / (1 + strength stiffness)``."""

    def kept(self, strengths: Floats) -> Floats:
        """Share of each mode that smoothing by strengths (s,) keeps, (s, r)."""
        kept: Floats = 1.0 / (1.0 + strengths[:, None] * self.stiffness)
        return kept

    def lost(self, strengths: Floats) -> Floats:
        """What is not kept, (s, r), to full precision however little it is."""
        stiff = strengths[:, None] * self.stiffness
        lost: Floats = stiff / (1.0 + stiff)
        return lost


def demmler_reinsch(weight: Floats, bending: Floats, basis: Floats) -> Modes:
    """Modes of points and a penalty.

    Parameters
    ----------
    weight : (n, n) array
        ``basis.T @ basis``, over its mean diagonal.
    bending : (n, n) array
        Quadratic form of the penalty, in the same measure.
    basis : (m, n) array
        Basis functions at the points, times the roots of the points' weights.

    Notes
    -----
    Demmler and Reinsch, *Oscillation matrices with spline smoothing*, 1975. The modes v solve
    ``G v = mu (G + B) v``, G the weight and B the bending: unlike ``B v = w G v`` this is well
    conditioned however the points lie, and what no point sees drops out.
    """
    count = len(weight)
    seen, control = eigh(weight, weight + bending + RIDGE * np.eye(count))
    seen = np.clip(seen, 0.0, 1.0)
    control, seen = control[:, seen > UNSEEN], seen[seen > UNSEEN]
    shapes = basis @ control
    length = np.linalg.norm(shapes, axis=0)
    return Modes(shapes / length, control / length, (1.0 - seen) / seen)
