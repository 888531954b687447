"""Spline volumes: space as a polynomial or rational (NURBS) spline of three parameters.

Its points and slopes, the parallelepiped of an undeformed one, and the determinant of its slopes.
The determinant is a polynomial between the knots; its coefficients over the Bernstein polynomials
enclose it, and halving a piece draws them closer. So they can prove that nothing folds, where
samples can only find no fold.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cache
from math import comb
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from palpate.core.arrays import Floats, finite_array
from palpate.core.splines.bases import (
    ROUNDING,
    Basis,
    Orders,
    evaluate_grid,
    evaluate_scattered,
    sparse_rows,
)
from palpate.reprs import readable

if TYPE_CHECKING:
    from scipy.sparse import csr_array

VALUE_ORDERS: tuple[Orders, ...] = ((0, 0, 0),)
FIRST_ORDERS: tuple[Orders, ...] = (*VALUE_ORDERS, (1, 0, 0), (0, 1, 0), (0, 0, 1))
SECOND_ORDERS: tuple[Orders, ...] = (
    *FIRST_ORDERS,
    (2, 0, 0),
    (1, 1, 0),
    (1, 0, 1),
    (0, 2, 0),
    (0, 1, 1),
    (0, 0, 2),
)
PAIR_INDICES = np.array([[0, 1, 2], [1, 3, 4], [2, 4, 5]])  # second derivatives by pairs of axes
COEFFICIENT_ROUNDING = 16 * float(np.finfo(float).eps)  # relative, of a Bernstein coefficient
MIN_RELATIVE_VOLUME = 1e-12  # over the edges' lengths; smaller is flat
Bases = tuple[Basis, Basis, Basis]  # along s, t and u


@readable
@dataclass(frozen=True, slots=True, eq=False)
class SplineVolume:
    """A spline solid over parameters s, t, u between 0 and 1.

    `control` (l, m, n, 3): control points along s, t, u [m]. `bases`: one for each axis, with as
    many functions as there are control points, over [0, 1]. `weights` (l, m, n): of the control
    points; None: all equal. Raises ValueError if shapes do not fit, values are not finite, or a
    weight is not positive. Fung, 1999, (2.20), (2.22), and (2.24), (2.25).
    """

    control: Floats
    bases: Bases
    weights: Floats | None = None
    spline: Floats = field(init=False, repr=False)  # control points, or (l, m, n, 4) with weights

    def __post_init__(self) -> None:
        if len(self.bases) != 3:
            raise ValueError(f"bases must be three, for s, t and u, got {len(self.bases)}")
        counts = tuple(basis.count for basis in self.bases)
        control = finite_array("control", self.control, (*counts, 3)).copy()
        for name, basis in zip("stu", self.bases, strict=True):
            if basis.domain != (0.0, 1.0):
                raise ValueError(f"basis along {name} must span 0 to 1, got {basis.domain}")
        spline = control
        if self.weights is not None:
            weights = finite_array("weights", self.weights, counts)
            if not (weights > 0.0).all():
                raise ValueError(f"weights must be positive, got {weights.min():g}")
            weights = weights / weights.max()
            spline = np.concatenate([weights[..., None] * control, weights[..., None]], axis=-1)
            weights.setflags(write=False)
            object.__setattr__(self, "weights", weights)
        control.setflags(write=False)
        spline.setflags(write=False)
        object.__setattr__(self, "control", control)
        object.__setattr__(self, "spline", spline)

    def at(self, parameters: Floats) -> Floats:
        """Points (n, 3) [m] at parameters (n, 3).

        Raises ValueError if parameters are not finite (n, 3), or lie outside 0 to 1 by more than
        rounding, here and below.
        """
        value: Floats = evaluate_scattered(self.bases, self.spline, parameters, VALUE_ORDERS)[0]
        return value if self.weights is None else value[:, :3] / value[:, 3:]

    def first(self, parameters: Floats) -> tuple[Floats, Floats]:
        """Points (n, 3) [m] and slopes (n, 3, 3): a column for each of s, t, u."""
        value, *slopes = evaluate_scattered(self.bases, self.spline, parameters, FIRST_ORDERS)
        slope = np.stack(slopes, axis=-1)
        if self.weights is None:
            return value, slope
        points = value[:, :3] / value[:, 3:]
        return points, _quotient_slope(points, slope, value[:, 3])

    def second(self, parameters: Floats) -> tuple[Floats, Floats, Floats]:
        """Points, slopes, and second derivatives (n, 3, 3, 3): component, axis, axis."""
        derivatives = evaluate_scattered(self.bases, self.spline, parameters, SECOND_ORDERS)
        value, slope = derivatives[0], np.stack(list(derivatives[1:4]), axis=-1)
        bend = derivatives[4:][PAIR_INDICES].transpose(2, 3, 0, 1)
        if self.weights is None:
            return value, slope, bend
        points, weight = value[:, :3] / value[:, 3:], value[:, 3]
        slopes = _quotient_slope(points, slope, weight)
        mixed = slopes[:, :, :, None] * slope[:, 3:, None, :]
        both = mixed + mixed.transpose(0, 1, 3, 2)
        bend = bend[:, :3] - both - points[:, :, None, None] * bend[:, 3:]
        return points, slopes, bend / weight[:, None, None, None]

    def grid(self, s: Floats, t: Floats, u: Floats) -> Floats:
        """Points (a, b, c, 3) [m] on a grid of parameters (a,), (b,), (c,)."""
        value = evaluate_grid(self.bases, self.spline, (s, t, u))
        return value if self.weights is None else value[..., :3] / value[..., 3:]

    def shares(self, parameters: Floats) -> csr_array:
        """Weights of the control points in the points: sparse (n, l m n), rows sum to 1."""
        parameters = finite_array("parameters", parameters, (None, 3))
        n = len(parameters)
        columns = np.zeros((n, 1), np.int64)
        values = np.ones((n, 1))
        for axis, basis in enumerate(self.bases):
            local = basis.nonzero(parameters[:, axis])
            shape = n, columns.shape[1] * (basis.degree + 1)
            columns = (columns[:, :, None] * basis.count + local.columns()[:, None]).reshape(shape)
            values = (values[:, :, None] * local.values[0][:, None]).reshape(shape)
        if self.weights is not None:
            values = values * self.weights.ravel()[columns]
            values = values / values.sum(axis=1, keepdims=True)
        return sparse_rows(values, columns, self.control[..., 0].size)


def _quotient_slope(points: Floats, slope: Floats, weight: Floats) -> Floats:
    """Slopes (n, 3, 3) of points that are a quotient, from those (n, 4, 3) of both its parts."""
    return (slope[:, :3] - points[:, :, None] * slope[:, 3:]) / weight[:, None, None]


class BernsteinPieces(NamedTuple):
    """Polynomial pieces of the determinant."""

    low: Floats  # smallest parameters of each, (k, 3)
    width: Floats  # along each parameter, (k, 3)
    coefficients: Floats  # (k, a + 1, b + 1, c + 1): they enclose the piece
    rounding: float  # largest error of a coefficient


def mean_determinant(volume: SplineVolume, n_steps: int = 12) -> float:
    """Mean determinant [m^3] of a volume's slopes: negative if most of it is a mirror image.

    `n_steps`: samples along each axis.
    """
    steps = (np.arange(n_steps) + 0.5) / n_steps
    return float(slope_determinant(volume, steps, steps, steps).mean())


def rescaled_volume(volume: SplineVolume, origin: Floats, size: float) -> SplineVolume:
    """A volume about an origin (3,) and over a size, so that no product leaves the range."""
    return SplineVolume((volume.control - origin) / size, volume.bases, volume.weights)


def control_extent(volume: SplineVolume) -> float:
    """Longest side [m] of the box around the control points; 1 where they are one point."""
    size = float(np.ptp(volume.control.reshape(-1, 3), axis=0).max())
    return size if size > 0.0 else 1.0


def slope_determinant(volume: SplineVolume, s: Floats, t: Floats, u: Floats) -> Floats:
    """Determinant of a volume's slopes on a grid of parameters: (a, b, c) [m^3]."""
    determinant, weight = _determinant_and_weight(volume, s, t, u)
    return determinant / weight**4


