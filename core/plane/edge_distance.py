"""How far points are from the edges of a polygon."""

from __future__ import annotations

import numpy as np

from palpate.core.arrays import Floats, finite_array
from palpate.core.plane.closed_polygon import closed_polygon


def edge_distance(polygon: Floats, points: Floats) -> Floats:
    """Distance (k,) of points (k, 2) to the nearest edge of a closed polygon (n, 2), m.

    To the edges, not to the lines that they lie on.

    Raises
    ------
    ValueError
        If the polygon has no vertex, or something is not finite or of another shape.
    """
    polygon, points = closed_polygon(polygon), finite_array("points", points, (None, 2))
    along = np.roll(polygon, -1, axis=0) - polygon
    squares = np.einsum("nd,nd->n", along, along)
    away = points[:, None, :] - polygon
    share = np.einsum("knd,nd->kn", away, along) / np.where(squares > 0.0, squares, 1.0)
    off = away - np.clip(share, 0.0, 1.0)[:, :, None] * along
    distance: Floats = np.sqrt(np.einsum("knd,knd->kn", off, off).min(axis=1))
    return distance
