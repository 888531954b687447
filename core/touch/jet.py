"""A local jet: a polynomial fitted to the touched part of a tactile image."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache

import numpy as np

from palpate.core.arrays import Bools, Floats, Ints

LEAST_TAXELS = 8
"""Below this there is no telling a slope from a corner."""
DEGREES = ((45, 4), (30, 3), (12, 2), (LEAST_TAXELS, 1))
"""Least number of taxels for each degree: about three for each coefficient."""
COUNT_OF_DEGREE = {3: 1, 6: 2, 10: 3, 15: 4}


@dataclass(frozen=True, slots=True, eq=False)
class Jet:
    """z(x, y) as a polynomial about the pad's middle.

    Cazals and Pouget, *Estimating differential quantities using polynomial fitting*, 2005.
    """

    coefficients: Floats
    """By total degree, then by the power of y: 1, x, y, x^2, xy, y^2, ...; m."""
    scale: float
    """Length by which x and y are divided, m."""

    def height(self, x: Floats, y: Floats) -> Floats:
        """Height at places x, y (n,), m."""
        return self._derivatives(x, y, (0, 0))[0]

    def slopes(self, x: Floats, y: Floats) -> tuple[Floats, Floats]:
        """Slopes dz/dx and dz/dy at places x, y (n,)."""
        by_x, by_y = self._derivatives(x, y, (1, 0), (0, 1))
        return by_x, by_y

    def second_derivatives(self, x: Floats, y: Floats) -> tuple[Floats, Floats, Floats]:
        """Derivatives z_xx, z_xy and z_yy at places x, y (n,), 1/m."""
        by_xx, by_xy, by_yy = self._derivatives(x, y, (2, 0), (1, 1), (0, 2))
        return by_xx, by_xy, by_yy

    @property
    def degree(self) -> int:
        """Total degree of the polynomial."""
        return COUNT_OF_DEGREE[len(self.coefficients)]

    def _derivatives(self, x: Floats, y: Floats, *orders: tuple[int, int]) -> list[Floats]:
        degree, scale = self.degree, self.scale
        in_x, in_y = _powers(x / scale, degree), _powers(y / scale, degree)
        return [
            _monomials(in_x, in_y, degree, by_x, by_y) @ self.coefficients / scale ** (by_x + by_y)
            for by_x, by_y in orders
        ]


def fit_jet(
    x: Floats, y: Floats, height: Floats, touched: Bools, scale: float
) -> tuple[Jet, float] | None:
    """Jet of the touched taxels and its root mean square misfit, m.

    Parameters
    ----------
    x, y, height : (rows, cols) arrays
        Where the surface is, pad frame, m.
    touched : (rows, cols) array of bool
        Which taxels count.
    scale : float
        Half the pad's width: coordinates are divided by it, m.

    Returns
    -------
    None if fewer than 8 taxels are touched, or they lie on a line.

    Notes
    -----
    Least squares by SVD; the degree follows the number of taxels.
    """
    count = int(touched.sum())
    degree = next((degree for least, degree in DEGREES if count >= least), 0)
    z = height[touched]
    in_x, in_y = _powers(x[touched] / scale, degree), _powers(y[touched] / scale, degree)
    while degree:
        basis = _monomials(in_x, in_y, degree, 0, 0)
        coefficients, _, rank, _ = np.linalg.lstsq(basis, z, rcond=1e-9)
        if rank == basis.shape[1]:
            misfit = basis @ coefficients - z
            return Jet(np.asarray(coefficients, np.float64), scale), float(
                np.sqrt(np.mean(misfit**2))
            )
        degree -= 1
    return None


def _powers(x: Floats, degree: int) -> Floats:
    """Powers of x (n,) from 0 to `degree`, (n, degree + 1); by multiplication, not by pow."""
    powers: Floats = np.ones((len(x), degree + 1))
    powers[:, 1:] = x[:, None]
    np.cumprod(powers, axis=1, out=powers)
    return powers


def _monomials(in_x: Floats, in_y: Floats, degree: int, by_x: int, by_y: int) -> Floats:
    """Monomials, differentiated so often by x and y: (n, coefficients)."""
    of_x, of_y, factor = _exponents(degree, by_x, by_y)
    product: Floats = in_x[:, of_x] * in_y[:, of_y]
    return product if by_x == by_y == 0 else product * factor


@cache
def _exponents(degree: int, by_x: int, by_y: int) -> tuple[Ints, Ints, Floats]:
    """Exponents of x and y in each differentiated monomial, and its factor."""
    pairs = [(total - power, power) for total in range(degree + 1) for power in range(total + 1)]
    of_x, of_y = np.array(pairs).T
    factor = [float(math.perm(i, by_x) * math.perm(j, by_y)) for i, j in pairs]
    return np.maximum(of_x - by_x, 0), np.maximum(of_y - by_y, 0), np.array(factor)
