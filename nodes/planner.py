"""Planner node: grasps the object, fixes the slicing frame, hands out slices and probes.

What is decided, and why, stands in `palpate.core.explore`; here it is turned into goals.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from msgspec import Meta, Struct

from palpate.core import explore
from palpate.core.arrays import Floats
from palpate.core.explore.planners import (
    Choice,
    Estimate,
    Findings,
    Height,
    Observation,
    ObservedSurface,
    Planner,
    Stop,
    Touch,
    Wait,
    WrongChoiceError,
    check_choice,
    estimate_error,
    make_planner,
    settled_height,
    untraceable_height,
)
from palpate.core.touch import FAULTS
from palpate.messages import derive
from palpate.messages.types import (
    Contour,
    ContourGoal,
    FingerClock,
    GraspContacts,
    GraspGoal,
    ModelGoal,
    ParameterEvent,
    PlanDone,
    PlanEstimate,
    Probe,
    ProbeGoal,
    SensorInfo,
    ShapeModel,
    Superquadric,
    World,
)
from palpate.nodes.planning.budget import allowance, fits_contour
from palpate.nodes.planning.knowledge import observed_surface, plan_done
from palpate.nodes.planning.phases import (
    State,
    Task,
    contour_goal,
    contour_limit,
    grasp_goal,
    model_goal,
    next_touch,
    probe_goal,
    traced_of,
    with_coarse,
    with_contacts,
    with_probe,
    with_single,
)
from palpate.nodes.runtime.node import Deferred, Node, NotReadyError, Outputs
from palpate.nodes.specs.sensors import pad_of_info, resolution_of_info

if TYPE_CHECKING:
    from palpate.core.explore import Demand
    from palpate.nodes.planning.budget import Allowance

Length = Annotated[float, Meta(gt=0, le=1, description="m")]


MAX_FAULTS = 3  # Single touches in succession that no sensor that works can have felt
MOST_GOALS = 4000  # A message lists no more than `messages.fields.MAX_ITEMS` of their results


class Params(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What the launch file may set."""

    # The rule that chooses slices or touches: predicted, touches, uniform, thesis, fuzzy, or one's
    # own, ``module:Class``.
    planner: str = "predicted"
    settings: dict[str, Any] = {}  # Its numbers
    tolerance: Length = 0.2e-3  # Root mean square error that is asked for, m
    # Largest height that may stay untouched, m; null: `explore.FEATURE_SHARE` times the tolerance.
    feature: Length | None = None
    # Touches that may be made; null for as many as it takes.
    most_touches: Annotated[int, Meta(ge=1)] | None = None
    # Robot time that may pass, s; null for as long as it takes.
    most_seconds: Annotated[float, Meta(gt=0, description="s")] | None = None
    # Along which the object is sliced, in the world, of any length; null for its own axis.
    axis: tuple[float, float, float] | None = None

    def __post_init__(self) -> None:
        if self.axis is not None and not 0.0 < math.hypot(*self.axis) < math.inf:
            raise ValueError(f"axis must have a length, got {list(self.axis)}")
        try:
            _ = self.rule
        except LookupError as error:
            raise ValueError(error.args[0]) from None

    @property
    def rule(self) -> Planner:
        """The rule that chooses slices."""
        made: Planner = make_planner(self.planner, self.settings)
        return made

    @property
    def makes_single_touches(self) -> bool:
        """Whether the rule chooses single touches: then there are no slices to make a solid of."""
        return bool(getattr(self.rule, "single_touches", False))

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
        return explore.Demand(
            tolerance=self.tolerance,
            feature=self.feature or explore.FEATURE_SHARE * self.tolerance,
            most_touches=math.inf if self.most_touches is None else self.most_touches,
            most_seconds=math.inf if self.most_seconds is None else self.most_seconds,
        )


def know_sensor(params: Params, state: State, info: SensorInfo) -> tuple[State, Outputs]:
    """Remember the finger's width and what it tells; ValueError if the tolerance is below that."""
    resolution = resolution_of_info(info)
    _check_tolerance(state.demand.tolerance, resolution)
    width = info.pitch * max(info.rows, info.cols)
    pad = pad_of_info(info)
    return replace(state, pad_width=width, resolution=resolution, pad=pad), []


def _check_tolerance(tolerance: float, resolution: float) -> None:
    if tolerance < resolution:
        raise ValueError(
            f"tolerance is {tolerance} m; it must be at least what the sensor can tell, "
            f"{resolution:g} m"
        )


