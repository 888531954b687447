"""Simulator node: knows the object, moves finger and hand, and reads the taxels."""

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

FIRST_HAND_FINGER = 1001  # number of a finger of the hand, which selects its random numbers
NO_SURFACE_PATH = -1.0  # length of a path along the surface if there is none, as in `MoveParts`
IDENTITY = Pose.from_array(IDENTITY_POSE)


@dataclass(frozen=True, slots=True, kw_only=True)
class TruthSettings:
    """Subdivisions of the meshes of the true surface, of 82k and 20k faces."""

    mesh_level: int = 6
    floor_level: int = 5  # of the second mesh, which gives the sampling floor


class Params(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What the launch file may set."""

    object: ObjectSpec  # on the platform
    sensor: SensorSpec = SensorSpec()
    effects: EffectSpecs = {}  # disturbances of the sensor: parameters by name of the effect
    # Reach sideways from the axis and upwards from the platform [m]; fitted to the object if None.
    reach: Length | None = None
    robot: str = "modern"  # preset of the robot's speeds: modern or puma
    seed: Seed = 0  # of the run
    # Finger that it moves; the first one also has the hand, and publishes world, sensor and truth.
    finger: Finger = 1
    fingers: Finger = 1  # number of fingers, each with its own simulator

    def __post_init__(self) -> None:
        if self.finger > self.fingers:
            raise ValueError(f"finger must be at most fingers, {self.fingers}, got {self.finger}")
        if self.robot not in ROBOT_PRESETS:
            raise ValueError(f"robot must be one of {sorted(ROBOT_PRESETS)}, got {self.robot!r}")
        build_pipeline(self.sensor, self.effects, ROBOT_PRESETS[self.robot])

    @property
    def reach_of_finger(self) -> float:
        """The reach, fitted to the object if it is None [m]."""
        return fitted_reach(self.object) if self.reach is None else self.reach


class LastContact(NamedTuple):
    """Last contact of the finger."""

    goal: int  # contour or probe of the touch
    place: Floats  # position of the pad, (3,) [m]


class HandState(NamedTuple):
    """The hand and its fingertips."""

    fingers: tuple[Pipeline, ...]  # with own random numbers each; the palm is last
    remembered: tuple[StageStates, ...]  # states of their stages after earlier closings
    closings: int  # number of closings
    resting: Pose | None  # of the hand at the last closing
    advanced: float  # largest advance of a finger before the last closing [m]


@dataclass(frozen=True, slots=True, eq=False)
class State:
    """The object, the finger and the hand."""

    shape: Shape  # of the object
    pipeline: Pipeline  # stages of the fingertip
    remembered: StageStates  # states of the stages after earlier touches
    touches: int = 0  # number of touches
    clock: float = 0.0  # robot time [s]
    resting: Pose | None = None  # start of the last touch, to which the finger returns
    contact: LastContact | None = None  # of the last touch, if it met the object
    hand: HandState | None = None  # None before its first use
    platform: float = 0.0  # height of the platform [m]
    placement: int = 0  # number of times that the object was turned over
    upright: Shape | None = None  # the object before the first turn, if it was turned over
    lies: Pose = IDENTITY  # pose relative to that before the first turn
    waiting: tuple[types.TouchGoal, ...] = ()  # touches of later placements


def start(params: Params) -> tuple[State, Outputs]:
    """Build the object; for the first finger, publish world, sensor and truth."""
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


def _truth(shape: Shape, platform: float, settings: TruthSettings = TruthSettings()) -> types.Truth:
    low, high = shape.bounds()
    vertices, faces = shape.mesh(settings.mesh_level)
    floor_vertices, floor_faces = shape.mesh(settings.floor_level)
    return types.Truth(
        vertices=vertices,
        faces=faces,
        floor_vertices=floor_vertices,
        floor_faces=floor_faces,
        height=high[2] - low[2],
        platform=platform,
    )


def touch(params: Params, state: State, goal: types.TouchGoal) -> tuple[State, Outputs]:
    """Make a guarded move; its frame is sent as often as the link delivers it.

    Where all fingers share one topic of goals, goals of other fingers are ignored.
    """
    if not 1 <= goal.finger <= params.fingers:
        raise ValueError(
            f"touch {goal.touch} of goal {goal.goal} is for finger {goal.finger}; "
            f"the fingers are 1 to {params.fingers}"
        )
    if goal.finger != params.finger:
        return state, []
    if goal.placement > state.placement:  # the goal may arrive before the turn
        return replace(state, waiting=(*state.waiting, goal)), []
    robot, pose = ROBOT_PRESETS[params.robot], Pose.from_array(goal.pose)
    begun = max(state.clock, goal.not_before)
    travel, turn = move_between(state.resting, pose)
    starts = begun + free_seconds(robot, travel=travel, turn=turn)
    done, remembered = _guarded_move(state, goal, pose, starts)
    delay = max(done.time - starts - contact_seconds(robot, done.advance), 0.0)
    contact = LastContact(goal.goal, done.believed.position) if done.outcome in HITS else None
    paths = (travel, turn, done.advance, _surface_path(state.contact, contact))
    array = state.pipeline.finger.calibration.encode(done.reading)
    frame = _frame(goal, done, array, np.array([begun - state.clock + delay, *paths]))
    state = replace(
        state,
        remembered=remembered,
        touches=state.touches + 1,
        clock=done.time,
        resting=pose,
        contact=contact,
    )
    return state, [("/touch/raw", frame)] * done.copies


def _guarded_move(
    state: State, goal: types.TouchGoal, pose: Pose, starts: float
) -> tuple[SimulatedTouch, StageStates]:
    """The simulated touch, and the states of the fingertip's stages after it."""
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
    return done, state.pipeline.simulate(done, state.remembered)


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
    """Close the hand, and publish its contacts."""
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
    travel += hand.advanced + advanced  # fingers open and advance at the speed of the arm
    starts = begun + free_seconds(robot, travel=travel, turn=turn)
    closing = Closing(hand.closings, starts, state.clock)
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


def turn_over(
    params: Params,
    state: State,
    goal: types.TurnGoal,
    settings: TruthSettings = TruthSettings(),
) -> tuple[State, Outputs]:
    """Set the object down on another side, with errors of the hand; then make waiting touches."""
    upright = state.shape if state.upright is None else state.upright
    requested, robot = Pose.from_array(goal.pose), ROBOT_PRESETS[params.robot]
    resting = RestingSolid(*upright.mesh(settings.mesh_level))
    pose = set_down(resting, requested, state.platform, params.seed, goal.placement)
    (travel, grip), turn = turning_distances(), rotation_angle(state.lies.axes, pose.axes)
    begun = max(state.clock, goal.not_before)
    clock = begun + free_seconds(robot, travel, turn) + contact_seconds(robot, grip)
    move = np.array([begun - state.clock, travel, turn, grip, NO_SURFACE_PATH])
    turned = types.Turned(placement=goal.placement, move=move, robot_time=clock)
    waiting = state.waiting
    state = replace(
        state,
        shape=PosedShape(upright, pose),
        upright=upright,
        lies=pose,
        placement=goal.placement,
        clock=clock,
        contact=None,
        waiting=(),
    )
    outputs: Outputs = [("/hand/turned", turned)] if params.finger == 1 else []
    for touch_goal in waiting:
        state, more = touch(params, state, touch_goal)
        outputs += more
    return state, outputs


def _hand(params: Params, state: State, fingers: int) -> HandState:
    """The hand as it is, or a new one if another number of fingers is requested."""
    if state.hand is not None and len(state.hand.fingers) == fingers + 1:
        return state.hand
    robot = ROBOT_PRESETS[params.robot]
    pipelines = tuple(
        build_pipeline(params.sensor, params.effects, robot, finger=number, seed=params.seed)
        for number in range(FIRST_HAND_FINGER, FIRST_HAND_FINGER + fingers + 1)
    )
    return HandState(pipelines, tuple(p.begin() for p in pipelines), 0, None, 0.0)


def _surface_path(previous: LastContact | None, contact: LastContact | None) -> float:
    """Distance from the previous contact [m]; `NO_SURFACE_PATH` if it belongs to another goal."""
    if previous is None or contact is None or previous.goal != contact.goal:
        return NO_SURFACE_PATH
    return float(np.linalg.norm(contact.place - previous.place))


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
    optional=("/hand/turn",),  # only planners turn the object over
    shared=("/world", "/truth", "/touch/info", "/hand/goal", "/hand/contacts", "/hand/turned"),
)
