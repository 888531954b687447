"""Calibrate a scene's sensor: press a known flat and a known ball, and touch nothing between."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.explore.aim import PRESS
from palpate.core.frames import DOWN, pose_of, split_pose
from palpate.core.measure.robot_time import PRESETS
from palpate.core.shapes.posed import PosedShape
from palpate.core.shapes.protocol import Shape
from palpate.core.shapes.superquadric import LEAST_EXPONENT, Superquadric
from palpate.core.touch.calibrate import Estimate, estimate_calibration
from palpate.core.touch.calibration import Calibration
from palpate.core.touch.contact import touched
from palpate.core.touch.pad import Pad
from palpate.core.touch.pipeline import Pipeline, States
from palpate.core.touch.taxel_fit import Presses
from palpate.core.touch.touch import Touch
from palpate.launch.scene import SceneSpec
from palpate.nodes import filter
from palpate.nodes.effects import build_pipeline, felt_face

ROBOT = "modern"
"""Preset of the robot's speeds."""
BALL = 0.03
"""Radius of the known ball, m."""
LEANS = 7
"""Ways to lean along each axis."""
DEPTHS = (0.4 * PRESS, 0.7 * PRESS, PRESS)
FREE_FRAMES = 40
HEIGHT, REACH = 0.03, 0.05
"""The pad's middle starts this high over what is pressed, and goes this far at most, m."""
CONTACT = filter.Params().contact
"""Least compression that counts as touched, m: what the filter takes."""
PAUSE = 3.0
"""Between two presses, s: a pad that creeps has come to rest."""

Progress = Callable[[str], None]


class Felt(NamedTuple):
    """One touch of something known."""

    pose: Floats
    """Where the arm believed the pad, (7,)."""
    read: Floats
    """What the data sheet makes of the signal, (rows, cols), m."""
    known: Floats
    """Compression that the known shape makes there, (rows, cols), m; 0 where it does not press."""


class Calibrated(NamedTuple):
    """What came of pressing."""

    estimate: Estimate
    """The calibration."""
    pad: Pad
    """The array, and what its data sheet says of its face."""
    sheet: Calibration
    """What it was read by."""
    on_ball: tuple[Felt, ...]
    """The touches of the ball."""
    touches: int
    """All touches made."""
    robot_time: float
    """Robot time that they took, s."""


def calibrate(scene: SceneSpec, progress: Progress) -> Calibrated:
    """Press a known flat and a known ball with the sensor of a scene.

    Raises
    ------
    ValueError
        If too few taxels could be pressed.
    """
    pipeline = build_pipeline(scene.sensor, scene.effects, PRESETS[ROBOT], seed=scene.seed)
    finger = _Finger(pipeline)
    pad = pipeline.finger.pad
    free = [finger.touch(_flat(), lean, 0.0).read for lean in _leans(pad)[:1] * FREE_FRAMES]
    progress(f"{FREE_FRAMES} frames of nothing")
    on_flat = tuple(_presses(finger, _flat(), progress, "the flat"))
    on_ball = tuple(_presses(finger, _ball(), progress, "the ball"))
    felt = [*on_flat, *on_ball]
    presses = Presses(
        known=np.stack([one.known.ravel() for one in felt]),
        read=np.stack([one.read.ravel() for one in felt]),
        free=np.stack([one.ravel() for one in free]),
    )
    x, y = pad.grid()
    progress(f"all done; fitting {len(felt)} presses")
    estimate = estimate_calibration(presses, x.ravel(), y.ravel(), pipeline.finger.calibration)
    sheet = pipeline.finger.calibration
    pad = replace(pad, face=felt_face(pipeline))
    return Calibrated(estimate, pad, sheet, on_ball, finger.touches, finger.clock)


class _Finger:
    """A finger on its way through the presses."""

    def __init__(self, pipeline: Pipeline):
        self._pipeline, self._face = pipeline, felt_face(pipeline)
        self.pad = pipeline.finger.pad
        self._states: States = pipeline.begin()
        self.touches, self.clock = 0, 0.0

    def touch(self, shape: Shape, pose: Floats, depth: float) -> Felt:
        """Press to a depth; 0 to stop before anything is met."""
        pad, sheet = self._pipeline.finger.pad, self._pipeline.finger.calibration
        touch = Touch(
            shape=shape,
            number=self.touches,
            believed=pose,
            actual=pose,
            reach=REACH if depth else 0.0,
            depth=depth,
            begun=self.clock + PAUSE,
            previous=self.clock,
        )
        self._states = self._pipeline.feel(touch, self._states)
        self.touches, self.clock = self.touches + 1, touch.time
        read = sheet.decode(sheet.encode(touch.reading))
        known = _known(shape, pad, touch.believed)
        if self._face.kind != "springs":
            # It is touched by less of the shape than that would cut through it.
            listener = replace(self.pad, face=self._face)
            loaded = touched(listener, read, CONTACT, self._pipeline.noise)
            known = np.where(loaded, known, 0.0)
        return Felt(touch.believed, read, known)


def _presses(finger: _Finger, shape: Shape, progress: Progress, name: str) -> Iterator[Felt]:
    leans = _leans(finger.pad)
    for depth in DEPTHS:
        for lean in leans:
            yield finger.touch(shape, lean, depth)
        progress(f"{len(leans)} presses of {name}, {1e3 * depth:.1f} mm deep")


def _leans(pad: Pad) -> list[Floats]:
    """Poses over the top of something: upright first, then so that each taxel is reached."""
    half = 0.5 * pad.pitch * max(pad.rows - 1, pad.cols - 1)
    most = math.atan(pad.dome * half) + PRESS / (2.0 * half)
    angles = sorted(np.linspace(-most, most, LEANS).tolist(), key=abs)
    position = np.array([0.0, 0.0, HEIGHT])
    return [pose_of(position, DOWN @ _turn(a, b)) for a in angles for b in angles]


def _turn(about_x: float, about_y: float) -> Floats:
    """Rotation about x, then about the new y."""
    c, s = math.cos(about_x), math.sin(about_x)
    first = np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])
    c, s = math.cos(about_y), math.sin(about_y)
    then = np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
    both: Floats = first @ then
    return both


def _flat() -> Shape:
    """A plate with its top at height 0, flat to far less than a nanometre where it is pressed."""
    return _below(Superquadric(np.array([0.2, 0.2, 0.05]), np.full(2, LEAST_EXPONENT)))


def _ball() -> Shape:
    return _below(Superquadric(np.full(3, BALL), np.ones(2)))


def _below(shape: Superquadric) -> Shape:
    return PosedShape(shape, pose_of(np.array([0.0, 0.0, -float(shape.size[2])]), np.eye(3)))


def _known(shape: Shape, pad: Pad, pose: Floats) -> Floats:
    """Compression that an ideal pad would have in this pose, (rows, cols), m."""
    position, axes = split_pose(pose)
    rays = pad.transducers() @ axes.T + position
    ranges = shape.cast(rays, axes[:, 2], pad.thickness)
    compression: Floats = np.clip(pad.thickness - ranges, 0.0, pad.saturation * pad.thickness)
    shaped: Floats = compression.reshape((pad.rows, pad.cols))
    return shaped
