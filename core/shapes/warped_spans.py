"""Bounds along rays of what is 0 on the surface of a tapered and bent superquadric.

That is f = N(c) - w with a norm N of a curve c and a width w: `Straightening`. Neither second
derivative is larger than known. So f lies above its parabola; and N(c) lies below the chord of
the norm along the curve's tangent, which is convex, and a parabola for what the curve leaves it.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from palpate.core.arrays import Floats, Ints
from palpate.core.shapes.certain_march import Below, Floor
from palpate.core.shapes.first_root import Gap
from palpate.core.shapes.straighten import Curve
from palpate.core.shapes.superquadric import TINY

CurveAt = Callable[[Floats, Ints], Curve]
"""Places (m,) on those of the rays that are named: the curves there."""
Norm = Callable[[Floats, Floats], tuple[Floats, Floats]]
"""Places and slopes (3, m): a norm and its slope."""


def outside_below(curve: CurveAt, norm: Norm, dip: float, gaps: tuple[Gap, ...]) -> Below:
    """Bounds from below of f, which bends down by `dip` at most.

    Parameters
    ----------
    curve, norm : functions
        Give c, w and N.
    dip : float
        N(c'') + |w''| at most, 1/m2.
    gaps : tuple of gaps
        Where f is known to be positive and nothing else is.
    """

    def floor(places: Floats, lengths: Floats, which: Ints) -> Floor:
        in_gap = np.zeros(len(places), bool)
        for begin, end in ((begin[which], end[which]) for begin, end in gaps):
            within = (begin <= places) & (places < end)
            stop = np.where(places < begin, begin, np.where(within, end, np.inf))
            lengths = np.minimum(lengths, stop - places)
            in_gap = in_gap | within
        with np.errstate(divide="ignore", over="ignore", invalid="ignore"):  # only in gaps
            at = curve(places, which)
            value, slope = norm(at.place, at.slope)
        value = np.where(in_gap, 1.0, value - at.width)
        slope = np.where(in_gap, 0.0, slope - at.width_slope)
        bend = np.where(in_gap, 0.0, dip)
        return Floor(value, slope, bend, lengths, np.zeros_like(value))

    return floor


def inside_below(curve: CurveAt, norm: Norm, dip: float) -> Below:
    """Bounds from below of -f, for places inside; parameters as of `outside_below`."""

    def floor(places: Floats, lengths: Floats, which: Ints) -> Floor:
        at = curve(places, which)
        here = norm(at.place, at.slope)[0]
        there = norm(at.place + lengths * at.slope, at.slope)[0]
        rise = (there - here) / (lengths + TINY)
        bend = np.full_like(places, dip)
        return Floor(at.width - here, at.width_slope - rise, bend, lengths, np.zeros_like(here))

    return floor
