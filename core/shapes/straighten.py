"""Rays as they look in a superquadric's own box: bent back, untapered, by its semi-axes.

There a ray is a curve c(t), and the solid is where the gauge N(c) is below 1. A taper divides by
the width w of the section; w c, which `Straightener.along` gives, has no denominators, and

    f(t) = N(w c) - w

has the solid's surface for its roots. N is a norm, so f falls short of being convex by no more
than the curve itself bends: f'' >= -N((w c)'') - |w''|, which `Straightener.dip` bounds.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.shapes.bend import Bend


class Curve(NamedTuple):
    """A place on each of some curves, times the width there, and the derivatives."""

    place: Floats
    """Place times width, by coordinate, in semi-axes, (3, n)."""
    slope: Floats
    """Its derivative, (3, n)."""
    width: Floats
    """Width of the section, (n,)."""
    width_slope: Floats
    """Its derivative, (n,)."""


class Straightener:
    """Undoes a taper and a bend along rays.

    Rays are given by their coordinates towards the bend's centre, square to its plane, and up.

    Parameters
    ----------
    size : (3,) array
        Semi-axes, m.
    taper : (2,) array
        Widening of x and y at the top.
    bend : Bend
        The bend.
    """

    def __init__(self, size: Floats, taper: Floats, bend: Bend):
        self._bend = bend
        towards = bend.towards
        ...

    def along(self, places: Floats, direction: Floats) -> Curve:
        """Curves at places (3, n) of rays in a direction (3,) or (3, n)."""
        k = self._bend.curvature
        u, v, height = places
        du, dv, dheight = direction
        r, z, stretch, cosine, sine = self._bend.unbend(u, height)
        dr = cosine * du - sine * dheight
        dz = (cosine * dheight + sine * du) / stretch
        ...
