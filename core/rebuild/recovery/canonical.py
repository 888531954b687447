"""One description of a solid among those that mean the same.

A superquadric is the same after a half turn about each of its axes, and after a quarter turn about
z with its two widths exchanged.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Floats


class Solid(NamedTuple):
    """A superquadric, tapered and bent, in some unit of length."""

    size: Floats
    exponents: Floats
    axes: Floats
    """(3, 3), as columns."""
    taper: Floats
    bend: Floats
    """Curvature times direction, (2,)."""


QUARTER_TURN: Floats = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
HALF_TURNS: Floats = np.array([[1.0, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]])
"""Diagonals of the rotations by half a turn about no axis, x, y and z."""


def canonical(solid: Solid) -> Solid:
    """The description with the larger width along x and the axes least turned from the world's."""
    if solid.size[1] > solid.size[0]:
        solid = Solid(
            solid.size[[1, 0, 2]],
            solid.exponents,
            solid.axes @ QUARTER_TURN,
            solid.taper[::-1],
            np.array([solid.bend[1], -solid.bend[0]]),
        )
    signs = HALF_TURNS[int(np.argmax(HALF_TURNS @ np.diagonal(solid.axes)))]
    return solid._replace(
        axes=solid.axes * signs, taper=solid.taper * signs[2], bend=solid.bend * signs[:2]
    )
