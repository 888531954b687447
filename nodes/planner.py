"""Planner node: grasps the object, fixes the slicing frame, hands out slices and probes, and stops.

What is decided, and why, stands in `palpate.core.explore`; here it is turned into goals.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Annotated, Any

import numpy as np
from msgspec import Meta, Struct

from palpate.core.arrays import Floats
from palpate.core.explore.planners.catalogue import make_planner
from palpate.core.explore.survey import Demand, Doubt
from palpate.messages.types import (
    Contour,
    ContourGoal,
    FingerClock,
    GraspContacts,
    GraspGoal,
    ModelGoal,
    PlanDone,
    Probe,
    ProbeGoal,
    SensorInfo,
    ShapeModel,
    Superquadric,
    World,
)
from palpate.nodes.node import Node, Outputs
from palpate.nodes.planner_decide import decide, done, take_up
from palpate.nodes.planner_grasp import grasp_goal, with_coarse, with_contacts
from palpate.nodes.planner_state import State, model_goal
from palpate.nodes.sensor import resolution_of_info

Length = Annotated[float, Meta(gt=0, le=1, description="m")]


class Params(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What the launch file may set."""

    planner: str = "predicted"
    """The rule that chooses slices: predicted, uniform, thesis, fuzzy, or one's own,
    ``module:Class``."""
    settings: dict[str, Any] = {}
    """Its numbers."""
    tolerance: Length = 0.2e-3
    """Root mean square error that is asked for, m."""
    feature: Length = 3.0e-3
    """Largest height that may stay unfelt, m."""
    most_touches: Annotated[int, Meta(ge=1)] | None = None
    """Touches that may be made; null for as many as it takes."""
    most_seconds: Annotated[float, Meta(gt=0, description="s")] | None = None
    """Robot time that may pass, s; null for as long as it takes."""
    axis: tuple[float, float, float] | None = None
    """Along which the object is sliced, in the world, of any length; null for its own axis."""

    def __post_init__(self) -> None:
        if self.axis is not None and not 0.0 < math.hypot(*self.axis) < math.inf:
            raise ValueError(f"axis must have a length, got {list(self.axis)}")
        try:
            make_planner(self.planner, self.settings)
        except LookupError as error:
            raise ValueError(error.args[0]) from None

    @property
    def direction(self) -> Floats | None:
        """The slicing axis that is asked for, a unit vector; None if none is."""
        if self.axis is None:
            return None
        axis = np.array(self.axis) / np.abs(self.axis).max()
        return np.asarray(axis / np.linalg.norm(axis))

    @property
    def demand(self) -> Demand:
        """What is asked of the exploration."""
        return Demand(
            tolerance=self.tolerance,
            feature=self.feature,
            most_touches=math.inf if self.most_touches is None else self.most_touches,
            most_seconds=math.inf if self.most_seconds is None else self.most_seconds,
        )


def start(params: Params) -> tuple[State, Outputs]:
    """Wait for the world."""
    return State(), []


def know_sensor(params: Params, state: State, info: SensorInfo) -> tuple[State, Outputs]:
    """Remember how wide the finger is, and what it can tell.

    Raises
    ------
    ValueError
        If the tolerance is below that.
    """
    resolution = resolution_of_info(info)
    if params.tolerance < resolution:
        raise ValueError(
            f"tolerance is {params.tolerance} m; it must be at least what the sensor can tell, "
            f"{resolution:g} m"
        )
    width = info.pitch * max(info.rows, info.cols)
    return replace(state, pad_width=width, resolution=resolution), []


def know_world(params: Params, state: State, world: World) -> tuple[State, Outputs]:
    """Begin: close the hand for the first time."""
    return _grasp_on(replace(state, world=world))


def take_contacts(params: Params, state: State, contacts: GraspContacts) -> tuple[State, Outputs]:
    """Close the hand again, or ask for the coarse model."""
    return _grasp_on(with_contacts(state, contacts))


def take_coarse(params: Params, state: State, coarse: Superquadric) -> tuple[State, Outputs]:
    """Fix the slicing frame and begin with the slices."""
    return decide(params.demand, _rule(params), with_coarse(state, coarse, params.direction))


def take_clock(params: Params, state: State, clock: FingerClock) -> tuple[State, Outputs]:
    """Remember how far a finger has come: an earlier result may be free to be taken up."""
    clocks = {**state.clocks, clock.finger: clock.robot_time}
    return take_up(params.demand, _rule(params), replace(state, clocks=clocks))


def take_result(params: Params, state: State, result: Contour | Probe) -> tuple[State, Outputs]:
    """Take up what a finger has finished, when its turn has come."""
    heard = {**state.heard, result.finger: result}
    return take_up(params.demand, _rule(params), replace(state, heard=heard))


def take_model(params: Params, state: State, model: ShapeModel) -> tuple[State, Outputs]:
    """Decide what comes next, now that the model with the last result is known."""
    if model.final:
        return state, []
    assert state.survey is not None
    dropped = set(model.dropped)
    pairs = zip(state.contours, state.survey.traced, strict=True)
    survey = replace(
        state.survey,
        traced=tuple(one._replace(dropped=number in dropped) for number, one in pairs),
        doubt=_doubt(model) if len(model.faces) else None,
    )
    return decide(params.demand, _rule(params), replace(state, survey=survey, asked=False))


def _doubt(model: ShapeModel) -> Doubt:
    starlike = model.health.get("felt_unused", 0.0) == 0.0
    return Doubt(
        heights=model.uncertainty_height,
        deviations=model.uncertainty,
        whole=model.deviation,
        pose=model.health.get("felt_pose_sigma", 0.0),
        starlike=starlike,
    )


def _rule(params: Params) -> Any:
    return make_planner(params.planner, params.settings)


def _grasp_on(state: State) -> tuple[State, Outputs]:
    """The next closing; or, after the last one, the coarse model, or the end."""
    goal = grasp_goal(state)
    if goal is not None:
        return state, [("/hand/goal", goal)]
    if not len(state.grasped.points):
        return done(state, "the hand closed on nothing within reach")
    state = replace(state, models=state.models + 1)
    return state, [("/model/goal", model_goal(state))]


NODE = Node(
    params=Params,
    start=start,
    longest=20.0,
    inputs={
        "/world": (World, know_world),
        "/touch/info": (SensorInfo, know_sensor),
        "/hand/contacts": (GraspContacts, take_contacts),
        "/model/coarse": (Superquadric, take_coarse),
        "/finger/clock": (FingerClock, take_clock),
        "/contour/traced": (Contour, take_result),
        "/probe/traced": (Probe, take_result),
        "/model/shape": (ShapeModel, take_model),
    },
    outputs={
        "/hand/goal": GraspGoal,
        "/contour/goal": ContourGoal,
        "/probe/goal": ProbeGoal,
        "/model/goal": ModelGoal,
        "/plan/done": PlanDone,
    },
    needs=("/world", "/touch/info"),
    many=("/finger/clock", "/contour/traced", "/probe/traced"),
)
