"""A local jet: a polynomial z(x, y) about the pad's middle."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache

import numpy as np

from palpate.core.arrays import Floats, Ints

COUNTS = (1, 3, 6, 10, 15)
"""Coefficients of a polynomial of each degree."""
UP_TO_SECOND = ((0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2))
"""How often z, z_x, z_y, z_xx, z_xy, z_yy are differentiated by x and y."""


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
        return COUNTS.index(len(self.coefficients))

    def _derivatives(self, x: Floats, y: Floats, *orders: tuple[int, int]) -> list[Floats]:
        degree, scale = self.degree, self.scale
        in_x, in_y = _powers(x / scale, degree), _powers(y / scale, degree)
        return [
            _monomials(in_x, in_y, degree, order) @ self.coefficients / scale ** sum(order)
            for order in orders
        ]


def monomials(x: Floats, y: Floats, degree: int) -> Floats:
    """Monomials at places x, y (n,) in units of the jet's scale: (n, m), as in a jet."""
    return _monomials(_powers(x, degree), _powers(y, degree), degree, (0, 0))


def derivative_rows(x: float, y: float, degree: int) -> Floats:
    """What gives z, z_x, z_y, z_xx, z_xy, z_yy at a place from the coefficients, (6, m).

    All in units of the jet's scale.
    """
    of_x, of_y, factor = _up_to_second(degree)
    in_x = np.array([x**power for power in range(degree + 1)])
    in_y = np.array([y**power for power in range(degree + 1)])
    rows: Floats = in_x[of_x] * in_y[of_y] * factor
    return rows


def _powers(x: Floats, degree: int) -> Floats:
    """Powers of x (n,) from 0 to `degree`, (n, degree + 1); by multiplication, not by pow."""
    powers: Floats = np.ones((len(x), degree + 1))
    powers[:, 1:] = x[:, None]
    np.cumprod(powers, axis=1, out=powers)
    return powers


def _monomials(in_x: Floats, in_y: Floats, degree: int, order: tuple[int, int]) -> Floats:
    """Monomials, differentiated so often by x and y: (n, m)."""
    of_x, of_y, factor = _exponents(degree, *order)
    product: Floats = in_x[:, of_x] * in_y[:, of_y]
    return product if order == (0, 0) else product * factor


@cache
def _exponents(degree: int, by_x: int, by_y: int) -> tuple[Ints, Ints, Floats]:
    """Exponents of x and y in each differentiated monomial, and its factor."""
    pairs = [(total - power, power) for total in range(degree + 1) for power in range(total + 1)]
    of_x, of_y = np.array(pairs).T
    factor = [float(math.perm(i, by_x) * math.perm(j, by_y)) for i, j in pairs]
    return np.maximum(of_x - by_x, 0), np.maximum(of_y - by_y, 0), np.array(factor)


@cache
def _up_to_second(degree: int) -> tuple[Ints, Ints, Floats]:
    """Exponents and factors of the height and its five derivatives, (6, m) each."""
    six = [_exponents(degree, *order) for order in UP_TO_SECOND]
    of_x, of_y, factor = zip(*six, strict=True)
    return np.stack(of_x), np.stack(of_y), np.stack(factor)
