"""Simulator node: the only one that knows the object. Moves the finger, and says what it feels."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from msgspec import Struct

from palpate.core.arrays import Floats
from palpate.core.frames import split_pose, turn_angle
from palpate.core.measure.robot_time import PRESETS, free_seconds
from palpate.core.shapes.protocol import Shape
from palpate.core.touch.pipeline import Pipeline, States
from palpate.core.touch.touch import Touch
from palpate.messages.types import SensorInfo, TactileFrame, TouchGoal, Truth, World
from palpate.nodes.effects import EffectSpecs, build_pipeline, felt_face
from palpate.nodes.node import Node, Outputs
from palpate.nodes.object import Length, ObjectSpec, Seed, build_shape
from palpate.nodes.sensor import SensorSpec, info_of

TRUTH_LEVEL, FLOOR_LEVEL = 6, 5
"""82k and 20k faces."""


class Params(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What the launch file may set."""

    object: ObjectSpec
    """What stands on the platform."""
    sensor: SensorSpec = SensorSpec()
    """What touches it."""
    effects: EffectSpecs = {}
    """What disturbs it: parameters by the effect's name; nothing else is simulated."""
    reach: Length = 0.15
    """The finger reaches this far sideways from the axis and up from the platform, m."""
    robot: str = "modern"
    """Preset of the robot's speeds: modern or puma."""
    seed: Seed = 0
    """The run's seed."""

    def __post_init__(self) -> None:
        if self.robot not in PRESETS:
            raise ValueError(f"robot must be one of {sorted(PRESETS)}, got {self.robot!r}")
        build_pipeline(self.sensor, self.effects, PRESETS[self.robot])


@dataclass(frozen=True, slots=True, eq=False)
class State:
    """The object, the finger, and what the finger remembers."""

    shape: Shape
    """What is touched."""
    pipeline: Pipeline
    """What touches, stage by stage."""
    remembered: States
    """What the stages remember of the touches before."""
    touches: int = 0
    """Touches made."""
    clock: float = 0.0
    """Robot time, s."""
    resting: Floats | None = None
    """Pose from which the last touch started: the finger returns to it."""


def start(params: Params) -> tuple[State, Outputs]:
    """Build the object and tell what a robot would know, and the truth."""
    shape = build_shape(params.object)
    pipeline = build_pipeline(
        params.sensor, params.effects, PRESETS[params.robot], seed=params.seed
    )
    low, high = shape.bounds()
    vertices, faces = shape.mesh(TRUTH_LEVEL)
    floor_vertices, floor_faces = shape.mesh(FLOOR_LEVEL)
    return State(shape, pipeline, pipeline.begin()), [
        ("/world", World(platform=low[2], reach=params.reach, fingers=1, seed=params.seed)),
        ("/touch/info", info_of(params.sensor, pipeline.noise, felt_face(pipeline))),
        (
            "/truth",
            Truth(
                vertices=vertices,
                faces=faces,
                floor_vertices=floor_vertices,
                floor_faces=floor_faces,
                height=high[2] - low[2],
            ),
        ),
    ]


def touch(params: Params, state: State, goal: TouchGoal) -> tuple[State, Outputs]:
    """One guarded move and its frame, sent as often as the link delivers it."""
    pipeline = state.pipeline
    felt = Touch(
        shape=state.shape,
        number=state.touches,
        believed=goal.pose,
        actual=goal.pose,
        reach=goal.reach,
        depth=goal.depth,
        begun=max(state.clock, goal.not_before) + _way_there(params, state, goal),
        previous=state.clock,
    )
    remembered = pipeline.feel(felt, state.remembered)
    frame = TactileFrame(
        goal=goal.goal,
        touch=goal.touch,
        finger=goal.finger,
        direction=goal.direction,
        pose=felt.believed,
        outcome=felt.outcome,
        array=pipeline.finger.calibration.encode(felt.reading),
        robot_time=felt.time,
    )
    state = replace(
        state,
        remembered=remembered,
        touches=state.touches + 1,
        clock=felt.time,
        resting=goal.pose,
    )
    return state, [("/touch/raw", frame)] * felt.copies


def _way_there(params: Params, state: State, goal: TouchGoal) -> float:
    """Robot time from where the finger rests to where the move starts, s."""
    if state.resting is None:
        return 0.0
    position, axes = split_pose(goal.pose)
    before, axes_before = split_pose(state.resting)
    return free_seconds(
        PRESETS[params.robot],
        travel=float(np.linalg.norm(position - before)),
        turn=turn_angle(axes_before, axes),
    )


NODE = Node(
    params=Params,
    start=start,
    inputs={"/finger/goal": (TouchGoal, touch)},
    outputs={
        "/world": World,
        "/truth": Truth,
        "/touch/info": SensorInfo,
        "/touch/raw": TactileFrame,
    },
)