def check_demand(params: Params, state: State) -> None:
    """Refuse, by a ValueError, a demand that cannot be met any more."""
    if not state.resolution:
        raise NotReadyError("the planner does not know its sensor yet")
    _check_tolerance(params.tolerance, state.resolution)
    demand = params.demand
    if demand.most_touches < state.touches:
        raise ValueError(
            f"most_touches is {params.most_touches}; {state.touches} touches are made already"
        )
    if demand.most_seconds < state.clock:
        raise ValueError(
            f"most_seconds is {params.most_seconds:g} s; {state.clock:.1f} s have passed already"
        )


def know_world(params: Params, state: State, world: World) -> tuple[State, Outputs]:
    """Begin: close the hand for the first time."""
    alone = params.makes_single_touches
    return _grasp_on(params, replace(state, world=world, general=alone))


def take_contacts(params: Params, state: State, contacts: GraspContacts) -> tuple[State, Outputs]:
    """Close the hand again, or ask for the coarse model."""
    return _grasp_on(params, with_contacts(state, contacts))


def _grasp_on(params: Params, state: State) -> tuple[State, Outputs]:
    """The next closing; or, after the last one, the coarse model, or the end."""
    goal = grasp_goal(state.demand, state)
    if goal is not None:
        return replace(state, closing=goal), [("/hand/goal", goal)]
    if not len(state.grasped.points):
        within = "reach" if math.isinf(state.demand.most_seconds) else "reach and robot time"
        return done(state.demand, state, f"the hand closed on nothing within {within}")
    state = replace(state, models=state.models + 1)
    return state, [("/model/goal", model_goal(state))]


def take_coarse(params: Params, state: State, coarse: Superquadric) -> tuple[State, Outputs]:
    """Fix the slicing frame and begin with the slices."""
    return decide(state.demand, params.rule, with_coarse(state, coarse, params.direction))


def take_clock(params: Params, state: State, clock: FingerClock) -> tuple[State, Outputs]:
    """Remember how far a finger has come: an earlier result may be free to be taken up."""
    clocks = {**state.clocks, clock.finger: clock.robot_time}
    return take_up(state.demand, params.rule, replace(state, clocks=clocks))


def take_result(params: Params, state: State, result: Contour | Probe) -> tuple[State, Outputs]:
    """Take up what a finger has finished, when its turn has come."""
    pending = {**state.pending, result.finger: result}
    return take_up(state.demand, params.rule, replace(state, pending=pending))


def take_model(params: Params, state: State, model: ShapeModel) -> tuple[State, Outputs]:
    """Decide what comes next, now that the model with the last result is known.

    Until the next model, what is asked is what was asked last when this one came.
    """
    if model.final:
        return state, []
    state = replace(state, demand=params.demand)
    assert state.survey is not None
    dropped = set(model.dropped)
    pairs = zip(state.contours, state.survey.traced, strict=True)
    survey = replace(
        state.survey,
        traced=tuple(
            one if one.dropped == (number in dropped) else replace(one, dropped=number in dropped)
            for number, one in pairs
        ),
        uncertainty=_uncertainty(model) if len(model.faces) else None,
    )
    state = replace(
        state,
        survey=survey,
        asked=False,
        surface=_surface(params, state, model),
        general=model.method == "general",
        aimed=(),
    )
    observation = _observation(state.demand, state)
    state, outputs = decide(state.demand, params.rule, state)
    # Nobody waits for what is said of it.
    told = Deferred(PlanEstimate, lambda step: _estimate(model, estimate_error(observation)))
    return state, [*outputs, ("/plan/estimate", told)]


def _surface(params: Params, state: State, model: ShapeModel) -> ObservedSurface | None:
    """The model as planners of single touches are told of it; None if nothing tells of errors."""
    assert state.world is not None and state.pad is not None
    earlier = state.surface.progress if state.surface is not None and state.general else ()
    refused = np.reshape(state.refused, (-1, 3))
    distance = params.demand.limits.unknown_distance
    return observed_surface(model, state.pad, state.world, distance, refused, earlier)


def _estimate(model: ShapeModel | PlanDone, estimate: Estimate) -> PlanEstimate:
    halving = estimate.halving
    return derive(
        PlanEstimate,
        model,
        estimate,
        contours=len(model.contours),
        halving_touches=halving and halving.touches,
        halving_seconds=halving and halving.seconds,
        open_share=estimate.open_area and estimate.open_area.share,
        open_width=estimate.open_area and estimate.open_area.width,
    )


