"""Hole and cavity explorer: fingers that fall in (Allen; Fung, 1999, 1.4.2 names his explorer).

A finger comes from above and from four sides, place by place, and what it sweeps is free in the
map of space. What is free inside the convex hull of all that was touched is an opening: a hole if
it has two mouths, a cavity if its bottom was touched. A hole narrower than the pad shows in the
tactile image, as taxels that touch nothing between others that do.
"""

from __future__ import annotations

import math
from collections.abc import Generator
from typing import Any, Literal, NamedTuple

import numpy as np

from palpate.core.arrays import Bools, Floats
from palpate.core.explore import SWEEPS, TOUCHED, Longs, SpaceMap, empty_map, swept_places
from palpate.core.poses import axes_along
from palpate.core.procedures.protocol import (
    CLEARANCE,
    STANDOFF,
    UP,
    Contact,
    Exploration,
    Findings,
    FingerMove,
    Met,
    Move,
    TouchSetting,
    approach,
    kept_clear,
    touch,
    touch_from_above,
)

PITCH = 0.7  # Of the pad's width, between two places
INSIDE = 5.0e-3  # Depth in the hull from which free space is an opening, m
SKIN, MOUTH = 2.0e-3, 6.0e-3  # What is nearer to the hull tells nothing; so near is a mouth, m
LEAST = 12  # Voxels of an opening
N_SECTORS = 16  # Azimuths in which the rim of a mouth is looked for
SAME_SIDE = 0.7  # Cosine between mouths that open to one side
NEAR = 0.75  # Of the pad's width: places so near to each other mean one opening
GROOVE = 0.6  # Length of a mouth's mean normal: what goes around the object is no opening
BOTTOM = 9.0e-3  # A bottom lies within so much beyond the deepest free place, m
# A pad whose contact is so far off its middle, over its width, stands on a rim; off it, so many
# times that, there may be an opening.
ASIDE, OFF_RIM = 0.2, 1.5
SHIFT, MOST_SHIFTS = 0.4, 5  # Of the way from what a pad stands on to its middle, to fall in
NARROW = 4.0e-3  # Least width of a hole in a tactile image, m
SIDES = np.array([[1.0, 0, 0], [-1.0, 0, 0], [0, 1.0, 0], [0, -1.0, 0]])
OpeningKind = Literal["hole", "cavity", "open"]


class Opening(NamedTuple):
    """A hole, a cavity, or an opening whose end no finger has reached."""

    kind: OpeningKind
    place: Floats  # Middle of its mouth, (3,), m
    axis: Floats  # Outward unit normal of the mouth, (3,)
    width: float  # Diameter of a circle with the mouth's area, m
    depth: float  # From the mouth to its bottom, or the deepest place known to be free, m


class FoundOpenings(NamedTuple):
    """All openings of an object, the widest first."""

    openings: tuple[Opening, ...]


class _Probed(NamedTuple):
    """What the fingers have found so far."""

    swept: list[Floats]  # Places that are free, (n, 3) each, m
    points: list[Floats]  # Touched ones
    hollow: list[tuple[Floats, Floats]]  # Places that pads spanned, and the outward normal there
    wanted: list[tuple[Floats, Floats]]  # Where pads might have fallen in, and from where, as this


def openings(setting: TouchSetting, pitch: float = PITCH) -> Exploration:
    """Probe from above and from four sides, and tell the holes and cavities.

    `pitch`: distance of the places over the pad's width, 0.3 to 1, else ValueError. Findings:
    `FoundOpenings`, maybe none. What is narrower than the pad is seen only from above it.
    """
    if not 0.3 <= pitch <= 1.0:
        raise ValueError(f"pitch must be from 0.3 to 1, got {pitch}")
    first = yield from touch_from_above(setting)
    if first is None:
        return Findings(status="incomplete", reason="nothing was touched within reach")
    found, step = _Probed([], [first.points], [], []), pitch * setting.width
    yield from _from_above(setting, found, first.middle, step)
    low, high = _extent(found)
    for outward in SIDES:
        across = np.cross(UP, outward)
        reach = np.abs(across @ np.stack([low, high]).T)
        for height in np.arange(setting.platform + CLEARANCE, high[2], step):
            for aside in np.arange(-reach.max(), reach.max() + step, step):
                middle = 0.5 * (low + high)
                place = aside * across + middle * np.abs(outward) + height * UP
                yield from _probe(setting, found, _across(setting, place, outward, low, high))
    yield from _centred(setting, found)
    return _findings(setting, found)


