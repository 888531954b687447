"""The largest ellipse of given place and proportions inside a polygon."""

from __future__ import annotations

import numpy as np

from palpate.core.arrays import Floats, finite_array
from palpate.core.plane.edge_distance import edge_distance
from palpate.core.plane.winding import winding_number


def ellipse_scale(polygon: Floats, middle: Floats, semi_axes: Floats) -> float:
    """The largest factor of an ellipse's semi-axes for which it lies inside a polygon.

    Parameters
    ----------
    polygon : (n, 2) array
        Closed, need not be convex, m.
    middle : (2,) array
        Centre of the ellipse, m.
    semi_axes : (2,) array
        Along x and y, m.

    Returns
    -------
    float
        1; 0 where the middle is not inside.

    Raises
    ------
    ValueError
        If a shape is wrong, a number not finite, or a semi-axis not positive.

    Notes
    -----
    In the plane in which the ellipse is the unit circle this is the distance of its middle
    from the polygon's edges: the answer to the search of Fung, 1999, table 4.2, which also
    tests the edges as if they were infinite lines.
    """
    polygon = finite_array("polygon", polygon, (None, 2))
    middle = finite_array("middle", middle, (2,))
    semi_axes = finite_array("semi_axes", semi_axes, (2,))
    if not (semi_axes > 0.0).all():
        raise ValueError(f"semi_axes must be positive, got {semi_axes.tolist()} m")
    around = (polygon - middle) / semi_axes
    origin = np.zeros((1, 2))
    if winding_number(around, origin)[0] == 0:
        return 0.0
    return float(edge_distance(around, origin)[0])
