"""The normal equations of the side, as a band: its splines reach few of their neighbours.

Coefficients are numbered around first, so that each row of the matrix ends within four rings.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.linalg import cho_solve_banded, cholesky_banded
from scipy.linalg.lapack import dtbtrs
from scipy.sparse import csr_array, eye_array, kron

from palpate.core.arrays import Floats
from palpate.core.rebuild.skin.bending import bending_around
from palpate.core.splines.knots import CUBIC

RIDGE = 1e-10
"""Bounds the condition of the system, over its mean diagonal."""
STEPS = 30
"""Of the iterations that estimate a condition number."""


@dataclass(frozen=True, slots=True, eq=False)
class SideSystem:
    """A factored system."""

    factor: Floats
    """Lower band of the Cholesky factor, (band + 1, n)."""
    norm: float
    """Largest row sum of the system."""

    def solve(self, right: Floats) -> Floats:
        """Coefficients (n,) or (n, k) for a right-hand side."""
        found: Floats = cho_solve_banded((self.factor, True), right, check_finite=False)
        return found

    def spread(self, rows: Floats) -> Floats:
        """Standard deviations (k,) of rows (k, n) of the basis, over the noise."""
        half, _ = dtbtrs(self.factor, np.asfortranarray(rows.T), uplo="L")
        spread: Floats = np.linalg.norm(half, axis=0)
        return spread

    @property
    def log_determinant(self) -> float:
        """Natural logarithm of the system's determinant."""
        return float(2.0 * np.log(self.factor[0]).sum())

    @property
    def condition(self) -> float:
        """Estimate of the condition number, to 2 digits.

        By inverse iteration from a fixed start; more digits would depend on the machine.
        """
        vector = np.cos(np.arange(self.factor.shape[1], dtype=float) ** 2)
        length = 1.0
        for _ in range(STEPS):
            vector = self.solve(vector / np.linalg.norm(vector))
            length = float(np.linalg.norm(vector))
        return float(f"{self.norm * length:.2g}")


def side_system(
    rows: csr_array, turns: int, along: tuple[Floats, Floats], around: float
) -> SideSystem:
    """Least squares of rows, penalised.

    Parameters
    ----------
    rows : (n, along * around) sparse array
        Equations.
    turns : int
        Coefficients around.
    along : pair of arrays
        Strength of the bending along, from knot to knot, (spans,); and the root of the bending,
        (r, along).
    around : float
        Strength of the bending around. Of strength 1, a penalty has the mean diagonal of the
        equations.
    """
    normal = csr_array(rows.T @ rows)
    band = banded(normal, _width(turns))
    mean = float(band[0].mean())
    band += mean * around * _bending_around(along[1].shape[1], turns)
    band += mean * _bending_along(*along, turns)
    band[0] += mean * RIDGE
    sums = np.abs(band).sum(axis=0)
    norm = float(2.0 * sums.max())
    factor: Floats = cholesky_banded(band, overwrite_ab=True, lower=True, check_finite=False)
    return SideSystem(factor, norm)


def banded(matrix: csr_array, width: int) -> Floats:
    """Lower band (width + 1, n) of a symmetric sparse matrix."""
    entries = matrix.tocoo()
    row, column = entries.row, entries.col
    lower = row >= column
    band = np.zeros((width + 1, matrix.shape[0]))
    band[(row - column)[lower], column[lower]] = entries.data[lower]
    return band


def _width(around: int) -> int:
    return (CUBIC + 1) * around - 1


def _bending_along(strengths: Floats, root: Floats, around: int) -> Floats:
    weighted = np.repeat(np.sqrt(strengths), len(root) // len(strengths))[:, None] * root
    form = csr_array(weighted.T @ weighted / (np.square(root).sum() / root.shape[1]))
    return banded(csr_array(kron(form, eye_array(around))), _width(around))


@lru_cache(maxsize=4)
def _bending_around(along: int, around: int) -> Floats:
    root = bending_around(around)
    form = csr_array(root.T @ root / (np.square(root).sum() / around))
    band = banded(csr_array(kron(eye_array(along), form)), _width(around))
    band.setflags(write=False)
    return band
