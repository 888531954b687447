"""An object that a hand sets down on another side: how it lies then, which nobody is told."""

from __future__ import annotations

import math
from dataclasses import dataclass
from zlib import crc32

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.geometry import RestingSolid, rotation_between
from palpate.core.poses import Pose, rotations_from_vectors

DOWN: Floats = np.array([0.0, 0.0, -1.0])
DOWN.setflags(write=False)


@dataclass(frozen=True, slots=True)
class TurnSettings:
    """What a hand does when it turns an object over, and by how much it errs."""

    shift: float = 2.0e-3  # [m] standard deviation along both level axes of where it is set down
    tilt: float = math.radians(2.0)  # [rad] about each axis, before the object comes to rest
    spin: float = math.pi  # [rad] largest turn about the vertical, to either side, evenly drawn
    lift: float = 0.15  # [m] by which it is lifted, and let down again
    grip: float = 0.02  # [m] way of the fingers to it: once to grip it, once to let it go


TURNING = TurnSettings()


def set_down(
    resting: RestingSolid,
    asked: Pose,
    platform: float,
    seed: int,
    number: int,
    settings: TurnSettings = TURNING,
) -> Pose:
    """Pose in the world of an object that was to be set down at another, and rests on a side of it.

    `resting`: its hull, in its own frame. `platform`: height on which it is set down [m]. `seed`,
    `number`: of the run, and how often it was turned over; they choose how the hand errs.
    """
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(crc32(b"turn"), number)))
    tilt, shift = settings.tilt * rng.normal(size=3), settings.shift * rng.normal(size=2)
    spin = np.array([[0.0, 0.0, rng.uniform(-settings.spin, settings.spin)]])
    leaning = rotations_from_vectors(tilt[None])[0] @ asked.axes
    rest = resting.settled(leaning.T @ DOWN)
    level = rotation_between(leaning @ rest.down, DOWN) @ leaning
    axes = rotations_from_vectors(spin)[0] @ level
    middle = asked.to_outer(resting.centre[None])[0]
    place = middle - axes @ resting.centre
    lowest = float((resting.hull @ axes[2]).min())
    return Pose(np.array([place[0] + shift[0], place[1] + shift[1], platform - lowest]), axes)


def turning_way(settings: TurnSettings = TURNING) -> tuple[float, float]:
    """Way of the hand, and of its fingers to the object, when it turns it over [m]."""
    return 2.0 * settings.lift, 2.0 * settings.grip
