"""Hole and cavity explorer: fingers that enter openings (Allen; named by Fung, 1999, 1.4.2).

A finger comes from above and from four sides, place by place, and the space that it sweeps is
marked free. Free space inside the convex hull of all touched points is an opening: a hole if it has
two mouths, a cavity if its bottom was touched. A hole narrower than the pad shows in the tactile
image, as untouched taxels between touched ones.
"""

from __future__ import annotations

import math
from collections.abc import Generator
from dataclasses import dataclass, field
from typing import Any, Literal, NamedTuple

import numpy as np

from palpate.core.arrays import Bools, Floats
from palpate.core.explore import TOUCHED, Longs, SpaceMap, SweepSettings, empty_map, swept_places
from palpate.core.poses import axes_along
from palpate.core.procedures.protocol import (
    UP,
    Contact,
    Exploration,
    Findings,
    FingerMove,
    Move,
    MoveResult,
    TouchSetup,
    approach,
    clear_of_platform,
    touch,
    touch_from_above,
)

SIDES: tuple[Floats, ...] = tuple(np.array([[1.0, 0, 0], [-1.0, 0, 0], [0, 1.0, 0], [0, -1.0, 0]]))
OpeningKind = Literal["hole", "cavity", "open"]


@dataclass(frozen=True, slots=True, kw_only=True)
class EntrySettings:
    """How a finger that stands on the rim of an opening is moved until it enters."""

    rim_offset: float = 0.2  # [pad's width] from the pad's middle, of a contact on a rim, at least
    hole_distance: float = 1.5  # [that offset] of the supposed opening beyond the pad's middle
    min_side_cosine: float = 0.9  # between the direction of a probe and the side it belongs to
    merge_distance: float = 0.75  # [pad's width] between places of one opening, at most
    shift: float = 0.4  # [offset of contact from pad's middle] by which the next probe is moved
    max_shifts: int = 5  # probes of one opening


@dataclass(frozen=True, slots=True, kw_only=True)
class OpeningSettings:
    """When free space inside the convex hull is an opening, and of which kind."""

    min_depth: float = 5.0e-3  # [m] below the hull, which an opening must exceed
    skin: float = 2.0e-3  # [m] below the hull, down to which free space is ignored
    mouth_depth: float = 6.0e-3  # [m] below the hull, down to which an opening is its mouth
    min_voxels: int = 12  # of an opening, deeper than `min_depth`; half of it of a mouth
    n_sectors: int = 16  # azimuths at which the rim of a mouth is located
    same_side: float = 0.7  # cosine between the normals of pieces that are joined to one mouth
    # Resultant length of a mouth's normals; a groove around the object has a shorter one.
    min_mean_normal: float = 0.6
    max_hole_cosine: float = 0.5  # between the normals of a hole's mouths
    bottom_distance: float = 9.0e-3  # [m] from the deepest free place to touched points of a bottom
    min_width: float = 4.0e-3  # [m] of a hole that shows in a tactile image alone
    entry: EntrySettings = EntrySettings()
    sweeps: SweepSettings = field(default=SweepSettings())


class Opening(NamedTuple):
    """A hole, a cavity, or an opening whose end was not reached."""

    kind: OpeningKind
    place: Floats  # middle of its mouth, (3,) [m]
    axis: Floats  # outward unit normal of the mouth, (3,)
    width: float  # [m] diameter of a circle with the mouth's area
    depth: float  # [m] from the mouth to the bottom, or to the deepest free place


class FoundOpenings(NamedTuple):
    """All openings of an object, the widest first."""

    openings: tuple[Opening, ...]


@dataclass(frozen=True, slots=True)
class _Survey:
    """All that fingers have swept and touched."""

    setup: TouchSetup
    settings: OpeningSettings
    swept: list[Floats] = field(default_factory=list)  # free places, (n, 3) each [m]
    points: list[Floats] = field(default_factory=list)  # touched points, (n, 3) each [m]
    # Untouched places between touched taxels, (n, 3) [m], and the outward normal there, (3,).
    hollow: list[tuple[Floats, Floats]] = field(default_factory=list)
    # Places off a rim, (3,) [m], where there may be an opening, and the outward normal, (3,).
    candidates: list[tuple[Floats, Floats]] = field(default_factory=list)

    def extent(self) -> tuple[Floats, Floats]:
        """Least and largest coordinates of the touched points [m]."""
        points = np.concatenate(self.points)
        return points.min(axis=0), points.max(axis=0)


