"""Planner node: turns its messages into an `Exploration`, and goals into messages.

The decisions are made in `palpate.core.explore`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Annotated, Any

import numpy as np
from msgspec import Meta, Struct

from palpate.core import explore
from palpate.core.arrays import Floats
from palpate.core.explore import planners
from palpate.core.poses import Pose
from palpate.core.robot_time import RobotPreset
from palpate.messages import types
from palpate.nodes.planning.knowledge import (
    fitted_superquadric,
    lying_of,
    observed_surface,
    plan_done,
)
from palpate.nodes.runtime.node import Deferred, Node, NotReadyError, Outputs
from palpate.nodes.specs.frames import MAX_TURNS
from palpate.nodes.specs.sensors import DEFAULT_SENSING, pad_of_info, resolution_of_info

Length = Annotated[float, Meta(gt=0, le=1, description="m")]


class Params(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What the launch file may set."""

    # Rule that chooses slices or touches: predicted, touches, uniform, thesis, fuzzy, learned, or a
    # user's own, ``module:Class``.
    planner: str = "predicted"
    settings: dict[str, Any] = {}  # of the rule
    tolerance: Length = 0.2e-3  # requested root mean square error [m]
    # Largest allowed untouched height [m]; null: 100 times the tolerance.
    feature: Length | None = None
    # Maximum number of touches; null: no limit.
    most_touches: Annotated[int, Meta(ge=1)] | None = None
    # Maximum robot time [s]; null: no limit.
    most_seconds: Annotated[float, Meta(gt=0, description="s")] | None = None
    # Whether single touches locate the object's ends; otherwise only slices and grasp do.
    touch_ends: bool = True
    # The underside, which cannot be touched: assumed flat, or required to be known.
    underside: explore.Underside = "flat"
    # How often the object may be turned over to touch more of it.
    turns: Annotated[int, Meta(ge=0, le=MAX_TURNS)] = 1
    # Slicing axis in the world, of any length; null: the object's own axis.
    axis: tuple[float, float, float] | None = None

    def __post_init__(self) -> None:
        if self.axis is not None and not 0.0 < math.hypot(*self.axis) < math.inf:
            raise ValueError(f"axis must have a length, got {list(self.axis)}")
        try:
            _ = self.rule
        except LookupError as error:
            raise ValueError(error.args[0]) from None

    @property
    def rule(self) -> planners.Planner:
        """The rule that chooses slices or touches."""
        rule: planners.Planner = planners.make_planner(self.planner, self.settings)
        return rule

    @property
    def makes_single_touches(self) -> bool:
        """Whether the rule chooses single touches, and no slices."""
        return bool(getattr(self.rule, "single_touches", False))

    @property
    def direction(self) -> Floats | None:
        """The requested slicing axis as a unit vector; None if there is none."""
        if self.axis is None:
            return None
        axis = np.array(self.axis) / np.abs(self.axis).max()
        return np.asarray(axis / np.linalg.norm(axis))

    @property
    def demand(self) -> explore.Demand:
        """The demand on the exploration."""
        return explore.Demand(
            tolerance=self.tolerance,
            feature=self.feature or explore.DEFAULT_SURVEY.feature_ratio * self.tolerance,
            most_touches=math.inf if self.most_touches is None else self.most_touches,
            most_seconds=math.inf if self.most_seconds is None else self.most_seconds,
            underside=self.underside,
            most_turns=self.turns,
        )


@dataclass(frozen=True, slots=True, eq=False)
class State:
    """The demand and the exploration."""

    demand: explore.Demand  # as it was at the last model; later changes apply with the next model
    rule: planners.Planner
    world: types.World | None = None
    info: types.SensorInfo | None = None
    known: explore.Exploration | None = None  # None until world and sensor are known

    @property
    def explored(self) -> explore.Exploration:
        """The exploration, which has begun."""
        assert self.known is not None
        return self.known


def know_sensor(params: Params, state: State, info: types.SensorInfo) -> tuple[State, Outputs]:
    """Remember the sensor; ValueError if the tolerance is below its resolution."""
    _check_tolerance(state.demand.tolerance, resolution_of_info(info))
    return _begun(params, replace(state, info=info))


def know_world(params: Params, state: State, world: types.World) -> tuple[State, Outputs]:
    """Remember the world."""
    return _begun(params, replace(state, world=world))


