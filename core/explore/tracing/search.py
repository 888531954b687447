"""Finding the slice: the first arc of a contour, and an arc near a place.

A pad that meets an object does not always meet it at the slice: on a pole it slides off to the
side, below a shoulder the shoulder holds it away, across a groove it is bridged. So it tilts to the
surface, walks along it, and tries other postures.
"""

from __future__ import annotations

import math
from typing import Literal, NamedTuple

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.explore.tracing.contour_path import (
    DEEP_TOUCH_DEPTH,
    MOST_TILT,
    UPRIGHT,
    Posture,
    Procedure,
    SliceArc,
    SliceSpec,
    TouchCommand,
)

# Directions from which the object is approached, rad: until one succeeds.
AZIMUTHS = tuple(np.radians([0, 90, 180, -90, 45, 135, -45, -135]).tolist())
MOST_REPEATS = 5  # Touches from one direction while the pad still stands askew
ASKEW = 0.12  # Angle to the surface above which the first arc is touched again, rad
# Ways of a repeated touch before and past the place, in widths of the pad.
STANDOFF, REACH = 12.0 / 15.0, 14.0 / 15.0
PAST = 0.2  # A touch from above goes this far past the slice, in widths of the pad
# Why there is no first arc: nothing was touched; only what keeps the pad off the slice was; or the
# object ends below the slice.
NoArc = Literal["no_contact", "occluded", "pole"]
LEAST_ARC = 2  # Points that make an arc
LEAST_SEARCHED_ARC = 3  # Points for which a searched posture is kept
FEED_FORWARD = 0.7  # Share of the measured slope by which the next touch is tilted
LEVEL = 0.03  # Slope below which the tilt is left alone
MOST_STEPS = 6  # Touches of a walk
GIVE_UP = 0.85  # A walk ends when a step leaves more than this share of the way to the slice
BRIDGED = 3  # More touched taxels than this above and below the slice, and none at it: a bridge
SHIFT = 6.8 / 15.0  # Brings the slice to just inside the pad's edge; in widths of the pad
LEANS = (-0.45, -0.9, 0.45)  # Tilts tried together with a shift, rad
INCLINED = 0.3  # A surface steeper than this is tried with the pad tilted to it and shifted, rad
MOST_FAILED_SEARCHES = 2  # After these, leaning postures are no longer tried on this contour
FROZEN_STANDOFF, FROZEN_REACH = 6.0 / 15.0, 8.0 / 15.0
WALK_STANDOFF = 10.0 / 15.0
SEARCH_STANDOFF, SEARCH_REACH = 8.0 / 15.0, 14.0 / 15.0
FIRST_STANDOFF, FIRST_REACH = 14.0 / 15.0, 2.0
MOST_WALK = 25.0 / 15.0  # Ways before and past the expected place, in widths of the pad
STEEPEST_WALK = 1.3


class FirstArc(NamedTuple):
    """Where a contour begins."""

    arc: SliceArc  # The first arc
    heading: float  # Azimuth of the outward normal there, rad
    posture: Posture  # How the pad was held


def search_first_arc(spec: SliceSpec, centre: Floats, radius: float) -> Procedure[FirstArc | NoArc]:
    """Approach the slice from one direction after the other until an arc is met.

    The pad comes from a `radius`, m, about `centre` (2,), the expected axis. Where it meets the
    object below the slice, that holds it off or ends there: one touch from above tells them apart.
    """
    held_off = 0
    for azimuth in AZIMUTHS:
        found = yield from approach_from(spec, centre, radius, azimuth, held_off)
        if isinstance(found, FirstArc):
            return found
        if found is None:
            continue
        if not held_off and found.below > found.above:
            ends = yield from _ends_below(spec, centre, radius)
            if ends:
                return "pole"
        held_off += 1
    return "occluded" if held_off else "no_contact"


def _ends_below(spec: SliceSpec, centre: Floats, radius: float) -> Procedure[bool]:
    """Whether a touch from above finds the object's top below the slice, or nothing."""
    from_above = UPRIGHT._replace(tilt=0.5 * math.pi)
    arc = yield TouchCommand(centre, 0.0, radius, PAST * spec.width, from_above)
    return arc is None or arc.above == 0


def approach_from(
    spec: SliceSpec, centre: Floats, radius: float, azimuth: float, held_off: int = 0
) -> Procedure[FirstArc | SliceArc | None]:
    """Come from outside: the arc, or what was touched first, or None; in ever fewer postures."""
    place = centre + radius * np.array([math.cos(azimuth), math.sin(azimuth)])
    arc = yield TouchCommand(place, azimuth, 0.0, radius, UPRIGHT)
    if arc is None:
        return None
    found, posture = yield from _refine(spec, arc, azimuth, held_off)
    return arc if found is None else FirstArc(found, azimuth, posture)


