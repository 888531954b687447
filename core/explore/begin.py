"""The first arc of a contour."""

from __future__ import annotations

import math
from typing import Literal, NamedTuple

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.explore.aim import MOST_TILT, UPRIGHT, Aim, Stance
from palpate.core.explore.cut import Cut
from palpate.core.explore.felt import Felt
from palpate.core.explore.routine import Routine
from palpate.core.explore.seek import Target, has_arc, seek

AZIMUTHS = tuple(np.radians([0, 90, 180, -90, 45, 135, -45, -135]).tolist())
"""Directions from which the object is approached, rad: until one succeeds."""
MOST_REPEATS = 5
"""Touches from one direction while the pad still stands askew."""
ASKEW = 0.12
"""Angle to the surface above which the first arc is felt again, rad."""
STANDOFF, REACH = 12.0 / 15.0, 14.0 / 15.0
"""Ways of a repeated touch before and past the place, in widths of the pad."""
PAST = 0.2
"""A touch from above goes this far past the slice, in widths of the pad."""

NoArc = Literal["no_contact", "occluded", "pole"]
"""Why there is no first arc: nothing was touched; only what keeps the pad off the slice was;
or the object ends below the slice."""


class Start(NamedTuple):
    """Where a contour begins."""

    felt: Felt
    """The first arc."""
    heading: float
    """Azimuth of the outward normal there, rad."""
    stance: Stance
    """How the pad was held."""


def begin(cut: Cut, centre: Floats, radius: float) -> Routine[Start | NoArc]:
    """Approach the slice from one direction after the other until an arc is felt.

    Parameters
    ----------
    cut : Cut
        The slice and the pad.
    centre : (2,) array
        Where the object's axis is expected, m.
    radius : float
        Distance from which the pad approaches, m.

    Notes
    -----
    A pad that meets the object below the slice is held off, or the object ends there. One touch
    from above tells them apart.
    """
    held_off = 0
    for azimuth in AZIMUTHS:
        found = yield from approach(cut, centre, radius, azimuth, held_off)
        if isinstance(found, Start):
            return found
        if found is None:
            continue
        if not held_off and found.below > found.above:
            ends = yield from _ends_below(cut, centre, radius)
            if ends:
                return "pole"
        held_off += 1
    return "occluded" if held_off else "no_contact"


def approach(
    cut: Cut, centre: Floats, radius: float, azimuth: float, held_off: int = 0
) -> Routine[Start | Felt | None]:
    """Come from outside: the arc there, or else what was felt first, or None for a miss.

    The more often the pad has been held off, the fewer stances are tried.
    """
    place = centre + radius * np.array([math.cos(azimuth), math.sin(azimuth)])
    felt = yield Aim(place, azimuth, 0.0, radius, UPRIGHT)
    if felt is None:
        return None
    found, stance = yield from _refine(cut, felt, azimuth, held_off)
    return felt if found is None else Start(found, azimuth, stance)


def _refine(
    cut: Cut, felt: Felt, heading: float, held_off: int
) -> Routine[tuple[Felt | None, Stance]]:
    """Touch again until the pad lies against the surface."""
    stance, best = UPRIGHT._replace(failed_searches=held_off), None
    for repeat in range(MOST_REPEATS):
        askew = math.atan(felt.slope)
        if has_arc(felt):
            best = felt
            if stance.frozen or abs(askew) < ASKEW:
                break
            if repeat == 0:  # from then on the search follows the slope itself
                stance = stance._replace(tilt=max(-MOST_TILT, min(MOST_TILT, -askew)))
        place = felt.points[len(felt.points) // 2] if len(felt.points) else felt.pad
        target = Target(place[:2], heading, STANDOFF * cut.width, REACH * cut.width)
        again, stance = yield from seek(cut, stance, target, first=True)
        if again is None or not has_arc(again):
            break
        felt = again
    else:
        best = felt
    return best, stance


def _ends_below(cut: Cut, centre: Floats, radius: float) -> Routine[bool]:
    """Whether a touch from above finds the object's top below the slice, or nothing."""
    from_above = UPRIGHT._replace(tilt=0.5 * math.pi)
    felt = yield Aim(centre, 0.0, radius, PAST * cut.width, from_above)
    return felt is None or felt.above == 0
