"""A planner that closes the hand once and then hands out heights, to whichever finger is free.

Contours are taken up in the order of robot time, so that no order of hearing changes who gets
which height.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import msgspec
import numpy as np

from palpate.core.explore.survey import next_finished
from palpate.core.poses import FACING_DOWN, IDENTITY_POSE, pose_of
from palpate.messages.types.motion import (
    Contour,
    ContourGoal,
    FingerClock,
    GraspContacts,
    GraspGoal,
    ProbeGoal,
)
from palpate.messages.types.world import World
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
    hand = GraspGoal(
        number=0,
        pose=pose_of(np.array([0.0, 0.0, 0.03]), FACING_DOWN),
        fingers=4,
        opening=0.1,
        reach=0.1,
        not_before=0.0,
    )
    return State(world.fingers, params.heights), [("/hand/goal", hand)]


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
    goal = ContourGoal(
        id=state.goals,
        finger=finger,
        frame=IDENTITY_POSE,
        height=state.left[0],
        centre=np.zeros(2),
        radius=params.radius,
        not_before=now,
    )
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
