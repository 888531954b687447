"""Simulator node, the only one that knows the object: moves finger and hand, reads the taxels."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from msgspec import Struct

from palpate.core.arrays import Floats
from palpate.core.geometry import RestingSolid
from palpate.core.poses import IDENTITY_POSE, Pose, rotation_angle
from palpate.core.robot_time import ROBOT_PRESETS, contact_seconds, free_seconds, move_between
from palpate.core.shapes import PosedShape, Shape
from palpate.core.touch import (
    HITS,
    Pipeline,
    SimulatedTouch,
    StageStates,
    set_down,
    turning_distances,
)
from palpate.messages import types
from palpate.nodes.runtime.node import Finger, Node, Outputs
from palpate.nodes.specs.objects import ObjectSpec, Seed, build_shape, fitted_reach
from palpate.nodes.specs.primitives import Length
from palpate.nodes.specs.sensors import (
    EffectSpecs,
    SensorSpec,
    build_pipeline,
    info_of,
    sensed_face,
)

FIRST_HAND_FINGER = 1001  # Of the hand: it chooses other random numbers than the exploring ones
NO_SURFACE_PATH = -1.0  # Way along the surface where there was none
TRUTH_LEVEL, FLOOR_LEVEL = 6, 5  # 82k and 20k faces
IDENTITY = Pose.from_array(IDENTITY_POSE)


class Params(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What the launch file may set."""

    object: ObjectSpec  # What stands on the platform
    sensor: SensorSpec = SensorSpec()  # What touches it
    # What disturbs it: parameters by the effect's name; nothing else is simulated.
    effects: EffectSpecs = {}
    # The finger reaches this far sideways from the axis and up from the platform, m; as far as the
    # object asks for if left out.
    reach: Length | None = None
    robot: str = "modern"  # Preset of the robot's speeds: modern or puma
    seed: Seed = 0  # The run's seed
    # The finger that it moves; the first has the hand as well, and tells what all may know.
    finger: Finger = 1
    fingers: Finger = 1  # How many fingers there are, each with a simulator of its own

    def __post_init__(self) -> None:
        if self.finger > self.fingers:
            raise ValueError(f"finger must be at most fingers, {self.fingers}, got {self.finger}")
        if self.robot not in ROBOT_PRESETS:
            raise ValueError(f"robot must be one of {sorted(ROBOT_PRESETS)}, got {self.robot!r}")
        build_pipeline(self.sensor, self.effects, ROBOT_PRESETS[self.robot])

    @property
    def reach_of_finger(self) -> float:
        """The reach, fitted to the object if none is given, m."""
        return fitted_reach(self.object) if self.reach is None else self.reach


class LastContact(NamedTuple):
    """Where a touch met the object."""

    goal: int  # Contour or probe that it belonged to
    place: Floats  # Where the pad then was, (3,), m


class HandState(NamedTuple):
    """The hand, and what its fingertips remember."""

    fingers: tuple[Pipeline, ...]  # With the scene's effects, own random numbers each; palm last
    remembered: tuple[StageStates, ...]  # What their stages remember of the closings before
    closings: int  # Closings made
    resting: Pose | None  # Of the hand at the last of them
    advanced: float  # How far a finger had been brought in for it, the farthest, m


@dataclass(frozen=True, slots=True, eq=False)
class State:
    """The object, the finger, and what the finger remembers."""

    shape: Shape  # What is touched
    pipeline: Pipeline  # What touches, stage by stage
    remembered: StageStates  # What the stages remember of the touches before
    touches: int = 0  # Touches made
    clock: float = 0.0  # Robot time, s
    resting: Pose | None = None  # Where the last touch started: the finger returns to it
    met: LastContact | None = None  # Where the last touch ended, if it met the object
    hand: HandState | None = None  # The hand, once it was used
    platform: float = 0.0  # Height on which the object stands, m
    placement: int = 0  # How often the object has been turned over
    upright: Shape | None = None  # The object as it stood at first, once it was turned over
    lies: Pose = IDENTITY  # How it lies now, from how it stood at first
    waiting: tuple[types.TouchGoal, ...] = ()  # Touches of later placements


