"""Reconstructor node: rebuilds the requested sets of contours and probes.

A set of contours and probes gives a solid; closings of the hand alone give a superquadric. A set is
fitted when all its messages have been received, in any order of the inputs.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial
from typing import Literal

import numpy as np
from msgspec import Struct

from palpate.core.explore import empty_map, swept_places, untouched_places
from palpate.core.poses import Pose
from palpate.core.rebuild import plugin_method
from palpate.core.rebuild.contours import ContactPoints
from palpate.core.steps import Steps
from palpate.messages import types
from palpate.nodes.rebuilding.candidates import QUALITIES, coarse_model, is_final, shape_model
from palpate.nodes.rebuilding.fitting import TOUCHED_OUTCOMES, published_solid, seen_state
from palpate.nodes.rebuilding.placements import contradicted, mistaken_error
from palpate.nodes.rebuilding.received import (
    Goal,
    State,
    Way,
    closings_in,
    far_from_touch,
    is_coarse,
    is_complete,
    known_space,
)
from palpate.nodes.runtime.node import Deferred, Node, Outputs
from palpate.nodes.specs.sensors import pad_of_info


class Params(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What the launch file may set."""

    quality: Literal["draft", "normal", "fine"] = "normal"  # of the final mesh
    # best: a solid in slices, or a general solid if that predicts touches better; thesis: shell and
    # core of the contours as in the thesis, without an error bound.
    method: Way = "best"
    # The coarse model: free, with exponents, taper and bend fitted; or three, the best of the
    # thesis's sphere, box and cylinder.
    coarse: Literal["free", "three"] = "free"

    def __post_init__(self) -> None:
        if self.method != "best":
            plugin_method(self.method)


def know_world(params: Params, state: State, world: types.World) -> tuple[State, Outputs]:
    """Remember the platform."""
    centre, sweeps = world.centre.tolist(), state.settings.sweeps
    space = empty_map(world.reach, world.platform, centre, sweeps)
    return replace(state, platform=None if world.held else world.platform, space=space), []


def know_sensor(params: Params, state: State, info: types.SensorInfo) -> tuple[State, Outputs]:
    """Remember the sensor."""
    return replace(state, pad=pad_of_info(info)), []


def take_patch(params: Params, state: State, patch: types.SurfacePatch) -> tuple[State, Outputs]:
    """Keep the contacts of a touch."""
    points = ContactPoints.of_touch(patch.points, patch.normals)
    of_goal = {**state.touches.get(patch.goal, {}), patch.touch: points}
    state = replace(state, touches={**state.touches, patch.goal: of_goal})
    if patch.placement:
        state = replace(state, placements={**state.placements, patch.goal: patch.placement})
    return _fit_ready(state if patch.outcome == "inside" else _with_swept(state, patch))


def _with_swept(state: State, patch: types.SurfacePatch) -> State:
    """The state with the space that a touch swept, and the places that its pad spanned."""
    pad, space, sweeps = state.pad, state.space, state.settings.sweeps
    assert pad is not None and space is not None
    pose, is_touched = Pose.from_array(patch.pose), patch.outcome in TOUCHED_OUTCOMES
    start = pose.advanced(-patch.advance)
    places = swept_places(pad, start, pose, space.step, touched=is_touched, settings=sweeps)
    contacts = patch.mask, patch.points, patch.normals
    untouched = untouched_places(pad, pose, *contacts, sweeps=sweeps)
    before = state.untouched.get(patch.goal, ())
    state = replace(state, untouched={**state.untouched, patch.goal: (*before, untouched)})
    if patch.placement:
        later = (*state.swept_places.get(patch.goal, ()), places)
        return replace(state, swept_places={**state.swept_places, patch.goal: later})
    freed = (*state.swept.get(patch.goal, ()), space.numbers(places))
    return replace(state, swept={**state.swept, patch.goal: freed})


def take_contacts(
    params: Params, state: State, received: types.GraspContacts
) -> tuple[State, Outputs]:
    """Keep the contacts of the hand."""
    touches = np.arange(len(received.points), dtype=np.int32)
    points = ContactPoints(received.points, received.normals, touches)
    placements = {**state.closing_placements, received.number: received.placement}
    contacts = {**state.contacts, received.number: points}
    return _fit_ready(replace(state, contacts=contacts, closing_placements=placements))


def take_turn(params: Params, state: State, turn: types.TurnGoal) -> tuple[State, Outputs]:
    """Remember the requested pose of a turn."""
    turns = {**state.turns, turn.placement: Pose.from_array(turn.pose)}
    return _fit_ready(replace(state, turns=turns))


