"""The first arc of a contour."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.explore.aim import MOST_TILT, UPRIGHT, Aim, Stance
from palpate.core.explore.felt import Felt
from palpate.core.explore.routine import Routine
from palpate.core.explore.seek import LEAST_ARC, seek

AZIMUTHS = (0.0, 90.0, 180.0, -90.0, 45.0, 135.0, -45.0, -135.0)
"""Directions from which the object is approached, degrees: until one succeeds."""
MOST_REPEATS = 5
"""Touches from one direction while the pad still stands askew."""
ASKEW = 0.12
"""Angle to the surface above which the first arc is felt again, rad."""
STANDOFF, REACH = 12.0e-3, 14.0e-3


class Start(NamedTuple):
    """Where a contour begins."""

    felt: Felt | None
    """The first arc; None if there was none."""
    heading: float
    """Azimuth of the outward normal there, rad."""
    stance: Stance
    """How the pad was held."""
    contact: bool
    """True if anything was felt at all."""


def begin(centre: Floats, radius: float, height: float) -> Routine[Start]:
    """Approach the slice from one direction after the other until an arc is felt.

    Parameters
    ----------
    centre : (2,) array
        Where the object's axis is expected, m.
    radius : float
        Distance from which the pad approaches, m.
    height : float
        Height of the slice, m.
    """
    contact = False
    for azimuth in AZIMUTHS:
        heading = math.radians(azimuth)
        place = centre + radius * np.array([math.cos(heading), math.sin(heading)])
        felt = yield Aim(place, heading, 0.0, radius, UPRIGHT)
        if felt is None:
            continue
        contact = True
        found, stance = yield from _refine(felt, heading, height)
        if found is not None:
            return Start(found, heading, stance, contact)
    return Start(None, 0.0, UPRIGHT, contact)


def _refine(felt: Felt, heading: float, height: float) -> Routine[tuple[Felt | None, Stance]]:
    """Touch again until the pad lies against the surface."""
    stance, best = UPRIGHT, None
    for repeat in range(MOST_REPEATS):
        has_arc = len(felt.points) >= LEAST_ARC
        place = felt.points[len(felt.points) // 2] if len(felt.points) else felt.pad
        askew = math.atan(felt.slope)
        if has_arc and (stance.frozen or abs(askew) < ASKEW):
            return felt, stance
        if has_arc:
            best = felt
        if has_arc and repeat == 0:  # from then on the search follows the slope itself
            stance = stance._replace(tilt=max(-MOST_TILT, min(MOST_TILT, -askew)))
        again, stance = yield from seek(
            stance, place[:2], heading, STANDOFF, REACH, height, first=True
        )
        if again is None:
            break
        felt = again
    return (felt if len(felt.points) >= LEAST_ARC else best), stance
