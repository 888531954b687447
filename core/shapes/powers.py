"""Powers |h|^g of quantities h that are affine along rays, and lines below and above them.

With g >= 1 a power is convex along a ray: its tangent lies below it, and its chord above.
With g < 1 it is two concave branches that meet in a cusp at h = 0.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Floats

TINY = 1e-300
LARGEST = 1e3
"""Beyond it a quantity counts as this: a power of it that overflowed would say no more."""


class Line(NamedTuple):
    """A line below or above a function from a place on."""

    slope: Floats
    """1/m."""
    gap: Floats
    """How far from the function it begins."""


def powers(h: Floats, exponents: Floats) -> Floats:
    """Powers |h|^g, (k, n).

    Parameters
    ----------
    h : (k, n) array
        Quantities.
    exponents : (k, 1) array
        Positive.
    """
    result: Floats = np.minimum(np.abs(h), LARGEST) ** exponents
    return result


def power_slopes(h: Floats, rate: Floats, exponents: Floats) -> Floats:
    """Derivatives of the powers along rays, (k, n); 0 in a cusp.

    Parameters
    ----------
    h, rate : (k, n) arrays
        Quantities, and their derivatives along the rays.
    exponents : (k, 1) array
        Positive.
    """
    size = np.minimum(np.abs(h), LARGEST)
    result: Floats = exponents * (size + TINY) ** (exponents - 1.0) * (np.sign(h) * rate)
    return result


def line_below(h: Floats, rate: Floats, exponents: Floats, lengths: Floats) -> Line:
    """Steepest line that begins at a power and stays below it over the lengths (n,)."""
    convex = exponents >= 1.0
    tangent = power_slopes(h, rate, exponents)
    if convex.all():
        return Line(tangent, np.zeros_like(tangent))
    # A branch lies above its chord. If it ends in a cusp, all that is known is: not below 0.
    passed = ~convex & (lengths > _to_cusp(h, rate))
    chord = _chord(h, rate, exponents, lengths)
    slope = np.where(convex, tangent, np.where(passed, 0.0, chord))
    return Line(slope, np.where(passed, powers(h, exponents), 0.0))


def line_above(h: Floats, rate: Floats, exponents: Floats, lengths: Floats) -> Line:
    """Flattest line that begins at a power, or above it, and stays above it over the lengths."""
    convex = exponents >= 1.0
    chord = _chord(h, rate, exponents, lengths)
    if convex.all():
        return Line(chord, np.zeros_like(chord))
    rise = chord * lengths
    passed = ~convex & ((lengths > _to_cusp(h, rate)) | (h == 0.0))
    gap = np.where(passed, np.maximum(rise, 0.0), 0.0)
    branch = power_slopes(h, rate, exponents)
    slope = np.where(passed, np.where(rise > 0.0, 0.0, np.maximum(branch, chord)), branch)
    return Line(np.where(convex, chord, slope), gap)


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


def _to_cusp(h: Floats, rate: Floats) -> Floats:
    """Way to where a quantity is 0; infinite if that is not ahead."""
    with np.errstate(divide="ignore", over="ignore", invalid="ignore"):
        return np.where(h * rate < 0.0, -h / rate, np.inf)


def _chord(h: Floats, rate: Floats, exponents: Floats, lengths: Floats) -> Floats:
    """Mean slope of the powers over lengths."""
    rise = powers(h + rate * lengths, exponents) - powers(h, exponents)
    with np.errstate(divide="ignore", over="ignore", invalid="ignore"):
        return np.where(lengths > 0.0, rise / lengths, power_slopes(h, rate, exponents))
