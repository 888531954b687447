"""A local jet: a polynomial fitted to the touched part of a tactile image."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from palpate.core.arrays import Bools, Floats

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
        result: Floats = _monomials(x / self.scale, y / self.scale, self.degree, 0, 0) @ (
            self.coefficients
        )
        return result

    def slopes(self, x: Floats, y: Floats) -> tuple[Floats, Floats]:
        """Slopes dz/dx and dz/dy at places x, y (n,)."""
        return self._derivative(x, y, 1, 0), self._derivative(x, y, 0, 1)

    def second_derivatives(self, x: Floats, y: Floats) -> tuple[Floats, Floats, Floats]:
        """Derivatives z_xx, z_xy and z_yy at places x, y (n,), 1/m."""
        return (
            self._derivative(x, y, 2, 0),
            self._derivative(x, y, 1, 1),
            self._derivative(x, y, 0, 2),
        )

    @property
    def degree(self) -> int:
        """Total degree of the polynomial."""
        return COUNT_OF_DEGREE[len(self.coefficients)]

    def _derivative(self, x: Floats, y: Floats, by_x: int, by_y: int) -> Floats:
        basis = _monomials(x / self.scale, y / self.scale, self.degree, by_x, by_y)
        result: Floats = basis @ self.coefficients / self.scale ** (by_x + by_y)
        return result


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
    while degree:
        basis = _monomials(x[touched] / scale, y[touched] / scale, degree, 0, 0)
        coefficients, _, rank, _ = np.linalg.lstsq(basis, z, rcond=1e-9)
        if rank == basis.shape[1]:
            misfit = basis @ coefficients - z
            return Jet(np.asarray(coefficients, np.float64), scale), float(
                np.sqrt(np.mean(misfit**2))
            )
        degree -= 1
    return None


def _monomials(x: Floats, y: Floats, degree: int, by_x: int, by_y: int) -> Floats:
    """Monomials at x, y (n,), differentiated: (n, coefficients)."""
    in_x, in_y = _powers(x, degree, by_x), _powers(y, degree, by_y)
    columns = [
        in_x[total - power] * in_y[power]
        for total in range(degree + 1)
        for power in range(total + 1)
    ]
    return np.stack(columns, axis=-1)


def _powers(x: Floats, degree: int, order: int) -> list[Floats]:
    """Powers of x from 0 to `degree`, differentiated so often; by multiplication, not by pow."""
    plain = [np.ones_like(x)]
    for _ in range(degree):
        plain.append(plain[-1] * x)
    zero = np.zeros_like(x)
    return [
        math.perm(power, order) * plain[power - order] if power >= order else zero
        for power in range(degree + 1)
    ]
