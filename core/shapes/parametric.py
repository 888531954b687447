"""Points and normals of a superquadric from two angles, by both of the text's ways.

The trigonometric way crowds its points where the surface turns sharply. The regular one strews
them almost evenly in the directions of the scaled solid. The angles are neither a point's latitude
nor its azimuth, but for the regular way of a solid with equal semi-axes.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from palpate.core.arrays import Floats, finite_array
from palpate.core.shapes.gauge import gauge_of
from palpate.core.shapes.superquadric import Superquadric

FEWEST_ETA, FEWEST_OMEGA = 2, 3


class SurfacePoints(NamedTuple):
    """Points of a surface."""

    points: Floats
    """(n, 3), m."""
    normals: Floats
    """(n, 3): unit normals, outwards."""


class Angles(NamedTuple):
    """A grid of angles."""

    eta: Floats
    """(n,): from -pi/2 to pi/2, both ends taken, rad."""
    omega: Floats
    """(n,): from -pi to pi, the end left out, for it is the beginning, rad."""


def grid_of_angles(rows: int, columns: int) -> Angles:
    """A grid, row by row: eta rises with the row, omega with the column.

    Raises
    ------
    ValueError
        If there are not at least 2 rows and 3 columns.
    """
    if rows < FEWEST_ETA or columns < FEWEST_OMEGA:
        raise ValueError(
            f"a grid of angles must have at least {FEWEST_ETA} rows and {FEWEST_OMEGA} columns, "
            f"got {rows} and {columns}"
        )
    eta = np.linspace(-0.5 * math.pi, 0.5 * math.pi, rows)
    omega = -math.pi + 2.0 * math.pi / columns * np.arange(columns)
    return Angles(np.repeat(eta, columns), np.tile(omega, rows))


def trigonometric(shape: Superquadric, eta: ArrayLike, omega: ArrayLike) -> SurfacePoints:
    """Points of (2.1), with powers that keep the sign.

    Parameters
    ----------
    shape : Superquadric
        Whose surface it is.
    eta, omega : (n,) arrays
        Angles, rad.

    Raises
    ------
    ValueError
        If the angles are not finite or not as many of one as of the other.

    Notes
    -----
    Normals by Barr, *Superquadrics and angle-preserving transformations*, 1981: the same angles
    with exponents 2 - e over the semi-axes. They are finite everywhere, poles and seam too.
    """
    cos_eta, sin_eta, cos_omega, sin_omega = _cosines(eta, omega)

    def surface(e1: float, e2: float) -> Floats:
        across = _power(cos_eta, e1)
        return np.column_stack(
            [across * _power(cos_omega, e2), across * _power(sin_omega, e2), _power(sin_eta, e1)]
        )

    e1, e2 = shape.exponents.tolist()
    return SurfacePoints(
        shape.size * surface(e1, e2), _units(surface(2.0 - e1, 2.0 - e2) / shape.size)
    )


def regular(shape: Superquadric, eta: ArrayLike, omega: ArrayLike) -> SurfacePoints:
    """Points of (2.4) and (2.5): where the radii of the scaled solid meet its surface.

    Parameters, errors and units as for `trigonometric`. Normals across a crease are the mean of
    its two sides.
    """
    cos_eta, sin_eta, cos_omega, sin_omega = _cosines(eta, omega)
    radii = np.column_stack([cos_eta * cos_omega, cos_eta * sin_omega, sin_eta])
    gauge, slope = gauge_of(radii, shape.exponents)
    return SurfacePoints(shape.size * radii / gauge[:, None], _units(slope / shape.size))


def _cosines(eta: ArrayLike, omega: ArrayLike) -> tuple[Floats, Floats, Floats, Floats]:
    """Cosine and sine of both angles; those of a pole and of the seam exactly 0."""
    first = finite_array("eta", eta, (None,))
    second = finite_array("omega", omega, (len(first),))
    return _exact(np.cos(first)), np.sin(first), _exact(np.cos(second)), _exact(np.sin(second))


def _exact(value: Floats) -> Floats:
    """What is 0 but for the rounding of pi: its small powers would be far from 0."""
    return np.where(np.abs(value) < 4.0 * np.finfo(float).eps, 0.0, value)


def _power(value: Floats, exponent: float) -> Floats:
    """Power of the absolute value, with the sign."""
    return np.sign(value) * np.abs(value) ** exponent


def _units(vectors: Floats) -> Floats:
    length = np.sqrt(np.einsum("ni,ni->n", vectors, vectors))
    return np.asarray(vectors / length[:, None])
