"""From where a closed polygon is seen whole."""

from __future__ import annotations

import numpy as np
from scipy.optimize import linprog

from palpate.core.arrays import Floats

DEEP = 1e-3
"""Of the polygon's size: a place that sees it whole lies at least so far behind each edge."""


def kernel_point(polygon: Floats) -> Floats | None:
    """The place (2,) deepest behind all edges of a polygon, m; None if none sees it whole.

    Parameters
    ----------
    polygon : (n, 2) array
        Counter-clockwise, finite, m.

    Notes
    -----
    The edges' half planes have the kernel in common (Lee and Preparata, *An optimal algorithm for
    finding the kernel of a polygon*, 1979); here a linear programme finds the middle of the
    largest disc in it.
    """
    middle = polygon.mean(axis=0)
    size = float(np.abs(polygon - middle).max())
    if not size > 0.0:
        return None
    corners = (polygon - middle) / size
    edges = np.roll(corners, -1, axis=0) - corners
    lengths = np.linalg.norm(edges, axis=1)
    corners, edges = corners[lengths > 0.0], edges[lengths > 0.0]
    outward = np.column_stack([edges[:, 1], -edges[:, 0]]) / lengths[lengths > 0.0, None]
    behind = np.einsum("ni,ni->n", outward, corners)
    rows = np.column_stack([outward, np.ones(len(outward))])
    bounds = [(-1.0, 1.0), (-1.0, 1.0), (DEEP, 2.0)]
    found = linprog([0.0, 0.0, -1.0], A_ub=rows, b_ub=behind, bounds=bounds)
    if found.x is None:
        return None
    place: Floats = middle + size * found.x[:2]
    return place
