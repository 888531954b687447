"""Contact points as equations for the squared distance from an axis curve, and their banded system.

The residual of a point is its distance along its own normal: to first order the misfit of the
squared distance times the radial component of the normal over twice the distance from the axis.
Coefficients are numbered around first: each row of the equations spans four rings.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np
import scipy

from palpate.core.arrays import Floats, Ints
from palpate.core.rebuild.contours import ContactPoints
from palpate.core.splines import CUBIC, Basis, PeriodicBasis, bending_around


class SideEquations(NamedTuple):
    """Equations of the points on the side."""

    # From coefficients to distances along the normals, (n, along * around) [1/m].
    matrix: scipy.sparse.csr_array
    target: Floats  # (n,) [m]
    normals: Floats  # (n, 3)
    touch: Ints  # (n,)
    heights: Floats  # (n,) [m]
    places: Floats  # (n, 2): along the heights, from 0 to 1, and around in turns
    middle: float  # median distance from the axis [m]
    normal: Floats  # lower band of the normal equations, (band + 1, along * around)


def looks_inward(
    contacts: ContactPoints,
    axis_curve: AxisCurve,
    max_radial: float = -0.2,
    max_fraction: float = 0.03,
) -> bool:
    """Whether too many normals point to the axis: sections are not star-shaped about it.

    More than a fraction of the normals then have a radial component below `max_radial`. False
    without normals.
    """
    if contacts.normals is None or not len(contacts.points):
        return False
    _, _, facing = _about(contacts.points, contacts.normals, axis_curve)
    return bool(np.mean(facing < max_radial) > max_fraction)


def side_equations(
    contacts: ContactPoints,
    axis_curve: AxisCurve,
    low: float,
    high: float,
    along: Basis,
    around: PeriodicBasis,
    min_facing: float = 0.05,
    min_distance: float = 0.05,
) -> SideEquations:
    """Equations of the points between two heights [m].

    `contacts` have normals; splines along are over 0 to 1. Points whose normals have a radial
    component of `min_facing` or less are left out: level faces do not determine the distance.
    `min_distance` is the least distance from the axis in a point's weight, over the median: next to
    the axis the first order does not hold, and no point counts more. Raises ValueError if no point
    is left.
    """
    assert contacts.normals is not None
    away, distance, facing = _about(contacts.points, contacts.normals, axis_curve)
    height = contacts.points[:, 2]
    used = (height >= low) & (height <= high) & (facing > min_facing)
    if not used.any():
        raise ValueError(f"no contact point lies on the side between {low:g} and {high:g} m")
    away, distance, facing, height = away[used], distance[used], facing[used], height[used]
    turns = np.arctan2(away[:, 1], away[:, 0]) / (2.0 * np.pi)
    middle = float(np.median(distance))
    weights = facing / (2.0 * np.maximum(distance, min_distance * middle))
    local = np.clip((height - low) / (high - low), 0.0, 1.0)
    bases = along.matrix(local), around.matrix(turns)
    matrix = tensor_rows(*bases)
    matrix.data *= np.repeat(weights, np.diff(matrix.indptr))
    return SideEquations(
        matrix=matrix,
        target=weights * distance**2,
        normals=contacts.normals[used],
        touch=contacts.touch[used],
        heights=height,
        places=np.stack([local, turns], axis=-1),
        middle=middle,
        normal=normal_band(*bases, weights),
    )


def _about(points: Floats, normals: Floats, axis_curve: AxisCurve) -> tuple[Floats, Floats, Floats]:
    """Places (n, 2) about the axis, distances from it, and radial components of the normals."""
    away = points[:, :2] - axis_curve.at(points[:, 2])
    distance = np.linalg.norm(away, axis=1)
    least = np.finfo(float).eps * max(float(distance.max(initial=0.0)), np.finfo(float).tiny)
    facing = np.einsum("ni,ni->n", normals[:, :2], away) / np.maximum(distance, least)
    return away, distance, facing


def tensor_rows(
    first: scipy.sparse.csr_array, second: scipy.sparse.csr_array
) -> scipy.sparse.csr_array:
    """Row by row product of two sparse bases, (n, first columns * second columns)."""
    counts = np.diff(first.indptr)[0], np.diff(second.indptr)[0]
    n = first.shape[0]
    values = first.data.reshape(n, counts[0], 1) * second.data.reshape(n, 1, counts[1])
    outer, inner = first.indices.reshape(n, counts[0], 1), second.indices.reshape(n, 1, counts[1])
    columns = outer * second.shape[1] + inner
    pointers = np.arange(0, n * counts[0] * counts[1] + 1, counts[0] * counts[1])
    shape = (n, first.shape[1] * second.shape[1])
    return scipy.sparse.csr_array((values.ravel(), columns.ravel(), pointers), shape=shape)


def normal_band(
    first: scipy.sparse.csr_array, second: scipy.sparse.csr_array, weights: Floats
) -> Floats:
    """Lower band (width + 1, n) of the normal equations of the weighted product of two bases.

    Cell by cell: rows of a cell share their columns; products are of pairs along and around.
    """
    reach = CUBIC + 1
    along, around = (basis.indices.reshape(-1, reach) for basis in (first, second))
    rings, turns = first.shape[1], second.shape[1]
    cells = along[:, 0] * turns + around[:, 0]
    order = np.argsort(cells, kind="stable")
    begins = np.flatnonzero(np.diff(cells[order], prepend=-1))
    i, j = np.tril_indices(reach)
    values = (weights[:, None] * first.data.reshape(-1, reach))[order]
    pairs = values[:, i] * values[:, j]
    values = second.data.reshape(-1, reach)[order]
    products = pairs[:, :, None] * (values[:, i] * values[:, j])[:, None]
    sums = np.add.reduceat(products, begins, axis=0)  # (cells, pairs along, pairs around)
    number = np.zeros((reach, reach), np.intp)
    number[i, j] = number[j, i] = np.arange(len(i))
    along, around = along[order[begins]], around[order[begins]]
    left, right = (part.ravel() for part in np.indices((reach, reach)))
    row = along[:, i, None] * turns + around[:, None, left]
    column = along[:, j, None] * turns + around[:, None, right]
    lower = row >= column
    size = rings * turns
    places = ((row - column) * size + column)[lower]
    band = np.bincount(places, sums[:, :, number.ravel()][lower], reach * turns * size)
    return np.asarray(band.reshape(-1, size), np.float64)


@dataclass(frozen=True, eq=False)
class SideSystem:
    """Cholesky factor of the penalised normal equations."""

    factor: Floats  # its lower band, (band + 1, n)
    norm: float  # largest row sum of the system

    def solve(self, right: Floats) -> Floats:
        """Coefficients (n,) or (n, k) for a right-hand side."""
        return scipy.linalg.cho_solve_banded((self.factor, True), right, check_finite=False)

    def half(self, rows: Floats) -> Floats:
        """Rows (k, n) times the inverse factor, (k, n): products of these are covariances.

        By blocks of a ring, for all rows whose first entry that is not 0 lies before its end.
        """
        begins = (rows != 0.0).argmax(axis=1)
        order = np.argsort(begins, kind="stable")
        left, begins = rows[order], begins[order]
        factor, (reach, n) = np.asfortranarray(self.factor), self.factor.shape
        ring = reach // (CUBIC + 1)
        strides = factor.itemsize, (reach - 1) * factor.itemsize  # of the factor's rows and columns
        for at in range(0, n, ring):
            begun = int(np.searchsorted(begins, at + ring))
            own, beyond = slice(at, at + ring), slice(at + ring, at + min(reach, n - at))
            columns = np.lib.stride_tricks.as_strided(
                factor[:, at:], (beyond.stop - at, ring), strides
            )
            block = np.asfortranarray(columns[:ring])
            left[:begun, own] = scipy.linalg.blas.dtrsm(
                1.0, block, left[:begun, own], side=1, lower=1, trans_a=1
            )
            left[:begun, beyond] -= left[:begun, own] @ columns[ring:].T
        half = np.empty_like(left)
        half[order] = left
        return half

    def condition(self, max_steps: int = 30, tolerance: float = 1e-3) -> float:
        """Condition number to 2 digits, by inverse iteration; more depend on the machine.

        It ends after `max_steps`, or when the norm changes by less than a relative tolerance.
        """
        vector = np.cos(np.arange(self.factor.shape[1], dtype=float) ** 2)
        before, length = 0.0, 1.0
        for _ in range(max_steps):
            vector = self.solve(vector / np.linalg.norm(vector))
            before, length = length, float(np.linalg.norm(vector))
            if abs(length - before) < tolerance * length:
                break
        return float(f"{self.norm * length:.2g}")


def side_system(
    normal: Floats,
    turns: int,
    along: tuple[Floats, Floats],
    around: float,
    tension: scipy.sparse.csr_array | None = None,
    ridge: float = 1e-10,
) -> SideSystem:
    """Penalised normal equations (band + 1, along * around), with `turns` coefficients around.

    `along` is the strength of the bending along in each span, (spans,), with the root of that
    bending, (r, along); `around` is the strength of the bending around. `tension` is the root of
    one more penalty, (m, along * around). A penalty of strength 1 has the mean diagonal of the
    equations; `ridge` is the strength of one on the coefficients, which bounds the condition.
    """
    mean = float(normal[0].mean())
    strengths, root = along
    band = normal + mean * around * _bending_around(root.shape[1], turns)
    weighted = np.repeat(np.sqrt(strengths), len(root) // len(strengths))[:, None] * root
    form = mean * (weighted.T @ weighted) / (np.square(root).sum() / root.shape[1])
    for apart in range(CUBIC + 1):
        diagonal = np.repeat(np.diagonal(form, -apart), turns)
        band[apart * turns, : len(diagonal)] += diagonal
    if tension is not None:
        band += mean * banded(scipy.sparse.csr_array(tension.T @ tension), _width(turns))
    band[0] += mean * ridge
    norm = float(2.0 * np.abs(band).sum(axis=0).max())
    factor: Floats = scipy.linalg.cholesky_banded(
        band, overwrite_ab=True, lower=True, check_finite=False
    )
    return SideSystem(factor, norm)


@lru_cache(maxsize=4)
def _bending_around(along: int, around: int) -> Floats:
    root = bending_around(around)
    form = scipy.sparse.csr_array(root.T @ root / (np.square(root).sum() / around))
    band = banded(
        scipy.sparse.csr_array(scipy.sparse.kron(scipy.sparse.eye_array(along), form)),
        _width(around),
    )
    band.setflags(write=False)
    return band


def banded(matrix: scipy.sparse.csr_array, width: int) -> Floats:
    """Lower band (width + 1, n) of a symmetric sparse matrix."""
    entries = matrix.tocoo()
    row, column = entries.row, entries.col
    lower = row >= column
    band = np.zeros((width + 1, matrix.shape[0]))
    band[(row - column)[lower], column[lower]] = entries.data[lower]
    return band


def _width(around: int) -> int:
    return (CUBIC + 1) * around - 1


@dataclass(frozen=True, slots=True, eq=False)
class AxisCurve:
    """x and y of the axis as a piecewise polynomial of the height; beyond it is upright."""

    breaks: Floats  # heights (m + 1,) between which the pieces lie, rising [m]
    coefficients: Floats  # (degree + 1, m, 2), highest power first, of the height over its break

    def at(self, heights: Floats, derivative: int = 0) -> Floats:
        """Places (n, 2) of the axis at heights (n,) [m], or a derivative of them by the height."""
        low, high = self.breaks[[0, -1]]
        piece = np.searchsorted(self.breaks[1:-1], heights, side="right")
        above = (np.clip(heights, low, high) - self.breaks[piece])[:, None]
        places = np.zeros((len(heights), 2))
        powers = range(len(self.coefficients) - 1, derivative - 1, -1)
        for power, coefficient in zip(powers, self.coefficients, strict=False):
            places = places * above + math.perm(power, derivative) * coefficient[piece]
        if derivative:
            places[(heights < low) | (heights > high)] = 0.0
        return places


def fit_axis_curve(
    heights: Floats, middles: Floats, max_degree: int = 3, max_misfit: float = 0.01
) -> AxisCurve:
    """Axis through middles (n, 2) of contours at heights (n,) [m], a polynomial.

    Where it misses a middle by more than `max_misfit`, a fraction of the height, the axis is a
    natural cubic spline: that of a bent object, as a banana's stem.
    """
    low, high = float(heights.min()), float(heights.max())
    levels, first = np.unique(heights, return_index=True)
    degree = min(max_degree, len(levels) - 1)
    extent = high - low if degree else 1.0
    powers = np.vander((heights - low) / extent, degree + 1)
    solution = np.linalg.lstsq(powers, middles, rcond=None)[0]
    scales = extent ** np.arange(degree, -1, -1.0)
    axis_curve = AxisCurve(np.array([low, high]), (solution / scales[:, None])[:, None])
    misfit = float(np.linalg.norm(axis_curve.at(heights) - middles, axis=1).max())
    if misfit <= max_misfit * (high - low) or len(levels) <= max_degree + 1:
        return axis_curve
    from scipy.interpolate import CubicSpline  # rare, and slow to import

    bent = CubicSpline(levels, middles[first], bc_type="natural")
    return AxisCurve(levels, np.asarray(bent.c))
