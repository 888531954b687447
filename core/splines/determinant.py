"""The Jacobian determinant of a spline volume, as the spline that it is itself.

Between the knots it is a polynomial; its coefficients over the Bernstein polynomials enclose
it, and halving a piece draws them closer. So they can prove that nothing folds, where samples
can only fail to find a fold.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from math import comb
from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.splines.basis import Basis
from palpate.core.splines.tensor import evaluate_grid
from palpate.core.splines.volume import FIRST, Volume

SAFETY = 16 * float(np.finfo(float).eps)
"""Rounding of a coefficient, times how much the conversion may enlarge it."""

MEAN_STEPS = 12
"""Along each axis, over which a determinant is averaged."""


class Pieces(NamedTuple):
    """Polynomial pieces of the determinant."""

    low: Floats
    """Smallest parameters of each, (k, 3)."""
    width: Floats
    """Their widths, (k, 3)."""
    coefficients: Floats
    """(k, a + 1, b + 1, c + 1): the piece lies between the least and the largest of them."""
    rounding: float
    """How far a coefficient may be off."""


def mean_determinant(volume: Volume) -> float:
    """Mean determinant of a volume's slopes, m^3: negative if most of it is a mirror image."""
    steps = (np.arange(MEAN_STEPS) + 0.5) / MEAN_STEPS
    return float(slope_determinant(volume, steps, steps, steps).mean())


def scaled(volume: Volume, origin: Floats, size: float) -> Volume:
    """A volume about an origin (3,) and over a size, so that no product leaves the range."""
    return Volume((volume.control - origin) / size, volume.bases, volume.weights)


def extent(volume: Volume) -> float:
    """Longest side of the box around the control points, m; 1 where they are one point."""
    size = float(np.ptp(volume.control.reshape(-1, 3), axis=0).max())
    return size if size > 0.0 else 1.0


def slope_determinant(volume: Volume, s: Floats, t: Floats, u: Floats) -> Floats:
    """Determinant of a volume's slopes on a grid of parameters: (a, b, c), m^3."""
    determinant, weight = _determinant_and_weight(volume, s, t, u)
    return determinant / weight**4


def determinant_pieces(volume: Volume) -> Iterator[Pieces]:
    """The determinant over the whole volume, one layer of pieces along u after the other."""
    factor = 3 if volume.weights is None else 4
    degrees = [factor * basis.degree - 1 for basis in volume.bases]
    breaks = [_breaks(basis) for basis in volume.bases]
    sites = [_sites(cuts, degree) for cuts, degree in zip(breaks, degrees, strict=True)]
    converters = [_converter(degree) for degree in degrees]
    growth = float(np.prod([np.abs(matrix).sum(axis=1).max() for matrix in converters]))
    along_s, along_t = (np.diff(cuts) for cuts in breaks[:2])
    for layer in range(len(breaks[2]) - 1):
        # A rational volume's is no polynomial before it is times the weight's fourth power.
        values, _ = _determinant_and_weight(
            volume, sites[0].ravel(), sites[1].ravel(), sites[2][layer]
        )
        shape = (*sites[0].shape, *sites[1].shape, sites[2].shape[1])
        pieces = values.reshape(shape)
        for axis, matrix in zip((1, 3, 4), converters, strict=True):
            pieces = np.moveaxis(np.tensordot(matrix, pieces, (1, axis)), 0, axis)
        pieces = pieces.swapaxes(1, 2)
        low = np.stack(np.meshgrid(breaks[0][:-1], breaks[1][:-1], indexing="ij"), axis=-1)
        wide = np.stack(np.meshgrid(along_s, along_t, indexing="ij"), axis=-1)
        cells = len(along_s) * len(along_t)
        end = np.full((cells, 1), 1.0)
        start, thick = breaks[2][layer], breaks[2][layer + 1] - breaks[2][layer]
        yield Pieces(
            np.hstack([low.reshape(cells, 2), start * end]),
            np.hstack([wide.reshape(cells, 2), thick * end]),
            pieces.reshape(cells, *pieces.shape[2:]),
            SAFETY * growth * float(np.abs(values).max()),
        )


def halve(pieces: Pieces) -> Pieces:
    """Each piece as eight, by de Casteljau's scheme."""
    low, width, coefficients, rounding = pieces
    for axis in range(3):
        left, right = _halves(coefficients.shape[axis + 1] - 1)
        along = np.moveaxis(coefficients, axis + 1, -1)
        both = np.concatenate([along @ left.T, along @ right.T])
        coefficients = np.moveaxis(both, -1, axis + 1)
        width = width * np.where(np.arange(3) == axis, 0.5, 1.0)
        step = np.where(np.arange(3) == axis, width, 0.0)
        low, width = np.concatenate([low, low + step]), np.concatenate([width, width])
    return Pieces(low, width, coefficients, rounding)


def _determinant_and_weight(
    volume: Volume, s: Floats, t: Floats, u: Floats
) -> tuple[Floats, Floats]:
    """The determinant times the fourth power of the weight, and the weight."""
    value, *slopes = (
        evaluate_grid(volume.bases, volume.spline, (s, t, u), order) for order in FIRST
    )
    if volume.weights is None:
        return _triple(*slopes), np.ones(1)
    weight = value[..., 3:]
    offsets = [weight * slope[..., :3] - value[..., :3] * slope[..., 3:] for slope in slopes]
    return _triple(*offsets) / weight[..., 0] ** 2, weight[..., 0]


def _triple(x: Floats, y: Floats, z: Floats) -> Floats:
    product: Floats = np.einsum("...i,...i->...", np.cross(x, y), z)
    return product


def _breaks(basis: Basis) -> Floats:
    return np.unique(np.clip(basis.knots, *basis.domain))


def _sites(breaks: Floats, degree: int) -> Floats:
    """Chebyshev's points in each piece, (pieces, degree + 1)."""
    sites: Floats = breaks[:-1, None] + np.diff(breaks)[:, None] * _unit_sites(degree)
    return sites


def _unit_sites(degree: int) -> Floats:
    angles = (np.arange(degree + 1) + 0.5) * np.pi / (degree + 1)
    sites: Floats = np.sin(0.5 * angles) ** 2
    return sites


@cache
def _converter(degree: int) -> Floats:
    """From values at Chebyshev's points to coefficients over the Bernstein polynomials."""
    x = _unit_sites(degree)[:, None]
    i = np.arange(degree + 1)
    binomials = np.array([comb(degree, k) for k in i.tolist()], dtype=np.float64)
    values: Floats = binomials * x**i * (1.0 - x) ** (degree - i)
    return np.asarray(np.linalg.inv(values), dtype=np.float64)


@cache
def _halves(degree: int) -> tuple[Floats, Floats]:
    """Coefficients of the left and of the right half, from those of the whole."""
    rows = [[comb(i, j) / 2.0**i for j in range(degree + 1)] for i in range(degree + 1)]
    left = np.array(rows, dtype=np.float64)
    return left, left[::-1, ::-1]