def determinant_pieces(volume: SplineVolume) -> Iterator[BernsteinPieces]:
    """The determinant over the whole volume, one layer of pieces along u after the other."""
    factor = 3 if volume.weights is None else 4
    degrees = [factor * basis.degree - 1 for basis in volume.bases]
    breaks = [basis.breaks() for basis in volume.bases]
    sites = [  # Chebyshev's points in each piece
        cuts[:-1, None] + np.diff(cuts)[:, None] * _unit_sites(degree)
        for cuts, degree in zip(breaks, degrees, strict=True)
    ]
    converters = [_converter(degree) for degree in degrees]
    growth = float(np.prod([np.abs(matrix).sum(axis=1).max() for matrix in converters]))
    low = np.stack(np.meshgrid(breaks[0][:-1], breaks[1][:-1], indexing="ij"), axis=-1)
    wide = np.stack(np.meshgrid(*map(np.diff, breaks[:2]), indexing="ij"), axis=-1)
    low, wide = low.reshape(-1, 2), wide.reshape(-1, 2)
    end = np.ones((len(low), 1))
    for layer in range(len(breaks[2]) - 1):
        # A rational volume's is a polynomial only times the weight's fourth power.
        places = sites[0].ravel(), sites[1].ravel(), sites[2][layer]
        values, _ = _determinant_and_weight(volume, *places)
        pieces = values.reshape(*sites[0].shape, *sites[1].shape, -1)
        for axis, matrix in zip((1, 3, 4), converters, strict=True):
            pieces = np.moveaxis(np.tensordot(matrix, pieces, (1, axis)), 0, axis)
        pieces = pieces.swapaxes(1, 2)
        start, thick = breaks[2][layer], breaks[2][layer + 1] - breaks[2][layer]
        yield BernsteinPieces(
            np.hstack([low, start * end]),
            np.hstack([wide, thick * end]),
            pieces.reshape(len(low), *pieces.shape[2:]),
            COEFFICIENT_ROUNDING * growth * float(np.abs(values).max()),
        )