def _across(
    setting: TouchSetting, place: Floats, outward: Floats, low: Floats, high: Floats
) -> FingerMove | None:
    """The move through a place from before all that was touched to behind it."""
    room = 0.5 * float((high - low) @ np.abs(outward)) + STANDOFF
    return kept_clear(setting, approach(place, outward, room, room))


def _from_above(
    setting: TouchSetting, found: _Probed, start: Floats, step: float
) -> Generator[Move, Met, None]:
    """Probe from above, place beside place, as far as the object goes."""
    waiting, known = [(0, 0)], {(0, 0)}
    while waiting:
        i, j = waiting.pop(0)
        place = start + step * np.array([i, j, 0.0])
        top = max(float(one[:, 2].max()) for one in found.points) + STANDOFF
        place[2] = setting.platform
        move = kept_clear(setting, approach(place, UP, top - setting.platform, 0.0))
        contact = yield from _probe(setting, found, move)
        if contact is not None and contact.met:
            beside = ((i + 1, j), (i - 1, j), (i, j + 1), (i, j - 1))
            waiting += [one for one in beside if one not in known]
            known.update(beside)


def _probe(
    setting: TouchSetting, found: _Probed, move: FingerMove | None
) -> Generator[Move, Met, Contact | None]:
    """One guarded move, and what it says of the space that it goes through."""
    if move is None:
        return None
    contact = yield from touch(setting, move)
    axis, met = move.pose.axes[:, 2], contact.outcome != "miss"
    if contact.outcome != "inside":
        end = contact.pose if met else move.pose.advanced(move.reach)
        found.swept.append(swept_places(setting.pad, move.pose, end, SWEEPS.voxel, touched=met))
    if contact.met:
        found.points.append(contact.points)
        if len(contact.hollow):
            found.hollow.append((contact.hollow, -axis))
        off = move.pose.position - contact.points.mean(axis=0)
        off -= (off @ axis) * axis
        if np.linalg.norm(off) > ASIDE * setting.width:
            found.wanted.append((contact.points.mean(axis=0) + (1.0 + OFF_RIM) * off, -axis))
    return contact


def _centred(setting: TouchSetting, found: _Probed) -> Generator[Move, Met, None]:
    """Probe once more between the rims on which pads stood, to fall in where nobody did."""
    low, high = _extent(found)
    for outward in (UP, *SIDES):
        level = np.abs(outward) < 0.5
        wanted = [place for place, way in found.wanted if way @ outward > 0.9]
        places = np.array([one for one in wanted if _within(one, low, high, level)])
        if len(places) < 2:
            continue
        for group in _together(places[:, level], NEAR * setting.width):
            if len(group) > 1:
                place = places[group].mean(axis=0)
                place += (0.5 * (low + high) - place) * ~level
                yield from _fall_in(setting, found, place, outward, (low, high))


def _fall_in(
    setting: TouchSetting,
    found: _Probed,
    place: Floats,
    outward: Floats,
    extent: tuple[Floats, Floats],
) -> Generator[Move, Met, None]:
    """Probe a place, and beside it, off the rim on which the pad stands, until it falls in."""
    for _ in range(MOST_SHIFTS):
        contact = yield from _probe(setting, found, _across(setting, place, outward, *extent))
        if contact is None or not contact.met:
            return
        off = contact.pose.position - contact.points.mean(axis=0)
        off -= (off @ outward) * outward
        if np.linalg.norm(off) < setting.pad.pitch:
            return
        place = place + SHIFT * off


def _within(place: Floats, low: Floats, high: Floats, level: Bools) -> bool:
    return bool(((place > low + INSIDE) & (place < high - INSIDE))[level].all())


