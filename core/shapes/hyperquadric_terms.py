"""The terms of a hyperquadric along rays, with bounds.

Powers of linear forms, and exponential dents.

With g >= 1 a power |h|^g is convex along a ray: its tangent lies below it, and its chord above.
With g < 1 it is two concave branches that meet in a cusp at h = 0.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Floats, finite_array

LEAST_EXPONENT, LARGEST_EXPONENT = 0.1, 100.0
LEAST_NORMAL, LARGEST_NORMAL = 1e-9, 1e9  # 1/m
TINY = 1e-300
# Beyond it a quantity counts as this: a power of it that overflowed would say no more.
LARGEST = 1e3


@dataclass(frozen=True, slots=True, eq=False)
class Dent:
    """A term a exp(-sum |a_k x + b_k y + c_k z + d_k|^g_k) of a hyperquadric.

    `depth`: a: above 0 it dents the solid, below it swells it, 1. `planes` (n, 4): a_k, b_k, c_k in
    1/m, and d_k: the dent lies where all these are small. `exponents` (n,): g_k, 0.1 to 100. Raises
    ValueError if a number is not finite, an exponent out of range, there is no plane, or one of
    them faces nowhere.

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

    def line_below(self, h: Floats, rate: Floats, lengths: Floats) -> LinearBound:
        """A line below the term over the lengths: see `powers.line_below`."""
        values, slopes = self._ranges(h, rate, lengths)
        known = np.isfinite(slopes[0])
        here = self.along(h, rate)[0]
        return LinearBound(np.where(known, slopes[0], 0.0), np.where(known, 0.0, here - values[0]))

    def line_above(self, h: Floats, rate: Floats, lengths: Floats) -> LinearBound:
        """A line above the term over the lengths: see `powers.line_above`."""
        values, slopes = self._ranges(h, rate, lengths)
        known = np.isfinite(slopes[1])
        here = self.along(h, rate)[0]
        return LinearBound(np.where(known, slopes[1], 0.0), np.where(known, 0.0, values[1] - here))

    def dip(self, rate: Floats) -> float:
        """How much the term bends downwards anywhere along rays, 1/m2; infinite if unbounded.

        `rate` (k, n): derivatives of the planes' values along the rays.

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


def _most(power: Floats, exponent: Floats) -> Floats:
    """Largest value of y^power exp(-y^exponent) for y >= 0."""
    share = power / exponent
    result: Floats = share**share * np.exp(-share)  # 0^0 is 1
    return result


def range_of_powers(h: Floats, rate: Floats, exponents: Floats, lengths: Floats) -> Floats:
    """Least and largest power over the lengths, (2, k, n)."""
    first, last = powers(h, exponents), powers(h + rate * lengths, exponents)
    least = np.where(lengths >= _to_cusp(h, rate), 0.0, np.minimum(first, last))
    return np.stack([least, np.maximum(first, last)])


def range_of_slopes(h: Floats, rate: Floats, exponents: Floats, lengths: Floats) -> Floats:
    """Least and largest derivative of the powers over the lengths, (2, k, n); perhaps infinite."""
    after = h + rate * lengths
    first, last = (power_slopes(place, rate, exponents) for place in (h, after))
    ends = np.sort(np.stack([first, last]), axis=0)
    cusp = (exponents < 1.0) & ((lengths >= _to_cusp(h, rate)) | (h == 0.0)) & (rate != 0.0)
    return np.stack([np.where(cusp, -np.inf, ends[0]), np.where(cusp, np.inf, ends[1])])


def checked_terms(planes: Floats, exponents: Floats) -> tuple[Floats, Floats]:
    """Planes (n, 4) and exponents (n,) of some terms.

    Raises ValueError if there is none, their numbers differ, an exponent is out of range, or a
    plane faces nowhere.
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


class LinearBound(NamedTuple):
    """A line below or above a function from a place on."""

    slope: Floats  # 1/m
    gap: Floats  # How far from the function it begins


def powers(h: Floats, exponents: Floats) -> Floats:
    """Powers |h|^g, (k, n).

    `h` (k, n): quantities. `exponents` (k, 1): positive.
    """
    result: Floats = np.minimum(np.abs(h), LARGEST) ** exponents
    return result


def power_slopes(h: Floats, rate: Floats, exponents: Floats) -> Floats:
    """Derivatives of the powers along rays, (k, n); 0 in a cusp.

    `h` and `rate` (k, n): quantities, and their derivatives along the rays. `exponents` (k, 1):
    positive.
    """
    size = np.minimum(np.abs(h), LARGEST)
    result: Floats = exponents * (size + TINY) ** (exponents - 1.0) * (np.sign(h) * rate)
    return result


def line_below(h: Floats, rate: Floats, exponents: Floats, lengths: Floats) -> LinearBound:
    """Steepest line that begins at a power and stays below it over the lengths (n,)."""
    convex = exponents >= 1.0
    tangent = power_slopes(h, rate, exponents)
    if convex.all():
        return LinearBound(tangent, np.zeros_like(tangent))
    # A branch lies above its chord. If it ends in a cusp, all that is known is: not below 0.
    passed = ~convex & (lengths > _to_cusp(h, rate))
    chord = _chord(h, rate, exponents, lengths)
    slope = np.where(convex, tangent, np.where(passed, 0.0, chord))
    return LinearBound(slope, np.where(passed, powers(h, exponents), 0.0))


def line_above(h: Floats, rate: Floats, exponents: Floats, lengths: Floats) -> LinearBound:
    """Flattest line that begins at a power, or above it, and stays above it over the lengths."""
    convex = exponents >= 1.0
    chord = _chord(h, rate, exponents, lengths)
    if convex.all():
        return LinearBound(chord, np.zeros_like(chord))
    rise = chord * lengths
    passed = ~convex & ((lengths > _to_cusp(h, rate)) | (h == 0.0))
    gap = np.where(passed, np.maximum(rise, 0.0), 0.0)
    branch = power_slopes(h, rate, exponents)
    slope = np.where(passed, np.where(rise > 0.0, 0.0, np.maximum(branch, chord)), branch)
    return LinearBound(np.where(convex, chord, slope), gap)


def _chord(h: Floats, rate: Floats, exponents: Floats, lengths: Floats) -> Floats:
    """Mean slope of the powers over lengths."""
    rise = powers(h + rate * lengths, exponents) - powers(h, exponents)
    with np.errstate(divide="ignore", over="ignore", invalid="ignore"):
        return np.where(lengths > 0.0, rise / lengths, power_slopes(h, rate, exponents))


def _to_cusp(h: Floats, rate: Floats) -> Floats:
    """Way to where a quantity is 0; infinite if that is not ahead."""
    with np.errstate(divide="ignore", over="ignore", invalid="ignore"):
        return np.where(h * rate < 0.0, -h / rate, np.inf)
