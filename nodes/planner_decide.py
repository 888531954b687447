"""The planner's second part: who does what next, and when it is over."""

from __future__ import annotations

from dataclasses import replace

from palpate.core.explore.fingers import next_finished
from palpate.core.explore.planners.asking import ask
from palpate.core.explore.planners.choice import Height, Planner, Stop
from palpate.core.explore.planners.cover import uncovered
from palpate.core.explore.planners.known import Known
from palpate.core.explore.planners.measured import widened
from palpate.core.explore.survey import Demand
from palpate.messages.types import Contour, PlanDone, Probe
from palpate.nodes.node import Outputs
from palpate.nodes.planner_ends import next_touch, with_probe
from palpate.nodes.planner_state import (
    State,
    Task,
    contour_goal,
    model_goal,
    probe_goal,
    traced_of,
)


def take_up(demand: Demand, rule: Planner, state: State) -> tuple[State, Outputs]:
    """Take up the result whose turn it is, and go on; wait while it is nobody's."""
    if state.asked:
        return state, []
    times = {finger: result.robot_time for finger, result in state.heard.items()}
    finger = next_finished(times, state.tasks.keys(), state.clocks)
    if finger is None:
        return state, []
    result, task = state.heard[finger], state.tasks[finger]
    state = replace(
        state,
        heard={other: one for other, one in state.heard.items() if other != finger},
        tasks={other: one for other, one in state.tasks.items() if other != finger},
        clocks={**state.clocks, finger: result.robot_time},
        touches=state.touches + result.touches,
        clock=max(state.clock, result.robot_time),
    )
    if isinstance(result, Probe):
        return decide(demand, rule, with_probe(state, task, result))
    return _with_contour(demand, rule, state, task, result)


def decide(demand: Demand, rule: Planner, state: State) -> tuple[State, Outputs]:
    """Give every idle finger something to do; end when there is nothing left."""
    assert state.world is not None
    outputs: Outputs = []
    for finger in range(1, state.world.fingers + 1):
        if finger in state.tasks:
            continue
        state, given = _give(demand, rule, state, finger)
        outputs += given
        if state.asked:
            return state, outputs
    if not state.tasks:
        return _finish(demand, rule, state)
    # A result may have waited for this decision.
    state, more = take_up(demand, rule, state)
    return state, outputs + more


def done(
    state: State, reason: str, known: Known | None = None, stop: Stop | None = None
) -> tuple[State, Outputs]:
    """Say that it is over."""
    state = replace(state, models=state.models + 1)
    goal = model_goal(state)
    plan_done = PlanDone(
        number=goal.number,
        contours=goal.contours,
        probes=goal.probes,
        touches=goal.touches,
        robot_time=goal.robot_time,
        reason=reason,
        within=None if stop is None else stop.within,
        bound=None if stop is None else stop.bound,
        unfelt=None if stop is None else stop.unfelt,
        uncovered=0.0 if known is None else uncovered(known),
    )
    return state, [("/plan/done", plan_done)]


def _give(demand: Demand, rule: Planner, state: State, finger: int) -> tuple[State, Outputs]:
    """Something to do for an idle finger, if there is anything; or a model, to decide by."""
    touch = next_touch(state, demand.tolerance, last=False)
    if touch is None:
        if state.is_searching:
            return state, []
        if state.is_stale:
            return _ask(state)
        known = _known(demand, state)
        choice = ask(rule, known)
        if isinstance(choice, Height):
            task = Task(state.goals, state.clock, choice.height)
            slice_goal = contour_goal(state, finger, choice)
            return _with_task(state, finger, task), [("/contour/goal", slice_goal)]
        if isinstance(choice, Stop) and not state.tasks and not known.budget.spent:
            touch = next_touch(state, demand.tolerance, last=True)
    if touch is None:
        return state, []
    task = Task(state.goals, state.clock, touch.height, (touch.end, touch.probing))
    goal = probe_goal(state, finger, touch.probing)
    return _with_task(state, finger, task), [("/probe/goal", goal)]


def _with_task(state: State, finger: int, task: Task) -> State:
    return replace(state, tasks={**state.tasks, finger: task}, goals=state.goals + 1)


def _with_contour(
    demand: Demand, rule: Planner, state: State, task: Task, contour: Contour
) -> tuple[State, Outputs]:
    """Go on with one contour more."""
    traced = traced_of(contour, task.begun)
    assert state.survey is not None
    survey = state.survey.with_slice(widened(traced, demand.feature))
    state = replace(state, survey=survey, contours=(*state.contours, contour.id))
    return decide(demand, rule, state)


def _ask(state: State) -> tuple[State, Outputs]:
    """Ask for a model of all that there is, and wait for it."""
    state = replace(state, models=state.models + 1, modelled=state.evidence, asked=True)
    return state, [("/model/goal", model_goal(state))]


def _finish(demand: Demand, rule: Planner, state: State) -> tuple[State, Outputs]:
    """The end, with what the rule says of it."""
    known = _known(demand, state)
    stop = ask(rule, known)
    if not isinstance(stop, Stop):
        raise ValueError(f"nothing is under way, and the planner neither stops nor goes on: {stop}")
    return done(state, stop.reason + _shape(state), known, stop)


def _shape(state: State) -> str:
    """What is to be said of slices that are not star-shaped."""
    assert state.survey is not None
    if not state.usable:
        return ""
    if state.survey.doubt is None:
        return "; no solid could be rebuilt from its slices"
    if not state.survey.doubt.starlike:
        return "; its slices are not star-shaped: it is rebuilt from contours alone"
    return ""


def _known(demand: Demand, state: State) -> Known:
    assert state.survey is not None
    taken = tuple(task.height for task in state.tasks.values())
    return state.survey.known(demand, touches=state.touches, seconds=state.clock, taken=taken)