@cache
def _converter(degree: int) -> Floats:
    """Matrix from values at Chebyshev's points to coefficients over the Bernstein polynomials."""
    x = _unit_sites(degree)[:, None]
    i = np.arange(degree + 1)
    binomials = np.array([comb(degree, k) for k in i.tolist()], dtype=np.float64)
    values: Floats = binomials * x**i * (1.0 - x) ** (degree - i)
    return np.asarray(np.linalg.inv(values), dtype=np.float64)


def _unit_sites(degree: int) -> Floats:
    angles = (np.arange(degree + 1) + 0.5) * np.pi / (degree + 1)
    return np.sin(0.5 * angles) ** 2


def _determinant_and_weight(
    volume: SplineVolume, s: Floats, t: Floats, u: Floats
) -> tuple[Floats, Floats]:
    """The determinant times the fourth power of the weight, and the weight."""
    bases, spline = volume.bases, volume.spline
    value, *slopes = (evaluate_grid(bases, spline, (s, t, u), order) for order in FIRST_ORDERS)
    if volume.weights is None:
        return _triple(*slopes), np.ones(1)
    weight = value[..., 3:]
    offsets = [weight * slope[..., :3] - value[..., :3] * slope[..., 3:] for slope in slopes]
    return _triple(*offsets) / weight[..., 0] ** 2, weight[..., 0]


def _triple(x: Floats, y: Floats, z: Floats) -> Floats:
    return np.asarray(np.einsum("...i,...i->...", np.cross(x, y), z))


def subdivide(pieces: BernsteinPieces) -> BernsteinPieces:
    """Each piece halved along all axes into eight, by de Casteljau's scheme."""
    low, width, coefficients, rounding = pieces
    for axis in range(3):
        left, right = _halves(coefficients.shape[axis + 1] - 1)
        along = np.moveaxis(coefficients, axis + 1, -1)
        coefficients = np.moveaxis(np.concatenate([along @ left.T, along @ right.T]), -1, axis + 1)
        width = width * np.where(np.arange(3) == axis, 0.5, 1.0)
        step = np.where(np.arange(3) == axis, width, 0.0)
        low, width = np.concatenate([low, low + step]), np.concatenate([width, width])
    return BernsteinPieces(low, width, coefficients, rounding)


