"""The exponential terms of a hyperquadric: local dents and bulges, with bounds along rays."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from palpate.core.arrays import Floats, finite_array
from palpate.core.shapes.powers import (
    Line,
    power_slopes,
    powers,
    range_of_powers,
    range_of_slopes,
)

LEAST_EXPONENT, LARGEST_EXPONENT = 0.1, 100.0
LEAST_NORMAL, LARGEST_NORMAL = 1e-9, 1e9
"""1/m."""


@dataclass(frozen=True, slots=True, eq=False)
class Dent:
    """A term a exp(-sum |a_k x + b_k y + c_k z + d_k|^g_k) of a hyperquadric.

    Parameters
    ----------
    depth : float
        a: above 0 it dents the solid, below it swells it, 1.
    planes : (n, 4) array
        a_k, b_k, c_k in 1/m, and d_k: the dent lies where all these are small.
    exponents : (n,) array
        g_k, 0.1 to 100.

    Raises
    ------
    ValueError
        If a number is not finite, an exponent out of range, there is no plane, or one of them
        faces nowhere.

    Notes
    -----
    Fung, 1999, (2.30).
    """

    depth: float
    planes: Floats
    exponents: Floats

    def __post_init__(self) -> None:
        if not math.isfinite(self.depth):
            raise ValueError(f"depth must be finite, got {self.depth}")
        planes, exponents = checked_terms(self.planes, self.exponents)
        object.__setattr__(self, "planes", planes)
        object.__setattr__(self, "exponents", exponents)

    def along(self, h: Floats, rate: Floats) -> tuple[Floats, Floats]:
        """Value and slope (n,) from the planes' values and rates (k, n)."""
        exponents = self.exponents[:, None]
        value = self.depth * np.exp(-powers(h, exponents).sum(axis=0))
        return value, -value * power_slopes(h, rate, exponents).sum(axis=0)

    def line_below(self, h: Floats, rate: Floats, lengths: Floats) -> Line:
        """A line below the term over the lengths: see `powers.line_below`."""
        values, slopes = self._ranges(h, rate, lengths)
        known = np.isfinite(slopes[0])
        here = self.along(h, rate)[0]
        return Line(np.where(known, slopes[0], 0.0), np.where(known, 0.0, here - values[0]))

    def line_above(self, h: Floats, rate: Floats, lengths: Floats) -> Line:
        """A line above the term over the lengths: see `powers.line_above`."""
        values, slopes = self._ranges(h, rate, lengths)
        known = np.isfinite(slopes[1])
        here = self.along(h, rate)[0]
        return Line(np.where(known, slopes[1], 0.0), np.where(known, 0.0, values[1] - here))

    def dip(self, rate: Floats) -> float:
        """How much the term bends downwards anywhere along rays, 1/m2; infinite if unbounded.

        Parameters
        ----------
        rate : (k, n) array
            Derivatives of the planes' values along the rays.

        Notes
        -----
        The second derivative is E (Q'^2 - Q'') with E = a exp(-Q). Each |h|^m exp(-|h|^g) is
        largest where |h|^g = m / g, and (sum q)^2 <= k sum q^2.
        """
        if (self.exponents < 2.0).any():
            return math.inf
        speed, g = np.abs(rate).max(axis=1), self.exponents
        if self.depth > 0.0:
            bends = g * (g - 1.0) * speed**2 * _most(g - 2.0, g)
        else:
            bends = len(g) * (g * speed) ** 2 * _most(2.0 * g - 2.0, g)
        return abs(self.depth) * float(bends.sum())

    def _ranges(self, h: Floats, rate: Floats, lengths: Floats) -> tuple[Floats, Floats]:
        """Least and largest value, and slope, over the lengths, (2, n) each."""
        exponents = self.exponents[:, None]
        least, most = range_of_powers(h, rate, exponents, lengths).sum(axis=1)
        factor = np.exp(-np.stack([most, least]))  # least and largest
        with np.errstate(invalid="ignore"):
            push = -self.depth * range_of_slopes(h, rate, exponents, lengths).sum(axis=1)
            low, high = push.min(axis=0), push.max(axis=0)
            slopes = np.stack(
                [low * np.where(low < 0.0, factor[1], factor[0]),
                 high * np.where(high > 0.0, factor[1], factor[0])]
            )  # fmt: skip
        return np.sort(self.depth * factor, axis=0), slopes


def checked_terms(planes: Floats, exponents: Floats) -> tuple[Floats, Floats]:
    """Planes (n, 4) and exponents (n,) of some terms.

    Raises
    ------
    ValueError
        If there is none, their numbers differ, an exponent is out of range, or a plane faces
        nowhere.
    """
    planes = finite_array("planes", planes, (None, 4))
    if not len(planes):
        raise ValueError("planes must be at least one, got none")
    length = np.hypot(np.hypot(planes[:, 0], planes[:, 1]), planes[:, 2])
    bad = ~((length >= LEAST_NORMAL) & (length <= LARGEST_NORMAL))
    if bad.any():
        raise ValueError(
            f"planes[{bad.argmax()}] must face somewhere: (a, b, c) must be {LEAST_NORMAL:g} to "
            f"{LARGEST_NORMAL:g} 1/m long, got {length[bad][0]:g}"
        )
    exponents = finite_array("exponents", exponents, (len(planes),))
    if not ((exponents >= LEAST_EXPONENT) & (exponents <= LARGEST_EXPONENT)).all():
        raise ValueError(
            f"exponents must lie between {LEAST_EXPONENT:g} and {LARGEST_EXPONENT:g}, "
            f"got {exponents.tolist()}"
        )
    return planes, exponents


def _most(power: Floats, exponent: Floats) -> Floats:
    """Largest value of y^power exp(-y^exponent) for y >= 0."""
    share = power / exponent
    result: Floats = share**share * np.exp(-share)  # 0^0 is 1
    return result
