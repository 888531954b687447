"""The inside-outside function of a superquadric, (2.6), as its logarithm.

F itself overflows or vanishes at a few times the size, with powers of up to 200 in it. Its
logarithm is twice that of the gauge, which is worked out by ratios and needs no power of anything
above 1: finite, and right to the last digits, at any point.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from palpate.core.arrays import Floats, finite_array
from palpate.core.shapes.gauge import LEAST, Norm, norm
from palpate.core.shapes.superquadric import LARGEST_EXPONENT


class InsideOutside(NamedTuple):
    """log F and its derivatives."""

    value: Floats
    """(n,): negative inside, 0 on the surface, positive outside; -1381 at the centre."""
    by_log: Floats
    """By the logarithms of the coordinates, (n, 3): between 0 and 2, and 2 in sum, but 0 at the
    centre. By the logarithms of the semi-axes it is the negative."""
    by_place: Floats
    """By the scaled coordinates, (n, 3)."""
    by_exponents: Floats
    """By e1 and e2, (n, 2)."""


def inside_outside(scaled: ArrayLike, exponents: ArrayLike) -> InsideOutside:
    """Logarithm of the inside-outside function.

    Parameters
    ----------
    scaled : (n, 3) array
        Points in the solid's own frame, divided by its semi-axes, 1.
    exponents : (2,) array
        e1 and e2, above 0 and up to 2.

    Raises
    ------
    ValueError
        If points are not finite, or an exponent is out of its range.

    Notes
    -----
    Fung, 1999, (2.6), with powers of absolute values. F is the square of the gauge; the distance
    along a radius is that from the centre, less its share 1 / sqrt(F). Exponents above 1 put
    creases into the coordinate planes. On a crease the derivative by the place is the mean of its
    two sides; it never exceeds twice the reciprocal of the gauge. At the centre, where there is
    none, all derivatives are 0.
    """
    points = finite_array("scaled", scaled, (None, 3))
    e1, e2 = finite_array("exponents", exponents, (2,)).tolist()
    if not (0.0 < e1 <= LARGEST_EXPONENT and 0.0 < e2 <= LARGEST_EXPONENT):
        raise ValueError(f"exponents must be above 0 and up to 2, got {[e1, e2]}")
    x, y, z = np.abs(points).T
    across = norm(x, y, np.asarray(e2))
    whole = norm(across.value, z, np.asarray(e1))
    outer, outer_z = _shares(whole)
    inner, inner_y = _shares(across)
    shares = np.stack([outer * inner, outer * inner_y, outer_z], axis=-1)
    slopes = np.stack([whole.by_x * across.by_x, whole.by_x * across.by_y, whole.by_y], axis=-1)
    by_e2 = outer * across.by_exponent / across.value
    by_e1 = whole.by_exponent / whole.value
    apart = (np.abs(points).max(axis=1) > LEAST)[:, None]
    return InsideOutside(
        2.0 * np.log(whole.value),
        np.where(apart, 2.0 * shares, 0.0),
        np.where(apart, 2.0 * np.sign(points) * slopes / whole.value[:, None], 0.0),
        np.where(apart, 2.0 * np.stack([by_e1, by_e2], axis=-1), 0.0),
    )


def _shares(at: Norm) -> tuple[Floats, Floats]:
    """How much of the sum of powers comes from each argument."""
    return at.by_x * at.share_x, at.by_y * at.share_y
