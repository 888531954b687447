"""A Cholesky factor that grows by blocks, as observations come in."""

from __future__ import annotations

import numpy as np
from scipy.linalg import cholesky, solve_triangular

from palpate.core.arrays import Floats

FIRST = 256
"""Rows for which there is room at first."""
BLOCK = 128


class Factor:
    """Lower factor L of a positive definite matrix L L'."""

    def __init__(self) -> None:
        self.size = 0
        """Rows."""
        self._room = np.zeros((FIRST, FIRST))

    @property
    def lower(self) -> Floats:
        """L, (size, size)."""
        return self._room[: self.size, : self.size]

    def append(self, across: Floats, own: Floats) -> None:
        """Add rows: their covariance with those before, (m, size), and their own, (m, m)."""
        before, after = self.size, self.size + len(own)
        if after > len(self._room):
            wider = np.zeros((3 * after // 2, 3 * after // 2))
            wider[:before, :before] = self.lower
            self._room = wider
        left = self.half(across.T).T
        self._room[before:after, :before] = left
        self._room[before:after, before:after] = cholesky(own - left @ left.T, lower=True)
        self.size = after

    def half(self, right: Floats) -> Floats:
        """Solve L x = right."""
        found = np.array(right, float)
        for some in self._blocks():
            rest = found[some] - self._room[some, : some.start] @ found[: some.start]
            found[some] = solve_triangular(self._room[some, some], rest, lower=True)
        return found

    def solve(self, right: Floats) -> Floats:
        """Solve L L' x = right."""
        found = self.half(right)
        for some in reversed(self._blocks()):
            below = slice(some.stop, self.size)
            rest = found[some] - self._room[below, some].T @ found[below]
            found[some] = solve_triangular(self._room[some, some], rest, lower=True, trans=1)
        return found

    def _blocks(self) -> list[slice]:
        """Of rows: scipy would copy the whole factor for each solution, of a block it may."""
        starts = range(0, self.size, BLOCK)
        return [slice(start, min(start + BLOCK, self.size)) for start in starts]