def _begun(params: Params, state: State) -> tuple[State, Outputs]:
    """Close the hand for the first time when world and sensor are known."""
    world, info = state.world, state.info
    if world is None or info is None or state.known is not None:
        return state, []
    setup = explore.Setup(
        platform=world.platform,
        reach=world.reach,
        robot=RobotPreset.of_array(world.robot) if len(world.robot) else None,
        pad_width=info.pitch * max(info.rows, info.cols),
        resolution=resolution_of_info(info),
        contact_error=DEFAULT_SENSING.contact_error,
        goals=explore.GoalSettings(touch_ends=params.touch_ends),
    )
    known = explore.Exploration(
        setup=setup,
        fingers=dict.fromkeys(range(1, world.fingers + 1), explore.Finger()),
        model=explore.ModelStatus(general=params.makes_single_touches),
    )
    return _act(state, known)


def _check_tolerance(tolerance: float, resolution: float) -> None:
    if tolerance < resolution:
        raise ValueError(
            f"tolerance is {tolerance} m; it must be at least the resolution of the sensor, "
            f"{resolution:g} m"
        )


def check_demand(params: Params, state: State) -> None:
    """Raise ValueError for a demand that is exceeded already."""
    known = state.known
    if known is None:
        raise NotReadyError("the planner does not know its sensor yet")
    _check_tolerance(params.tolerance, known.setup.resolution)
    demand = params.demand
    if demand.most_touches < known.touches:
        raise ValueError(
            f"most_touches is {params.most_touches}; {known.touches} touches are made already"
        )
    if demand.most_seconds < known.seconds:
        raise ValueError(
            f"most_seconds is {params.most_seconds:g} s; {known.seconds:.1f} s have passed already"
        )


def take_contacts(
    params: Params, state: State, contacts: types.GraspContacts
) -> tuple[State, Outputs]:
    """Remember the contacts of the hand."""
    points, normals = contacts.points, contacts.normals
    return _act(state, explore.with_contacts(state.explored, points, normals, contacts.robot_time))


def take_turned(params: Params, state: State, turned: types.Turned) -> tuple[State, Outputs]:
    """Locate the object after it was turned over."""
    return _act(state, explore.with_turned(state.explored, turned.robot_time))


def take_coarse(params: Params, state: State, coarse: types.Superquadric) -> tuple[State, Outputs]:
    """Fix the slicing frame."""
    fit = fitted_superquadric(coarse)
    return _act(state, explore.with_coarse(state.explored, fit, params.direction))


def take_clock(params: Params, state: State, clock: types.FingerClock) -> tuple[State, Outputs]:
    """Remember the robot time of a finger, after which earlier results may be used."""
    known = state.explored
    finger = known.fingers[clock.finger]._replace(clock=clock.robot_time)
    return _take_up(state, known.with_finger(clock.finger, finger))


def take_result(
    params: Params, state: State, message: types.Contour | types.Probe
) -> tuple[State, Outputs]:
    """Remember the result of a finger until all earlier results are used."""
    known = state.explored
    finger = known.fingers[message.finger]
    assert finger.task is not None
    result = explore.Result(
        robot_time=message.robot_time,
        touches=message.touches,
        fault=message.fault,
        measured=_traced(message, finger.task, known.setup.survey)
        if isinstance(message, types.Contour)
        else explore.ProbedPoint(message.outcome, message.point, message.normal),
    )
    return _take_up(state, known.with_finger(message.finger, finger._replace(result=result)))


def _traced(
    contour: types.Contour, task: explore.Task, settings: explore.SurveySettings
) -> explore.TracedContour:
    """A contour in the slicing frame."""
    frame = Pose.from_array(contour.frame)
    gaps = contour.gap_ends - contour.gap_starts
    return explore.TracedContour(
        height=contour.height,
        status=contour.status,
        points=frame.to_local(contour.points),
        normals=contour.normals @ frame.axes,
        across=contour.curvature,
        contact_low=contour.contact_low,
        contact_high=contour.contact_high,
        missing=float(np.linalg.norm(gaps, axis=1).sum()),
        touches=contour.touches,
        seconds=max(contour.robot_time - task.start, 0.0),
        number=contour.id,
        max_touches=task.work.max_touches if isinstance(task.work, explore.TraceSlice) else 0,
        settings=settings,
    )


