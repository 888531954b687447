"""The move itself, one ray a taxel: what every touch has, with or without effects."""

from __future__ import annotations

import numpy as np

from palpate.core.measure.robot_time import contact_seconds
from palpate.core.touch.pad import Press, press
from palpate.core.touch.touch import Finger, Touch


def one_ray_each(finger: Finger, touch: Touch) -> None:
    """Press the pad, seeing the surface at the middle of each taxel."""
    pressed(finger, touch, press(touch.shape, finger.pad, touch.actual, touch.reach, touch.depth))


def pressed(finger: Finger, touch: Touch, end: Press) -> None:
    """Write down how a guarded move ended: poses, times, compression and pressure.

    The arm believes to have gone as far as it went, from where it believed to start. Each
    taxel is a spring of its own (Winkler): the pressure is (1.2) for each area.
    """
    touch.outcome, touch.advance = end.outcome, end.advance
    touch.believed = advanced(touch.believed, end.advance)
    touch.actual = end.pose
    touch.indentation, touch.compression = end.indentation, end.compression
    touch.pressure = finger.stiffness * end.compression
    robot = finger.robot
    touch.time = touch.begun + contact_seconds(robot, end.advance)
    met = end.outcome in ("hit", "bottomed")
    touch.loading = float(end.compression.max()) / robot.approach if met else 0.0
    touch.dwell = robot.dwell if met else 0.0
    before = end.advance / robot.approach - touch.loading
    touch.rest = touch.begun - touch.previous + before + robot.overhead


def advanced(pose: np.ndarray, way: float) -> np.ndarray:
    """A pose moved along its own z axis."""
    x, y, z, w = pose[3:].tolist()
    axis = (2 * (x * z + y * w), 2 * (y * z - x * w), 1 - 2 * (x * x + y * y))
    moved = pose.copy()
    moved[:3] += np.multiply(axis, way)
    return moved
