"""The middle of what a contour encloses."""

from __future__ import annotations

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.plane.closed_polygon import closed_polygon
from palpate.core.plane.signed_area import signed_area

FLAT = 1e-9
"""Area, as a share of the box around the contour, below which it encloses nothing."""


def area_centroid(contour: Floats) -> Floats:
    """Centroid (2,) of the area that a closed contour encloses, m.

    Of the area, because the mean of unevenly felt points lies nearer to where they are dense;
    where there is no area, that mean.

    Parameters
    ----------
    contour : (n, 2) or (n, 3) array
        Around it, in either direction, m; a third coordinate is ignored.

    Raises
    ------
    ValueError
        If the contour has no point, or is not finite (n, 2) or (n, 3).
    """
    polygon = closed_polygon(np.asarray(contour)[..., :2])
    middle = polygon.mean(axis=0)
    near = polygon - middle
    size = float(np.abs(near).max())
    near = near / size if size > 0.0 else near
    area = signed_area(near)
    if abs(area) <= FLAT * float(np.prod(np.ptp(near, axis=0))):
        return np.asarray(middle)
    x, y = near.T
    following = np.roll(near, -1, axis=0)
    twice = x * following[:, 1] - following[:, 0] * y
    shift = ((near + following) * twice[:, None]).sum(axis=0)
    return np.asarray(middle + size * shift / (6.0 * area))
