"""Finding the slice near a place: tilt to the surface, walk along it, try other stances.

A pad that meets an object does not always meet it at the slice: on a pole it slides off to
the side, below a shoulder the shoulder holds it away, across a groove it is bridged.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.explore.aim import DEEP_PRESS, MOST_TILT, UPRIGHT, Aim, Stance
from palpate.core.explore.cut import Cut
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
"""More touched taxels than this above and below the slice, and none at it: a bridge."""
SHIFT = 6.8 / 15.0
"""Shift that brings the slice to just inside the pad's edge; in widths of the pad."""
LEANS = (-0.45, -0.9, 0.45)
"""Tilts tried together with a shift, rad."""
INCLINED = 0.3
"""A surface steeper than this is tried with the pad tilted to it and shifted, rad."""
MOST_FAILED_SEARCHES = 2
"""After these, leaning stances are no longer tried on this contour."""
FROZEN_STANDOFF, FROZEN_REACH = 6.0 / 15.0, 8.0 / 15.0
WALK_STANDOFF = 10.0 / 15.0
SEARCH_STANDOFF, SEARCH_REACH = 8.0 / 15.0, 14.0 / 15.0
FIRST_STANDOFF, FIRST_REACH = 14.0 / 15.0, 2.0
MOST_WALK = 25.0 / 15.0
"""Ways before and past the expected place, in widths of the pad."""
STEEPEST_WALK = 1.3


class Target(NamedTuple):
    """Where an arc is looked for."""

    place: Floats
    """Where the contour is expected, (2,), m."""
    heading: float
    """Azimuth of the expected outward normal, rad."""
    standoff: float
    """Way before the place, m."""
    reach: float
    """Way past it, m."""

    def at_least(self, standoff: float, reach: float) -> Target:
        """The same with longer ways."""
        return self._replace(standoff=max(self.standoff, standoff), reach=max(self.reach, reach))

    def aim(self, stance: Stance) -> Aim:
        """A touch there."""
        return Aim(*self, stance)


def seek(
    cut: Cut, stance: Stance, target: Target, first: bool = False
) -> Routine[tuple[Felt | None, Stance]]:
    """Touch near a place until an arc of the slice is felt.

    Parameters
    ----------
    cut : Cut
        The slice and the pad.
    stance : Stance
        How the pad was held at the last arc.
    target : Target
        Where to look.
    first : bool
        True at the start of a contour, where places are least certain.

    Returns
    -------
    The touch that felt an arc, or else the last that felt anything, and the stance for the next
    touch.
    """
    if stance.frozen:
        wider = target.at_least(FROZEN_STANDOFF * cut.width, FROZEN_REACH * cut.width)
        felt = yield wider.aim(stance)
        if felt is None or has_arc(felt):
            return felt, stance
    felt, held = yield from _walk(cut, stance, target)
    if felt is None or has_arc(felt):
        return felt, held
    return (yield from _search(cut, stance, held.tilt, felt, target, first))


def has_arc(felt: Felt) -> bool:
    """Whether a touch has felt enough of the slice."""
    return len(felt.points) >= LEAST_ARC


def settled(stance: Stance, felt: Felt) -> Stance:
    """The stance for the next touch, tilted after the slope just felt."""
    if stance.frozen or abs(felt.slope) <= LEVEL:
        return stance
    tilt = _bounded(stance.tilt - FEED_FORWARD * math.atan(felt.slope))
    return stance._replace(tilt=tilt)


def _walk(cut: Cut, stance: Stance, target: Target) -> Routine[tuple[Felt | None, Stance]]:
    """Tilt to the surface and step along it towards the slice."""
    outward = np.array([math.cos(target.heading), math.sin(target.heading)])
    best: Felt | None = None
    held = UPRIGHT._replace(
        tilt=0.0 if stance.frozen else stance.tilt, failed_searches=stance.failed_searches
    )
    left = math.inf
    for _ in range(MOST_STEPS):
        felt = yield target.aim(held)
        if felt is None:
            break
        best = felt
        if has_arc(felt):
            return felt, settled(held, felt)
        wanted = _bounded(held.tilt - math.atan(felt.slope))
        rise = cut.height - float(felt.nearest[2])
        upright = abs(wanted) < 0.12 and abs(wanted - held.tilt) < 0.08
        bridged = min(felt.above, felt.below) > BRIDGED
        if bridged or abs(rise) > GIVE_UP * left or upright:
            break
        left, most = abs(rise), MOST_WALK * cut.width
        inwards = rise * math.tan(max(-STEEPEST_WALK, min(STEEPEST_WALK, wanted)))
        target = target.at_least(WALK_STANDOFF * cut.width, WALK_STANDOFF * cut.width)._replace(
            place=felt.nearest[:2] - outward * max(-most, min(most, inwards))
        )
        held = held._replace(tilt=wanted)
    return best, held


def _search(
    cut: Cut, stance: Stance, tilt: float, felt: Felt, target: Target, first: bool
) -> Routine[tuple[Felt | None, Stance]]:
    """Try a list of stances; the first that feels an arc is kept for the whole contour."""
    away = -1.0 if felt.below >= felt.above else 1.0
    standoff, reach = FIRST_STANDOFF, FIRST_REACH
    if not first:
        standoff, reach = SEARCH_STANDOFF, SEARCH_REACH
    wider = target._replace(standoff=standoff * cut.width, reach=reach * cut.width)
    for tried, shift in _stances(tilt, away, stance.failed_searches):
        held = Stance(tried, shift * cut.width, DEEP_PRESS, frozen=True)
        found = yield wider.aim(held)
        if found is not None and len(found.points) >= LEAST_SEARCHED_ARC:
            half = 0.5 * float(np.linalg.norm(found.points[-1] - found.points[0]))
            return found, held._replace(contact=half)
    return felt, stance._replace(failed_searches=stance.failed_searches + 1)


def _stances(tilt: float, away: float, failed_searches: int) -> list[tuple[float, float]]:
    """Tilt, and shift in widths of the pad, of each stance to try, the likeliest first."""
    shifts = (SHIFT * away, -SHIFT * away)
    inclined = [(tilt, shift) for shift in shifts] if abs(tilt) > INCLINED else []
    plain = [(tilt, 0.0), *inclined, *((0.0, shift) for shift in shifts)]
    if failed_searches > MOST_FAILED_SEARCHES:
        return plain
    leaning = [(lean * away, SHIFT * away) for lean in LEANS[:2]]
    leaning += [(-LEANS[0] * away, -SHIFT * away), (LEANS[2] * away, SHIFT * away)]
    leaning += [(-LEANS[1] * away, SHIFT * away), (LEANS[0] * away, -SHIFT * away)]
    return plain + leaning


def _bounded(tilt: float) -> float:
    return max(-MOST_TILT, min(MOST_TILT, tilt))
