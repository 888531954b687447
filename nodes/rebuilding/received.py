"""What the reconstructor has received, and what belongs to a set of it.

Touches are kept in the world as it was then. An object that was turned over lies otherwise since:
`as_at_first` gives what was received as it would be had the object never been moved.
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

Goal = types.ModelGoal | types.PlanDone
Way = Literal["best", "thesis"]
TouchesByGoal = Mapping[int, Mapping[int, ContactPoints]]  # Goal to touch to what it touched


@dataclass(frozen=True, slots=True, eq=False)
class State:
    """What has been received."""

    quality: Quality = QUALITIES["normal"]  # Of the final mesh
    method: Way = "best"  # How solids are rebuilt
    three_shapes: bool = False  # Whether the coarse model is a sphere, a box or a cylinder
    platform: float | None = 0.0  # Height on which the object stands, m; None if it is held
    pad: Pad | None = None  # The sensor's array
    # Every touch; goals are numbered for all fingers together.
    touches: TouchesByGoal = field(default_factory=dict)
    # Where the hand met the object, by the number of the closing; each contact is a touch.
    contacts: Mapping[int, ContactPoints] = field(default_factory=dict)
    # How often the object had been turned over, if it had been: by the number of the goal that was
    # touched for, and of the closing.
    placements: Mapping[int, int] = field(default_factory=dict)
    closing_placements: Mapping[int, int] = field(default_factory=dict)
    turns: Mapping[int, Pose] = field(default_factory=dict)  # How it was to lie then, by placement
    space: SpaceMap | None = None  # Of all that a finger reaches, empty
    # Voxels that the touches of a goal have swept.
    swept: Mapping[int, tuple[Longs, ...]] = field(default_factory=dict)
    # Places that they have swept since the object was turned over.
    swept_places: Mapping[int, tuple[Floats, ...]] = field(default_factory=dict)
    # Places on the pad's face that touched nothing in a goal's touches.
    untouched: Mapping[int, tuple[UntouchedPlaces, ...]] = field(default_factory=dict)
    # Both by number.
    contours: Mapping[int, types.Contour] = field(default_factory=dict)
    probes: Mapping[int, types.Probe] = field(default_factory=dict)
    asked: tuple[Goal, ...] = ()  # Models still to be fitted, in order
    history: tuple[Goal, ...] = ()  # Those that were fitted, in order
    # What was fitted last, by number, lest it is fitted twice: no model differs for it.
    fitted: dict[int, Candidates] = field(default_factory=dict)


def touched_goals(goal: Goal) -> tuple[int, ...]:
    """Numbers of all goals whose touches count for a model."""
    return (*goal.contours, *goal.probes, *goal.arcs)


def as_at_first(state: State, poses: Sequence[Pose]) -> State:
    """What was received as it would be had the object never been turned over.

    `poses`: of the object in the world after each time. What was touched in later placements than
    these is left out.
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
        touches[id_] = {key: _seen_from(pose, one) for key, one in state.touches[id_].items()}
        freed = state.swept_places.get(id_, ())
        swept[id_] = tuple(state.space.numbers(pose.to_local(one)) for one in freed)
        untouched[id_] = tuple(
            one._replace(
                openings=pose.to_local(one.openings),
                valleys=pose.to_local(one.valleys),
                hanging=pose.to_local(one.hanging),
            )
            for one in state.untouched.get(id_, ())
        )
    return replace(state, touches=touches, swept=swept, untouched=untouched)


def contacts_in(
    state: State, goal: Goal, poses: Sequence[Pose], placements: Collection[int]
) -> list[tuple[ContactPoints, int]]:
    """What the hand met in some placements, as if the object had never been turned over."""
    contacts = [(one, 0) for one in closings_in(state, goal, 0) if 0 in placements]
    for number, pose in enumerate(poses, 1):
        if number in placements:
            met = closings_in(state, goal, number)
            contacts += [(_seen_from(pose, one), number) for one in met]
    return contacts


def _seen_from(pose: Pose, touched: ContactPoints) -> ContactPoints:
    assert touched.normals is not None
    points, normals = pose.to_local(touched.points), touched.normals @ pose.axes
    return ContactPoints(points, normals, touched.touch)


