"""Cholesky factors of equations over the cells of a band, by nested dissection.

Cells are halved across their longest extent until a part is small; control values of one half alone
are eliminated there, and the rest of both halves is summed at their border (George, *Nested
dissection of a regular finite element mesh*, 1973; fronts as Duff and Reid, 1983). All work is in
dense blocks. The largest border in a shell of n cells has about sqrt(n) cells, where every row of a
banded matrix has as many: an object of 200 cm^2 takes a tenth of the time. It is our own code, as
scipy factors a sparse symmetric matrix only as a general one.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from typing import NamedTuple, Protocol

import numpy as np
import scipy
from numpy.typing import NDArray

from palpate.core.arrays import Floats, Ints

Longs = NDArray[np.int64]

MAX_LEAF = 192  # Most cells of a part that is not halved; it affects the time only
RIDGE = 1e-9  # Added to the diagonal, over its largest: for undetermined control values


class Front(NamedTuple):
    """One part of the cells, whose own control values are eliminated together."""

    cells: Longs  # Numbers of its cells if it is not halved, else empty
    parts: tuple[int, ...]  # Numbers of the fronts of its two halves, which come before it
    own: Longs  # Control values that are eliminated here, (k,)
    border: Longs  # Control values that are eliminated in later fronts, in that order, (b,)


class Dissection(NamedTuple):
    """The order in which control values are eliminated, for all equations over a band."""

    fronts: tuple[Front, ...]  # In the order of elimination: halves before their whole
    local: Ints  # Control values over each cell, (m, 64)
    size: int  # Number of control values


def dissect(cells: Ints, local: Ints, count: int) -> Dissection:
    """The order for cells (m, 3) with the control values `local` (m, 64), of `count` in all."""
    order, spans = _halved(cells)
    position = np.empty(len(cells), np.int64)
    position[order] = np.arange(len(cells))
    at = np.repeat(position, local.shape[1])
    first, last = np.full(count, len(cells)), np.full(count, -1)
    np.minimum.at(first, local.ravel(), at)
    np.maximum.at(last, local.ravel(), at)
    fronts: list[Front] = []
    for low, high, parts in spans:
        if parts:
            values = np.unique(np.concatenate([fronts[part].border for part in parts]))
        else:
            values = np.unique(local[order[low:high]]).astype(np.int64)
        inner = (first[values] >= low) & (last[values] < high)
        own = np.zeros(0, np.int64) if parts else order[low:high]
        mine = values[inner]
        mine = mine[np.lexsort((last[mine], first[mine]))]
        fronts.append(Front(own, parts, mine, values[~inner]))
    turn = np.empty(count, np.int64)
    turn[np.concatenate([front.own for front in fronts])] = np.arange(count)
    ordered = (front._replace(border=_sorted_by(turn, front.border)) for front in fronts)
    return Dissection(tuple(ordered), local, count)


def _sorted_by(turn: Longs, values: Longs) -> Longs:
    return np.asarray(values[np.argsort(turn[values])])


def _halved(cells: Ints) -> tuple[Longs, list[tuple[int, int, tuple[int, ...]]]]:
    """Order of the cells, in which each part is a range, and (begin, end, halves) of each part."""
    order = np.arange(len(cells), dtype=np.int64)
    spans: list[tuple[int, int, tuple[int, ...]]] = []

    def halve(low: int, high: int) -> int:
        parts: tuple[int, ...] = ()
        if high - low > MAX_LEAF:
            own = cells[order[low:high]]
            axis = int(np.ptp(own, axis=0).argmax())
            order[low:high] = order[low:high][np.argsort(own[:, axis], kind="stable")]
            middle = (low + high) // 2
            parts = halve(low, middle), halve(middle, high)
        spans.append((low, high, parts))
        return len(spans) - 1

    halve(0, len(cells))
    return order, spans


class Factor(NamedTuple):
    """A Cholesky factor, front by front."""

    dissection: Dissection
    corners: tuple[Floats, ...]  # Lower triangles over the own control values, (k, k)
    sides: tuple[Floats, ...]  # Below them, over the border, (b, k)

    def solve(self, right: Floats) -> Floats:
        """The solution of the equations with right-hand sides, (n,) or (n, k)."""
        solution = right.copy()
        for front, corner, side in self._eliminating():
            own = scipy.linalg.lapack.dtrtrs(corner, solution[front.own], lower=1)[0]
            solution[front.own] = own
            solution[front.border] -= side @ own
        return self._substituted(solution)

    def draws(self, normal: Floats) -> Floats:
        """Draws (n, k) with the inverse of the equations as covariance, from normal ones (n, k)."""
        return self._substituted(normal.copy())

    def _eliminating(self) -> list[tuple[Front, Floats, Floats]]:
        fronts = zip(self.dissection.fronts, self.corners, self.sides, strict=True)
        return [(front, corner, side) for front, corner, side in fronts if len(front.own)]

    def _substituted(self, solution: Floats) -> Floats:
        for front, corner, side in reversed(self._eliminating()):
            own = solution[front.own] - side.T @ solution[front.border]
            solution[front.own] = scipy.linalg.lapack.dtrtrs(corner, own, lower=1, trans=1)[0]
        return solution

    def halves(self, right: scipy.sparse.csr_matrix) -> Iterator[tuple[Longs, Floats]]:
        """The product F of the inverse of the lower factor and a sparse right-hand side (n, k).

        Front by front: the columns (c,) that are not 0 there, and the rows (own, c) of F. The
        product F^T F is that of the right-hand side and the solution.
        """
        passed: dict[int, tuple[Longs, Longs, Floats]] = {}  # Columns, control values, rows
        place = np.empty(self.dissection.size, np.int64)
        for number, (front, corner, side) in enumerate(
            zip(self.dissection.fronts, self.corners, self.sides, strict=True)
        ):
            count, size = len(front.own), len(front.own) + len(front.border)
            place[front.own], place[front.border] = np.arange(count), np.arange(count, size)
            begun = right[front.own].tocoo()
            below = [passed.pop(part) for part in front.parts if part in passed]
            columns = np.unique(np.concatenate([begun.col, *(one[0] for one in below)]))
            if not len(columns):
                continue
            solved, rest = (
                np.zeros((rows, len(columns)), order="F") for rows in (count, size - count)
            )
            solved[begun.row, np.searchsorted(columns, begun.col)] = begun.data
            while below:
                their_columns, values, part = below.pop(0)
                at, across = place[values], np.searchsorted(columns, their_columns)
                own = at < count
                solved[np.ix_(at[own], across)] += part[own]
                rest[np.ix_(at[~own] - count, across)] += part[~own]
            if count:
                solved = scipy.linalg.blas.dtrsm(1.0, corner, solved, lower=1, overwrite_b=1)
                yield columns.astype(np.int64), solved
            if side.size:
                rest = scipy.linalg.blas.dgemm(-1.0, side, solved, 1.0, rest, overwrite_c=1)
            if len(front.border):
                passed[number] = columns.astype(np.int64), front.border, rest


class Blocks(Protocol):
    """Positive semidefinite blocks (64, 64), one a cell."""

    def of(self, cells: Longs) -> Floats:
        """The blocks of some cells, (c, 64, 64)."""

    @property
    def largest(self) -> float:
        """The largest diagonal element of all blocks."""


def factorise(dissection: Dissection, blocks: Blocks) -> Factor:
    """The factor of the sum of the blocks of all cells."""
    corners, sides = [], []
    left: dict[int, Floats] = {}  # Lower triangles over borders, not yet summed
    ridge = RIDGE * blocks.largest
    place = np.empty(dissection.size, np.int64)
    for number, front in enumerate(dissection.fronts):
        count, size = len(front.own), len(front.own) + len(front.border)
        place[front.own], place[front.border] = np.arange(count), np.arange(count, size)
        if front.parts:
            below = [(left.pop(part), dissection.fronts[part].border) for part in front.parts]
            corner, side, rest = _half_sum([(part, place[at]) for part, at in below], count, size)
        else:
            local = place[dissection.local[front.cells]]
            corner, side, rest = _cell_sum(local, blocks.of(front.cells), count, size)
        corner[np.arange(count), np.arange(count)] += ridge
        if count:
            corner, _ = scipy.linalg.lapack.dpotrf(corner, lower=1, overwrite_a=1)
        if side.size:
            side = scipy.linalg.blas.dtrsm(
                1.0, corner, side, side=1, lower=1, trans_a=1, overwrite_b=1
            )
            rest = scipy.linalg.blas.dsyrk(-1.0, side, 1.0, rest, lower=1, overwrite_c=1)
        left[number] = rest
        corners.append(corner)
        sides.append(side)
    return Factor(dissection, tuple(corners), tuple(sides))


class _Matrix(NamedTuple):
    """Lower triangle of a front's equations, stored by columns."""

    corner: Floats  # Over its own control values, (k, k)
    side: Floats  # Below, over its border, (b, k)
    rest: Floats  # Over its border, (b, b)


