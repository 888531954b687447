"""True pose of an object after a hand has set it down on another side."""

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
    """Motion of a hand that turns an object over, and its errors."""

    shift: float = 2.0e-3  # [m] standard deviation of the object's place on each horizontal axis
    tilt: float = math.radians(2.0)  # [rad] standard deviation about each axis, when it is let go
    spin: float = math.pi  # [rad] largest turn about the vertical, to either side, uniform
    lift: float = 0.15  # [m] by which it lifts the object, and lowers it again
    grip: float = 0.02  # [m] by which the fingers close, and open again


def set_down(
    resting: RestingSolid,
    asked: Pose,
    platform: float,
    seed: int,
    number: int,
    settings: TurnSettings = TurnSettings(),
) -> Pose:
    """True pose, in the world, of an object that a hand sets down at `asked` with some error.

    It rests on a side of its hull (`resting`, in its own frame) at the height `platform` [m].
    `seed` of the run and `number` of the turn select the hand's errors.
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


def turning_distances(settings: TurnSettings = TurnSettings()) -> tuple[float, float]:
    """Distances that the hand and its fingers travel to turn the object over [m]."""
    return 2.0 * settings.lift, 2.0 * settings.grip
