"""The largest circle inside a polygon, wherever it lies."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.plane.closed_polygon import closed_polygon
from palpate.core.plane.edge_distance import edge_distance
from palpate.core.plane.winding import winding_number

CELLS = 12
"""Across the longer side of the box around the polygon, at the beginning."""
TOLERANCE = 1e-3
"""Of the longer side: no circle is larger by more."""
POLISHED = 1e-9
"""Of the longer side: steps by which the middle of the best one is moved at last."""
AT_ONCE = 1000
"""Cells whose distances are taken together, so that memory stays small."""
CORNERS: Floats = 0.5 * np.array([[-1.0, -1.0], [-1.0, 1.0], [1.0, -1.0], [1.0, 1.0]])
"""Middles of a square's quarters, in halves of its side."""
CORNERS.setflags(write=False)
AROUND: Floats = np.array([[np.cos(a), np.sin(a)] for a in 2 * np.pi * np.arange(16) / 16])
"""Directions in which the middle is moved."""
AROUND.setflags(write=False)


class Circle(NamedTuple):
    """A circle in the plane."""

    middle: Floats
    """(2,), m."""
    radius: float
    """m; 0 where the polygon encloses nothing."""


def inscribed_circle(polygon: Floats) -> Circle:
    """The largest circle inside a closed polygon (n, 2), m, which need not be convex.

    Its middle is inside where that of the box, or of the area, is not: in a U or a C.

    Raises
    ------
    ValueError
        If the polygon has fewer than 3 vertices or is not finite.

    Notes
    -----
    Squares that may hold the middle of a larger circle than the best one so far are quartered:
    the distance to the edges changes by no more than the way. So the result is the largest
    one to a tolerance of 1e-3 of the polygon's size, however many local ones there are. Then
    its middle climbs on by steps to ever nearer places.
    """
    polygon = closed_polygon(polygon, least=3)
    low, high = polygon.min(axis=0), polygon.max(axis=0)
    size = float((high - low).max())
    best = Circle(0.5 * (low + high), 0.0)
    if size == 0.0:
        return best
    around = (polygon - best.middle) / size
    side = 1.0 / CELLS
    steps = [np.arange(np.ceil(extent / (size * side)) + 1) for extent in high - low]
    grid = np.stack(np.meshgrid(*steps, indexing="ij"), axis=-1).reshape(-1, 2)
    cells = (grid - 0.5 * grid.max(axis=0)) * side
    found = Circle(np.zeros(2), 0.0)
    while len(cells):
        depth = _depth(around, cells)
        deepest = int(np.argmax(depth))
        if depth[deepest] > found.radius:
            found = Circle(cells[deepest], float(depth[deepest]))
        promising = depth + np.sqrt(0.5) * side > found.radius + TOLERANCE
        side *= 0.5
        cells = (cells[promising][:, None, :] + side * CORNERS).reshape(-1, 2)
    found = _polish(around, found, TOLERANCE)
    return Circle(best.middle + size * found.middle, size * found.radius)


def _polish(polygon: Floats, circle: Circle, step: float) -> Circle:
    """The circle, moved to where no place around it is deeper."""
    while step > POLISHED:
        near = circle.middle + step * AROUND
        depth = _depth(polygon, near)
        deepest = int(np.argmax(depth))
        if depth[deepest] > circle.radius:
            circle = Circle(near[deepest], float(depth[deepest]))
        else:
            step *= 0.5
    return circle


def _depth(polygon: Floats, points: Floats) -> Floats:
    """Distance (k,) to the edges, negative outside."""
    parts = [points[first : first + AT_ONCE] for first in range(0, len(points), AT_ONCE)]
    return np.concatenate(
        [
            np.where(winding_number(polygon, part) != 0, 1.0, -1.0) * edge_distance(polygon, part)
            for part in parts
        ]
    )
