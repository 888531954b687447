"""Points of a contour that belong to given azimuths, in order, whatever the contour's shape."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Floats, finite_array
from palpate.core.plane.angle_between import turn_between
from palpate.core.plane.closed_polygon import closed_polygon

LENGTH_SHARE = 0.1
"""How much of the length's even pace is mixed in where the azimuth does not always rise."""


class AzimuthMatch(NamedTuple):
    """Which places on a contour belong to azimuths."""

    points: Floats
    """(k, 2), m."""
    turns: Floats
    """(k,): the share of the contour's length from its first vertex on, from 0 to 1. Azimuths
    that rise by less than a turn give turns that do as well, but for the seam."""
    one_to_one: bool
    """Each ray from the middle meets the contour once: the match is exactly the radial one."""
    inside: bool
    """The contour goes once round the middle, counter-clockwise. If not, the azimuth says
    nothing, and the match is by length alone."""


def azimuth_match(polygon: Floats, middle: Floats, azimuths: Floats) -> AzimuthMatch:
    """Match a contour to azimuths about a middle.

    Parameters
    ----------
    polygon : (n, 2) array
        Closed, fine, counter-clockwise, m.
    middle : (2,) array
        From where azimuths are taken, m.
    azimuths : (k,) array
        rad.

    Raises
    ------
    ValueError
        If the polygon has fewer than 3 vertices, or anything is not finite.

    Notes
    -----
    Along a concave contour the azimuth rises, falls back, and rises again; a ray then meets
    it several times. Here the azimuth is replaced by the middle between the largest one so
    far and the least one still to come, which never falls.
    """
    polygon = closed_polygon(polygon, least=3)
    middle = finite_array("middle", middle, (2,))
    azimuths = finite_array("azimuths", azimuths, (None,))
    around = np.vstack([polygon, polygon[:1]])
    lengths = np.linalg.norm(np.diff(around, axis=0), axis=1)
    turns = np.concatenate([[0.0], np.cumsum(lengths)])
    turns /= turns[-1] if turns[-1] > 0.0 else 1.0
    away = around - middle
    rises = turn_between(away[:-1], away[1:])
    azimuth = np.arctan2(away[0, 1], away[0, 0]) + np.concatenate([[0.0], np.cumsum(rises)])
    inside = bool(abs(float(rises.sum()) - 2.0 * np.pi) < 1.0)
    one_to_one = inside and bool((rises > 0.0).all())
    pace = _rising(azimuth) if inside else azimuth
    even = 2.0 * np.pi * turns
    # The even pace is begun where it is nearest to the azimuth all around.
    ahead = pace[:-1] - even[:-1]
    even += np.arctan2((lengths * np.sin(ahead)).sum(), (lengths * np.cos(ahead)).sum())
    if not inside:
        pace = even
    elif not one_to_one:
        even += 2.0 * np.pi * np.round((pace - even).mean() / (2.0 * np.pi))
        pace = (1.0 - LENGTH_SHARE) * pace + LENGTH_SHARE * even
    places = np.interp(pace[0] + np.mod(azimuths - pace[0], 2.0 * np.pi), pace, turns)
    points = np.column_stack([np.interp(places, turns, around[:, axis]) for axis in (0, 1)])
    return AzimuthMatch(points, places, one_to_one, inside)


def _rising(azimuth: Floats) -> Floats:
    """The middle of the largest azimuth so far and the least to come, around the seam as well."""
    turn = azimuth[:-1]
    wound = np.concatenate([turn - 2.0 * np.pi, turn, turn + 2.0 * np.pi, azimuth[-1:] + 2 * np.pi])
    so_far = np.maximum.accumulate(wound)
    to_come = np.minimum.accumulate(wound[::-1])[::-1]
    middle: Floats = 0.5 * (so_far + to_come)[len(turn) : 2 * len(turn) + 1]
    return middle
