"""The first touch of an end: along the axis, and elsewhere if there is nothing."""

from __future__ import annotations

import math

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.explore.aim import PRESS
from palpate.core.explore.probing.known import EndKnown, Probing
from palpate.core.frames import DOWN, pose_of

CLEARANCE = 5e-3
"""Start of a touch over the highest point known, m."""
DEVIATIONS = 3.0
"""Standard deviations by which an end may be higher than expected."""
MOST_RINGS = 3
"""Rings of places around the axis at which an object is looked for."""
DEEP = 0.5
"""Of the object's height: how far down a face is looked for. Farther inside nothing closes it."""


def search_places(radius: float, width: float) -> list[Floats]:
    """Places (2,) at which an end is looked for: the axis, then rings around it, m.

    Neighbouring ones are a pad's width apart, so that nothing wider is missed.
    """
    places = [np.zeros(2)]
    for ring in range(1, min(int(radius / width), MOST_RINGS) + 1):
        for azimuth in 2.0 * math.pi * np.arange(6 * ring) / (6 * ring):
            places.append(ring * width * np.array([math.cos(azimuth), math.sin(azimuth)]))
    return places


def along_axis(known: EndKnown, place: Floats) -> Probing:
    """A touch over a place (2,), along the slicing axis, that nothing known is in the way of."""
    start = highest_known(known) + CLEARANCE + PRESS
    lowest = known.height - DEEP * (known.height - known.other)
    pose = pose_of(np.array([place[0], place[1], start]), DOWN)
    return Probing(pose, start - lowest, "search", np.array([place[0], place[1], known.height]))


def highest_known(known: EndKnown) -> float:
    """The highest that anything is known to be, or may be while the end is not found, m."""
    felt = [float(one.point[2]) for one in known.found]
    if known.wall is not None:
        felt.append(float(known.wall.felt_high.max()))
    if not known.found:
        felt.append(known.height + DEVIATIONS * known.deviation)
    return max(felt)