@cache
def _halves(degree: int) -> tuple[Floats, Floats]:
    rows = [[comb(i, j) / 2.0**i for j in range(degree + 1)] for i in range(degree + 1)]
    left = np.array(rows, dtype=np.float64)
    return left, left[::-1, ::-1]


@dataclass(frozen=True, slots=True, eq=False)
class Parallelepiped:
    """A corner and three edge vectors.

    `corner` (3,): the point s = t = u = 0 [m]. `edges` (3, 3): a row for each of s, t and u, from
    the corner to the point where it is 1 [m]. Raises ValueError if an edge has no length, or the
    three lie in a plane. Fung, 1999, (2.17) to (2.19), with the edges themselves: with unit
    vectors, as printed, the far end of an edge would be its length, not 1.
    """

    corner: Floats
    edges: Floats
    inverse: Floats = field(init=False, repr=False)  # [1/m] from offsets to s, t, u

    def __post_init__(self) -> None:
        corner = finite_array("corner", self.corner, (3,)).copy()
        edges = finite_array("edges", self.edges, (3, 3)).copy()
        lengths = np.abs(edges).max(axis=1, keepdims=True)
        if not (lengths > 0.0).all():
            raise ValueError(f"edges must have a length, got {edges.tolist()} m")
        units = edges / lengths
        if not abs(np.linalg.det(units)) > MIN_RELATIVE_VOLUME:
            raise ValueError(f"edges must not lie in a plane, got {edges.tolist()} m")
        inverse = np.linalg.inv(units) / lengths.T
        for name, array in (("corner", corner), ("edges", edges), ("inverse", inverse)):
            array.setflags(write=False)
            object.__setattr__(self, name, array)

    @property
    def volume(self) -> float:
        """Volume [m^3]; negative if the edges are left-handed."""
        return float(np.linalg.det(self.edges))

    def local(self, points: Floats) -> Floats:
        """s, t and u (n, 3) of points (n, 3): (2.18); the inside is between 0 and 1."""
        return _combine([points[..., axis] - self.corner[axis] for axis in range(3)], self.inverse)

    def points(self, local: Floats) -> Floats:
        """Points (..., 3) of s, t and u (..., 3): (2.17)."""
        offsets = _combine([local[..., axis] for axis in range(3)], self.edges)
        offsets += self.corner
        return offsets

    def rounding(self, points: Floats) -> float:
        """Rounding error of s, t and u of such points."""
        size = max(float(np.abs(points).max(initial=0.0)), float(np.abs(self.corner).max()))
        return ROUNDING * (1.0 + size * float(np.abs(self.inverse).sum(axis=0).max()))

    def greville_control(self, bases: Bases) -> Floats:
        """Control points (l, m, n, 3) [m] that deform nothing: at the Greville abscissae."""
        return self._grid([basis.greville() for basis in bases])

    def even_control(self, counts: tuple[int, int, int]) -> Floats:
        """Control points (l, m, n, 3) [m] in even steps along each edge: (2.19).

        They deform nothing under Bernstein polynomials alone; under other bases parameters are
        found by inversion. Raises ValueError if there are fewer than two along an edge.
        """
        if min(counts) < 2:
            raise ValueError(f"counts must be at least 2 along each edge, got {counts}")
        return self._grid([np.linspace(0.0, 1.0, count) for count in counts])

    def _grid(self, places: list[Floats]) -> Floats:
        return self.points(np.stack(np.meshgrid(*places, indexing="ij"), axis=-1))


def _combine(columns: list[Floats], matrix: Floats) -> Floats:
    """Columns of three numbers times a matrix (3, 3), without the products by 0."""
    result = np.zeros((*columns[0].shape, 3))
    for row, column in zip(matrix, columns, strict=True):
        for axis in np.flatnonzero(row):
            result[..., axis] += column * row[axis]
    return result


def upright_parallelepiped(low: Floats, extent: Floats) -> Parallelepiped:
    """Frame of an upright box: low corner (3,) and positive lengths (3,) [m], or ValueError."""
    extent = finite_array("extent", extent, (3,))
    if not (extent > 0.0).all():
        raise ValueError(f"extent must be positive, got {extent.tolist()} m")
    return Parallelepiped(finite_array("low", low, (3,)), np.diag(extent))