def take_model(params: Params, state: State, model: types.ShapeModel) -> tuple[State, Outputs]:
    """Decide on the next goals with the model of the last result.

    The current demand is used until the next model.
    """
    if model.final:
        return state, []
    state = replace(state, demand=params.demand)
    lying = lying_of(model, state.explored.lying)
    known = explore.with_model(
        state.explored,
        dropped=frozenset(model.dropped),
        uncertainty=_uncertainty(model),
        surface=_surface(state, model, lying.pose),
        general=model.method == "general",
        lying=lying,
    )
    if known.lying.fault:
        return _act(state, known)
    observation = known.observation(state.demand)
    state, outputs = _act(state, known)
    # The estimate is deferred, so that goals are sent before it is made.
    estimate = Deferred(
        types.PlanEstimate, lambda step: _estimate(model, planners.estimate_error(observation))
    )
    return state, [*outputs, ("/plan/estimate", estimate)]


def _uncertainty(model: types.ShapeModel) -> explore.ModelUncertainty:
    bounded = model.method != "thesis"
    if not len(model.faces):
        return explore.ModelUncertainty(bounded=bounded)
    return explore.ModelUncertainty(
        heights=model.uncertainty_height,
        deviations=model.uncertainty,
        whole=model.deviation,
        ends=model.ends_deviation,
        pose=model.health.get("radial_pose_sigma", 0.0),
        bounded=bounded,
        starlike=model.health.get("radial_unused", 0.0) == 0.0,
    )


def _surface(
    state: State, model: types.ShapeModel, pose: Pose | None
) -> planners.ObservedSurface | None:
    """The model for planners of single touches; None if it states no errors.

    `pose`: of the object in the world; if None, the model stays in the frame of the first pose.
    """
    assert state.world is not None and state.info is not None
    known, before = state.explored, state.explored.model
    known = replace(known, lying=known.lying._replace(pose=pose))
    before_surface = before.surface if before.general else None
    is_pose_known = before_surface is not None and state.explored.lying.pose is not None
    earlier = before_surface.progress if before_surface is not None and is_pose_known else ()
    distance = state.demand.limits.unknown_distance
    pad = pad_of_info(state.info)
    return observed_surface(
        model,
        pad,
        state.world,
        distance,
        refused=known.refused,
        aimed=known.aimed,
        earlier=earlier,
        pose=pose if known.lying.placement else None,
        settings=known.setup.surface,
    )


def _take_up(state: State, known: explore.Exploration) -> tuple[State, Outputs]:
    """Use the earliest result, and act on it; wait while an earlier one may come."""
    finger = known.next_finger
    if finger is None:
        return replace(state, known=known), []
    return _act(state, explore.with_result(known, finger, state.demand.feature))


def _act(state: State, known: explore.Exploration) -> tuple[State, Outputs]:
    """Send the next goals, and use results that had to wait for them."""
    outputs: Outputs = []
    while True:
        for goal in explore.goals(known, state.demand, state.rule):
            known = known.after(goal)
            outputs += _messages(goal, known, state.demand)
        finger = known.next_finger
        if finger is None:
            return replace(state, known=known), outputs
        known = explore.with_result(known, finger, state.demand.feature)


def _messages(goal: explore.Goal, known: explore.Exploration, demand: explore.Demand) -> Outputs:
    """Topics and messages of a goal."""
    match goal:
        case explore.CloseHand():
            return [("/hand/goal", _grasp_goal(goal, known))]
        case explore.TurnObject():
            return [("/hand/turn", _turn_goal(goal, known))]
        case explore.MakeModel():
            return [("/model/goal", _model_goal(known))]
        case explore.Done():
            return _done(goal.reason, known, demand)
        case explore.Task():
            return [_task_goal(goal, known.surveyed.frame.pose, known.lying.placement)]


def _task_goal(task: explore.Task, frame: Pose, placement: int) -> tuple[str, object]:
    match task.work:
        case explore.TraceSlice() as work:
            return "/contour/goal", _contour_goal(task, work, frame)
        case explore.TouchEnd(_, command):
            return "/probe/goal", _probe_goal(task, frame @ command.pose, command.reach, 0)
        case explore.SingleTouch(touch):
            return "/probe/goal", _probe_goal(task, touch.pose, touch.reach, placement)


def _grasp_goal(goal: explore.CloseHand, known: explore.Exploration) -> types.GraspGoal:
    return types.GraspGoal(
        number=known.hand.closings,
        placement=known.lying.placement,
        pose=goal.pose.array,
        fingers=goal.hand.fingers,
        opening=goal.hand.opening,
        reach=goal.hand.reach,
        advanced=np.array(goal.hand.advanced),
        not_before=known.seconds,
    )


