"""Area and orientation of a closed polygon."""

from __future__ import annotations

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.plane.closed_polygon import closed_polygon


def signed_area(polygon: Floats) -> float:
    """Area of a closed polygon (n, 2), m^2: positive where it runs counter-clockwise.

    About its first vertex, so that a small polygon far from the origin keeps its digits.

    Raises
    ------
    ValueError
        If the polygon has no vertex, or is not finite (n, 2).
    """
    polygon = closed_polygon(polygon)
    near = polygon - polygon[0]
    following = np.roll(near, -1, axis=0)
    twice = near[:, 0] * following[:, 1] - following[:, 0] * near[:, 1]
    return 0.5 * float(twice.sum())
