"""Simulator node: the only one that knows the object. Moves the finger, and says what it feels."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from msgspec import Struct

from palpate.core.arrays import Floats
from palpate.core.frames import split_pose, turn_angle
from palpate.core.measure.robot_time import PRESETS, touch_seconds
from palpate.core.shapes.protocol import Shape
from palpate.core.touch.calibration import flight_times
from palpate.core.touch.pad import Pad, press
from palpate.messages.types import SensorInfo, TactileFrame, TouchGoal, Truth, World
from palpate.nodes.node import Node, Outputs
from palpate.nodes.object import Length, ObjectSpec, Seed, build_shape
from palpate.nodes.sensor import SensorSpec, pad_of_info

TRUTH_LEVEL, FLOOR_LEVEL = 6, 5
"""82k and 20k faces."""


class Params(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What the launch file may set."""

    object: ObjectSpec
    """What stands on the platform."""
    sensor: SensorSpec = SensorSpec()
    """What touches it."""
    reach: Length = 0.15
    """The finger reaches this far sideways from the axis and up from the platform, m."""
    robot: str = "modern"
    """Preset of the robot's speeds: modern or puma."""
    seed: Seed = 0
    """The run's seed."""

    def __post_init__(self) -> None:
        if self.robot not in PRESETS:
            raise ValueError(f"robot must be one of {sorted(PRESETS)}, got {self.robot!r}")


@dataclass(frozen=True, slots=True, eq=False)
class State:
    """The object, and where the finger is."""

    shape: Shape
    """What is touched."""
    pad: Pad
    """What touches."""
    clock: float = 0.0
    """Robot time, s."""
    resting: Floats | None = None
    """Pose from which the last touch started: the finger returns to it."""


def start(params: Params) -> tuple[State, Outputs]:
    """Build the object and tell what a robot would know, and the truth."""
    shape, info = build_shape(params.object), info_of(params.sensor)
    low, high = shape.bounds()
    vertices, faces = shape.mesh(TRUTH_LEVEL)
    floor_vertices, floor_faces = shape.mesh(FLOOR_LEVEL)
    return State(shape, pad_of_info(info)), [
        ("/world", World(platform=low[2], reach=params.reach, fingers=1, seed=params.seed)),
        ("/touch/info", info),
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
    """One guarded move and its frame."""
    spec = params.sensor.pad
    pressed = press(state.shape, state.pad, goal.pose, goal.reach, goal.depth)
    resting = goal.pose if state.resting is None else state.resting
    position, axes = split_pose(goal.pose)
    before, axes_before = split_pose(resting)
    clock = max(state.clock, goal.not_before) + touch_seconds(
        PRESETS[params.robot],
        travel=float(np.linalg.norm(position - before)),
        turn=turn_angle(axes_before, axes),
        approach=pressed.advance,
    )
    frame = TactileFrame(
        goal=goal.goal,
        touch=goal.touch,
        finger=goal.finger,
        direction=goal.direction,
        pose=pressed.pose,
        outcome=pressed.outcome,
        array=flight_times(pressed.compression, spec.thickness, spec.sound_speed),
        robot_time=clock,
    )
    return replace(state, clock=clock, resting=goal.pose), [("/touch/raw", frame)]


def info_of(sensor: SensorSpec) -> SensorInfo:
    """The calibration of the sensor that a scene describes."""
    return SensorInfo(
        rows=sensor.rows,
        cols=sensor.cols,
        pitch=sensor.pitch,
        thickness=sensor.pad.thickness,
        dome=0.0 if sensor.pad.radius is None else 1.0 / sensor.pad.radius,
        sound_speed=sensor.pad.sound_speed,
        saturation=sensor.pad.saturation,
        noise=0.0,
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
