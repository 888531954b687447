"""The messages that the reconstructor has received, and which of them belong to a set.

Touches are kept in world coordinates at their time. If the object was turned over, `as_at_first`
transforms all later touches into the world frame of its first placement.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal, TypeGuard

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.explore import Longs, SpaceMap, UntouchedPlaces
from palpate.core.poses import Pose
from palpate.core.rebuild.contours import ContactPoints, stack_points
from palpate.core.rebuild.general import touch_distances
from palpate.core.touch import Pad
from palpate.messages import types
from palpate.nodes.rebuilding.candidates import QUALITIES, Candidates, Quality
from palpate.nodes.rebuilding.settings import DEFAULT_RECONSTRUCTOR, ReconstructorSettings

Goal = types.ModelGoal | types.PlanDone
Way = Literal["best", "thesis"]
TouchesByGoal = Mapping[int, Mapping[int, ContactPoints]]  # contacts by goal, then by touch


@dataclass(frozen=True, slots=True, eq=False)
class State:
    """What has been received."""

    quality: Quality = QUALITIES["normal"]  # of the final mesh
    method: Way = "best"  # how solids are rebuilt
    three_shapes: bool = False  # whether the coarse model is a sphere, a box or a cylinder
    platform: float | None = 0.0  # height on which the object stands [m]; None if it is held
    pad: Pad | None = None  # of the fingertip; None until the sensor is known
    # Contacts of all touches; goals of all fingers are numbered in one series.
    touches: TouchesByGoal = field(default_factory=dict)
    # Contacts of the hand, by the number of the closing; each contact counts as a touch.
    contacts: Mapping[int, ContactPoints] = field(default_factory=dict)
    # Number of turns of the object before the touches of a goal, by goal, and before a closing of
    # the hand, by closing; a goal before the first turn is left out.
    placements: Mapping[int, int] = field(default_factory=dict)
    closing_placements: Mapping[int, int] = field(default_factory=dict)
    turns: Mapping[int, Pose] = field(default_factory=dict)  # requested poses, by placement
    space: SpaceMap | None = None  # empty map of the space that a finger reaches
    # Voxels that the touches of a goal swept before the first turn, by goal.
    swept: Mapping[int, tuple[Longs, ...]] = field(default_factory=dict)
    # Places (n, 3) that the touches of a goal swept after a turn, by goal [m].
    swept_places: Mapping[int, tuple[Floats, ...]] = field(default_factory=dict)
    # Places on the pad's face without contact in the touches of a goal, by goal.
    untouched: Mapping[int, tuple[UntouchedPlaces, ...]] = field(default_factory=dict)
    # Contours and probes by number.
    contours: Mapping[int, types.Contour] = field(default_factory=dict)
    probes: Mapping[int, types.Probe] = field(default_factory=dict)
    asked: tuple[Goal, ...] = ()  # requests for models that are not fitted yet, in order
    history: tuple[Goal, ...] = ()  # requests for models that were fitted, in order
    # The last fitted solids, by number of the request; a cache that changes no model.
    fitted: dict[int, Candidates] = field(default_factory=dict)
    settings: ReconstructorSettings = DEFAULT_RECONSTRUCTOR


def touched_goals(goal: Goal) -> tuple[int, ...]:
    """Numbers of all goals whose touches count for a model."""
    return (*goal.contours, *goal.probes, *goal.arcs)


def as_at_first(state: State, poses: Sequence[Pose]) -> State:
    """The state with all touches in the world frame of the object's first placement.

    `poses`: of the object in the world after each turn. Touches in later placements, with unknown
    poses, are left out.
    """
    later = {id_: number for id_, number in state.placements.items() if number <= len(poses)}
    if not state.placements:
        return state
    touches, swept, untouched = dict(state.touches), dict(state.swept), dict(state.untouched)
    for id_ in state.placements.keys() - later.keys():
        touches[id_] = {}
        swept.pop(id_, None), untouched.pop(id_, None)
    assert state.space is not None
    for id_, number in later.items():
        pose = poses[number - 1]
        touches[id_] = {key: _in_frame(pose, item) for key, item in state.touches[id_].items()}
        freed = state.swept_places.get(id_, ())
        swept[id_] = tuple(state.space.numbers(pose.to_local(places)) for places in freed)
        untouched[id_] = tuple(
            item._replace(
                openings=pose.to_local(item.openings),
                valleys=pose.to_local(item.valleys),
                hanging=pose.to_local(item.hanging),
            )
            for item in state.untouched.get(id_, ())
        )
    return replace(state, touches=touches, swept=swept, untouched=untouched)


def contacts_in(
    state: State, goal: Goal, poses: Sequence[Pose], placements: Collection[int]
) -> list[tuple[ContactPoints, int]]:
    """Contacts of the hand with their placements, in the frame of the object's first placement."""
    contacts = [(closing, 0) for closing in closings_in(state, goal, 0) if 0 in placements]
    for number, pose in enumerate(poses, 1):
        if number in placements:
            closings = closings_in(state, goal, number)
            contacts += [(_in_frame(pose, closing), number) for closing in closings]
    return contacts


