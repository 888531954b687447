"""Finding the slice: the first arc of a contour, and an arc near a place.

A pad that meets an object does not always meet it at the slice: on a pole it slides off to the
side, a shoulder holds it away from what lies below, and it bridges a groove. So it tilts to the
surface, walks along it, and tries other postures.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.explore.tracing.contour_path import (
    UPRIGHT,
    Posture,
    Procedure,
    SliceArc,
    SliceSpec,
    TouchCommand,
)

# Why there is no first arc: nothing was touched; a part beside the slice holds the pad off; or the
# object ends below the slice.
NoArc = Literal["no_contact", "occluded", "pole"]


@dataclass(frozen=True, slots=True, kw_only=True)
class FirstArcSettings:
    """From where the first arc is looked for, and when the pad lies against the surface."""

    # [rad] directions from which the object is approached, until one succeeds.
    azimuths: tuple[float, ...] = tuple(np.radians([0, 90, 180, -90, 45, 135, -45, -135]).tolist())
    max_touches: int = 5  # from one direction, until the pad lies against the surface
    max_askew: float = 0.12  # [rad] between pad and surface; above it, the touch is repeated
    standoff: float = 12.0 / 15.0  # [widths of the pad] before the place of a repeated touch
    reach: float = 14.0 / 15.0  # [widths of the pad] past the place of a repeated touch
    reach_from_above: float = 0.2  # [widths of the pad] past the slice, of a touch from above


@dataclass(frozen=True, slots=True, kw_only=True)
class WalkSettings:
    """How the pad tilts to a surface and walks along it towards the slice."""

    max_touches: int = 6  # of one walk
    max_remaining: float = 0.85  # ratio of the distances to the slice after and before a step
    max_step: float = 25.0 / 15.0  # [widths of the pad] inwards or outwards
    max_slope_angle: float = 1.3  # [rad] largest slope for which the length of a step is computed
    standoff: float = 10.0 / 15.0  # [widths of the pad] before and past the place, at least
    # A wall is upright, and leads to no slice, if tilt and change of tilt are both smaller.
    upright_tilt: float = 0.12  # [rad] of the next touch
    upright_change: float = 0.08  # [rad] from this touch to the next one
    max_bridged: int = 3  # touched taxels on each side of the slice; with more, it is bridged
    tilt_gain: float = 0.7  # fraction of the measured slope by which the next touch is tilted
    min_slope: float = 0.03  # [1] smaller measured slopes leave the tilt as it is


@dataclass(frozen=True, slots=True, kw_only=True)
class PostureSettings:
    """Which postures are tried where tilting and walking have met no arc."""

    min_points: int = 3  # of an arc whose posture is kept
    shift: float = 6.8 / 15.0  # [widths of the pad] that puts the slice just inside the pad's edge
    lean: float = 0.45  # [rad] smaller tilt that is tried together with a shift
    large_lean: float = 0.9  # [rad] larger tilt that is tried together with a shift
    min_tilt: float = 0.3  # [rad] of the walk's last touch, above which it is tried with a shift
    max_failed_searches: int = 2  # on one contour; after more, leaning postures are not tried
    standoff: float = 8.0 / 15.0  # [widths of the pad] before the place
    reach: float = 14.0 / 15.0  # [widths of the pad] past the place
    first_standoff: float = 14.0 / 15.0  # [widths of the pad] the same, before a contour has begun
    first_reach: float = 2.0  # [widths of the pad] the same, before a contour has begun
    kept_standoff: float = 6.0 / 15.0  # [widths of the pad] the same in a kept posture, at least
    kept_reach: float = 8.0 / 15.0  # [widths of the pad] the same in a kept posture, at least


@dataclass(frozen=True, slots=True, kw_only=True)
class SearchSettings:
    """How an arc of the slice is looked for."""

    first: FirstArcSettings = FirstArcSettings()
    walk: WalkSettings = WalkSettings()
    postures: PostureSettings = PostureSettings()


class FirstArc(NamedTuple):
    """Where a contour begins."""

    arc: SliceArc
    heading: float  # [rad] azimuth of the outward normal there
    posture: Posture


def search_first_arc(
    spec: SliceSpec, centre: Floats, radius: float, settings: SearchSettings = SearchSettings()
) -> Procedure[FirstArc | NoArc]:
    """Approach the slice from one direction after the other until an arc is met.

    The pad comes from a `radius` [m] about `centre` (2,) [m], the expected axis. Where it meets the
    object below the slice, a touch from above shows whether the object ends there or holds it off.
    """
    held_off = 0
    for azimuth in settings.first.azimuths:
        met = yield from approach_from(spec, centre, radius, azimuth, settings, held_off)
        if isinstance(met, FirstArc):
            return met
        if met is None:
            continue
        if not held_off and met.below > met.above:
            ends_below = yield from _ends_below(spec, centre, radius, settings.first)
            if ends_below:
                return "pole"
        held_off += 1
    return "occluded" if held_off else "no_contact"


def _ends_below(
    spec: SliceSpec, centre: Floats, radius: float, settings: FirstArcSettings
) -> Procedure[bool]:
    """Whether a touch from above finds the object's top below the slice, or nothing."""
    from_above = UPRIGHT._replace(tilt=0.5 * math.pi)
    reach = settings.reach_from_above * spec.width
    arc = yield TouchCommand(centre, 0.0, radius, reach, from_above)
    return arc is None or arc.above == 0