def start(params: Params) -> tuple[State, Outputs]:
    """Build the object; the first finger's tells what a robot would know, and the truth."""
    shape = build_shape(params.object)
    pipeline = build_pipeline(
        params.sensor, params.effects, ROBOT_PRESETS[params.robot], params.finger, params.seed
    )
    platform = float(shape.bounds()[0, 2])
    state = State(shape, pipeline, pipeline.begin(), platform=platform)
    if params.finger > 1:
        return state, []
    world = types.World(
        platform=platform,
        reach=params.reach_of_finger,
        fingers=params.fingers,
        seed=params.seed,
        robot=ROBOT_PRESETS[params.robot].array,
    )
    return state, [
        ("/world", world),
        ("/touch/info", info_of(params.sensor, pipeline.noise, sensed_face(pipeline))),
        ("/truth", _truth(shape, platform)),
    ]


def _truth(shape: Shape, platform: float) -> types.Truth:
    low, high = shape.bounds()
    vertices, faces = shape.mesh(TRUTH_LEVEL)
    floor_vertices, floor_faces = shape.mesh(FLOOR_LEVEL)
    return types.Truth(
        vertices=vertices,
        faces=faces,
        floor_vertices=floor_vertices,
        floor_faces=floor_faces,
        height=high[2] - low[2],
        platform=platform,
    )


def touch(params: Params, state: State, goal: types.TouchGoal) -> tuple[State, Outputs]:
    """One guarded move and its frame, sent as often as the link delivers it.

    Where all fingers have one topic of goals, each takes its own.
    """
    if not 1 <= goal.finger <= params.fingers:
        raise ValueError(
            f"touch {goal.touch} of goal {goal.goal} is for finger {goal.finger}; "
            f"the fingers are 1 to {params.fingers}"
        )
    if goal.finger != params.finger:
        return state, []
    if goal.placement > state.placement:  # nobody knows which of two publishers is heard first
        return replace(state, waiting=(*state.waiting, goal)), []
    pipeline, robot = state.pipeline, ROBOT_PRESETS[params.robot]
    begun = max(state.clock, goal.not_before)
    pose = Pose.from_array(goal.pose)
    travel, turn = move_between(state.resting, pose)
    starts = begun + free_seconds(robot, travel=travel, turn=turn)
    done = SimulatedTouch(
        shape=state.shape,
        number=state.touches,
        believed=pose,
        actual=pose,
        reach=goal.reach,
        depth=goal.depth,
        begun=starts,
        previous=state.clock,
    )
    remembered = pipeline.simulate(done, state.remembered)
    late = max(done.time - starts - contact_seconds(robot, done.advance), 0.0)
    met = LastContact(goal.goal, done.believed.position) if done.outcome in HITS else None
    ways = (travel, turn, done.advance, _along(state.met, met))
    array = pipeline.finger.calibration.encode(done.reading)
    frame = _frame(goal, done, array, np.array([begun - state.clock + late, *ways]))
    state = replace(
        state,
        remembered=remembered,
        touches=state.touches + 1,
        clock=done.time,
        resting=pose,
        met=met,
    )
    return state, [("/touch/raw", frame)] * done.copies


def _frame(
    goal: types.TouchGoal, done: SimulatedTouch, array: Floats, move: Floats
) -> types.TactileFrame:
    return types.TactileFrame(
        goal=goal.goal,
        touch=goal.touch,
        finger=goal.finger,
        placement=goal.placement,
        direction=goal.direction,
        pose=done.believed.array,
        outcome=done.outcome,
        array=array,
        move=move,
        robot_time=done.time,
    )


