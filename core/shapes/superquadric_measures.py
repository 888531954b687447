"""Volume and second moments of a superquadric, in closed form, tapered or not."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from palpate.core.arrays import Floats, finite_array
from palpate.core.shapes.superquadric import Superquadric
from palpate.core.shapes.taper import Taper


class Moments(NamedTuple):
    """Of a solid of density 1."""

    volume: float
    """m3."""
    centroid: Floats
    """(3,), m."""
    second: Floats
    """Integral of the products of the coordinates, from the frame's origin, (3, 3), m5."""

    def inertia(self) -> Floats:
        """Inertia (3, 3) about the frame's origin, m5; times the density it is in kg m2."""
        return np.asarray(np.trace(self.second) * np.eye(3) - self.second)


def volume(size: ArrayLike, exponents: ArrayLike) -> float:
    """Volume of a superquadric, m3: 2 a1 a2 a3 e1 e2 B(e1/2 + 1, e1) B(e2/2, e2/2).

    Parameters
    ----------
    size : (3,) array
        Semi-axes, positive, m.
    exponents : (2,) array
        Positive; here also those that are too small to be cast, or above 2.

    Raises
    ------
    ValueError
        If a semi-axis or an exponent is not positive.
    """
    semi_axes = finite_array("size", size, (3,))
    pair = finite_array("exponents", exponents, (2,))
    if not (semi_axes > 0.0).all():
        raise ValueError(f"size must be positive, got {semi_axes.tolist()} m")
    if not (pair > 0.0).all():
        raise ValueError(f"exponents must be positive, got {pair.tolist()}")
    e1, e2 = pair.tolist()
    return float(np.prod(semi_axes) * 4.0 * _ratio(0.5 * e2, 0.5 * e2) * _heights(e1, 1.0, 1)[0])


def moments(shape: Superquadric, taper: ArrayLike = (0.0, 0.0)) -> Moments:
    """Volume, centroid and second moments of a superquadric that may be tapered.

    Parameters
    ----------
    shape : Superquadric
        What is tapered.
    taper : (2,) array
        Widening of x and y at the top: see `Taper`.

    Raises
    ------
    ValueError
        If a widening is not between -1 and 1.

    Notes
    -----
    A section at the share h of the half height is widened by 1 + K h, so that every moment is a
    polynomial in the widenings. Its coefficients are integrals over h of a power of h times the
    section's area, or times its square for the moments across. A bend would leave the volume.
    """
    kx, ky = finite_array("taper", taper, (2,)).tolist()
    a, b, c = shape.size.tolist()
    Taper(kx, ky, c)  # refuses what collapses a section
    e1, e2 = shape.exponents.tolist()
    area, across = 4.0 * _ratio(0.5 * e2, 0.5 * e2), 4.0 / 3.0 * _ratio(1.5 * e2, 0.5 * e2)
    wide, deep = np.array([1.0, kx]), np.array([1.0, ky])
    widening = np.convolve(wide, deep)
    heights, squares = a * b * c * area * _heights(e1, 1.0, 5), _heights(e1, 2.0, 5)
    content = float(widening @ heights[:3])
    over_x = np.convolve(np.convolve(wide, wide), widening) @ squares
    over_y = np.convolve(np.convolve(deep, deep), widening) @ squares
    return Moments(
        content,
        np.array([0.0, 0.0, c * float(widening @ heights[1:4]) / content]),
        np.diag(
            [
                a**3 * b * c * across * float(over_x),
                a * b**3 * c * across * float(over_y),
                c * c * float(widening @ heights[2:5]),
            ]
        ),
    )


def _heights(e1: float, power: float, count: int) -> Floats:
    """Integrals over h from -1 to 1 of h^k (1 - |h|^(2/e1))^(e1 power), k below count."""
    found = np.zeros(count)
    for k in range(0, count, 2):
        found[k] = 2.0 / (k + 1.0) * _ratio(0.5 * e1 * (k + 1.0), power * e1)
    return found


def _ratio(x: float, y: float) -> float:
    """Gamma(1 + x) Gamma(1 + y) / Gamma(1 + x + y): 1 where both vanish, and no digits lost."""
    from scipy.special import gammaln

    return float(np.exp(gammaln(1.0 + x) + gammaln(1.0 + y) - gammaln(1.0 + x + y)))
