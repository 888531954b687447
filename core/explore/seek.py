"""Finding the slice near a place: tilt to the surface, walk along it, try other stances.

A pad that meets an object does not always meet it at the slice: on a pole it slides off to
the side, below a shoulder the shoulder holds it away, across a groove it is bridged.
"""

from __future__ import annotations

import math

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.explore.aim import DEEP_PRESS, MOST_TILT, PRESS, Aim, Stance
from palpate.core.explore.felt import Felt
from palpate.core.explore.routine import Routine

LEAST_ARC = 2
"""Points that make an arc."""
LEAST_SEARCHED_ARC = 3
"""Points for which a searched stance is kept."""
FEED_FORWARD = 0.7
"""Share of the felt slope by which the next touch is tilted."""
LEVEL = 0.03
"""Slope below which the tilt is left alone."""
MOST_STEPS = 6
"""Touches of a walk."""
GIVE_UP = 0.85
"""A walk ends when a step leaves more than this share of the way to the slice."""
BRIDGED = 3
"""More touched taxels than this on both halves of the pad, and none at the slice: a bridge."""
SHIFT = 6.8e-3
"""Shift that brings the slice to 0.7 mm inside the edge of a 15 mm pad, m."""
LEANS = (-0.45, -0.9, 0.45)
"""Tilts tried together with a shift, rad."""
MOST_FAILED_SEARCHES = 2
"""After these, leaning stances are no longer tried on this contour."""
FROZEN_STANDOFF, FROZEN_REACH = 6.0e-3, 8.0e-3
WALK_STANDOFF = 10.0e-3
SEARCH_STANDOFF, SEARCH_REACH = 8.0e-3, 14.0e-3
FIRST_STANDOFF, FIRST_REACH = 14.0e-3, 30.0e-3
MOST_WALK = 25.0e-3
STEEPEST_WALK = 1.3


def seek(
    stance: Stance,
    place: Floats,
    heading: float,
    standoff: float,
    reach: float,
    height: float,
    first: bool = False,
) -> Routine[tuple[Felt | None, Stance]]:
    """Touch near a place until an arc of the slice is felt.

    Parameters
    ----------
    stance : Stance
        How the pad was held at the last arc.
    place : (2,) array
        Where the contour is expected, m.
    heading : float
        Azimuth of the expected outward normal, rad.
    standoff, reach : float
        Way before and past the place, m.
    height : float
        Height of the slice, m.
    first : bool
        True at the start of a contour, where places are least certain.

    Returns
    -------
    The touch that felt an arc, or None, and the stance for the next touch.
    """
    if stance.frozen:
        standoff_, reach_ = max(standoff, FROZEN_STANDOFF), max(reach, FROZEN_REACH)
        felt = yield Aim(place, heading, standoff_, reach_, stance)
        if felt is None or len(felt.points) >= LEAST_ARC:
            return felt, stance
    tilt = 0.0 if stance.frozen else stance.tilt
    felt, held = yield from _walk(stance, place, heading, standoff, reach, tilt, height)
    if felt is None or len(felt.points) >= LEAST_ARC:
        return felt, held
    return (yield from _search(stance, held.tilt, felt, place, heading, first))


def settled(stance: Stance, felt: Felt) -> Stance:
    """The stance for the next touch, tilted after the slope just felt."""
    if stance.frozen or abs(felt.slope) <= LEVEL:
        return stance
    tilt = _bounded(stance.tilt - FEED_FORWARD * math.atan(felt.slope))
    return stance._replace(tilt=tilt)


def _walk(
    stance: Stance,
    place: Floats,
    heading: float,
    standoff: float,
    reach: float,
    tilt: float,
    height: float,
) -> Routine[tuple[Felt | None, Stance]]:
    """Tilt to the surface and step along it towards the slice."""
    outward = np.array([math.cos(heading), math.sin(heading)])
    best: Felt | None = None
    held = stance._replace(tilt=tilt, shift=0.0, depth=PRESS, frozen=False)
    left = math.inf
    for _ in range(MOST_STEPS):
        felt = yield Aim(place, heading, standoff, reach, held)
        if felt is None:
            break
        best = felt
        if len(felt.points) >= LEAST_ARC:
            return felt, settled(held, felt)
        wanted = _bounded(held.tilt - math.atan(felt.slope))
        rise = height - float(felt.deepest[2])
        upright = abs(wanted) < 0.12 and abs(wanted - held.tilt) < 0.08
        if min(felt.plus, felt.minus) > BRIDGED or abs(rise) > GIVE_UP * left or upright:
            break
        left = abs(rise)
        inwards = rise * math.tan(max(-STEEPEST_WALK, min(STEEPEST_WALK, wanted)))
        place = felt.deepest[:2] - outward * max(-MOST_WALK, min(MOST_WALK, inwards))
        standoff, reach = max(standoff, WALK_STANDOFF), max(reach, WALK_STANDOFF)
        held = held._replace(tilt=wanted)
    return best, held


def _search(
    stance: Stance, tilt: float, felt: Felt, place: Floats, heading: float, first: bool
) -> Routine[tuple[Felt | None, Stance]]:
    """Try a list of stances; the first that feels an arc is kept for the whole contour."""
    away = -1.0 if felt.plus >= felt.minus else 1.0
    standoff = FIRST_STANDOFF if first else SEARCH_STANDOFF
    reach = FIRST_REACH if first else SEARCH_REACH
    for tried, shift in _stances(tilt, away, stance.failed_searches):
        held = Stance(tried, shift, DEEP_PRESS, frozen=True)
        found = yield Aim(place, heading, standoff, reach, held)
        if found is not None and len(found.points) >= LEAST_SEARCHED_ARC:
            return found, held
    failed = stance.failed_searches + 1
    return None, stance._replace(failed_searches=failed)


def _stances(tilt: float, away: float, failed_searches: int) -> list[tuple[float, float]]:
    """Tilt and shift of each stance to try, the likeliest first."""
    plain = [(tilt, 0.0), (0.0, SHIFT * away), (0.0, -SHIFT * away)]
    if failed_searches > MOST_FAILED_SEARCHES:
        return plain
    leaning = [(lean * away, SHIFT * away) for lean in LEANS[:2]]
    leaning += [(-LEANS[0] * away, -SHIFT * away), (LEANS[2] * away, SHIFT * away)]
    leaning += [(-LEANS[1] * away, SHIFT * away), (LEANS[0] * away, -SHIFT * away)]
    return plain + leaning


def _bounded(tilt: float) -> float:
    return max(-MOST_TILT, min(MOST_TILT, tilt))
