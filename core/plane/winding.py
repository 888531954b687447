"""How often a closed polygon goes round a point."""

from __future__ import annotations

import numpy as np

from palpate.core.arrays import Floats, Ints, finite_array
from palpate.core.plane.closed_polygon import closed_polygon


def winding_number(polygon: Floats, points: Floats) -> Ints:
    """Turns (k,) that a closed polygon (n, 2) makes around points (k, 2); 0 outside.

    Positive counter-clockwise. Edges that cross the level of a point to its right are counted,
    so that no angle is ever taken: Sunday, *Inclusion of a point in a polygon*, 2001.

    Raises
    ------
    ValueError
        If the polygon has no vertex, or something is not finite or of another shape.
    """
    polygon, points = closed_polygon(polygon), finite_array("points", points, (None, 2))
    starts, ends = polygon, np.roll(polygon, -1, axis=0)
    along = ends - starts
    away = points[:, None, :] - starts
    left = along[:, 0] * away[:, :, 1] - along[:, 1] * away[:, :, 0]
    begins_below = starts[:, 1] <= points[:, 1, None]
    ends_below = ends[:, 1] <= points[:, 1, None]
    up = begins_below & ~ends_below & (left > 0.0)
    down = ~begins_below & ends_below & (left < 0.0)
    turns: Ints = (up.sum(axis=1) - down.sum(axis=1)).astype(np.int32)
    return turns
