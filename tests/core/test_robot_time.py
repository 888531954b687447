import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from palpate.core.robot_time import (
    LIFTED,
    ROBOT_PRESETS,
    ROBOTS,
    SLIDING,
    MoveGeometry,
    contact_seconds,
    elapsed_seconds,
    free_seconds,
    move_durations,
)

MODERN = ROBOT_PRESETS["modern"]


def touch_seconds(preset, travel, turn, approach):
    return free_seconds(preset, travel, turn) + contact_seconds(preset, approach)


def test_a_touch_without_a_way_costs_the_rest_and_both_commands():
    assert touch_seconds(MODERN, 0.0, 0.0, 0.0) == pytest.approx(0.1 + 2 * 0.05)


def test_a_long_way_is_a_trapezoid_of_speed():
    still = touch_seconds(MODERN, 0.0, 0.0, 0.0)
    # 0.1 m/s is reached after 0.1 s and 5 mm, and lost likewise: 0.2 s for 10 mm, then 0.1 m/s.
    assert touch_seconds(MODERN, 0.110, 0.0, 0.0) - still == pytest.approx(0.2 + 1.0)


def test_a_short_way_never_reaches_the_speed():
    still = touch_seconds(MODERN, 0.0, 0.0, 0.0)
    assert touch_seconds(MODERN, 0.0025, 0.0, 0.0) - still == pytest.approx(2 * math.sqrt(0.0025))


def test_the_two_laws_of_travel_meet():
    corner = MODERN.speed**2 / MODERN.acceleration
    below, above = (touch_seconds(MODERN, corner * s, 0.0, 0.0) for s in (1 - 1e-9, 1 + 1e-9))
    assert below == pytest.approx(above, abs=1e-8)


def test_turning_and_travelling_happen_together():
    still = touch_seconds(MODERN, 0.0, 0.0, 0.0)
    turned = touch_seconds(MODERN, 0.01, math.radians(60), 0.0)
    assert turned - still == pytest.approx(1.0)  # 60 deg at 60 deg/s; the way takes 0.2 s


def test_the_finger_goes_back_as_far_as_it_came():
    still = touch_seconds(MODERN, 0.0, 0.0, 0.0)
    # 4 mm at 10 mm/s, back at 50 mm/s.
    assert touch_seconds(MODERN, 0.0, 0.0, 0.004) - still == pytest.approx(0.4 + 0.08)


def test_a_usual_touch_takes_a_modern_arm_about_a_second_and_an_old_one_three():
    modern, puma = (touch_seconds(ROBOT_PRESETS[k], 0.012, 0.35, 0.004) for k in ("modern", "puma"))
    assert 0.9 < modern < 1.5
    assert 2.4 < puma < 3.6


@pytest.mark.parametrize("bad", [-1e-9, math.nan, math.inf])
@pytest.mark.parametrize("name", ["travel", "turn", "approach"])
def test_a_way_that_cannot_be_gone_is_refused(name, bad):
    ways = {"travel": 0.01, "turn": 0.1, "approach": 0.003, name: bad}
    with pytest.raises(ValueError, match=f"{name} must be 0 or more and finite, got"):
        touch_seconds(MODERN, **ways)


@pytest.mark.parametrize("name", ["speed", "acceleration", "turning", "approach", "retract"])
def test_an_arm_that_does_not_move_is_refused(name):
    with pytest.raises(ValueError, match=f"{name} must be positive and finite, got 0.0"):
        replace(MODERN, **{name: 0.0})


@pytest.mark.parametrize("name", ["dwell", "overhead"])
def test_a_negative_duration_is_refused(name):
    with pytest.raises(ValueError, match=f"{name} must be 0 or more and finite, got -0.1 s"):
        replace(MODERN, **{name: -0.1})


LENGTHS = st.floats(0.0, 0.3)
ROWS = st.lists(st.tuples(st.floats(0.0, 5.0), LENGTHS, LENGTHS, LENGTHS), min_size=1, max_size=8)


def moves(*rows):
    return MoveGeometry.of_rows(np.array(rows))


