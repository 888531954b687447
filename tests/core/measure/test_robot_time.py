from __future__ import annotations

import math
from dataclasses import replace

import pytest

from palpate.core.measure.robot_time import PRESETS, touch_seconds

MODERN = PRESETS["modern"]


def test_a_touch_without_a_way_costs_the_rest_and_both_commands() -> None:
    assert touch_seconds(MODERN, 0.0, 0.0, 0.0) == pytest.approx(0.1 + 2 * 0.05)


def test_a_long_way_is_a_trapezoid_of_speed() -> None:
    still = touch_seconds(MODERN, 0.0, 0.0, 0.0)

    # 0.1 m/s is reached after 0.1 s and 5 mm, and lost likewise: 0.2 s for 10 mm, then 0.1 m/s.
    assert touch_seconds(MODERN, 0.110, 0.0, 0.0) - still == pytest.approx(0.2 + 1.0)


def test_a_short_way_never_reaches_the_speed() -> None:
    still = touch_seconds(MODERN, 0.0, 0.0, 0.0)

    assert touch_seconds(MODERN, 0.0025, 0.0, 0.0) - still == pytest.approx(2 * math.sqrt(0.0025))


def test_the_two_laws_of_travel_meet() -> None:
    corner = MODERN.speed**2 / MODERN.acceleration
    below, above = (touch_seconds(MODERN, corner * s, 0.0, 0.0) for s in (1 - 1e-9, 1 + 1e-9))

    assert below == pytest.approx(above, abs=1e-8)


def test_turning_and_travelling_happen_together() -> None:
    still = touch_seconds(MODERN, 0.0, 0.0, 0.0)
    turned = touch_seconds(MODERN, 0.01, math.radians(60), 0.0)

    assert turned - still == pytest.approx(1.0)  # 60 deg at 60 deg/s; the way takes 0.2 s


def test_the_finger_goes_back_as_far_as_it_came() -> None:
    still = touch_seconds(MODERN, 0.0, 0.0, 0.0)

    # 4 mm at 10 mm/s, back at 50 mm/s.
    assert touch_seconds(MODERN, 0.0, 0.0, 0.004) - still == pytest.approx(0.4 + 0.08)


def test_a_usual_touch_takes_a_modern_arm_about_a_second_and_an_old_one_three() -> None:
    modern, puma = (touch_seconds(PRESETS[k], 0.012, 0.35, 0.004) for k in ("modern", "puma"))

    assert 0.9 < modern < 1.5
    assert 2.4 < puma < 3.6


@pytest.mark.parametrize("bad", [-1e-9, math.nan, math.inf])
@pytest.mark.parametrize("name", ["travel", "turn", "approach"])
def test_a_way_that_cannot_be_gone_is_refused(name: str, bad: float) -> None:
    ways = {"travel": 0.01, "turn": 0.1, "approach": 0.003, name: bad}

    with pytest.raises(ValueError, match=f"{name} must be finite and not negative, got"):
        touch_seconds(MODERN, **ways)


@pytest.mark.parametrize("name", ["speed", "acceleration", "turning", "approach", "retract"])
def test_an_arm_that_does_not_move_is_refused(name: str) -> None:
    with pytest.raises(ValueError, match=f"{name} must be positive and finite, got 0.0"):
        replace(MODERN, **{name: 0.0})


@pytest.mark.parametrize("name", ["dwell", "overhead"])
def test_a_negative_duration_is_refused(name: str) -> None:
    with pytest.raises(ValueError, match=f"{name} must be finite and not negative, got -0.1 s"):
        replace(MODERN, **{name: -0.1})