def take_contour(params: Params, state: State, contour: types.Contour) -> tuple[State, Outputs]:
    """Keep a contour."""
    return _fit_ready(replace(state, contours={**state.contours, contour.id: contour}))


def take_probe(params: Params, state: State, probe: types.Probe) -> tuple[State, Outputs]:
    """Keep a probe."""
    return _fit_ready(replace(state, probes={**state.probes, probe.id: probe}))


def take_goal(params: Params, state: State, goal: Goal) -> tuple[State, Outputs]:
    """Fit a set when all of it has been received; a fitted set is not fitted again."""
    if any(goal.number == earlier.number for earlier in state.history):
        return state, []
    return _fit_ready(replace(state, asked=(*state.asked, goal)))


def _fit_ready(state: State) -> tuple[State, Outputs]:
    """Fit the models whose sets are complete, in the order of their numbers."""
    outputs: Outputs = []
    asked = sorted(state.asked, key=lambda goal: goal.number)
    while asked and is_complete(state, asked[0]):
        goal = asked.pop(0)
        if is_coarse(goal):
            coarse = Deferred(types.Superquadric, partial(_coarse, state, goal))
            outputs.append(("/model/coarse", coarse))
        else:
            outputs.append(("/model/shape", Deferred(types.ShapeModel, partial(_fit, state, goal))))
            if state.space is not None:
                space = Deferred(types.SpaceMap, partial(_space, state, goal))
                outputs.append(("/model/space", space))
            state = replace(state, history=(*state.history, goal))
    return replace(state, asked=tuple(asked)), outputs


def _coarse(state: State, goal: types.ModelGoal, step: Steps) -> types.Superquadric:
    contacts = [closing.points for closing in closings_in(state, goal, 0)]
    with step("superquadric"):
        points = np.concatenate([np.zeros((0, 3)), *contacts])
        return coarse_model(goal.number, points, three_shapes=state.three_shapes)


def _space(state: State, goal: Goal, step: Steps) -> types.SpaceMap:
    """The map of space for a model."""
    assert state.space is not None
    seen = seen_state(state, goal, step)
    with step("space"):
        space = known_space(seen, goal)
    return types.SpaceMap(number=goal.number, low=space.low, step=space.step, states=space.states)


def _fit(state: State, goal: Goal, step: Steps, max_kept: int = 4) -> types.ShapeModel:
    """The model of a set; the last `max_kept` fitted solids are kept."""
    published = published_solid(state, goal, step)
    for number in sorted(state.fitted)[:-max_kept]:
        del state.fitted[number]
    general, placements = published.candidates.general, published.candidates.placements
    with step("bound"):
        locating = state.settings.locating
        mistaken, faults = 0.0, tuple[str, ...]()
        if general is not None:
            error, faults = contradicted(general.solid)
            mistaken = math.hypot(error, mistaken_error(general.solid, placements, locating))
    placements = placements._replace(faults=(*placements.faults, *faults))
    return shape_model(
        goal,
        replace(published.candidates, placements=placements),
        published.solid,
        published.predicted,
        far_from_touch(seen_state(state, goal, step), goal),
        state.quality if is_final(goal) else None,
        step,
        published.rejected,
        mistaken,
    )


def _start(params: Params) -> tuple[State, Outputs]:
    quality = QUALITIES[params.quality]
    state = State(quality, method=params.method, three_shapes=params.coarse == "three")
    return state, []


NODE = Node(
    params=Params,
    step="contacts",
    start=_start,
    handler_timeout=120.0,
    inputs={
        "/world": (types.World, know_world),
        "/touch/info": (types.SensorInfo, know_sensor),
        "/hand/contacts": (types.GraspContacts, take_contacts),
        "/hand/turn": (types.TurnGoal, take_turn),
        "/touch/patch": (types.SurfacePatch, take_patch),
        "/contour/traced": (types.Contour, take_contour),
        "/probe/traced": (types.Probe, take_probe),
        "/model/goal": (types.ModelGoal, take_goal),
        "/plan/done": (types.PlanDone, take_goal),
    },
    outputs={
        "/model/coarse": types.Superquadric,
        "/model/shape": types.ShapeModel,
        "/model/space": types.SpaceMap,
    },
    needs=("/world", "/touch/info"),
    fan_in=("/touch/patch", "/contour/traced", "/probe/traced"),
    optional=("/hand/contacts", "/hand/turn", "/contour/traced"),  # a driver has none
)
