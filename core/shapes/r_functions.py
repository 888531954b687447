"""R-functions: the Boolean algebra of solids that are given as f >= 0.

Fung, 1999, (2.33) to (2.37), in a form in which no digits cancel and nothing overflows. With
S the root of f1^2 + f2^2 - 2 omega f1 f2, the product (f1 + f2 + S)(f1 + f2 - S) is
2 (1 + omega) f1 f2. Of the two factors only the larger one is ever computed from its sum.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from palpate.core.arrays import Floats, Ints

LARGEST = float(np.finfo(np.float64).max)
LEAST = float(np.finfo(np.float64).smallest_subnormal)


class _Scaled(NamedTuple):
    """Two values over a power of two, so that the larger lies between 1/2 and 1."""

    first: Floats
    second: Floats
    power: Ints  # Of two, by which they were divided
    root: Floats  # S, scaled alike


def complement(f: ArrayLike) -> Floats:
    """All that is not in a solid: -f."""
    return -_finite("f", f)


def conjunction(f1: ArrayLike, f2: ArrayLike, omega: float = 0.0, *, smoothness: int = 0) -> Floats:
    """Intersection of two solids.

    `f1` and `f2`: values of the defining functions, positive inside. `omega`: above -1, at most 1.
    With 1 it is the minimum; 0 is the usual choice. `smoothness`: how often the result can be
    differentiated where both functions vanish. The value grows with this power of the functions
    beside their own: (2.37). Returns positive where both are. A value that would leave the range of
    floating point numbers stays at its end and keeps its sign. Raises ValueError if a value is not
    finite, omega not in (-1, 1], or the smoothness negative.
    """
    return -disjunction(complement(f1), complement(f2), omega, smoothness=smoothness)


def disjunction(f1: ArrayLike, f2: ArrayLike, omega: float = 0.0, *, smoothness: int = 0) -> Floats:
    """Union of two solids; parameters, result and errors as of `conjunction`."""
    first, second, omega = _checked(f1, f2, omega, smoothness)
    scaled = _scaled(first, second, omega)
    total = scaled.first + scaled.second
    factor = np.abs(total) + scaled.root
    one_is_larger = np.abs(first) >= np.abs(second)
    smaller = np.where(one_is_larger, second, first)
    larger = np.abs(np.where(one_is_larger, scaled.first, scaled.second))
    safe = np.where(factor > 0.0, factor, 1.0)
    with np.errstate(over="ignore"):
        added = np.ldexp(factor / (1.0 + omega), scaled.power)
        # Unscaled, for a value far smaller than the other one must not be lost.
        value = np.where(total >= 0.0, added, 2.0 * (larger / safe) * smaller)
        if smoothness:
            value = value * np.minimum(np.hypot(first, second) ** smoothness, LARGEST)
    sign = np.where(total >= 0.0, (factor > 0.0).astype(float), np.sign(smaller))
    return np.asarray(sign * np.clip(np.abs(value), LEAST, LARGEST))


def difference(f1: ArrayLike, f2: ArrayLike, omega: float = 0.0, *, smoothness: int = 0) -> Floats:
    """The first solid without the second; parameters, result and errors as of `conjunction`."""
    return conjunction(f1, complement(f2), omega, smoothness=smoothness)


def conjunction_slopes(
    f1: ArrayLike, f2: ArrayLike, omega: float = 0.0, *, smoothness: int = 0
) -> tuple[Floats, Floats]:
    """Derivatives of `conjunction` by f1 and by f2; parameters and errors as there.

    Where there is no derivative (both functions vanish; with omega 1, they are equal) each is
    1 / (1 + omega), the middle of what is found nearby; with a smoothness, 0.
    """
    first, second, omega = _checked(f1, f2, omega, smoothness)
    scaled = _scaled(first, second, omega)
    one = _slope(scaled.first, scaled.second, scaled.root, omega)
    two = _slope(scaled.second, scaled.first, scaled.root, omega)
    if not smoothness:
        return one, two
    size = np.hypot(scaled.first, scaled.second)
    safe = np.where(size > 0.0, size, 1.0)
    value = conjunction(scaled.first / safe, scaled.second / safe, omega)
    with np.errstate(over="ignore"):
        power = np.minimum(np.hypot(first, second) ** smoothness, LARGEST)
        one = power * (one + smoothness * value * scaled.first / safe)
        two = power * (two + smoothness * value * scaled.second / safe)
    return np.clip(one, -LARGEST, LARGEST), np.clip(two, -LARGEST, LARGEST)


def disjunction_slopes(
    f1: ArrayLike, f2: ArrayLike, omega: float = 0.0, *, smoothness: int = 0
) -> tuple[Floats, Floats]:
    """Derivatives of `disjunction` by f1 and by f2; see `conjunction_slopes`."""
    return conjunction_slopes(complement(f1), complement(f2), omega, smoothness=smoothness)


def difference_slopes(
    f1: ArrayLike, f2: ArrayLike, omega: float = 0.0, *, smoothness: int = 0
) -> tuple[Floats, Floats]:
    """Derivatives of `difference` by f1 and by f2; see `conjunction_slopes`."""
    one, two = conjunction_slopes(f1, complement(f2), omega, smoothness=smoothness)
    return one, -two


def _slope(mine: Floats, other: Floats, root: Floats, omega: float) -> Floats:
    """(1 - (mine - omega other) / S) / (1 + omega): all terms added have one sign."""
    # The difference that is exact comes first, so that little is lost as omega nears 1 or -1.
    if omega > 0.0:
        lean = (mine - other) + (1.0 - omega) * other
    else:
        lean = (mine + other) - (1.0 + omega) * other
    safe = np.where(root > 0.0, root, 1.0)
    share, lean = other / safe, lean / safe
    small = (1.0 - omega) * share * share / (1.0 + np.maximum(lean, 0.0))
    large = (1.0 - np.minimum(lean, 0.0)) / (1.0 + omega)
    found = np.where(lean > 0.0, small, large)
    return np.where(root > 0.0, found, 1.0 / (1.0 + omega))


def _scaled(first: Floats, second: Floats, omega: float) -> _Scaled:
    power = np.frexp(np.maximum(np.abs(first), np.abs(second)))[1]
    a, b = np.ldexp(first, -power), np.ldexp(second, -power)
    apart, together = math.sqrt(0.5 * (1.0 + omega)), math.sqrt(0.5 * (1.0 - omega))
    return _Scaled(a, b, power, np.hypot(apart * (a - b), together * (a + b)))


def _checked(
    f1: ArrayLike, f2: ArrayLike, omega: float, smoothness: int
) -> tuple[Floats, Floats, float]:
    if not -1.0 < omega <= 1.0:
        raise ValueError(f"omega must be above -1 and at most 1, got {omega}")
    if smoothness < 0:
        raise ValueError(f"smoothness must be 0 or more, got {smoothness}")
    first, second = np.broadcast_arrays(_finite("f1", f1), _finite("f2", f2))
    return first, second, float(omega)


def _finite(name: str, value: ArrayLike) -> Floats:
    array = np.asarray(value, dtype=np.float64)
    if not np.isfinite(array).all():
        raise ValueError(f"{name} must be finite")
    return array
