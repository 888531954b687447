"""A planner that closes the hand once and then hands out heights to the fingers that are free.

Contours are taken up in the order of robot time, whatever the order in which they arrive.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import msgspec
import numpy as np

from palpate.core.explore import next_finished
from palpate.core.poses import FACING_DOWN, IDENTITY_POSE, Pose
from palpate.messages.types import (
    Contour,
    ContourGoal,
    FingerClock,
    GraspContacts,
    GraspGoal,
    ProbeGoal,
    World,
)
from palpate.nodes.runtime.node import Finished, Node, Outputs


class Params(msgspec.Struct, frozen=True, kw_only=True):
    heights: tuple[float, ...]
    radius: float = 0.05


@dataclass(frozen=True, eq=False)
class State:
    fingers: int = 0
    left: tuple[float, ...] = ()
    goals: int = 0
    busy: tuple[int, ...] = ()
    received: dict[int, Contour] = field(default_factory=dict)
    clocks: dict[int, float] = field(default_factory=dict)
    taken: tuple[int, ...] = ()


def _know_world(params: Params, state: State, world: World) -> tuple[State, Outputs]:
    pose, hand = Pose(np.array([0.0, 0.0, 0.03]), FACING_DOWN).array, {"opening": 0.1, "reach": 0.1}
    goal = GraspGoal(number=0, pose=pose, fingers=4, not_before=0.0, **hand)
    return State(world.fingers, params.heights), [("/hand/goal", goal)]


def _grasped(params: Params, state: State, contacts: GraspContacts) -> tuple[State, Outputs]:
    outputs: Outputs = []
    for finger in range(1, state.fingers + 1):
        state, more = _send(params, state, finger, contacts.robot_time)
        outputs += more
    return state, outputs


def _take_contour(params: Params, state: State, contour: Contour) -> tuple[State, Outputs]:
    received = {**state.received, contour.finger: contour}
    return _take_up(params, replace(state, received=received))


def _take_clock(params: Params, state: State, clock: FingerClock) -> tuple[State, Outputs]:
    return _take_up(params, _passed(state, clock.finger, clock.robot_time))


def _take_up(params: Params, state: State) -> tuple[State, Outputs]:
    outputs: Outputs = []
    while state.received:
        times = {finger: contour.robot_time for finger, contour in state.received.items()}
        finger = next_finished(times, state.busy, state.clocks)
        if finger is None:
            break
        contour = state.received[finger]
        state = replace(
            state,
            received={one: received for one, received in state.received.items() if one != finger},
            busy=tuple(one for one in state.busy if one != finger),
            taken=(*state.taken, contour.id),
        )
        state, more = _send(params, state, finger, contour.robot_time)
        outputs += more
    if not (state.busy or state.left):
        outputs.append(Finished(f"took {state.taken}"))
    return state, outputs


def _send(params: Params, state: State, finger: int, now: float) -> tuple[State, Outputs]:
    if not state.left:
        return state, []
    where = {"frame": IDENTITY_POSE, "height": state.left[0], "centre": np.zeros(2)}
    whose = {"id": state.goals, "finger": finger, "not_before": now}
    goal = ContourGoal(radius=params.radius, **where, **whose)
    busy = (*state.busy, finger)
    state = replace(state, left=state.left[1:], goals=state.goals + 1, busy=busy)
    return _passed(state, finger, now), [("/contour/goal", goal)]


def _passed(state: State, finger: int, seconds: float) -> State:
    latest = max(seconds, state.clocks.get(finger, 0.0))
    return replace(state, clocks={**state.clocks, finger: latest})


NODE = Node(
    params=Params,
    start=lambda params: (State(), []),
    inputs={
        "/world": (World, _know_world),
        "/hand/contacts": (GraspContacts, _grasped),
        "/contour/traced": (Contour, _take_contour),
        "/finger/clock": (FingerClock, _take_clock),
    },
    outputs={"/hand/goal": GraspGoal, "/contour/goal": ContourGoal, "/probe/goal": ProbeGoal},
    needs=("/world",),
    fan_in=("/contour/traced", "/finger/clock"),
)
