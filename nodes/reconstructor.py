"""Reconstructor node: rebuilds exactly the sets that it is asked for.

A set of contours and probes gives a solid; closings of the hand alone give a superquadric. It is
fitted once all of it has been heard, whichever input brings the last of it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from types import MappingProxyType
from typing import TypeGuard

import numpy as np
from msgspec import Struct

from palpate.core.arrays import Floats
from palpate.core.rebuild.felt.felt_points import FeltPoints, felt_points
from palpate.core.rebuild.solid import Solid
from palpate.core.touch.jet import Jet
from palpate.core.touch.pad import Pad
from palpate.messages.types import (
    Contour,
    GraspContacts,
    ModelGoal,
    PlanDone,
    Probe,
    SensorInfo,
    ShapeModel,
    Superquadric,
    SurfacePatch,
    World,
)
from palpate.nodes.node import Later, Node, Outputs
from palpate.nodes.reconstructor_set import coarse_model, rebuilt_from
from palpate.nodes.sensor import pad_of_info
from palpate.nodes.shape_model import shape_model


class Params(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """There is nothing to set."""


Touches = Mapping[int, Mapping[int, FeltPoints]]
"""Goal to touch to what it felt."""


@dataclass(frozen=True, slots=True, eq=False)
class State:
    """What has been heard."""

    platform: float = 0.0
    """Height on which the object stands, m."""
    pad: Pad | None = None
    """The sensor's array."""
    felt: Touches = field(default_factory=lambda: MappingProxyType({}))
    """Every touch; goals are numbered for all fingers together."""
    contacts: Mapping[int, Floats] = field(default_factory=lambda: MappingProxyType({}))
    """Where the hand met the object, by the number of the closing."""
    contours: Mapping[int, Contour] = field(default_factory=lambda: MappingProxyType({}))
    """By number."""
    probes: Mapping[int, Probe] = field(default_factory=lambda: MappingProxyType({}))
    """By number."""
    asked: tuple[ModelGoal | PlanDone, ...] = ()
    """Models still to be fitted, in order."""


def start(params: Params) -> tuple[State, Outputs]:
    """Begin with nothing."""
    return State(), []


def know_world(params: Params, state: State, world: World) -> tuple[State, Outputs]:
    """Remember the platform."""
    return replace(state, platform=world.platform), []


def know_sensor(params: Params, state: State, info: SensorInfo) -> tuple[State, Outputs]:
    """Remember the sensor."""
    return replace(state, pad=pad_of_info(info)), []


def take_patch(params: Params, state: State, patch: SurfacePatch) -> tuple[State, Outputs]:
    """Keep what a touch felt."""
    assert state.pad is not None
    jet = Jet(patch.jet, patch.jet_scale) if len(patch.jet) else None
    points = felt_points(state.pad, patch.pose, patch.height, patch.mask, jet)
    of_goal = {**state.felt.get(patch.goal, {}), patch.touch: points}
    return _fit_ready(replace(state, felt={**state.felt, patch.goal: of_goal}))


def take_contacts(params: Params, state: State, heard: GraspContacts) -> tuple[State, Outputs]:
    """Keep what the hand met."""
    contacts = {**state.contacts, heard.number: heard.points}
    return _fit_ready(replace(state, contacts=contacts))


def take_contour(params: Params, state: State, contour: Contour) -> tuple[State, Outputs]:
    """Keep a contour."""
    return _fit_ready(replace(state, contours={**state.contours, contour.id: contour}))


def take_probe(params: Params, state: State, probe: Probe) -> tuple[State, Outputs]:
    """Keep a probe."""
    return _fit_ready(replace(state, probes={**state.probes, probe.id: probe}))


def take_goal(params: Params, state: State, goal: ModelGoal | PlanDone) -> tuple[State, Outputs]:
    """Fit a set, at once or when all of it has been heard."""
    return _fit_ready(replace(state, asked=(*state.asked, goal)))


def _fit_ready(state: State) -> tuple[State, Outputs]:
    """Fit the models whose turn has come, in the order of their numbers."""
    outputs: Outputs = []
    asked = sorted(state.asked, key=lambda goal: goal.number)
    while asked and _is_heard(state, asked[0]):
        goal = asked.pop(0)
        if _is_coarse(goal):
            outputs.append(("/model/coarse", Later(Superquadric, partial(_coarse, state, goal))))
        else:
            outputs.append(("/model/shape", Later(ShapeModel, partial(_fit, state, goal))))
    return replace(state, asked=tuple(asked)), outputs


def _is_coarse(goal: ModelGoal | PlanDone) -> TypeGuard[ModelGoal]:
    """Whether a superquadric is asked for."""
    return isinstance(goal, ModelGoal) and not (goal.contours or goal.probes)


def _is_heard(state: State, goal: ModelGoal | PlanDone) -> bool:
    """Whether all of a set is there."""
    if _is_coarse(goal):
        return all(number in state.contacts for number in range(goal.closings))
    wanted: list[Contour | Probe | None] = [state.contours.get(id_) for id_ in goal.contours]
    wanted += [state.probes.get(id_) for id_ in goal.probes]
    return all(one is not None and len(state.felt.get(one.id, {})) == one.touches for one in wanted)


def _coarse(state: State, goal: ModelGoal) -> Superquadric:
    contacts = [state.contacts[number] for number in range(goal.closings)]
    return coarse_model(goal.number, np.concatenate([np.zeros((0, 3)), *contacts]))


def _fit(state: State, goal: ModelGoal | PlanDone) -> ShapeModel:
    if not goal.contours:
        return shape_model(goal, None)
    try:
        return shape_model(goal, _rebuild(state, goal))
    except ValueError as why:  # what was felt is no solid: a result to be told, not a fault
        return shape_model(goal, None, str(why))


def _rebuild(state: State, goal: ModelGoal | PlanDone) -> Solid:
    felt = {
        id_: [state.felt[id_][touch] for touch in sorted(state.felt.get(id_, {}))]
        for id_ in (*goal.contours, *goal.probes)
    }
    return rebuilt_from(
        [state.contours[id_] for id_ in goal.contours],
        [state.probes[id_] for id_ in goal.probes],
        felt,
        state.platform,
    )


NODE = Node(
    params=Params,
    start=start,
    longest=120.0,
    inputs={
        "/world": (World, know_world),
        "/touch/info": (SensorInfo, know_sensor),
        "/hand/contacts": (GraspContacts, take_contacts),
        "/touch/patch": (SurfacePatch, take_patch),
        "/contour/traced": (Contour, take_contour),
        "/probe/traced": (Probe, take_probe),
        "/model/goal": (ModelGoal, take_goal),
        "/plan/done": (PlanDone, take_goal),
    },
    outputs={"/model/coarse": Superquadric, "/model/shape": ShapeModel},
    needs=("/world", "/touch/info"),
    many=("/touch/patch", "/contour/traced", "/probe/traced"),
)
