"""Reconstructor node: rebuilds exactly the sets of contours and probes that it is asked for.

A set is fitted once every touch of it has been heard, whichever input brings the last one.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType

import numpy as np
from msgspec import Struct

from palpate.core.rebuild.felt.felt_points import FeltPoints, felt_points, stack_points
from palpate.core.rebuild.felt.felt_solid import Evidence, FeltContour, Solid, rebuild
from palpate.core.touch.jet import Jet
from palpate.core.touch.pad import Pad
from palpate.messages.types import (
    Contour,
    ModelGoal,
    PlanDone,
    Probe,
    SensorInfo,
    ShapeModel,
    SurfacePatch,
    World,
)
from palpate.nodes.node import Node, Outputs
from palpate.nodes.sensor import pad_of_info


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
    """Every touch."""
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
        outputs.append(("/model/shape", _fit(state, asked.pop(0))))
    return replace(state, asked=tuple(asked)), outputs


def _is_heard(state: State, goal: ModelGoal | PlanDone) -> bool:
    """Whether every touch of a set is there."""
    wanted: list[Contour | Probe | None] = [state.contours.get(id_) for id_ in goal.contours]
    wanted += [state.probes.get(id_) for id_ in goal.probes]
    return all(one is not None and len(state.felt.get(one.id, {})) == one.touches for one in wanted)


def _fit(state: State, goal: ModelGoal | PlanDone) -> ShapeModel:
    if not goal.contours:
        return _model(goal, None)
    contours = [state.contours[id_] for id_ in goal.contours]
    evidence = Evidence(
        contours=tuple(FeltContour(one.height, one.points) for one in contours),
        side=_points_of(state, goal.contours),
        cap=_points_of(state, goal.probes),
        platform=state.platform,
    )
    return _model(goal, rebuild(evidence))


def _points_of(state: State, goals: tuple[int, ...]) -> FeltPoints:
    """All taxels of some goals, in the order of goals and touches."""
    return stack_points(
        [state.felt[goal][touch] for goal in goals for touch in sorted(state.felt[goal])]
    )


def _model(goal: ModelGoal | PlanDone, solid: Solid | None) -> ShapeModel:
    """The message for a solid; an empty one if there was nothing to rebuild."""
    frame = None if solid is None else solid.prism.frame
    return ShapeModel(
        number=goal.number,
        contours=goal.contours,
        probes=goal.probes,
        dropped=(),
        dropped_why=(),
        control=np.zeros((0, 0, 0, 3)) if solid is None else solid.prism.lattice.control,
        half_extent=np.zeros(2) if solid is None else solid.prism.half_extent,
        bottom=0.0 if frame is None else float(frame.corner[2]),
        top=0.0 if frame is None else float(frame.corner[2] + frame.edges[2, 2]),
        vertices=np.zeros((0, 3)) if solid is None else solid.vertices,
        faces=np.zeros((0, 3), np.int32) if solid is None else solid.faces,
        uncertainty_height=np.zeros(0) if solid is None else solid.band_heights,
        uncertainty=np.zeros(0) if solid is None else solid.deviation,
        health={} if solid is None else solid.health,
        touches=goal.touches,
        robot_time=goal.robot_time,
        final=isinstance(goal, PlanDone),
    )


NODE = Node(
    params=Params,
    start=start,
    inputs={
        "/world": (World, know_world),
        "/touch/info": (SensorInfo, know_sensor),
        "/touch/patch": (SurfacePatch, take_patch),
        "/contour/traced": (Contour, take_contour),
        "/probe/traced": (Probe, take_probe),
        "/model/goal": (ModelGoal, take_goal),
        "/plan/done": (PlanDone, take_goal),
    },
    outputs={"/model/shape": ShapeModel},
    needs=("/world", "/touch/info"),
)
