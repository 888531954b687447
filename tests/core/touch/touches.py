"""Pads, fingers and touches that have come as far as a test wants them."""

from __future__ import annotations

from dataclasses import fields, replace
from typing import Any

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.poses import FACING_DOWN, Pose
from palpate.core.robot_time import ROBOT_PRESETS
from palpate.core.shapes import Superquadric
from palpate.core.touch import Calibration, Fingertip, Pad, SimulatedTouch, Stage
from palpate.core.touch.effects import effect_type

FLAT = Pad(rows=16, cols=16, pitch=1e-3, thickness=3e-3, dome=0.0, saturation=0.8)
DOMED = replace(FLAT, dome=1.0 / 0.015)
X, Y = FLAT.grid()
BALL = Superquadric(np.full(3, 0.03), np.ones(2))
SOUND_SPEED, TAXEL_STIFFNESS = 1000.0, 200.0  # [m/s], [N/m]
# Compression of a flat pad under a ball of 30 mm, 1 mm deep, not quite in the middle.
DENT: Floats = np.maximum(1e-3 - ((X - 0.7e-3) ** 2 + (Y + 0.4e-3) ** 2) / 0.06, 0.0)
DENT.setflags(write=False)


def above(height: float, x: float = 0.0) -> Pose:
    """Pose of a pad that looks down from a height [m]."""
    return Pose(np.array([x, 0.0, height]), FACING_DOWN)


def rotations(count: int) -> Floats:
    """Random rotation matrices of a fixed seed, (count, 3, 3)."""
    matrices = np.linalg.qr(np.random.default_rng(5).normal(size=(count, 3, 3)))[0]
    matrices[:, :, 0] *= np.linalg.det(matrices)[:, None]
    return matrices


def finger(signal: Any = "time", seed: int = 7, number: int = 1, **pad: Any) -> Fingertip:
    """A modern finger; a flat pad of 16 by 16 taxels unless the fields of the pad differ."""
    made = replace(FLAT, **pad)
    sheet = Calibration(signal, made.thickness, SOUND_SPEED, TAXEL_STIFFNESS)
    return Fingertip(made, sheet, ROBOT_PRESETS["modern"], number, seed)


def touch(number: int = 0, field: Floats | None = None, **more: Any) -> SimulatedTouch:
    """A touch of a ball from 3 mm above it, with read-only arrays.

    `field` (rows, cols): compression [m] with which the move has ended in a hit.
    """
    start = above(0.033)
    given = {"shape": BALL, "believed": start, "actual": start, "reach": 0.01, "depth": 1e-3}
    given |= {"begun": float(number), "previous": float(number)}
    if field is not None:
        given |= {"indentation": field, "compression": field, "reading": field}
        given |= {"pressure": 2e8 * field, "outcome": "hit", "time": number + 1.0}
    given |= more
    for value in given.values():
        if isinstance(value, np.ndarray):
            value.setflags(write=False)
    return SimulatedTouch(number=number, **given)


def stage(name: str, tip: Fingertip | None = None, **parameters: Any) -> Stage:
    """The stage of an effect."""
    return effect_type(name)(**parameters).prepare(tip or finger())


def applied(
    name: str, to: SimulatedTouch, tip: Fingertip | None = None, **parameters: Any
) -> SimulatedTouch:
    """The touch after an effect in its first state."""
    made = stage(name, tip, **parameters)
    made.apply(to, made.state)
    return to


def readings(made: Stage, field: Floats, count: int) -> Floats:
    """What a stage makes of the same field in each of many touches, (count, rows, cols)."""
    state, found = made.state, []
    for number in range(count):
        one = touch(number, field)
        state = made.apply(one, state)
        found.append(one.reading)
    return np.array(found)


def values(one: SimulatedTouch) -> dict[str, Any]:
    """All that a touch holds, with arrays as bytes, so that touches can be compared."""
    held = {field.name: getattr(one, field.name) for field in fields(one)}
    arrays = {k: v.array if isinstance(v, Pose) else v for k, v in held.items()}
    return {k: v.tobytes() if isinstance(v, np.ndarray) else v for k, v in arrays.items()}