def _cell_sum(local: Longs, blocks: Floats, count: int, size: int) -> _Matrix:
    """The sum of blocks (m, 64, 64) at places (m, 64) of a front of `size`, `count` its own."""
    flat = local[:, :, None] + size * local[:, None, :]
    sums = np.bincount(flat.ravel(), blocks.ravel(), size * size)
    matrix = sums.reshape((size, size), order="F")
    parts = matrix[:count, :count], matrix[count:, :count], matrix[count:, count:]
    return _Matrix(*(np.asarray(part, np.float64, order="F") for part in parts))


def _half_sum(below: list[tuple[Floats, Longs]], count: int, size: int) -> _Matrix:
    """The sum of the lower triangles (b, b) that two halves leave, at ascending places (b,)."""
    shapes = (count, count), (size - count, count), (size - count, size - count)
    joined = _Matrix(*(np.zeros(shape, order="F") for shape in shapes))
    for part, at in below:
        starts = (np.diff(at, prepend=-2) != 1) | (at == count)
        ends = [*np.flatnonzero(starts).tolist(), len(at)]
        stretches = [(slice(i, j), int(at[i]), int(at[i]) + j - i) for i, j in pairwise(ends)]
        for number, (columns, low, high) in enumerate(stretches):
            for rows, first, last in stretches[number:]:
                if first < count:
                    into = joined.corner[first:last, low:high]
                elif low < count:
                    into = joined.side[first - count : last - count, low:high]
                else:
                    into = joined.rest[first - count : last - count, low - count : high - count]
                into += part[rows, columns]
    return joined
