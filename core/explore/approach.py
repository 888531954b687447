"""From where a slice is approached, and where an object is looked for."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.plane.area_centroid import area_centroid
from palpate.core.plane.winding import winding_number

APPROACH = 30.0e-3
"""The pad approaches a slice from this far outside the widest contour so far, m."""


def search_places(reach: float, spacing: float) -> list[Floats]:
    """Places (2,) at which to look for the object, m: the axis, then rings around it.

    Neighbouring places are at most so far apart that nothing wider is missed within reach.
    """
    places = [np.zeros(2)]
    for ring in range(1, int(reach / spacing) + 1):
        azimuths = 2 * math.pi * np.arange(6 * ring) / (6 * ring)
        away = ring * spacing
        places += [away * np.array([math.cos(a), math.sin(a)]) for a in azimuths]
    return places


def approach(
    height: float,
    heights: Sequence[float],
    contours: Sequence[Floats],
    tips: Sequence[Floats] = (),
) -> tuple[Floats, float]:
    """Where the middle of a slice is expected, (2,), and from how far it is approached, m.

    Parameters
    ----------
    height : float
        Height of the slice, m.
    heights : sequence of float
        Heights of the contours traced so far, at least one, m.
    contours : sequence of (n, 3) arrays
        The contours, slicing frame, m.
    tips : sequence of (3,) arrays
        Where the object ends, m. One that lies outside the nearest contour tells which way the
        object leans.
    """
    nearest = int(np.argmin([abs(one - height) for one in heights]))
    middle = _leant(height, heights[nearest], contours[nearest], tips)
    widest = max(float(np.linalg.norm(points[:, :2] - middle, axis=1).max()) for points in contours)
    return middle, widest + APPROACH


def _leant(height: float, nearest: float, contour: Floats, tips: Sequence[Floats]) -> Floats:
    """The contour's middle, moved towards a tip that the slice lies on the way to, (2,), m."""
    middle = area_centroid(contour)
    for tip in tips:
        share = (height - nearest) / (tip[2] - nearest) if tip[2] != nearest else 0.0
        if 0.0 < share < 1.0 and winding_number(contour[:, :2], tip[None, :2])[0] == 0:
            return np.asarray(middle + share * (tip[:2] - middle))
    return middle