def openings(
    setup: TouchSetup, pitch: float = 0.7, settings: OpeningSettings = OpeningSettings()
) -> Exploration:
    """Probe from above and from four sides, and report the holes and cavities.

    `pitch`: distance of the probed places over the pad's width, 0.3 to 1, else ValueError.
    Findings: `FoundOpenings`, possibly none. An opening narrower than the pad is found only where a
    pad stands over it.
    """
    if not 0.3 <= pitch <= 1.0:
        raise ValueError(f"pitch must be from 0.3 to 1, got {pitch}")
    first = yield from touch_from_above(setup)
    if first is None:
        return Findings(status="incomplete", reason="nothing was touched within reach")
    survey, step = _Survey(setup, settings), pitch * setup.width
    survey.points.append(first.points)
    yield from _from_above(survey, first.middle, step)
    yield from _from_sides(survey, step)
    yield from _probe_between_rims(survey)
    return _findings(survey)


def _from_sides(survey: _Survey, step: float) -> Generator[Move, MoveResult, None]:
    """Probe from four sides, on a grid over the extent of the object."""
    setup, (low, high) = survey.setup, survey.extent()
    for outward in SIDES:
        across = np.cross(UP, outward)
        reach = np.abs(across @ np.stack([low, high]).T).max()
        lowest = setup.platform + setup.common.fingertip_radius
        for height in np.arange(lowest, high[2], step):
            for offset in np.arange(-reach, reach + step, step):
                middle = 0.5 * (low + high)
                place = offset * across + middle * np.abs(outward) + height * UP
                yield from _probe(survey, _through_move(survey, place, outward, low, high))


def _through_move(
    survey: _Survey, place: Floats, outward: Floats, low: Floats, high: Floats
) -> FingerMove | None:
    """The move through a place from in front of all touched points to behind them."""
    distance = 0.5 * float((high - low) @ np.abs(outward)) + survey.setup.common.standoff
    return clear_of_platform(survey.setup, approach(place, outward, distance, distance))


def _from_above(survey: _Survey, start: Floats, step: float) -> Generator[Move, MoveResult, None]:
    """Probe from above, on a grid from `start` on, as far as the object extends."""
    setup, waiting, known = survey.setup, [(0, 0)], {(0, 0)}
    while waiting:
        i, j = waiting.pop(0)
        place = start + step * np.array([i, j, 0.0])
        top = max(float(points[:, 2].max()) for points in survey.points) + setup.common.standoff
        place[2] = setup.platform
        move = clear_of_platform(setup, approach(place, UP, top - setup.platform, 0.0))
        contact = yield from _probe(survey, move)
        if contact is not None and contact.is_hit:
            neighbours = ((i + 1, j), (i - 1, j), (i, j + 1), (i, j - 1))
            waiting += [cell for cell in neighbours if cell not in known]
            known.update(neighbours)


def _probe(survey: _Survey, move: FingerMove | None) -> Generator[Move, MoveResult, Contact | None]:
    """One guarded move; keeps the space that it sweeps, its contact, and a possible opening."""
    if move is None:
        return None
    setup, entry, sweeps = survey.setup, survey.settings.entry, survey.settings.sweeps
    contact = yield from touch(setup, move)
    axis, is_stopped = move.pose.axes[:, 2], contact.outcome != "miss"
    if contact.outcome != "inside":
        end = contact.pose if is_stopped else move.pose.advanced(move.reach)
        survey.swept.append(
            swept_places(
                setup.pad, move.pose, end, sweeps.voxel, touched=is_stopped, settings=sweeps
            )
        )
    if contact.is_hit:
        survey.points.append(contact.points)
        if len(contact.hollow):
            survey.hollow.append((contact.hollow, -axis))
        middle = contact.points.mean(axis=0)
        offset = _across_axis(move.pose.position - middle, axis)
        if np.linalg.norm(offset) > entry.rim_offset * setup.width:
            place = middle + (1.0 + entry.hole_distance) * offset
            survey.candidates.append((place, -axis))
    return contact


def _across_axis(vector: Floats, axis: Floats) -> Floats:
    """The part of a vector (3,) that is square to a unit vector (3,)."""
    return np.asarray(vector - (vector @ axis) * axis)


def _probe_between_rims(survey: _Survey) -> Generator[Move, MoveResult, None]:
    """Probe again between the rims on which pads stood, to enter what was missed."""
    (low, high), settings = survey.extent(), survey.settings
    entry, margin = settings.entry, settings.min_depth
    for outward in (UP, *SIDES):
        level = np.abs(outward) < 0.5
        least = entry.min_side_cosine
        facing = [place for place, normal in survey.candidates if normal @ outward > least]
        inner = (((p > low + margin) & (p < high - margin))[level].all() for p in facing)
        places = np.array([place for place, is_in in zip(facing, inner, strict=True) if is_in])
        if len(places) < 2:
            continue
        for group in _place_groups(places[:, level], entry.merge_distance * survey.setup.width):
            if len(group) > 1:
                place = places[group].mean(axis=0)
                place += (0.5 * (low + high) - place) * ~level
                yield from _probe_until_inside(survey, place, outward, (low, high))