def _turn_goal(goal: explore.TurnObject, known: explore.Exploration) -> types.TurnGoal:
    return types.TurnGoal(
        placement=known.lying.placement, pose=goal.pose.array, not_before=known.seconds
    )


def _contour_goal(task: explore.Task, work: explore.TraceSlice, frame: Pose) -> types.ContourGoal:
    return types.ContourGoal(
        id=task.number,
        finger=task.finger,
        frame=frame.array,
        height=task.height,
        centre=work.centre,
        radius=work.radius,
        gap=work.gap,
        not_before=task.start,
        most_touches=int(min(work.max_touches, task.max_touches)),
        not_after=None if math.isinf(task.not_after) else task.not_after,
        reason=work.reason,
    )


def _probe_goal(task: explore.Task, pose: Pose, reach: float, placement: int) -> types.ProbeGoal:
    return types.ProbeGoal(
        id=task.number,
        finger=task.finger,
        placement=placement,
        pose=pose.array,
        reach=reach,
        not_before=task.start,
        not_after=None if math.isinf(task.not_after) else task.not_after,
    )


def _model_goal(known: explore.Exploration) -> types.ModelGoal:
    """A request for a model of all results."""
    survey = known.survey
    return types.ModelGoal(
        number=known.model.number,
        contours=() if survey is None else survey.contours,
        probes=known.probes,
        arcs=() if survey is None else survey.arcs,
        failed=survey is not None and survey.failed,
        missed=tuple(single.number for single in known.singles if single.outcome == "miss"),
        general=known.model.general,
        closings=known.hand.closings,
        touches=known.touches,
        robot_time=known.seconds,
    )


def _done(reason: str, known: explore.Exploration, demand: explore.Demand) -> Outputs:
    """The end of the exploration, with the error of the solid."""
    goal = _model_goal(known)
    if known.survey is None:
        return [("/plan/done", plan_done(goal, reason, planners.Findings(), demand.limits))]
    observation = known.observation(demand)
    estimate = planners.estimate_error(observation)
    findings = estimate.findings
    if not known.model.general:  # single touches of a general solid have no heights
        findings = replace(findings, untraced_height=planners.untraceable_height(observation))
    unknown, pose = estimate.open_area, known.lying.pose
    if unknown is not None and pose is not None and known.lying.placement:
        places, normals = pose.to_local(unknown.places), unknown.normals @ pose.axes
        unknown = unknown._replace(places=places, normals=normals)  # in its first pose
    done = plan_done(goal, reason, findings, observation.limits, unknown)
    return [("/plan/estimate", _estimate(done, estimate)), ("/plan/done", done)]


def _estimate(
    model: types.ShapeModel | types.PlanDone, estimate: planners.Estimate
) -> types.PlanEstimate:
    halving, open_area = estimate.halving, estimate.open_area
    return types.PlanEstimate(
        number=model.number,
        contours=len(model.contours),
        touches=model.touches,
        robot_time=model.robot_time,
        rms_bound_95=estimate.rms_bound_95,
        largest_untouched=estimate.largest_untouched,
        halving_touches=halving and halving.touches,
        halving_seconds=halving and halving.seconds,
        open_share=open_area and open_area.share,
        open_width=open_area and open_area.width,
    )


NODE = Node(
    params=Params,
    start=lambda params: (State(params.demand, params.rule), []),
    handler_timeout=20.0,
    step="planning",
    inputs={
        "/world": (types.World, know_world),
        "/touch/info": (types.SensorInfo, know_sensor),
        "/hand/contacts": (types.GraspContacts, take_contacts),
        "/hand/turned": (types.Turned, take_turned),
        "/model/coarse": (types.Superquadric, take_coarse),
        "/finger/clock": (types.FingerClock, take_clock),
        "/contour/traced": (types.Contour, take_result),
        "/probe/traced": (types.Probe, take_result),
        "/model/shape": (types.ShapeModel, take_model),
    },
    outputs={
        "/hand/goal": types.GraspGoal,
        "/hand/turn": types.TurnGoal,
        "/contour/goal": types.ContourGoal,
        "/probe/goal": types.ProbeGoal,
        "/model/goal": types.ModelGoal,
        "/plan/estimate": types.PlanEstimate,
        "/plan/done": types.PlanDone,
        "/planner/parameter_events": types.ParameterEvent,
    },
    settable=dict.fromkeys(("tolerance", "most_touches", "most_seconds"), "/model/shape"),
    check_set=check_demand,
    needs=("/world", "/touch/info"),
    fan_in=("/finger/clock", "/contour/traced", "/probe/traced"),
)