def _together(places: Floats, near: float) -> list[Longs]:
    """Numbers of places (n, k) that a chain of steps of at most `near` joins, group by group."""
    from palpate.core.geometry import linked_groups

    apart = np.linalg.norm(places[:, None] - places[None], axis=2)
    groups = linked_groups(len(places), *np.nonzero(apart <= near))
    return [np.flatnonzero(groups == group) for group in np.unique(groups)]


def _extent(found: _Probed) -> tuple[Floats, Floats]:
    points = np.concatenate(found.points)
    return points.min(axis=0), points.max(axis=0)


def _findings(setting: TouchSetting, found: _Probed) -> Findings:
    """The openings that the map of space shows."""
    space = empty_map(setting.reach, setting.platform)
    points = np.concatenate(found.points)
    free = space.numbers(np.concatenate([np.zeros((0, 3)), *found.swept]))
    space = space.marked(free, space.numbers(points))
    wide = openings_in(space, points)
    shape = FoundOpenings((*wide, *_narrow(setting, found, wide)))
    told = [one.kind for one in shape.openings]
    names: dict[str, OpeningKind] = {"holes": "hole", "cavities": "cavity", "open_ends": "open"}
    figures = {name: float(told.count(kind)) for name, kind in names.items()}
    figures["free_m3"] = float(len(free)) * space.step**3
    reason = f"{told.count('hole')} holes, {told.count('cavity')} cavities"
    if told.count("open"):
        reason += f", and {told.count('open')} openings whose end no finger has reached"
    return Findings(status="done", reason=reason, shape=shape, figures=figures)


def openings_in(space: SpaceMap, points: Floats) -> tuple[Opening, ...]:
    """What is free in the convex hull of points (n, 3), m, the widest first; none of a plane."""
    from scipy.ndimage import label
    from scipy.spatial import ConvexHull, QhullError

    try:
        hull = ConvexHull(points)
    except QhullError:
        return ()
    normals, offsets = hull.equations[:, :3], hull.equations[:, 3]
    places = space.free_places()
    places = places[((places >= points.min(axis=0)) & (places <= points.max(axis=0))).all(axis=1)]
    if not len(places):
        return ()
    above = places @ normals.T + offsets
    depth, nearest = -above.max(axis=1), above.argmax(axis=1)
    inner = depth > SKIN
    groups = _groups(space, places, inner, label, None)
    touched = np.argwhere(space.states == TOUCHED) * space.step + space.low
    found = []
    for group in range(1, int(groups.max(initial=0)) + 1):
        of_it = groups == group
        if (of_it & (depth > INSIDE)).sum() < LEAST:
            continue
        mouth = _groups(space, places, of_it & (depth <= MOUTH), label, np.ones((3, 3, 3)))
        mouths = _mouths(places, mouth, normals[nearest], touched)
        if mouths:
            found.append(_opening(places[of_it], depth[of_it], mouths, touched))
    return tuple(sorted(found, key=lambda one: -one.width))


def _groups(
    space: SpaceMap, places: Floats, members: Bools, label: Any, beside: Floats | None
) -> Longs:
    """Number of the group of voxels to which each place belongs, (n,); 0 of none."""
    at = np.round((places - space.low) / space.step).astype(int)
    grid = np.zeros(space.states.shape, bool)
    grid[tuple(at[members].T)] = True
    found: Longs = label(grid, beside)[0][tuple(at.T)]
    return found * members


class _Mouth(NamedTuple):
    """Where an opening reaches the hull."""

    place: Floats
    axis: Floats  # Outward unit normal
    area: float  # m2