@settings(derandomize=True, deadline=None, max_examples=50)
@given(ROWS, st.sampled_from(sorted(ROBOT_PRESETS)))
def test_all_moves_at_once_cost_what_each_costs_alone(rows, name):
    made = moves(*((*row, LIFTED) for row in rows))
    each = [wait + touch_seconds(ROBOT_PRESETS[name], *ways) for wait, *ways in rows]
    assert elapsed_seconds(made, ROBOTS[name]) == pytest.approx(np.cumsum(each), rel=1e-12)


def test_durations_add_up():
    made = moves((0.3, 0.02, 0.1, 0.01, LIFTED), (0.0, 0.01, 0.5, 0.02, 0.01))
    for robot in ROBOTS.values():
        parts = move_durations(made, robot)
        assert np.sum(parts, axis=0) == pytest.approx(parts.total())
        assert np.cumsum(parts.total()) == pytest.approx(elapsed_seconds(made, robot))


def test_sliding_between_touches_has_neither_approach_nor_retreat():
    made = moves(
        (0.0, 0.0, 0.0, 0.02, LIFTED),
        (0.0, 0.01, 0.1, 0.004, 0.01),
        (0.0, 0.01, 0.1, 0.004, 0.01),
        (0.0, 0.05, 0.0, 0.03, LIFTED),
    )
    parts = move_durations(made, SLIDING)
    assert parts.approach == pytest.approx([2.0, 0.0, 0.0, 3.0])
    assert parts.travel[1:3] == pytest.approx([1.0, 1.0])  # 10 mm at 10 mm/s
    assert parts.dwell[1:3] == pytest.approx([SLIDING.frame] * 2)
    assert parts.retract == pytest.approx([0.0, 0.0, 0.02 / 0.05, 0.03 / 0.05])


def test_a_robot_that_never_finds_a_surface_to_slide_on_is_the_modern_one():
    made = moves((0.1, 0.02, 0.1, 0.01, LIFTED), (0.0, 0.01, 0.5, 0.02, LIFTED))
    assert np.array_equal(
        elapsed_seconds(made, SLIDING), elapsed_seconds(made, ROBOT_PRESETS["modern"])
    )


def test_turning_may_take_longer_than_the_way():
    made = moves((0.0, 0.0, 0.0, 0.01, LIFTED), (0.0, 0.0, 3.0, 0.01, 0.001))
    assert move_durations(made, SLIDING).travel[1] == pytest.approx(3.0 / SLIDING.arm.turning)


def test_sliding_is_faster_where_touches_are_near_each_other():
    row = (0.0, 0.012, 0.35, 0.004)
    made = moves((*row, LIFTED), *((*row, 0.006) for _ in range(20)))
    ends = {name: elapsed_seconds(made, robot)[-1] for name, robot in ROBOTS.items()}
    assert ends["sliding"] < ends["modern"] < 0.5 * ends["puma"]


def test_no_move_costs_no_time():
    none = MoveGeometry.of_rows(np.zeros((0, 5)))
    assert all(len(elapsed_seconds(none, robot)) == 0 for robot in ROBOTS.values())


@pytest.mark.parametrize(
    ("rows", "words"),
    [
        (np.zeros((2, 4)), r"moves must have shape \(any, 5\), got \(2, 4\)"),
        (np.full((2, 5), np.nan), "moves must be finite"),
        (np.array([[0.0, -0.1, 0.0, 0.0, 0.0]]), "moves must not be negative but for `along`"),
    ],
)
def test_what_are_no_moves_is_refused(rows, words):
    with pytest.raises(ValueError, match=words):
        MoveGeometry.of_rows(rows)


def test_a_robot_that_cannot_slide_is_refused():
    with pytest.raises(ValueError, match=r"speed must be positive and finite, got 0.0 m/s"):
        replace(SLIDING, speed=0.0)
    with pytest.raises(ValueError, match=r"frame must be positive and finite, got -1.0 s"):
        replace(SLIDING, frame=-1.0)