def _uncertainty(model: ShapeModel) -> explore.ModelUncertainty:
    return explore.ModelUncertainty(
        heights=model.uncertainty_height,
        deviations=model.uncertainty,
        whole=model.deviation,
        ends=model.ends_deviation,
        pose=model.health.get("radial_pose_sigma", 0.0),
        starlike=model.health.get("radial_unused", 0.0) == 0.0,
    )


def take_up(demand: Demand, rule: Planner, state: State) -> tuple[State, Outputs]:
    """Take up the result whose turn it is, and go on; wait while it is nobody's."""
    if state.asked:
        return state, []
    times = {finger: result.robot_time for finger, result in state.pending.items()}
    finger = explore.next_finished(times, state.tasks.keys(), state.clocks)
    if finger is None:
        return state, []
    result, task = state.pending[finger], state.tasks[finger]
    faults = 0 if result.fault == "none" else state.faults + 1
    state = replace(
        state,
        pending={other: one for other, one in state.pending.items() if other != finger},
        tasks={other: one for other, one in state.tasks.items() if other != finger},
        clocks={**state.clocks, finger: result.robot_time},
        touches=state.touches + result.touches,
        clock=max(state.clock, result.robot_time),
        cut=state.cut or not result.touches,
        faults=faults,
        broken=_broken(state, result, faults),
    )
    if not result.touches:
        return decide(demand, rule, state)
    if task.touch is not None:
        assert isinstance(result, Probe)
        return decide(demand, rule, with_single(state, task, result))
    if isinstance(result, Probe):
        return decide(demand, rule, with_probe(state, task, result))
    assert state.survey is not None
    traced = explore.widened(traced_of(result, task.begun), demand.feature)
    survey = state.survey.with_slice(traced)
    state = replace(state, survey=survey, contours=(*state.contours, result.id))
    if not traced.usable:
        cut = result.status == "budget" and result.touches < task.limit
        failed = state.failed or not cut
        state = replace(state, arcs=(*state.arcs, result.id), failed=failed)
    return decide(demand, rule, state)


def _broken(state: State, result: Contour | Probe, faults: int) -> str:
    """Why a sensor is not to be used any more, if it is so."""
    gives_up = isinstance(result, Contour) or faults >= MAX_FAULTS
    if state.broken or result.fault == "none" or not gives_up:
        return state.broken
    return f"the sensor of finger {result.finger} failed: {FAULTS[result.fault]}"


def decide(demand: Demand, rule: Planner, state: State) -> tuple[State, Outputs]:
    """Give every idle finger something to do; end when there is nothing left."""
    assert state.world is not None
    outputs: Outputs = []
    for finger in range(1, state.world.fingers + 1):
        if finger in state.tasks or state.broken:
            continue
        state, given = _assign(demand, rule, state, finger)
        outputs += given
    if not state.tasks and not state.asked:
        if state.broken:
            return done(demand, state, state.broken, _observation(demand, state))
        return _finish(demand, rule, state)
    # A result may have waited for this decision.
    state, more = take_up(demand, rule, state)
    return state, outputs + more


def _assign(demand: Demand, rule: Planner, state: State, finger: int) -> tuple[State, Outputs]:
    """Something to do for an idle finger, if there is anything; or a model, to decide by.

    While a model is in the making, that is a slice in which no model has a say.
    """
    allowed = allowance(demand, state)
    touch = None
    if state.again is not None and allowed and not state.cut and not state.asked:
        return _touched(state, finger, state.again, allowed)
    if allowed and not state.cut and not state.general and not state.asked:
        last = bool(state.usable) and not fits_contour(demand, state)
        touch = next_touch(state, demand.tolerance, last=last)
    if touch is None:
        if state.is_searching:
            return state, []
        asked: Outputs = []
        if state.is_stale and not state.asked:  # ask for a model of all that there is
            state, asked = _ask(state)
        observation = _observation(demand, state, finger)
        choice = _answer(rule, state, observation)
        if isinstance(choice, Stop) and state.is_beyond_model and not observation.budget.spent:
            return _ask(state)
        if isinstance(choice, Touch) and allowed:
            task = Task(state.goals, state.clock, _height(state, choice), allowed, touch=choice)
            return _touched(state, finger, task, allowed)
        if isinstance(choice, Height) and allowed:
            limit = contour_limit(state)
            task = Task(state.goals, state.clock, choice.height, allowed, limit=limit)
            goal = contour_goal(state, finger, choice, demand.feature, task)
            return _with_task(state, finger, task), [*asked, ("/contour/goal", goal)]
        if state.asked:
            return state, asked
        stops = isinstance(choice, Stop) and not state.tasks and not observation.budget.spent
        if stops and not state.general:  # whose ends are surface: the planner knows of them
            touch = next_touch(state, demand.tolerance, last=True)
    if touch is None or allowed is None:
        return state, []
    allowed = allowed._replace(most_touches=1)
    task = Task(state.goals, state.clock, touch.height, allowed, (touch.end, touch.probing))
    probe = probe_goal(state, finger, touch.probing, allowed)
    return _with_task(state, finger, task), [("/probe/goal", probe)]


