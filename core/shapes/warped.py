"""A superquadric that is tapered, then bent, cast exactly.

Bent back and untapered, a straight ray is a curve c(t), and the superquadric is where the
gauge N(c) is below 1. Multiplied by the section's width w, which clears the denominators,

    f(t) = N(w c) - w

is convex but for the curve's own bending: N is a norm, so f'' >= -N((w c)'') - |w''|, which is
bounded in terms of the solid alone. With that bound no root is passed, however thin the part
of the solid that a ray meets.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.shapes.bend import Bend
from palpate.core.shapes.bent_box import through_bent_box
from palpate.core.shapes.first_root import Which, first_roots
from palpate.core.shapes.protocol import INSIDE, MISS, Mesh
from palpate.core.shapes.superquadric import RANGE_TOLERANCE, Superquadric
from palpate.core.shapes.taper import Taper

LARGEST_SHARE = 0.98
"""Of the bend at which the inner side is squeezed to nothing, or the ends meet."""


class WarpedSuperquadric:
    """A superquadric about the origin, tapered along z, then bent.

    Parameters
    ----------
    base : Superquadric
        What is tapered and bent.
    taper : (2,) array
        Widening of x and y at the top, as a share: see `Taper`.
    bend : Bend
        How the tapered solid is bent.

    Raises
    ------
    ValueError
        If a taper collapses the solid, or the bend squeezes its inner side to nothing or
        closes it to a ring.

    Notes
    -----
    Taper, then bend: in the other order they give another solid.
    """

    def __init__(self, base: Superquadric, taper: Floats, bend: Bend = NO_BEND):
        self._base = base
        self._taper = Taper(float(taper[0]), float(taper[1]), float(base.size[2]))
        self._bend = bend
        self._half = bend_box(base, taper, bend.direction)
        most = most_bend(base, taper, bend.direction)
        if not abs(bend.curvature) <= most:
            raise ValueError(
                f"bend must lie between {-most:.4g} and {most:.4g} 1/m for a solid of this size and "
                f"taper, or it folds: got {bend.curvature:g}"
            )
        cosine, sine = bend.towards
        self._turn = np.array([[cosine, sine, 0.0], [-sine, cosine, 0.0], [0.0, 0.0, 1.0]])

    def bounds(self) -> Floats:
        """Smallest and largest coordinates of a fine tessellation, (2, 3), m."""
        vertices = self.mesh(BOUNDS_LEVEL).vertices
        return np.stack([vertices.min(axis=0), vertices.max(axis=0)])
