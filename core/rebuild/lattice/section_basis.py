"""Functions of a section: products of those across it, each way."""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_array

from palpate.core.arrays import Floats
from palpate.core.splines.basis import Basis


def section_matrix(basis: Basis, places: Floats, orders: tuple[int, int] = (0, 0)) -> csr_array:
    """Functions of a section at places (n, 2), or a derivative of them: sparse (n, side^2)."""
    width = basis.degree + 1
    one, other = (basis.nonzero(places[:, axis], orders[axis]) for axis in (0, 1))
    columns = one.columns()[:, :, None] * basis.count + other.columns()[:, None, :]
    values = one.values[orders[0]][:, :, None] * other.values[orders[1]][:, None, :]
    starts = np.arange(0, columns.size + 1, width**2)
    shape = (len(places), basis.count**2)
    return csr_array((values.ravel(), columns.ravel(), starts), shape=shape)