def _mouths(places: Floats, groups: Longs, normals: Floats, touched: Floats) -> list[_Mouth]:
    """The mouths of an opening, that from above first, then the widest; none of a groove.

    What opens to one side is one mouth, though fingers have found it in pieces.
    """
    pieces = [np.flatnonzero(groups == one) for one in range(1, int(groups.max(initial=0)) + 1)]
    sides: list[list[Longs]] = []
    for piece in sorted(pieces, key=len, reverse=True):
        normal = normals[piece].mean(axis=0)
        if np.linalg.norm(normal) < GROOVE or len(piece) < LEAST // 2:
            continue
        for side in sides:
            if normals[side[0]].mean(axis=0) @ normal > SAME_SIDE:
                side.append(piece)
                break
        else:
            sides.append([piece])
    found = [_mouth(places, normals, np.concatenate(side), touched) for side in sides]
    return sorted(found, key=lambda one: (-round(float(one.axis[2])), -one.area))


def _mouth(places: Floats, normals: Floats, members: Longs, touched: Floats) -> _Mouth:
    """The mouth of some of the free places (n, 3).

    On each azimuth its rim is midway between what is free and what was touched (k, 3) about it:
    only whole pads fall in, so that the free places alone make it too small.
    """
    normal = normals[members].mean(axis=0)
    normal /= np.linalg.norm(normal)
    middle, across = places[members].mean(axis=0), axes_along(normal)[:, :2]
    off = touched - middle
    free, free_sectors = _polar((places[members] - middle) @ across)
    rim, rim_sectors = _polar(off[np.abs(off @ normal) <= MOUTH] @ across)
    inner, outer = np.zeros(N_SECTORS), np.full(N_SECTORS, math.inf)
    np.maximum.at(inner, free_sectors, free)
    beyond = rim > inner[rim_sectors]
    np.minimum.at(outer, rim_sectors[beyond], rim[beyond])
    radii = np.where(np.isfinite(outer), 0.5 * (inner + outer), inner)
    return _Mouth(middle, normal, math.pi * float((radii**2).mean()))


def _polar(flat: Floats) -> tuple[Floats, Longs]:
    """Radius of places (n, 2), and in which of the sectors each lies."""
    turns = np.arctan2(flat[:, 1], flat[:, 0]) / (2.0 * math.pi) % 1.0
    return np.hypot(flat[:, 0], flat[:, 1]), (turns * N_SECTORS).astype(np.int64) % N_SECTORS


def _opening(places: Floats, depth: Floats, mouths: list[_Mouth], touched: Floats) -> Opening:
    """What an opening is, by its mouths and its bottom."""
    mouth = mouths[0]
    below = (mouth.place - places) @ mouth.axis
    deepest = places[int(below.argmax())]
    at_mouth = depth[np.abs(below) <= MOUTH]
    deep = float(below.max()) + (float(at_mouth.mean()) if len(at_mouth) else SKIN)
    kind: OpeningKind = "open"
    if len(mouths) > 1 and min(one.axis @ mouth.axis for one in mouths[1:]) < 0.5:
        kind = "hole"
    else:
        off = touched - deepest
        aside = np.linalg.norm(off - np.outer(off @ mouth.axis, mouth.axis), axis=1)
        beyond = -(off @ mouth.axis)
        bottom = beyond[(aside < BOTTOM) & (beyond > 0.0) & (beyond < BOTTOM)]
        if len(bottom):
            kind, deep = "cavity", deep + float(np.median(bottom))
    width = math.sqrt(4.0 * mouth.area / math.pi)
    return Opening(kind, mouth.place, mouth.axis, width, deep)


def _narrow(
    setting: TouchSetting, found: _Probed, wide: tuple[Opening, ...]
) -> tuple[Opening, ...]:
    """Openings too narrow for the pad: what contacts spanned, and nothing touched anywhere."""
    from palpate.core.geometry import point_tree

    tree = point_tree(np.concatenate(found.points))
    kept: list[Opening] = []
    for places, outward in found.hollow:
        places = places[np.asarray(tree.query(places)[0]) > setting.pad.pitch]
        width = math.sqrt(4.0 * len(places) / math.pi) * setting.pad.pitch
        if width < NARROW:
            continue
        one = Opening("open", places.mean(axis=0), outward, width, 0.0)
        near = (
            np.linalg.norm(other.place - one.place) < max(other.width, one.width, setting.width)
            for other in (*wide, *kept)
        )
        if not any(near):
            kept.append(one)
    return tuple(kept)
