"""Contact points as equations for the squared distance from an axis curve, and their banded system.

Each point counts by its distance along its own normal: to first order that is the misfit of the
squared distance, times the radial part of the normal, over twice the distance from the axis.
Coefficients are numbered around first: each row of the equations ends within four rings.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import NamedTuple

import numpy as np
import scipy

from palpate.core.arrays import Floats, Ints
from palpate.core.rebuild.contours import ContactPoints
from palpate.core.splines import CUBIC, Basis, PeriodicBasis, bending_around

LEAST_DISTANCE = 0.05  # Least distance from the axis in a point's weight, as a share of the median
LEAST_FACING = 0.05  # Least radial part of a normal: level faces tell nothing of the distance
# Radial part of a normal below which a point looks towards the axis, and the share of such points
# above which sections are not star-shaped about it.
INWARD, MOST_INWARD = -0.2, 0.03
RIDGE = 1e-10  # Bounds the condition of the system, over its mean diagonal
STEPS, STILL = 30, 1e-3  # Of the iterations that estimate a condition number, and their last
MOST_DEGREE = 3
MISSES = 0.01  # Of the height: where middles lie farther off a polynomial, the axis is a spline


class SideEquations(NamedTuple):
    """The points that tell of the side."""

    matrix: (
        scipy.sparse.csr_array
    )  # (n, along * around): coefficients to distances along the normals, over m
    target: Floats  # (n,), m
    normals: Floats  # (n, 3)
    touch: Ints  # (n,)
    heights: Floats  # (n,), m
    places: Floats  # (n, 2): along the heights, from 0 to 1, and around in turns
    middle: float  # Median distance from the axis, m
    normal: Floats  # Lower band of the normal equations, (band + 1, along * around)


def looks_inward(contacts: ContactPoints, axis_curve: AxisCurve) -> bool:
    """Whether too many points look towards the axis for one distance a turn; needs normals."""
    if contacts.normals is None or not len(contacts.points):
        return False
    _, _, facing = _about(contacts.points, contacts.normals, axis_curve)
    return bool(np.mean(facing < INWARD) > MOST_INWARD)


def side_equations(
    contacts: ContactPoints,
    axis_curve: AxisCurve,
    low: float,
    high: float,
    along: Basis,
    around: PeriodicBasis,
) -> SideEquations:
    """Equations of the points between two heights, m; those on level faces are left out.

    `contacts` have normals; splines along run over 0 to 1. Raises ValueError if no point is left.
    """
    assert contacts.normals is not None
    away, distance, facing = _about(contacts.points, contacts.normals, axis_curve)
    height = contacts.points[:, 2]
    within = (height >= low) & (height <= high) & (facing > LEAST_FACING)
    if not within.any():
        raise ValueError(f"no contact point lies on the side between {low:g} and {high:g} m")
    away, distance, facing = away[within], distance[within], facing[within]
    turns = np.arctan2(away[:, 1], away[:, 0]) / (2.0 * np.pi)
    middle = float(np.median(distance))
    # Next to the axis the first order is worth nothing: no point counts more than those there.
    weights = facing / (2.0 * np.maximum(distance, LEAST_DISTANCE * middle))
    height = height[within]
    local = np.clip((height - low) / (high - low), 0.0, 1.0)
    bases = along.matrix(local), around.matrix(turns)
    matrix = tensor_rows(*bases)
    matrix.data *= np.repeat(weights, np.diff(matrix.indptr))
    return SideEquations(
        matrix,
        weights * distance**2,
        contacts.normals[within],
        contacts.touch[within],
        height,
        np.stack([local, turns], axis=-1),
        middle,
        normal_band(*bases, weights),
    )


def _about(points: Floats, normals: Floats, axis_curve: AxisCurve) -> tuple[Floats, Floats, Floats]:
    """Places (n, 2) about the axis, distances from it, and the radial parts of the normals."""
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
    along, around = (one.indices.reshape(-1, reach) for one in (first, second))
    rings, turns = first.shape[1], second.shape[1]
    cells = along[:, 0] * turns + around[:, 0]
    order = np.argsort(cells, kind="stable")
    begins = np.flatnonzero(np.diff(cells[order], prepend=-1))
    one, other = np.tril_indices(reach)
    values = (weights[:, None] * first.data.reshape(-1, reach))[order]
    pairs = values[:, one] * values[:, other]
    values = second.data.reshape(-1, reach)[order]
    products = pairs[:, :, None] * (values[:, one] * values[:, other])[:, None]
    sums = np.add.reduceat(products, begins, axis=0)  # (cells, pairs along, pairs around)
    number = np.zeros((reach, reach), np.intp)
    number[one, other] = number[other, one] = np.arange(len(one))
    along, around = along[order[begins]], around[order[begins]]
    left, right = (part.ravel() for part in np.indices((reach, reach)))
    row = along[:, one, None] * turns + around[:, None, left]
    column = along[:, other, None] * turns + around[:, None, right]
    lower = row >= column
    size = rings * turns
    places = ((row - column) * size + column)[lower]
    found = np.bincount(places, sums[:, :, number.ravel()][lower], reach * turns * size)
    return np.asarray(found.reshape(-1, size), np.float64)


@dataclass(frozen=True, eq=False)
class SideSystem:
    """A factored system."""

    factor: Floats  # Lower band of the Cholesky factor, (band + 1, n)
    norm: float  # Largest row sum of the system

    def solve(self, right: Floats) -> Floats:
        """Coefficients (n,) or (n, k) for a right-hand side."""
        return scipy.linalg.cho_solve_banded((self.factor, True), right, check_finite=False)

    def half(self, rows: Floats) -> Floats:
        """Half of the solution for each of rows (k, n): products of these are covariances, (k, n).

        By blocks of a ring, for all rows that have begun by then: before its first a row is zero.
        """
        begins = (rows != 0.0).argmax(axis=1)
        order = np.argsort(begins, kind="stable")
        left, begins = rows[order], begins[order]
        factor, (reach, n) = np.asfortranarray(self.factor), self.factor.shape
        ring = reach // (CUBIC + 1)
        strides = factor.itemsize, (reach - 1) * factor.itemsize  # Of the factor's rows and columns
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

    @cached_property
    def condition(self) -> float:
        """Condition number to 2 digits, by inverse iteration; more would depend on the machine."""
        vector = np.cos(np.arange(self.factor.shape[1], dtype=float) ** 2)
        before, length = 0.0, 1.0
        for _ in range(STEPS):
            vector = self.solve(vector / np.linalg.norm(vector))
            before, length = length, float(np.linalg.norm(vector))
            if abs(length - before) < STILL * length:
                break
        return float(f"{self.norm * length:.2g}")


def side_system(
    normal: Floats,
    turns: int,
    along: tuple[Floats, Floats],
    around: float,
    tension: scipy.sparse.csr_array | None = None,
) -> SideSystem:
    """Normal equations (band + 1, along * around), penalised, with `turns` coefficients around.

    `along` is the strength of the bending along, from knot to knot, (spans,), with the root of the
    bending, (r, along); `around` the strength of that around. `tension` is the root of one more
    penalty, (m, along * around). Of strength 1, a penalty has the mean diagonal.
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
    band[0] += mean * RIDGE
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
    """x and y of the axis as pieces of a polynomial of the height; beyond them it is upright."""

    breaks: Floats  # Heights (m + 1,) between which the pieces lie, rising, m
    coefficients: Floats  # (degree + 1, m, 2), highest power first, of the height over its break

    def at(self, heights: Floats, derivative: int = 0) -> Floats:
        """Places (n, 2) of the axis at heights (n,), m, or a derivative of them by the height."""
        low, high = self.breaks[[0, -1]]
        piece = np.searchsorted(self.breaks[1:-1], heights, side="right")
        above = (np.clip(heights, low, high) - self.breaks[piece])[:, None]
        found = np.zeros((len(heights), 2))
        powers = range(len(self.coefficients) - 1, derivative - 1, -1)
        for power, coefficient in zip(powers, self.coefficients, strict=False):
            found = found * above + math.perm(power, derivative) * coefficient[piece]
        if derivative:
            found[(heights < low) | (heights > high)] = 0.0
        return found


def fit_axis_curve(heights: Floats, middles: Floats) -> AxisCurve:
    """Axis through middles (n, 2) of contours at heights (n,), m, of degree 3 or less.

    What is bent more than that, as the stem of a banana, has a natural cubic spline for its axis.
    """
    low, high = float(heights.min()), float(heights.max())
    levels, first = np.unique(heights, return_index=True)
    degree = min(MOST_DEGREE, len(levels) - 1)
    extent = high - low if degree else 1.0
    powers = np.vander((heights - low) / extent, degree + 1)
    shares = np.linalg.lstsq(powers, middles, rcond=None)[0]
    scales = extent ** np.arange(degree, -1, -1.0)
    axis_curve = AxisCurve(np.array([low, high]), (shares / scales[:, None])[:, None])
    missed = float(np.linalg.norm(axis_curve.at(heights) - middles, axis=1).max())
    if missed <= MISSES * (high - low) or len(levels) <= MOST_DEGREE + 1:
        return axis_curve
    from scipy.interpolate import CubicSpline  # Seldom, and slow to import

    bent = CubicSpline(levels, middles[first], bc_type="natural")
    return AxisCurve(levels, np.asarray(bent.c))
