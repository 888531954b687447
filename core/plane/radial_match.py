"""Points of a contour by rays from its middle, as Fung, 1999, 4.2, step 5, matches them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Floats, Ints, finite_array
from palpate.core.plane.closed_polygon import closed_polygon


class RadialMatch(NamedTuple):
    """Where rays meet a contour."""

    points: Floats
    """(k, 2): the farthest meeting of each ray, m; the middle where there is none."""
    meetings: Ints
    """(k,): how many there are. Only where all are 1 is the match one to one."""


def radial_match(polygon: Floats, middle: Floats, azimuths: Floats) -> RadialMatch:
    """Points of a closed polygon (n, 2) on rays from a middle (2,), m, at azimuths (k,), rad.

    Kept for comparison; `azimuth_match` gives a match where a ray meets the contour several
    times or not at all.

    Raises
    ------
    ValueError
        If the polygon has no vertex, or something is not finite or of another shape.
    """
    polygon, middle = closed_polygon(polygon), finite_array("middle", middle, (2,))
    azimuths = finite_array("azimuths", azimuths, (None,))
    starts = polygon - middle
    ends = np.roll(starts, -1, axis=0)
    rays = np.column_stack([np.cos(azimuths), np.sin(azimuths)])
    # Left of the ray (or on it) to right of it and back: each meeting counts once.
    first = rays[:, :1] * starts[:, 1] - rays[:, 1:] * starts[:, 0]
    second = rays[:, :1] * ends[:, 1] - rays[:, 1:] * ends[:, 0]
    crossing = (first >= 0.0) != (second >= 0.0)
    share = np.divide(first, first - second, out=np.zeros_like(first), where=crossing)
    along = rays @ starts.T + share * (rays @ (ends - starts).T)
    met = crossing & (along > 0.0)
    farthest = np.where(met, along, 0.0).max(axis=1)
    return RadialMatch(middle + farthest[:, None] * rays, met.sum(axis=1).astype(np.int32))