def approach_from(
    spec: SliceSpec,
    centre: Floats,
    radius: float,
    azimuth: float,
    settings: SearchSettings = SearchSettings(),
    held_off: int = 0,
) -> Procedure[FirstArc | SliceArc | None]:
    """Come from outside: the first arc, or else what was touched at first, or None.

    `held_off`: number of approaches so far that met the object beside the slice; after some of them
    fewer postures are tried.
    """
    place = centre + radius * np.array([math.cos(azimuth), math.sin(azimuth)])
    touched = yield TouchCommand(place, azimuth, 0.0, radius, UPRIGHT)
    if touched is None:
        return None
    arc, posture = yield from _refine(spec, touched, azimuth, settings, held_off)
    return touched if arc is None else FirstArc(arc, azimuth, posture)


def _refine(
    spec: SliceSpec, arc: SliceArc, heading: float, settings: SearchSettings, held_off: int
) -> Procedure[tuple[SliceArc | None, Posture]]:
    """Touch again until the pad lies against the surface."""
    posture, best = UPRIGHT._replace(failed_searches=held_off), None
    first = settings.first
    for repeat in range(first.max_touches):
        askew = math.atan(arc.slope)
        if has_arc(arc):
            best = arc
            if posture.is_kept or abs(askew) < first.max_askew:
                break
            if repeat == 0:  # from then on the search follows the slope itself
                posture = posture._replace(tilt=_bounded(spec, -askew))
        place = arc.points[len(arc.points) // 2] if len(arc.points) else arc.pad
        standoff, reach = first.standoff * spec.width, first.reach * spec.width
        target = Target(place[:2], heading, standoff, reach)
        again, posture = yield from search_arc(spec, posture, target, settings, is_first=True)
        if again is None or not has_arc(again):
            break
        arc = again
    else:
        best = arc
    return best, posture


class Target(NamedTuple):
    """Where an arc is looked for."""

    place: Floats  # (2,) [m] where the contour is expected
    heading: float  # [rad] azimuth of the expected outward normal
    standoff: float  # [m] before the place
    reach: float  # [m] past the place

    def at_least(self, standoff: float, reach: float) -> Target:
        """The target with a standoff and a reach that are not shorter [m]."""
        return self._replace(standoff=max(self.standoff, standoff), reach=max(self.reach, reach))

    def command(self, posture: Posture) -> TouchCommand:
        """A touch there."""
        return TouchCommand(*self, posture)


def search_arc(
    spec: SliceSpec,
    posture: Posture,
    target: Target,
    settings: SearchSettings = SearchSettings(),
    is_first: bool = False,
) -> Procedure[tuple[SliceArc | None, Posture]]:
    """Touch near a place until an arc of the slice is touched.

    `is_first`: whether a contour begins, where places are least certain. Returns the touch that met
    the slice, or else the last that touched anything, and the posture for the next touch.
    """
    if posture.is_kept:
        postures = settings.postures
        wider = target.at_least(
            postures.kept_standoff * spec.width, postures.kept_reach * spec.width
        )
        arc = yield wider.command(posture)
        if arc is None or has_arc(arc):
            return arc, posture
    arc, current = yield from _walk(spec, posture, target, settings.walk)
    if arc is None or has_arc(arc) or (not is_first and _is_edge(arc, settings.walk)):
        return arc, current
    return (
        yield from _search(spec, posture, current.tilt, arc, target, settings.postures, is_first)
    )


def _walk(
    spec: SliceSpec, posture: Posture, target: Target, settings: WalkSettings
) -> Procedure[tuple[SliceArc | None, Posture]]:
    """Tilt to the surface and step along it towards the slice."""
    outward = np.array([math.cos(target.heading), math.sin(target.heading)])
    last: SliceArc | None = None
    tilt = 0.0 if posture.is_kept else posture.tilt
    current = UPRIGHT._replace(tilt=tilt, failed_searches=posture.failed_searches)
    remaining = math.inf
    for _ in range(settings.max_touches):
        arc = yield target.command(current)
        if arc is None:
            break
        last = arc
        if has_arc(arc):
            return arc, _next_posture(spec, current, arc, settings)
        tilt = _bounded(spec, current.tilt - math.atan(arc.slope))
        rise = spec.height - float(arc.nearest[2])
        is_upright = (
            abs(tilt) < settings.upright_tilt and abs(tilt - current.tilt) < settings.upright_change
        )
        is_bridge = min(arc.above, arc.below) > settings.max_bridged
        if is_bridge or abs(rise) > settings.max_remaining * remaining or is_upright:
            break
        remaining = abs(rise)
        target = _step_along(spec, target, outward, arc, rise, tilt, settings)
        current = current._replace(tilt=tilt)
    return last, current


def _step_along(
    spec: SliceSpec,
    target: Target,
    outward: Floats,
    arc: SliceArc,
    rise: float,
    tilt: float,
    settings: WalkSettings,
) -> Target:
    """The target of the next step, `rise` [m] higher along a surface tilted by `tilt` [rad]."""
    steepest, longest = settings.max_slope_angle, settings.max_step * spec.width
    inwards = rise * math.tan(max(-steepest, min(steepest, tilt)))
    place = arc.nearest[:2] - outward * max(-longest, min(longest, inwards))
    standoff = settings.standoff * spec.width
    return target.at_least(standoff, standoff)._replace(place=place)


def has_arc(arc: SliceArc) -> bool:
    """Whether a touch has touched enough of the slice: two points make an arc."""
    return len(arc.points) >= 2


def _is_edge(arc: SliceArc, settings: WalkSettings) -> bool:
    """Whether a touch met the slice on an edge that crosses it: no tilt meets more of the slice."""
    is_on_both_sides = len(arc.points) > 0 and min(arc.above, arc.below) > 0
    return is_on_both_sides and arc.above + arc.below > settings.max_bridged


def _next_posture(
    spec: SliceSpec, posture: Posture, arc: SliceArc, settings: WalkSettings
) -> Posture:
    """The posture for the next touch, tilted after the slope just measured."""
    if abs(arc.slope) <= settings.min_slope:
        return posture
    tilt = posture.tilt - settings.tilt_gain * math.atan(arc.slope)
    return posture._replace(tilt=_bounded(spec, tilt))


def _bounded(spec: SliceSpec, tilt: float) -> float:
    return max(-spec.touch.max_tilt, min(spec.touch.max_tilt, tilt))


def _search(
    spec: SliceSpec,
    posture: Posture,
    tilt: float,
    arc: SliceArc,
    target: Target,
    settings: PostureSettings,
    is_first: bool,
) -> Procedure[tuple[SliceArc | None, Posture]]:
    """Try a list of postures; the first that meets an arc is kept for the whole contour."""
    side = -1.0 if arc.below >= arc.above else 1.0
    standoff, reach = settings.standoff, settings.reach
    if is_first:
        standoff, reach = settings.first_standoff, settings.first_reach
    wider = target._replace(standoff=standoff * spec.width, reach=reach * spec.width)
    for tried_tilt, shift in _postures(tilt, side, posture.failed_searches, settings):
        current = Posture(tried_tilt, shift * spec.width, spec.touch.deep_depth, is_kept=True)
        met = yield wider.command(current)
        if met is not None and len(met.points) >= settings.min_points:
            half = 0.5 * float(np.linalg.norm(met.points[-1] - met.points[0]))
            return met, current._replace(half_contact=half)
    return arc, posture._replace(failed_searches=posture.failed_searches + 1)


def _postures(
    tilt: float, side: float, failed_searches: int, settings: PostureSettings
) -> list[tuple[float, float]]:
    """Tilt [rad], and shift [widths of the pad], of each posture to try, the likeliest first.

    `side`: 1 where most of the touched taxels lie above the slice, else -1.
    """
    shift, lean, large = settings.shift * side, settings.lean * side, settings.large_lean * side
    inclined = [(tilt, shift), (tilt, -shift)] if abs(tilt) > settings.min_tilt else []
    plain = [(tilt, 0.0), *inclined, (0.0, shift), (0.0, -shift)]
    if failed_searches > settings.max_failed_searches:
        return plain
    leaning = [(-lean, shift), (-large, shift), (lean, -shift)]
    return [*plain, *leaning, (lean, shift), (large, shift), (-lean, -shift)]
