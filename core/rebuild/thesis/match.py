"""Points of a contour that belong to the model's azimuths: Fung, 1999, 4.2, step 5."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.plane.area_centroid import area_centroid
from palpate.core.plane.azimuth_match import azimuth_match
from palpate.core.splines.closed_curve import fit_closed_curve

FINE = 8
"""Chords for each point of a contour, by which rays meet the curve through them."""


class ContourMatch(NamedTuple):
    """Which points of a contour belong to given azimuths."""

    points: Floats
    """(k, 2)."""
    middle: Floats
    """(2,): from where the azimuths are taken."""
    one_to_one: bool
    """Each ray from the middle meets the contour once."""
    degenerate: bool
    """The contour encloses nothing."""
    self_intersecting: bool
    """The curve meets itself."""


def ray_azimuths(count: int) -> Floats:
    """Azimuths (count,) of so many rays: even ones from -pi on, rad."""
    rays: Floats = np.pi * (2.0 * np.arange(count) / count - 1.0)
    return rays


def match_contour(points: Floats, azimuths: Floats) -> ContourMatch:
    """Where rays from the middle of a contour meet the closed curve through its points.

    Parameters
    ----------
    points : (n, 2) array
        Around it, begun anywhere, in either direction.
    azimuths : (k,) array
        Of the rays, rad.

    Notes
    -----
    The middle is that of the area: the mean of the points, as printed, lies where they are
    dense. Where a ray meets the curve several times or not at all, the azimuth is made
    monotone, or gives way to the length.
    """
    curve = fit_closed_curve(points)
    count = FINE * len(points)
    polygon = curve.at(np.arange(count) / count)
    middle = area_centroid(polygon)
    match = azimuth_match(polygon, middle, azimuths)
    flags = curve.flags
    return ContourMatch(
        match.points, middle, match.one_to_one, flags.degenerate, flags.self_intersecting
    )