def _probe_until_inside(
    survey: _Survey, place: Floats, outward: Floats, extent: tuple[Floats, Floats]
) -> Generator[Move, MoveResult, None]:
    """Probe a place, shifted off the rim on which the pad stands until the pad enters."""
    for _ in range(survey.settings.entry.max_shifts):
        contact = yield from _probe(survey, _through_move(survey, place, outward, *extent))
        if contact is None or not contact.is_hit:
            return
        offset = _across_axis(contact.pose.position - contact.points.mean(axis=0), outward)
        if np.linalg.norm(offset) < survey.setup.pad.pitch:
            return
        place = place + survey.settings.entry.shift * offset


def _place_groups(places: Floats, max_step: float) -> list[Longs]:
    """Numbers of places (n, k) by group; neighbours in a group are at most `max_step` apart."""
    from palpate.core.geometry import linked_groups

    distances = np.linalg.norm(places[:, None] - places[None], axis=2)
    groups = linked_groups(len(places), *np.nonzero(distances <= max_step))
    return [np.flatnonzero(groups == group) for group in np.unique(groups)]


def _findings(survey: _Survey) -> Findings:
    """The openings in the map of space, and those in tactile images."""
    space = empty_map(survey.setup.reach, survey.setup.platform, settings=survey.settings.sweeps)
    points = np.concatenate(survey.points)
    free = space.numbers(np.concatenate([np.zeros((0, 3)), *survey.swept]))
    space = space.marked(free, space.numbers(points))
    wide = openings_in(space, points, survey.settings)
    shape = FoundOpenings((*wide, *_narrow_openings(survey, wide)))
    kinds = [opening.kind for opening in shape.openings]
    names: dict[str, OpeningKind] = {"holes": "hole", "cavities": "cavity", "open_ends": "open"}
    figures = {name: float(kinds.count(kind)) for name, kind in names.items()}
    figures["free_m3"] = float(len(free)) * space.step**3
    reason = f"{kinds.count('hole')} holes, {kinds.count('cavity')} cavities"
    if kinds.count("open"):
        reason += f", and {kinds.count('open')} openings whose end no finger has reached"
    return Findings(status="done", reason=reason, shape=shape, figures=figures)


def openings_in(
    space: SpaceMap, points: Floats, settings: OpeningSettings = OpeningSettings()
) -> tuple[Opening, ...]:
    """Free space in the convex hull of points (n, 3) [m], the widest opening first.

    Points on a plane have no openings.
    """
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
    groups = _voxel_groups(space, places, depth > settings.skin, label, None)
    touched = np.argwhere(space.states == TOUCHED) * space.step + space.low
    all_openings = []
    for group in range(1, int(groups.max(initial=0)) + 1):
        members = groups == group
        if (members & (depth > settings.min_depth)).sum() < settings.min_voxels:
            continue
        is_mouth = members & (depth <= settings.mouth_depth)
        mouth = _voxel_groups(space, places, is_mouth, label, np.ones((3, 3, 3)))
        mouths = _mouths(places, mouth, normals[nearest], touched, settings)
        if mouths:
            all_openings.append(
                _classified(places[members], depth[members], mouths, touched, settings)
            )
    return tuple(sorted(all_openings, key=lambda opening: -opening.width))


def _voxel_groups(
    space: SpaceMap, places: Floats, members: Bools, label: Any, neighbours: Floats | None
) -> Longs:
    """Number of the connected group of voxels to which each place belongs, (n,); 0 of none."""
    cells = np.round((places - space.low) / space.step).astype(int)
    grid = np.zeros(space.states.shape, bool)
    grid[tuple(cells[members].T)] = True
    groups: Longs = label(grid, neighbours)[0][tuple(cells.T)]
    return groups * members


class _Mouth(NamedTuple):
    """Where an opening reaches the hull."""

    place: Floats  # its middle, (3,) [m]
    axis: Floats  # outward unit normal, (3,)
    area: float  # [m2]


