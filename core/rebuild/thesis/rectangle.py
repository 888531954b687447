"""The largest rectangle of given place and proportions inside a polygon."""

from __future__ import annotations

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.plane.winding import winding_number


def rectangle_scale(polygon: Floats, middle: Floats, half_sides: Floats) -> float:
    """The largest factor of a rectangle's half sides for which it lies inside a polygon.

    Parameters
    ----------
    polygon : (n, 2) array
        Closed, need not be convex.
    middle : (2,) array
        Of the rectangle.
    half_sides : (2,) array
        Along x and y; positive.

    Returns
    -------
    float
        1; 0 where the middle is not inside.

    Notes
    -----
    In the plane in which the rectangle is the square from -1 to 1 this is the distance of the
    middle from the polygon's edges, by the larger coordinate. Along an edge it is convex and
    made of straight pieces: its least value is at an end, or where a coordinate is 0, or where
    both are of one size.
    """
    starts = (polygon - middle) / half_sides
    if winding_number(starts, np.zeros((1, 2)))[0] == 0:
        return 0.0
    along = np.roll(starts, -1, axis=0) - starts
    (x, y), (dx, dy) = starts.T, along.T
    wanted, pace = np.stack([-x, -y, y - x, -x - y]), np.stack([dx, dy, dx - dy, dx + dy])
    shares = np.divide(wanted, pace, out=np.zeros_like(wanted), where=pace != 0.0)
    places = starts + np.clip(shares, 0.0, 1.0)[:, :, None] * along
    return float(np.abs(np.concatenate([places, starts[None]])).max(axis=2).min())
