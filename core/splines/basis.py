"""B-spline bases: clamped on an interval, periodic on the circle."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import BSpline
from scipy.sparse import csr_array

from palpate.core.arrays import Floats

CUBIC = 3


def clamped_knots(count: int, degree: int = CUBIC) -> Floats:
    """Uniform clamped knots on [0, 1] for `count` coefficients.

    Raises
    ------
    ValueError
        If there are not more coefficients than the degree.
    """
    if count <= degree:
        raise ValueError(f"count must be larger than the degree {degree}, got {count}")
    inner = np.linspace(0.0, 1.0, count - degree + 1)
    return np.concatenate([np.zeros(degree), inner, np.ones(degree)])


def greville(count: int, degree: int = CUBIC) -> Floats:
    """Greville abscissae (count,): the knot averages.

    Coefficients equal to them reproduce the identity.
    """
    knots = clamped_knots(count, degree)
    return np.array([knots[i + 1 : i + degree + 1].mean() for i in range(count)])


def clamped_matrix(x: Floats, count: int, degree: int = CUBIC) -> csr_array:
    """Clamped basis at `x` (n,), clipped to [0, 1]: sparse (n, count)."""
    return csr_array(
        BSpline.design_matrix(np.clip(x, 0.0, 1.0), clamped_knots(count, degree), degree)
    )


def clamped_slopes(x: Floats, count: int, degree: int = CUBIC) -> Floats:
    """First derivatives of the clamped basis at `x` (n,): dense (n, count)."""
    basis = BSpline(clamped_knots(count, degree), np.eye(count), degree)
    slopes: Floats = basis.derivative()(np.clip(x, 0.0, 1.0))
    return slopes


def periodic_matrix(turn: Floats, count: int) -> csr_array:
    """Periodic cubic basis at `turn` (n,), in turns: sparse (n, count), 4 entries in each row.

    Raises
    ------
    ValueError
        If there are fewer than 4 coefficients.
    """
    if count <= CUBIC:
        raise ValueError(f"count must be larger than the degree {CUBIC}, got {count}")
    knots = (np.arange(count + 2 * CUBIC + 1) - CUBIC) / count
    open_basis = csr_array(BSpline.design_matrix(np.mod(turn, 1.0), knots, CUBIC))
    # The columns that hang over the seam are those at the beginning.
    wrapped = open_basis.data, open_basis.indices % count, open_basis.indptr
    return csr_array(wrapped, shape=(len(turn), count))
