"""A closed contour as a plane figure."""

from __future__ import annotations

import numpy as np

from palpate.core.arrays import Floats


def contour_middle(contour: Floats) -> Floats:
    """Centroid (2,) of the area that a closed contour (n, 3) encloses, m.

    Of the area, because the mean of unevenly felt points lies nearer to where they are dense.
    """
    middle = contour[:, :2].mean(axis=0)
    x, y = (contour[:, :2] - middle).T
    following_x, following_y = np.roll(x, -1), np.roll(y, -1)
    twice = x * following_y - following_x * y
    area = 0.5 * float(twice.sum())
    if abs(area) <= 1e-9 * float(np.ptp(x) * np.ptp(y)):
        return np.asarray(middle)
    shift = np.array([((x + following_x) * twice).sum(), ((y + following_y) * twice).sum()])
    return np.asarray(middle + shift / (6.0 * area))