def _mouths(
    places: Floats, groups: Longs, normals: Floats, touched: Floats, settings: OpeningSettings
) -> list[_Mouth]:
    """The mouths of an opening, that from above first, then the widest; none of a groove.

    Pieces on one side of the object are one mouth.
    """
    count = int(groups.max(initial=0))
    pieces = [np.flatnonzero(groups == number) for number in range(1, count + 1)]
    sides: list[list[Longs]] = []
    for piece in sorted(pieces, key=len, reverse=True):
        normal = normals[piece].mean(axis=0)
        is_groove = np.linalg.norm(normal) < settings.min_mean_normal
        if is_groove or len(piece) < settings.min_voxels // 2:
            continue
        for side in sides:
            if normals[side[0]].mean(axis=0) @ normal > settings.same_side:
                side.append(piece)
                break
        else:
            sides.append([piece])
    mouths = [_mouth(places, normals, np.concatenate(side), touched, settings) for side in sides]
    return sorted(mouths, key=lambda mouth: (-round(float(mouth.axis[2])), -mouth.area))


def _mouth(
    places: Floats, normals: Floats, members: Longs, touched: Floats, settings: OpeningSettings
) -> _Mouth:
    """The mouth of some of the free places (n, 3).

    On each azimuth its rim is midway between the free places and the touched ones (k, 3) around
    them: only whole pads enter, so that the free places alone give too small a mouth.
    """
    normal = normals[members].mean(axis=0)
    normal /= np.linalg.norm(normal)
    middle, across = places[members].mean(axis=0), axes_along(normal)[:, :2]
    offsets, count = touched - middle, settings.n_sectors
    free, free_sectors = _polar((places[members] - middle) @ across, count)
    is_level = np.abs(offsets @ normal) <= settings.mouth_depth
    rim, rim_sectors = _polar(offsets[is_level] @ across, count)
    inner, outer = np.zeros(count), np.full(count, math.inf)
    np.maximum.at(inner, free_sectors, free)
    is_outside = rim > inner[rim_sectors]
    np.minimum.at(outer, rim_sectors[is_outside], rim[is_outside])
    radii = np.where(np.isfinite(outer), 0.5 * (inner + outer), inner)
    return _Mouth(middle, normal, math.pi * float((radii**2).mean()))


def _polar(flat: Floats, n_sectors: int) -> tuple[Floats, Longs]:
    """Radius of places (n, 2), and the sector of each."""
    turns = np.arctan2(flat[:, 1], flat[:, 0]) / (2.0 * math.pi) % 1.0
    return np.hypot(flat[:, 0], flat[:, 1]), (turns * n_sectors).astype(np.int64) % n_sectors


def _classified(
    places: Floats,
    depth: Floats,
    mouths: list[_Mouth],
    touched: Floats,
    settings: OpeningSettings,
) -> Opening:
    """An opening, of the kind that its mouths and its bottom show."""
    mouth = mouths[0]
    below = (mouth.place - places) @ mouth.axis
    deepest = places[int(below.argmax())]
    at_mouth = depth[np.abs(below) <= settings.mouth_depth]
    total = float(below.max()) + (float(at_mouth.mean()) if len(at_mouth) else settings.skin)
    kind: OpeningKind = "open"
    cosines = [other.axis @ mouth.axis for other in mouths[1:]]
    if min(cosines, default=1.0) < settings.max_hole_cosine:
        kind = "hole"
    else:
        offsets, reach = touched - deepest, settings.bottom_distance
        along = offsets @ mouth.axis
        aside, behind = np.linalg.norm(offsets - np.outer(along, mouth.axis), axis=1), -along
        bottom = behind[(aside < reach) & (behind > 0.0) & (behind < reach)]
        if len(bottom):
            kind, total = "cavity", total + float(np.median(bottom))
    width = math.sqrt(4.0 * mouth.area / math.pi)
    return Opening(kind, mouth.place, mouth.axis, width, total)


def _narrow_openings(survey: _Survey, wide: tuple[Opening, ...]) -> tuple[Opening, ...]:
    """Openings too narrow for the pad: untouched between taxels, and by all other contacts."""
    from palpate.core.geometry import point_tree

    setup, tree = survey.setup, point_tree(np.concatenate(survey.points))
    kept: list[Opening] = []
    for spanned, outward in survey.hollow:
        places = spanned[np.asarray(tree.query(spanned)[0]) > setup.pad.pitch]
        width = math.sqrt(4.0 * len(places) / math.pi) * setup.pad.pitch
        if width < survey.settings.min_width:
            continue
        place, least = places.mean(axis=0), max(width, setup.width)
        distances = ((np.linalg.norm(o.place - place), o.width) for o in (*wide, *kept))
        if not any(distance < max(other, least) for distance, other in distances):
            kept.append(Opening("open", place, outward, width, 0.0))
    return tuple(kept)
