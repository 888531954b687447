"""Cubic tensor B-splines on the cells of a narrow band: the control lattice of a general solid.

A cell is a cube of a grid through the origin; over it a spline has 64 control values. Only cells
near the surface are kept, so that the number of control values grows with the area of an object and
not its volume. Positions and values are in cells: a distance's gradient is 1 in any unit.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from itertools import product
from math import factorial, prod

import numpy as np

from palpate.core.arrays import Bools, Floats, Ints
from palpate.reprs import readable

ORDER = 4  # Of the splines along each axis: cubics
N_LOCAL = ORDER**3  # Control values over a cell
MAX_COORDINATE = 1 << 19  # [cells] from the origin: three such coordinates fit a 64-bit key
N_GAUSS = 5  # Quadrature points an axis: products of derivatives of cubics are exact
CORNERS = np.stack(np.meshgrid(*[np.arange(ORDER)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)


@readable
@dataclass(frozen=True, slots=True, eq=False)
class Band:
    """Cells, and the control values over them."""

    cells: Ints  # Lowest corners, (m, 3), in the order of their keys
    control: Ints  # Grid places of the control values, (n, 3)
    local: Ints  # Numbers of the control values over each cell, (m, 64)

    def find(self, cells: Ints) -> Ints:
        """Numbers (k,) of cells (k, 3); -1 for those outside the band."""
        keys, wanted = cell_keys(self.cells), cell_keys(cells)
        at = np.minimum(np.searchsorted(keys, wanted), len(keys) - 1)
        return np.where(keys[at] == wanted, at, -1).astype(np.int32)

    def locate(self, places: Floats) -> tuple[Ints, Floats]:
        """Cell number (k,) of each place (k, 3), -1 outside, and the offset in it, (k, 3)."""
        corners = np.floor(places)
        return self.find(corners.astype(np.int32)), places - corners

    def evaluate(self, values: Floats, places: Floats) -> tuple[Floats, Floats]:
        """The spline of values (n,) and its gradient at places (k, 3); NaN outside the band."""
        number, offsets = self.locate(places)
        inside = number >= 0
        value, gradient = np.full(len(places), np.nan), np.full((len(places), 3), np.nan)
        value[inside], gradient[inside] = self.evaluate_in(values, number[inside], offsets[inside])
        return value, gradient

    def evaluate_in(self, values: Floats, number: Ints, offsets: Floats) -> tuple[Floats, Floats]:
        """Value and gradient in cells of these numbers (k,), at offsets (k, 3) in the cells."""
        control = values[self.local[number]].reshape(-1, 4, 4, 4)
        (x, y, z), (dx, dy, dz) = (_cubics(offsets, order).transpose(1, 0, 2) for order in range(2))
        # Direction by direction: a tenth of the work of 64 products for each of the four.
        planes, sloped = (np.einsum("kxyz,kz->kxy", control, one) for one in (z, dz))
        lines = np.einsum("kxy,ky->kx", planes, y)
        slopes = [
            np.einsum("kx,kx->k", lines, dx),
            np.einsum("kxy,ky,kx->k", planes, dy, x),
            np.einsum("kxy,ky,kx->k", sloped, y, x),
        ]
        return np.einsum("kx,kx->k", lines, x), np.column_stack(slopes)


def make_band(cells: Ints) -> Band:
    """The band of cells (k, 3), in any order, possibly repeated; ValueError if none, or too far."""
    if not len(cells) or np.abs(cells).max() >= MAX_COORDINATE:
        raise ValueError(
            f"a band must have cells within {MAX_COORDINATE} of the origin, got {len(cells)}"
        )
    cells = cells[np.unique(cell_keys(cells), return_index=True)[1]].astype(np.int32)
    spread = (cells[:, None] + CORNERS).reshape(-1, 3)
    _, first, inverse = np.unique(cell_keys(spread), return_index=True, return_inverse=True)
    local = inverse.reshape(-1, N_LOCAL)
    control = spread[first] - 1  # a control value stands one cell inside its support
    return Band(cells, control.astype(np.int32), local.astype(np.int32))


def cell_keys(cells: Ints) -> Ints:
    """One number (k,) for each cell (k, 3), ascending along x, then y, then z."""
    shifted = cells.astype(np.int64) + MAX_COORDINATE
    return np.asarray(
        (shifted[:, 0] * 2 * MAX_COORDINATE + shifted[:, 1]) * 2 * MAX_COORDINATE + shifted[:, 2]
    )


def basis_values(offsets: Floats) -> Floats:
    """Values of the 64 splines at places (k, 3) in a cell, (k, 64)."""
    return _products(*[_cubics(offsets, 0)] * 3)


def basis_rows(offsets: Floats) -> Floats:
    """Values and gradients of the 64 splines at places (k, 3) in a cell, (4, k, 64)."""
    values, slopes = (_cubics(offsets, order) for order in range(2))  # (k, 3, 4)
    return np.stack(
        [_products(values, values, values)]
        + [
            _products(*(slopes if axis == other else values for other in range(3)))
            for axis in range(3)
        ]
    )


def _products(along_x: Floats, along_y: Floats, along_z: Floats) -> Floats:
    planes = along_x[:, 0, :, None] * along_y[:, 1, None, :]
    return np.asarray((planes[..., None] * along_z[:, 2, None, None, :]).reshape(-1, N_LOCAL))


def _cubics(t: Floats, order: int) -> Floats:
    """The four uniform cubic B-splines over [0, 1], or a derivative of them, (..., 4)."""
    s = 1.0 - t
    if order == 0:
        middle = 3.0 * t**3 - 6.0 * t**2 + 4.0, 3.0 * s**3 - 6.0 * s**2 + 4.0
        return np.stack([s**3, *middle, t**3], axis=-1) / 6.0
    if order == 1:
        middle = 9.0 * t**2 - 12.0 * t, 12.0 * s - 9.0 * s**2
        return np.stack([-3.0 * s**2, *middle, 3.0 * t**2], axis=-1) / 6.0
    if order == 2:
        return np.stack([s, 3.0 * t - 2.0, 3.0 * s - 2.0, t], axis=-1)
    ones = np.ones_like(t)
    return np.stack([-ones, 3.0 * ones, -3.0 * ones, ones], axis=-1)


@cache
def cell_integrals() -> tuple[Floats, Floats]:
    """Quadratic forms (64, 64) over one cell: squared third derivatives, and squared values."""
    nodes, weights = np.polynomial.legendre.leggauss(N_GAUSS)
    at = 0.5 * (nodes + 1.0)
    forms = [
        np.einsum("gi,gj,g->ij", _cubics(at, order), _cubics(at, order), 0.5 * weights)
        for order in range(4)
    ]
    third = np.zeros((N_LOCAL, N_LOCAL))
    for orders in product(range(4), repeat=3):
        if sum(orders) == 3:  # times: orders in which the derivatives can be taken
            times = 6 // prod(factorial(order) for order in orders)
            third += times * _kron(*(forms[order] for order in orders))
    return third, _kron(forms[0], forms[0], forms[0])


def _kron(x: Floats, y: Floats, z: Floats) -> Floats:
    return np.asarray(np.kron(np.kron(x, y), z))


def cells_between(mask: Bools, corner: Ints) -> Ints:
    """Cells (k, 3) where a mask is set, whose first element is the cell `corner`."""
    return (np.column_stack(np.nonzero(mask)) + corner).astype(np.int32)
