"""The middle of what a contour encloses."""

from __future__ import annotations

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.plane.closed_polygon import closed_polygon

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
    return np.asarray(area_centroids(polygon[None])[0])


def area_centroids(contours: Floats) -> Floats:
    """The same of many contours (m, n, 2) of finite points at once, (m, 2)."""
    middle = contours.mean(axis=1)
    near = contours - middle[:, None]
    size = np.abs(near).max(axis=(1, 2))
    size = np.where(size > 0.0, size, 1.0)
    near = near / size[:, None, None]
    following = np.roll(near, -1, axis=1)
    first = near[:, :1]  # areas are taken about it, for digits
    twice = _cross(near - first, following - first)
    area = 0.5 * twice.sum(axis=1)
    flat = np.abs(area) <= FLAT * np.prod(np.ptp(near, axis=1), axis=1)
    shift = ((near + following) * _cross(near, following)[..., None]).sum(axis=1)
    safe = np.where(flat, 1.0, area)
    shift = np.where(flat[:, None], 0.0, shift / (6.0 * safe)[:, None])
    centroids: Floats = middle + size[:, None] * shift
    return centroids


def _cross(first: Floats, second: Floats) -> Floats:
    cross: Floats = first[..., 0] * second[..., 1] - second[..., 0] * first[..., 1]
    return cross
