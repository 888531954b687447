"""The gauge of a superquadric, the root of (2.6), with its derivatives up to the second.

The gauge is a norm of a norm. Each is worked out from the ratio of its smaller to its larger
argument, so that no power can overflow and no digits are lost: what a power of 2/e does to a
rounding, the root of the sum takes back.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Floats

LEAST = 1e-300
"""Stands for 0 in a logarithm or a divisor."""
RIDGE = 1e-3
"""Of the gauge: nearer to a coordinate plane, exponents above 1 have unbounded second derivatives,
which are taken here instead. They hold over no step that anybody would take."""


class Norm(NamedTuple):
    """(x^p + y^p)^(1/p) with p = 2/e, of numbers that are not negative, and its slopes."""

    value: Floats
    by_x: Floats
    by_y: Floats
    by_exponent: Floats
    share_x: Floats
    """x as a share of the norm."""
    share_y: Floats


class Curve(NamedTuple):
    """How the slope of a norm along a direction changes."""

    slope: Floats
    """Along the direction itself."""
    by_x: Floats
    by_y: Floats
    by_exponent: Floats


def norm(x: Floats, y: Floats, e: Floats) -> Norm:
    """The norm of exponent `e`, up to 2; all arguments have a common shape or broadcast to it."""
    p = 2.0 / e
    larger = np.maximum(np.maximum(x, y), LEAST)
    ratio = np.minimum(x, y) / larger
    part = ratio**p
    total = 1.0 + part
    value = larger * total ** (1.0 / p)
    log_part = p * np.log(np.maximum(ratio, LEAST))
    # The entropy of the two parts: by_exponent is half of it, times the norm.
    entropy = np.log1p(part) - part / total * log_part
    share_x, share_y = x / value, y / value
    return Norm(
        value,
        share_x ** (p - 1.0),
        share_y ** (p - 1.0),
        0.5 * value * entropy,
        share_x,
        share_y,
    )


def curve(at: Norm, along_x: Floats, along_y: Floats, e: Floats) -> Curve:
    """Second derivatives of a norm, of which one is taken along a direction."""
    p = 2.0 / e
    x, y = at.share_x, at.share_y
    slope = at.by_x * along_x + at.by_y * along_y
    sharpness = (np.maximum(x, RIDGE) * np.maximum(y, RIDGE)) ** (p - 2.0)
    turn = (p - 1.0) / at.value * sharpness * (y * along_x - x * along_y)
    half = 0.5 * p * p
    by_exponent = -(p - 1.0) * at.by_exponent / at.value * slope
    for share, part in ((x, at.by_x * along_x), (y, at.by_y * along_y)):
        by_exponent = by_exponent - half * part * np.log(np.maximum(share, RIDGE**4))
    return Curve(slope, turn * y, -turn * x, by_exponent)


def gauge_of(scaled: Floats, exponents: Floats) -> tuple[Floats, Floats]:
    """Gauge (n,) and its gradient (n, 3), at points (n, 3) divided by the semi-axes.

    Across a crease, which exponents above 1 have in the coordinate planes, the gradient is the
    mean of its two sides; at the centre it is 0.
    """
    x, y, z = np.abs(scaled).T
    e1, e2 = exponents
    across = norm(x, y, np.asarray(e2))
    whole = norm(across.value, z, np.asarray(e1))
    slopes = (whole.by_x * across.by_x, whole.by_x * across.by_y, whole.by_y)
    return whole.value, np.sign(scaled) * np.stack(slopes, axis=-1)
