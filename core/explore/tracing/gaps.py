"""Gaps of a contour: stretches between touched points that are wider than points may lie apart.

A gap is probed in its middle, by a plain touch and by a deep one. Where the pad bridges a hollow,
its edge or a corner follows the hollow's walls down from both ends. That is repeated between the
points that are touched there, until the gap is closed or known to stay.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.explore.tracing.contour_path import (
    UPRIGHT,
    Gap,
    GapReason,
    Path,
    Posture,
    Procedure,
    SliceArc,
    SliceSpec,
    TouchCommand,
    normal_azimuth,
    path_of,
    travel_direction,
)
from palpate.core.explore.tracing.search import SearchSettings, Target, search_arc


class WallPosture(NamedTuple):
    """How the pad is held against a wall."""

    # Fraction of the wall's turn against the chord by which the pad is turned: a pad quite along
    # the wall meets the other rim first.
    turn: float
    advance: float  # [widths of the pad] of the edge beyond the gap's end, along the wall
    tilt: float  # [rad] 0 for an edge; else the upper or the lower corner comes first


@dataclass(frozen=True, slots=True, kw_only=True)
class GapSettings:
    """How gaps are probed. Standoff and reach are at least the gap's length."""

    standoff: float = 6.0 / 15.0  # [widths of the pad] before the gap's chord, at least
    reach: float = 8.0 / 15.0  # [widths of the pad] past the gap's chord, at least
    min_inside: float = 0.25 / 15.0  # [widths of the pad] of a point in the gap from both its ends
    min_gain: float = 0.25  # [pitches] by which a useful touch shortens the gap
    max_turn: float = 1.3  # [rad] between the pad's heading and the normal of the chord
    corner_shift: float = 7.0 / 15.0  # [widths of the pad] that leaves one row beyond the slice
    wall_standoff: float = 9.0 / 15.0  # [widths of the pad] added to the gap's length
    wall_reach: float = 8.0 / 15.0  # [widths of the pad], or the gap's length if that is more
    # The likeliest first; each is tried at both ends. Chosen on slots, wedges and dents.
    wall_postures: tuple[WallPosture, ...] = (
        WallPosture(0.9, 0.22, 0.0),
        WallPosture(0.9, 0.22, 0.7),
        WallPosture(0.9, 0.22, -0.7),
        WallPosture(0.7, 0.1, 0.0),
        WallPosture(0.5, 0.35, 0.5),
        WallPosture(0.5, 0.35, -0.5),
    )


def probe_gaps(
    spec: SliceSpec, chain: Path, posture: Posture, settings: GapSettings, search: SearchSettings
) -> Procedure[tuple[Path, tuple[Gap, ...]]]:
    """Probe every gap between neighbouring points of a chain.

    `chain`: points in the order of travel, its gaps not yet probed. `posture`: of the pad at the
    chain's end. `search`: how an arc is looked for in a gap. Returns the chain with the points
    touched between its points, and the gaps that are left.
    """
    gaps: list[Gap] = []
    last = len(chain.points) - 1
    while last > 0:  # from the end, so that inserted points move no gap that is still to come
        ends = chain.part(slice(last - 1, last + 1))
        start, end = ends.points
        if np.linalg.norm(end - start) <= spec.max_spacing:
            last -= 1
            continue
        between, reason = yield from _probe(spec, ends, posture, settings, search)
        if between is None:
            gaps.append(Gap(start, end, reason))
            last -= 1
            continue
        before, after = chain.part(slice(None, last)), chain.part(slice(last, None))
        chain = before.followed_by(between).followed_by(after)
        last += len(between.points)
    return chain, tuple(reversed(gaps))


def _probe(
    spec: SliceSpec, ends: Path, posture: Posture, settings: GapSettings, search: SearchSettings
) -> Procedure[tuple[Path | None, GapReason]]:
    """What is touched between two points: by a plain touch, a deep one, by the pad's edges."""
    start, end = ends.points
    deep = UPRIGHT._replace(tilt=posture.tilt, shift=posture.shift, depth=spec.touch.deep_depth)
    chord = end[:2] - start[:2]
    length = float(np.linalg.norm(chord))
    target = Target(
        start[:2] + 0.5 * chord,
        normal_azimuth(chord),
        max(settings.standoff * spec.width, length),
        max(settings.reach * spec.width, length),
    )
    arc, _ = yield from search_arc(spec, posture, target, search)
    between = _between(spec, start, end, arc, settings)
    if arc is None or between is not None:
        return between, "missed"
    walls = wall_touches(spec, ends.points, ends.normals, settings)
    for command in (target.command(deep), *walls):
        arc = yield command
        between = _between(spec, start, end, arc, settings)
        if between is not None:
            break
    return between, "bridged"


def _between(
    spec: SliceSpec, start: Floats, end: Floats, arc: SliceArc | None, settings: GapSettings
) -> Path | None:
    """The part of an arc that lies in a gap, if it shortens the gap."""
    if arc is None or not len(arc.points):
        return None
    chord = end[:2] - start[:2]
    length = float(np.linalg.norm(chord))
    along = (arc.points[:, :2] - start[:2]) @ chord / length
    margin = settings.min_inside * spec.width
    is_inside = (along > margin) & (along < length - margin)
    if not is_inside.any():
        return None
    stretch = path_of(arc).part(is_inside)
    steps = np.diff(np.concatenate([start[None], stretch.points, end[None]]), axis=0)
    longest = float(np.linalg.norm(steps, axis=1).max())
    whole = float(np.linalg.norm(end - start))
    return stretch if longest < whole - settings.min_gain * spec.pad.pitch else None


def wall_touches(
    spec: SliceSpec, ends: Floats, normals: Floats, settings: GapSettings = GapSettings()
) -> list[TouchCommand]:
    """Touches that follow the walls of a gap inwards from its ends, the likeliest first.

    `ends` (2, 3) [m], `normals` (2, 3): the points at the gap's ends, and outward unit normals.
    """
    return [
        _along_wall(spec, ends, normals[number], number, posture, settings)
        for posture in settings.wall_postures
        for number in (0, 1)
    ]


def _along_wall(
    spec: SliceSpec,
    ends: Floats,
    normal: Floats,
    number: int,
    posture: WallPosture,
    settings: GapSettings,
) -> TouchCommand:
    """A touch with the pad's edge beyond end `number` of a gap, its body outside the hollow."""
    chord = ends[1, :2] - ends[0, :2]
    length, across = float(np.linalg.norm(chord)), normal_azimuth(chord)
    wall = math.remainder(math.atan2(normal[1], normal[0]) - across, 2.0 * math.pi)
    side = 1.0 if number == 0 else -1.0
    heading = across + max(-settings.max_turn, min(settings.max_turn, posture.turn * wall))
    advance = side * min(posture.advance * spec.width, 0.5 * length)
    place = ends[number, :2] + advance * travel_direction(across + wall)
    place = place - side * 0.5 * spec.width * travel_direction(heading)
    shift = settings.corner_shift * spec.width * float(np.sign(posture.tilt))
    return TouchCommand(
        place,
        heading,
        settings.wall_standoff * spec.width + length,
        max(settings.wall_reach * spec.width, length),
        Posture(posture.tilt, shift, spec.touch.deep_depth),
    )