def is_complete(state: State, goal: Goal) -> bool:
    """Whether all of a set is there."""
    turned = {state.closing_placements.get(number, 0) for number in range(goal.closings)}
    if not turned - {0} <= state.turns.keys():
        return False
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


def untouched_by(state: State, goal: Goal) -> UntouchedPlaces:
    """The places at which pads touched nothing in the touches of a set [m]."""
    touches = [one for id_ in touched_goals(goal) for one in state.untouched.get(id_, ())]
    nowhere = np.zeros((0, 3))
    none = UntouchedPlaces(nowhere, nowhere, np.zeros(0), nowhere)
    return UntouchedPlaces(*map(np.concatenate, zip(none, *touches, strict=True)))


@dataclass(frozen=True, slots=True, kw_only=True)
class OpeningSettings:
    """How far from every touch a place lies at which a pad that touched nothing tells of a hole."""

    between: float = 1.5e-3  # [m] of places between others that were touched: narrower holes hide
    beside: float = 4.0e-3  # [m] of places beside all that was touched: edges are rounded off


OPENINGS = OpeningSettings()


def far_from_touch(state: State, goal: Goal) -> UntouchedPlaces:
    """The same without openings and hanging places that lie near to touch."""
    untouched = untouched_by(state, goal)
    if not len(untouched.openings) + len(untouched.hanging):
        return untouched
    contacts = stack_points([one for one in touched_points(state, goal) if len(one.points)])
    mouths = untouched.openings[touch_distances(contacts, untouched.openings) > OPENINGS.between]
    hanging = untouched.hanging[touch_distances(contacts, untouched.hanging) > OPENINGS.beside]
    return untouched._replace(openings=mouths, hanging=hanging)


def touched_points(state: State, goal: Goal) -> list[ContactPoints]:
    """What each touch of a set has touched, perhaps nothing."""
    return [one for id_ in touched_goals(goal) for one in touches_of(state, id_)]


def touches_of(state: State, id_: int) -> list[ContactPoints]:
    """What each touch of a goal has touched, perhaps nothing."""
    return [one for _, one in sorted(state.touches.get(id_, {}).items())]


def touched_since(state: State, before: Goal, goal: Goal) -> list[ContactPoints]:
    """What each touch between two goals has touched."""
    return [one for one, _ in touches_since(state, set(touched_goals(before)), goal)]


def touches_since(
    state: State, known: Collection[int], goal: Goal
) -> list[tuple[ContactPoints, int]]:
    """What each touch of a set has touched, but for goals that are known, and its placement."""
    return [
        (one, state.placements.get(id_, 0))
        for id_ in touched_goals(goal)
        if id_ not in known
        for one in touches_of(state, id_)
        if len(one.points)
    ]


def closings_in(state: State, goal: Goal, placement: int) -> list[ContactPoints]:
    """What the hand met in each of its closings in a placement, in the world as it was then."""
    return [
        state.contacts[number]
        for number in range(goal.closings)
        if state.closing_placements.get(number, 0) == placement
        and len(state.contacts[number].points)
    ]


def touches_in(state: State, goal: Goal, placement: int) -> list[ContactPoints]:
    """One contact of each touch of a set in a placement, in the world as it was then."""
    ids = [id_ for id_ in touched_goals(goal) if state.placements.get(id_, 0) == placement]
    return [_middle(one) for id_ in ids for one in touches_of(state, id_) if len(one.points)]


def _middle(touched: ContactPoints) -> ContactPoints:
    """The point of a touch that lies nearest to the mean of all."""
    assert touched.normals is not None
    far = np.linalg.norm(touched.points - touched.points.mean(axis=0), axis=1)
    nearest = slice(int(far.argmin()), int(far.argmin()) + 1)
    return ContactPoints(touched.points[nearest], touched.normals[nearest], touched.touch[nearest])


def placements_of(state: State) -> int:
    """How often the object was turned over, as far as goals of turns and touches tell."""
    return max((*state.turns, *state.placements.values()), default=0)
