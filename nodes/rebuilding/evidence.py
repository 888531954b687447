"""What the reconstructor has received, and what of it belongs to a set that it is asked for."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import TypeGuard

import numpy as np

from palpate.core import Floats, split_pose
from palpate.core.explore import Longs, SpaceMap
from palpate.core.rebuild.contours import ContactPoints, stack_points
from palpate.core.rebuild.general import touch_distances
from palpate.core.touch import Pad
from palpate.messages import types
from palpate.nodes.rebuilding.candidates import QUALITIES, Candidates, Quality

Goal = types.ModelGoal | types.PlanDone
TouchesByGoal = Mapping[int, Mapping[int, ContactPoints]]  # Goal to touch to what it touched
HALF_OPENING = 1.5e-3  # From every touch: what pads spanned and lies farther is an opening, m
UPRIGHT_TOLERANCE = 1e-12  # By how much the cosine of an upright frame's lean may be less than 1
TOUCHED_OUTCOMES = ("hit", "bottomed")  # How a probe ended that met the object


@dataclass(frozen=True, slots=True, eq=False)
class State:
    """What has been received."""

    quality: Quality = QUALITIES["normal"]  # Of the final mesh
    platform: float = 0.0  # Height on which the object stands, m
    pad: Pad | None = None  # The sensor's array
    # Every touch; goals are numbered for all fingers together.
    touches: TouchesByGoal = field(default_factory=lambda: MappingProxyType({}))
    # Where the hand met the object, by the number of the closing; each contact is a touch.
    contacts: Mapping[int, ContactPoints] = field(default_factory=lambda: MappingProxyType({}))
    space: SpaceMap | None = None  # Of all that a finger reaches, empty
    # Voxels that the touches of a goal have swept.
    swept: Mapping[int, tuple[Longs, ...]] = field(default_factory=lambda: MappingProxyType({}))
    # Places that the pad spanned in a goal's touches, between what it touched.
    spanned: Mapping[int, tuple[Floats, ...]] = field(default_factory=lambda: MappingProxyType({}))
    # By number.
    contours: Mapping[int, types.Contour] = field(default_factory=lambda: MappingProxyType({}))
    probes: Mapping[int, types.Probe] = field(
        default_factory=lambda: MappingProxyType({})
    )  # By number
    asked: tuple[Goal, ...] = ()  # Models still to be fitted, in order
    history: tuple[Goal, ...] = ()  # Those that were fitted, in order
    # What was fitted last, by number, lest it is fitted twice: no model differs for it.
    fitted: dict[int, Candidates] = field(default_factory=dict)


def touched_goals(goal: Goal) -> tuple[int, ...]:
    """Numbers of all goals whose touches count for a model."""
    return (*goal.contours, *goal.probes, *goal.arcs)


def is_complete(state: State, goal: Goal) -> bool:
    """Whether all of a set is there."""
    if is_coarse(goal):
        return all(number in state.contacts for number in range(goal.closings))
    contours = (*goal.contours, *goal.arcs)
    wanted: list[types.Contour | types.Probe | None] = [state.contours.get(id_) for id_ in contours]
    wanted += [state.probes.get(id_) for id_ in (*goal.probes, *goal.missed)]
    return all(number in state.contacts for number in range(goal.closings)) and all(
        one is not None and len(state.touches.get(one.id, {})) == one.touches for one in wanted
    )


def is_coarse(goal: Goal) -> TypeGuard[types.ModelGoal]:
    """Whether a superquadric is asked for."""
    return isinstance(goal, types.ModelGoal) and not touched_goals(goal)


def known_space(state: State, goal: Goal) -> SpaceMap:
    """The map of space, as the touches of a set have left it."""
    assert state.space is not None
    none = np.zeros(0, np.int64)
    ids = (*touched_goals(goal), *goal.missed)
    free = [voxels for id_ in ids for voxels in state.swept.get(id_, ())]
    points = [one.points for one in touched_points(state, goal)]
    touched = state.space.numbers(np.concatenate([np.zeros((0, 3)), *points]))
    return state.space.marked(np.concatenate([none, *free]), touched)


def spanned_by(state: State, goal: Goal) -> Floats:
    """Places (n, 3) that pads spanned, and that nothing has touched anywhere near, m."""
    spanned = [one for id_ in touched_goals(goal) for one in state.spanned.get(id_, ())]
    places = np.concatenate([np.zeros((0, 3)), *spanned])
    if not len(places):
        return places
    touched = stack_points([one for one in touched_points(state, goal) if len(one.points)])
    return places[touch_distances(touched, places) > HALF_OPENING]


def touched_points(state: State, goal: Goal) -> list[ContactPoints]:
    """What each touch of a set has touched, perhaps nothing."""
    ids = touched_goals(goal)
    return [state.touches[id_][n] for id_ in ids for n in sorted(state.touches.get(id_, {}))]


def touched_since(state: State, before: Goal, goal: Goal) -> list[ContactPoints]:
    """What each touch between two goals has touched."""
    known = set(touched_goals(before))
    ids = [id_ for id_ in touched_goals(goal) if id_ not in known]
    found = [state.touches[id_][n] for id_ in ids for n in sorted(state.touches.get(id_, {}))]
    return [one for one in found if len(one.points)]


def common_frame(contours: Sequence[types.Contour]) -> Floats:
    """Pose (7,) of the frame in which all contours were traced.

    Raises ValueError if they were not all traced in the same.
    """
    first = contours[0]
    for other in contours[1:]:
        if not np.array_equal(other.frame, first.frame):
            raise ValueError(
                f"contours must be traced in one slicing frame, but that of contour {other.id} "
                f"is not that of contour {first.id}"
            )
    return first.frame


def is_upright(frame: Floats) -> bool:
    """Whether heights in a frame are the world's, so that an object stands on its lower end."""
    return bool(split_pose(frame)[1][2, 2] >= 1.0 - UPRIGHT_TOLERANCE)


def touched_ends(
    contours: Sequence[types.Contour],
    probes: Sequence[types.Probe],
    touched: Mapping[int, Sequence[ContactPoints]],
    platform: float | None,
) -> Floats | None:
    """Where the ends of an object were touched, (k, 3), m; None if they were not.

    Arguments are as for `rebuild_set`; of probes of which nothing else is known, their own point
    counts. A known height on which the object stands is a touch of its lower end if it is upright.

    Raises ValueError if the contours were not traced in one frame.
    """
    frame = common_frame(contours)
    tops = list(_probed(contours, probes, touched, frame))
    if platform is not None and is_upright(frame):
        tops.append(np.array([*frame[:2], platform]))
    return np.array(tops) if tops else None


def _probed(
    contours: Sequence[types.Contour],
    probes: Sequence[types.Probe],
    touched: Mapping[int, Sequence[ContactPoints]],
    frame: Floats,
) -> Iterator[Floats]:
    """Farthest point (3,) of each probe that touched an end: beyond the contours."""
    position, axes = split_pose(frame)
    levels = [contour.height for contour in contours]
    low, high = min(levels), max(levels)
    for probe in probes:
        if probe.outcome not in TOUCHED_OUTCOMES:
            continue
        way = 1.0 if (probe.point - position) @ axes[:, 2] > 0.5 * (low + high) else -1.0
        found = [one.points for one in touched.get(probe.id, ()) if len(one.points)]
        points = np.concatenate(found) if found else probe.point[None]
        reached = way * (points - position) @ axes[:, 2]
        if reached.max() > max(way * low, way * high):
            yield points[int(reached.argmax())]