def _refine(
    spec: SliceSpec, arc: SliceArc, heading: float, held_off: int
) -> Procedure[tuple[SliceArc | None, Posture]]:
    """Touch again until the pad lies against the surface."""
    posture, best = UPRIGHT._replace(failed_searches=held_off), None
    for repeat in range(MOST_REPEATS):
        askew = math.atan(arc.slope)
        if has_arc(arc):
            best = arc
            if posture.frozen or abs(askew) < ASKEW:
                break
            if repeat == 0:  # from then on the search follows the slope itself
                posture = posture._replace(tilt=max(-MOST_TILT, min(MOST_TILT, -askew)))
        place = arc.points[len(arc.points) // 2] if len(arc.points) else arc.pad
        target = Target(place[:2], heading, STANDOFF * spec.width, REACH * spec.width)
        again, posture = yield from search_arc(spec, posture, target, first=True)
        if again is None or not has_arc(again):
            break
        arc = again
    else:
        best = arc
    return best, posture


class Target(NamedTuple):
    """Where an arc is looked for."""

    place: Floats  # Where the contour is expected, (2,), m
    heading: float  # Azimuth of the expected outward normal, rad
    standoff: float  # Way before the place, m
    reach: float  # Way past it, m

    def at_least(self, standoff: float, reach: float) -> Target:
        """The same with longer ways."""
        return self._replace(standoff=max(self.standoff, standoff), reach=max(self.reach, reach))

    def command(self, posture: Posture) -> TouchCommand:
        """A touch there."""
        return TouchCommand(*self, posture)


def search_arc(
    spec: SliceSpec, posture: Posture, target: Target, first: bool = False
) -> Procedure[tuple[SliceArc | None, Posture]]:
    """Touch near a place until an arc of the slice is touched.

    `first`: true at the start of a contour, where places are least certain. Returns the touch that
    met the slice, or else the last that touched anything, and the posture for the next touch.
    """
    if posture.frozen:
        wider = target.at_least(FROZEN_STANDOFF * spec.width, FROZEN_REACH * spec.width)
        arc = yield wider.command(posture)
        if arc is None or has_arc(arc):
            return arc, posture
    arc, held = yield from _walk(spec, posture, target)
    if arc is None or has_arc(arc) or (not first and _is_edge(arc)):
        return arc, held
    return (yield from _search(spec, posture, held.tilt, arc, target, first))


def _walk(
    spec: SliceSpec, posture: Posture, target: Target
) -> Procedure[tuple[SliceArc | None, Posture]]:
    """Tilt to the surface and step along it towards the slice."""
    outward = np.array([math.cos(target.heading), math.sin(target.heading)])
    best: SliceArc | None = None
    tilt = 0.0 if posture.frozen else posture.tilt
    held = UPRIGHT._replace(tilt=tilt, failed_searches=posture.failed_searches)
    left = math.inf
    for _ in range(MOST_STEPS):
        arc = yield target.command(held)
        if arc is None:
            break
        best = arc
        if has_arc(arc):
            return arc, next_posture(held, arc)
        wanted = _bounded(held.tilt - math.atan(arc.slope))
        rise = spec.height - float(arc.nearest[2])
        upright = abs(wanted) < 0.12 and abs(wanted - held.tilt) < 0.08
        bridged = min(arc.above, arc.below) > BRIDGED
        if bridged or abs(rise) > GIVE_UP * left or upright:
            break
        left, most = abs(rise), MOST_WALK * spec.width
        inwards = rise * math.tan(max(-STEEPEST_WALK, min(STEEPEST_WALK, wanted)))
        target = target.at_least(WALK_STANDOFF * spec.width, WALK_STANDOFF * spec.width)._replace(
            place=arc.nearest[:2] - outward * max(-most, min(most, inwards))
        )
        held = held._replace(tilt=wanted)
    return best, held


def has_arc(arc: SliceArc) -> bool:
    """Whether a touch has touched enough of the slice."""
    return len(arc.points) >= LEAST_ARC


def _is_edge(arc: SliceArc) -> bool:
    """Whether a touch met the slice in one column that runs along it: no tilt meets more of it."""
    return len(arc.points) > 0 and min(arc.above, arc.below) > 0 and arc.above + arc.below > BRIDGED


def next_posture(posture: Posture, arc: SliceArc) -> Posture:
    """The posture for the next touch, tilted after the slope just measured."""
    if posture.frozen or abs(arc.slope) <= LEVEL:
        return posture
    return posture._replace(tilt=_bounded(posture.tilt - FEED_FORWARD * math.atan(arc.slope)))


def _bounded(tilt: float) -> float:
    return max(-MOST_TILT, min(MOST_TILT, tilt))


def _search(
    spec: SliceSpec, posture: Posture, tilt: float, arc: SliceArc, target: Target, first: bool
) -> Procedure[tuple[SliceArc | None, Posture]]:
    """Try a list of postures; the first that meets an arc is kept for the whole contour."""
    away = -1.0 if arc.below >= arc.above else 1.0
    standoff, reach = FIRST_STANDOFF, FIRST_REACH
    if not first:
        standoff, reach = SEARCH_STANDOFF, SEARCH_REACH
    wider = target._replace(standoff=standoff * spec.width, reach=reach * spec.width)
    for tried, shift in _postures(tilt, away, posture.failed_searches):
        held = Posture(tried, shift * spec.width, DEEP_TOUCH_DEPTH, frozen=True)
        found = yield wider.command(held)
        if found is not None and len(found.points) >= LEAST_SEARCHED_ARC:
            half = 0.5 * float(np.linalg.norm(found.points[-1] - found.points[0]))
            return found, held._replace(contact=half)
    return arc, posture._replace(failed_searches=posture.failed_searches + 1)


def _postures(tilt: float, away: float, failed_searches: int) -> list[tuple[float, float]]:
    """Tilt, and shift in widths of the pad, of each posture to try, the likeliest first."""
    shifts = (SHIFT * away, -SHIFT * away)
    inclined = [(tilt, shift) for shift in shifts] if abs(tilt) > INCLINED else []
    plain = [(tilt, 0.0), *inclined, *((0.0, shift) for shift in shifts)]
    if failed_searches > MOST_FAILED_SEARCHES:
        return plain
    leaning = [(lean * away, SHIFT * away) for lean in LEANS[:2]]
    leaning += [(-LEANS[0] * away, -SHIFT * away), (LEANS[2] * away, SHIFT * away)]
    leaning += [(-LEANS[1] * away, SHIFT * away), (LEANS[0] * away, -SHIFT * away)]
    return plain + leaning
