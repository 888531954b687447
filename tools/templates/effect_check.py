"""Tests of the effect Template. Run them with ``python -m pytest`` in this folder."""

from __future__ import annotations

import numpy as np
from palpate.core.poses import Pose
from palpate.core.arrays import Floats
from palpate.core.poses import FACING_DOWN
from palpate.core.robot_time import ROBOT_PRESETS
from palpate.core.touch import assemble
from palpate.effects import Effect, Fingertip, SimulatedTouch
from palpate.shapes import Superquadric
from palpate.tools.templates.effect import Template
from palpate.touch import Calibration, Pad

BALL = Superquadric(np.full(3, 0.03), np.ones(2))
PAD = Pad(rows=16, cols=16, pitch=1e-3, thickness=3e-3, dome=0.0, saturation=0.8)
FINGER = Fingertip(PAD, Calibration("time", 3e-3, 1000.0, 0.2e3), ROBOT_PRESETS["modern"])


def reading(*effects: Effect, begun: float = 0.0) -> Floats:
    """Compression that the array measures at the top of a ball of 30 mm, m."""
    start = Pose(np.array([0.0, 0.0, 0.033]), FACING_DOWN)
    touch = SimulatedTouch(
        BALL, 0, start, start, reach=0.01, depth=1e-3, begun=begun, previous=begun
    )
    pipeline = assemble(FINGER, effects)
    pipeline.simulate(touch, pipeline.begin())
    return touch.reading


def test_hum_is_the_same_in_all_taxels() -> None:
    """The hum is at most its amplitude."""
    hum = reading(Template(size=1e-5)) - reading()
    assert np.allclose(hum, hum[0, 0], rtol=0.0, atol=1e-12)
    assert abs(hum[0, 0]) <= 1e-5


def test_hum_changes_sign_after_half_a_period() -> None:
    """Two touches are half a period apart."""
    first, later = (
        (reading(Template(size=1e-5), begun=begun) - reading(begun=begun))[0, 0]
        for begun in (0.0, 0.01)
    )
    assert np.isclose(later, -first, rtol=0.0, atol=1e-12)


def test_without_size_the_reading_is_the_ideal_one() -> None:
    """An effect of no size changes nothing."""
    assert np.array_equal(reading(Template(size=0.0)), reading())
