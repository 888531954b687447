"""Fingers, and touches that have come as far as a test wants them."""

from dataclasses import fields

import numpy as np
import pytest

from palpate.core.poses import FACING_DOWN, pose_of
from palpate.core.robot_time import ROBOT_PRESETS
from palpate.core.touch.pad import Calibration, Pad
from palpate.core.touch.pipeline import Fingertip, SimulatedTouch


@pytest.fixture
def make_finger():
    """A finger; times of flight, 1000 m/s and a flat pad unless told otherwise."""

    def make(signal="time", seed=7, number=1, **pad):
        usual = {"rows": 16, "cols": 16, "pitch": 1e-3, "thickness": 3e-3}
        made = Pad(**{**usual, "dome": 0.0, "saturation": 0.8, **pad})
        calibration = Calibration(signal, made.thickness, 1000.0, 0.2e3)
        return Fingertip(made, calibration, ROBOT_PRESETS["modern"], number, seed)

    return make


def read_only(value):
    if isinstance(value, np.ndarray):
        value.setflags(write=False)
    return value


@pytest.fixture
def make_touch(ball):
    """A touch of a ball from 3 mm above it, with read-only arrays."""

    def make(number=0, field=None, **more):
        start = pose_of(np.array([0.0, 0.0, 0.033]), FACING_DOWN)
        given = {"believed": start, "actual": start, "reach": 0.01, "depth": 1e-3}
        given |= {"begun": float(number), "previous": float(number)}
        if field is not None:
            given |= {"indentation": field, "compression": field, "reading": field}
            given |= {"pressure": 2e8 * field, "outcome": "hit", "time": number + 1.0}
        given |= more
        given = {name: read_only(value) for name, value in given.items()}
        return SimulatedTouch(shape=ball, number=number, **given)

    return make


@pytest.fixture
def dent():
    """Compression of a flat pad under a ball of 30 mm, 1 mm deep, not quite in the middle."""
    axis = (np.arange(16) - 7.5) * 1e-3
    squares = (axis - 0.7e-3)[None, :] ** 2 + (axis + 0.4e-3)[:, None] ** 2
    return read_only(np.maximum(1e-3 - squares / 0.06, 0.0))


@pytest.fixture
def readings(make_touch):
    """What a stage makes of the same field in each of many touches, (touches, rows, cols)."""

    def collect(stage, field, touches):
        state, found = stage.state, []
        for number in range(touches):
            touch = make_touch(number, field)
            state = stage.apply(touch, state)
            found.append(touch.reading)
        return np.array(found)

    return collect


@pytest.fixture
def values_of():
    """All that a touch holds, with arrays as bytes, so that touches can be compared."""

    def values(touch):
        held = {field.name: getattr(touch, field.name) for field in fields(touch)}
        return {
            name: value.tobytes() if isinstance(value, np.ndarray) else value
            for name, value in held.items()
        }

    return values
