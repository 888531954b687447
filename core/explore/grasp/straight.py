"""The axis along which a surface runs straight, as that of a box or a column, from its normals.

Most normals of such a surface are square to its axis, wherever its contacts lie; those of its two
ends are not, and count for nothing.
"""

from __future__ import annotations

import math

import numpy as np

from palpate.core.arrays import Floats

NEAR = tuple(math.radians(one) for one in (20.0, 10.0, 5.0, 2.5, 1.5))
"""Normals that are square to the axis but for less are those of the sides; closer each time."""
FEWEST, LEAST_STRAIGHT = 10, 0.4
"""Contacts of straight sides, at least; and their share of those that face sideways at all: of a
round surface far fewer do."""
ROUND_ABOUT = 0.05
"""Share of the sides' normals, at least, in the direction that has fewest: else the axis may turn
about the only direction in which they point."""


def straight_axis(normals: Floats, axis: Floats) -> Floats | None:
    """The axis near another one to which the sides' normals are square; None if they are not.

    Parameters
    ----------
    normals : (n, 3) array
        Of the contacts, unit vectors.
    axis : (3,) array
        About where it lies, a unit vector.
    """
    facing = int((np.abs(normals @ axis) < math.sin(NEAR[0])).sum())
    for near in NEAR:
        sides = normals[np.abs(normals @ axis) < math.sin(near)]
        if len(sides) < max(FEWEST, LEAST_STRAIGHT * facing):
            return None
        spread, directions = np.linalg.eigh(sides.T @ sides / len(sides))
        found = directions[:, 0]
        axis = found if found @ axis > 0.0 else -found
    return np.asarray(axis) if spread[1] >= ROUND_ABOUT else None