def _ask(state: State) -> tuple[State, Outputs]:
    state = replace(
        state,
        models=state.models + 1,
        modelled=state.evidence,
        modelled_touches=state.touches,
        asked=True,
    )
    return state, [("/model/goal", model_goal(state))]


def _answer(rule: Planner, state: State, observation: Observation) -> Choice:
    """What the rule answers; what nobody can act on ends the exploration with what there is.

    While a model is in the making, it is asked only for what no model has a say in.
    """
    if state.goals >= MOST_GOALS:
        return Stop("a model can list no more contours and single touches")
    settled = settled_height(rule, observation)
    if settled is not None:
        return settled
    if state.asked:
        return Wait("a model is in the making")
    try:
        return check_choice(rule, observation)
    except WrongChoiceError as error:
        return Stop(str(error))


def _height(state: State, touch: Touch) -> float:
    """Of a touch's target, in the slicing frame, m."""
    assert state.frame is not None
    return float(state.frame.pose.to_local(touch.target)[2])


def _touched(state: State, finger: int, task: Task, allowed: Allowance) -> tuple[State, Outputs]:
    """A single touch is asked for."""
    assert task.touch is not None
    touch = task.touch
    allowed = allowed._replace(most_touches=1)
    task = task._replace(goal=state.goals, begun=state.clock, allowed=allowed)
    goal = probe_goal(state, finger, touch, allowed)
    return _with_task(replace(state, again=None), finger, task), [("/probe/goal", goal)]


def _with_task(state: State, finger: int, task: Task) -> State:
    return replace(state, tasks={**state.tasks, finger: task}, goals=state.goals + 1)


def _finish(demand: Demand, rule: Planner, state: State) -> tuple[State, Outputs]:
    """The end, with what the rule says of it."""
    observation = _observation(demand, state)
    stop = _answer(rule, state, observation)
    if not isinstance(stop, Stop):
        raise ValueError(f"nothing is under way, and the planner neither stops nor goes on: {stop}")
    return done(demand, state, stop.reason + _shape(state), observation)


def _observation(demand: Demand, state: State, finger: int = 1) -> Observation:
    assert state.survey is not None
    return state.survey.observation(
        demand,
        touches=state.touches,
        seconds=state.clock,
        busy_heights=tuple(task.height for task in state.tasks.values()),
        cut=state.cut,
        surface=state.surface,
        general=state.general,
        tried=state.aimed,
        resting=state.resting.get(finger),
    )


def done(
    demand: Demand, state: State, reason: str, observation: Observation | None = None
) -> tuple[State, Outputs]:
    """Say that it is over, and how good the solid is."""
    state = replace(state, models=state.models + 1)
    goal = model_goal(state)
    if observation is None:
        return state, [("/plan/done", plan_done(goal, reason, Findings(), demand.limits))]
    estimate = estimate_error(observation)
    found = estimate.findings
    if not state.general:  # single touches of a general solid have no heights
        found = replace(found, untraced_height=untraceable_height(observation))
    over = plan_done(goal, reason, found, observation.limits, estimate.open_area)
    return state, [("/plan/estimate", _estimate(over, estimate)), ("/plan/done", over)]


def _shape(state: State) -> str:
    """What is to be said of slices that are not star-shaped."""
    assert state.survey is not None
    known = state.survey.uncertainty
    if not state.usable or (known is not None and known.starlike):
        return ""
    if known is None:
        return "; no solid could be rebuilt from its slices"
    return "; its slices are not star-shaped: it is rebuilt from contours alone"


NODE = Node(
    params=Params,
    start=lambda params: (State(params.demand), []),
    handler_timeout=20.0,
    step="planning",
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
        "/plan/estimate": PlanEstimate,
        "/plan/done": PlanDone,
        "/planner/parameter_events": ParameterEvent,
    },
    settable=dict.fromkeys(("tolerance", "most_touches", "most_seconds"), "/model/shape"),
    check_set=check_demand,
    needs=("/world", "/touch/info"),
    fan_in=("/finger/clock", "/contour/traced", "/probe/traced"),
)