def take_grasp(params: Params, state: State, goal: types.GraspGoal) -> tuple[State, Outputs]:
    """Close the hand, and say where it met the object."""
    from palpate.core.explore.grasp import Closing, Hand, close_hand

    shape = Hand(
        fingers=goal.fingers,
        opening=goal.opening,
        reach=goal.reach,
        advanced=tuple(goal.advanced.tolist()),
    )
    advanced = max(shape.advanced, default=0.0)
    hand = _hand(params, state, goal.fingers)
    robot, begun = ROBOT_PRESETS[params.robot], max(state.clock, goal.not_before)
    pose = Pose.from_array(goal.pose)
    travel, turn = move_between(hand.resting, pose)
    travel += hand.advanced + advanced  # the fingers open, and come near, as fast as the arm
    there = begun + free_seconds(robot, travel=travel, turn=turn)
    closing = Closing(hand.closings, there, state.clock)
    grasp, remembered = close_hand(
        state.shape, hand.fingers, hand.remembered, shape, pose, state.platform, closing
    )
    clock = closing.begun + contact_seconds(robot, grasp.advance)
    contacts = types.GraspContacts(
        number=goal.number,
        placement=state.placement,
        points=grasp.points,
        normals=grasp.normals,
        fingers=np.array(grasp.fingers, np.int32),
        missed=grasp.missed,
        blocked=grasp.blocked,
        move=np.array([begun - state.clock, travel, turn, grasp.advance, NO_SURFACE_PATH]),
        robot_time=clock,
    )
    used = HandState(hand.fingers, remembered, hand.closings + 1, pose, advanced)
    return replace(state, hand=used, clock=clock), [("/hand/contacts", contacts)]


def turn_over(params: Params, state: State, goal: types.TurnGoal) -> tuple[State, Outputs]:
    """Set the object down on another side, as well as the hand can; touches that wait follow."""
    upright = state.shape if state.upright is None else state.upright
    asked, robot = Pose.from_array(goal.pose), ROBOT_PRESETS[params.robot]
    resting = RestingSolid(*upright.mesh(TRUTH_LEVEL))
    pose = set_down(resting, asked, state.platform, params.seed, goal.placement)
    (travel, grip), turn = turning_distances(), rotation_angle(state.lies.axes, pose.axes)
    begun = max(state.clock, goal.not_before)
    clock = begun + free_seconds(robot, travel, turn) + contact_seconds(robot, grip)
    move = np.array([begun - state.clock, travel, turn, grip, NO_SURFACE_PATH])
    turned = types.Turned(placement=goal.placement, move=move, robot_time=clock)
    waiting, state = (
        state.waiting,
        replace(
            state,
            shape=PosedShape(upright, pose),
            upright=upright,
            lies=pose,
            placement=goal.placement,
            clock=clock,
            met=None,
            waiting=(),
        ),
    )
    outputs: Outputs = [("/hand/turned", turned)] if params.finger == 1 else []
    for one in waiting:
        state, more = touch(params, state, one)
        outputs += more
    return state, outputs


def _hand(params: Params, state: State, fingers: int) -> HandState:
    """The hand as it was left, or a new one if it has another number of fingers."""
    if state.hand is not None and len(state.hand.fingers) == fingers + 1:
        return state.hand
    robot = ROBOT_PRESETS[params.robot]
    made = tuple(
        build_pipeline(params.sensor, params.effects, robot, finger=number, seed=params.seed)
        for number in range(FIRST_HAND_FINGER, FIRST_HAND_FINGER + fingers + 1)
    )
    return HandState(made, tuple(one.begin() for one in made), 0, None, 0.0)


def _along(before: LastContact | None, now: LastContact | None) -> float:
    """Way from the last contact, m; `NO_SURFACE_PATH` if the surface does not join them."""
    if before is None or now is None or before.goal != now.goal:
        return NO_SURFACE_PATH
    return float(np.linalg.norm(now.place - before.place))


NODE = Node(
    params=Params,
    step="casting",
    start=start,
    handler_timeout=20.0,
    inputs={
        "/finger/goal": (types.TouchGoal, touch),
        "/hand/goal": (types.GraspGoal, take_grasp),
        "/hand/turn": (types.TurnGoal, turn_over),
    },
    outputs={
        "/world": types.World,
        "/truth": types.Truth,
        "/touch/info": types.SensorInfo,
        "/touch/raw": types.TactileFrame,
        "/hand/contacts": types.GraspContacts,
        "/hand/turned": types.Turned,
    },
    optional=("/hand/turn",),  # other graphs than those of a planner never turn it over
    shared=("/world", "/truth", "/touch/info", "/hand/goal", "/hand/contacts", "/hand/turned"),
)