def _in_frame(pose: Pose, touched: ContactPoints) -> ContactPoints:
    assert touched.normals is not None
    points, normals = pose.to_local(touched.points), touched.normals @ pose.axes
    return ContactPoints(points, normals, touched.touch)


def is_complete(state: State, goal: Goal) -> bool:
    """Whether all messages of a set have been received."""
    turned = {state.closing_placements.get(number, 0) for number in range(goal.closings)}
    if not turned - {0} <= state.turns.keys():
        return False
    if is_coarse(goal):
        return all(number in state.contacts for number in range(goal.closings))
    contours = (*goal.contours, *goal.arcs)
    wanted: list[types.Contour | types.Probe | None] = [state.contours.get(id_) for id_ in contours]
    wanted += [state.probes.get(id_) for id_ in (*goal.probes, *goal.missed)]
    return all(number in state.contacts for number in range(goal.closings)) and all(
        item is not None and len(state.touches.get(item.id, {})) == item.touches for item in wanted
    )


def is_coarse(goal: Goal) -> TypeGuard[types.ModelGoal]:
    """Whether a request is for the coarse superquadric."""
    return isinstance(goal, types.ModelGoal) and not touched_goals(goal)


def known_space(state: State, goal: Goal) -> SpaceMap:
    """The map of space with the voxels that the touches of a set swept and touched."""
    assert state.space is not None
    none = np.zeros(0, np.int64)
    ids = (*touched_goals(goal), *goal.missed)
    free = [voxels for id_ in ids for voxels in state.swept.get(id_, ())]
    points = [contacts.points for contacts in touched_points(state, goal)]
    touched = state.space.numbers(np.concatenate([np.zeros((0, 3)), *points]))
    return state.space.marked(np.concatenate([none, *free]), touched)


def untouched_by(state: State, goal: Goal) -> UntouchedPlaces:
    """The places at which pads touched nothing in the touches of a set [m]."""
    touches = [item for id_ in touched_goals(goal) for item in state.untouched.get(id_, ())]
    nowhere = np.zeros((0, 3))
    none = UntouchedPlaces(nowhere, nowhere, np.zeros(0), nowhere)
    return UntouchedPlaces(*map(np.concatenate, zip(none, *touches, strict=True)))


def far_from_touch(state: State, goal: Goal) -> UntouchedPlaces:
    """The untouched places of a set without openings and hanging places near contacts."""
    untouched, limits = untouched_by(state, goal), state.settings.openings
    if not len(untouched.openings) + len(untouched.hanging):
        return untouched
    contacts = stack_points([part for part in touched_points(state, goal) if len(part.points)])
    spanned = touch_distances(contacts, untouched.openings) > limits.spanned_distance
    hanging = touch_distances(contacts, untouched.hanging) > limits.hanging_distance
    return untouched._replace(
        openings=untouched.openings[spanned], hanging=untouched.hanging[hanging]
    )


def touched_points(state: State, goal: Goal) -> list[ContactPoints]:
    """Contacts of each touch of a set; they may be empty."""
    return [contacts for id_ in touched_goals(goal) for contacts in touches_of(state, id_)]


def touches_of(state: State, id_: int) -> list[ContactPoints]:
    """Contacts of each touch of a goal, in order; they may be empty."""
    return [contacts for _, contacts in sorted(state.touches.get(id_, {}).items())]


def touched_since(state: State, before: Goal, goal: Goal) -> list[ContactPoints]:
    """Contacts of each touch of `goal` that is not of `before`."""
    return [contacts for contacts, _ in touches_since(state, set(touched_goals(before)), goal)]


def touches_since(
    state: State, known: Collection[int], goal: Goal
) -> list[tuple[ContactPoints, int]]:
    """Contacts and placement of each touch with contact, without those of `known` goals."""
    return [
        (contacts, state.placements.get(id_, 0))
        for id_ in touched_goals(goal)
        if id_ not in known
        for contacts in touches_of(state, id_)
        if len(contacts.points)
    ]


def closings_in(state: State, goal: Goal, placement: int) -> list[ContactPoints]:
    """Contacts of each closing of the hand in a placement, in world coordinates at that time."""
    return [
        state.contacts[number]
        for number in range(goal.closings)
        if state.closing_placements.get(number, 0) == placement
        and len(state.contacts[number].points)
    ]


def touches_in(state: State, goal: Goal, placement: int) -> list[ContactPoints]:
    """One contact of each touch of a set in a placement, in world coordinates at that time."""
    ids = [id_ for id_ in touched_goals(goal) if state.placements.get(id_, 0) == placement]
    return [_middle(part) for id_ in ids for part in touches_of(state, id_) if len(part.points)]


def _middle(touched: ContactPoints) -> ContactPoints:
    """The contact of a touch that is nearest to the mean of its contacts."""
    assert touched.normals is not None
    distances = np.linalg.norm(touched.points - touched.points.mean(axis=0), axis=1)
    nearest = slice(int(distances.argmin()), int(distances.argmin()) + 1)
    return ContactPoints(touched.points[nearest], touched.normals[nearest], touched.touch[nearest])


def placements_of(state: State) -> int:
    """Number of turns of the object, by the goals of turns and touches received so far."""
    return max((*state.turns, *state.placements.values()), default=0)
