"""Laws of the time that moves cost a robot."""

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from palpate.core.poses import Pose, rotations_from_vectors
from palpate.core.robot_time import (
    LIFTED,
    ROBOT_PRESETS,
    ROBOTS,
    SLIDING,
    MoveGeometry,
    RobotPreset,
    contact_seconds,
    free_seconds,
    longest_seconds,
    move_between,
    move_durations,
)

ARM = RobotPreset(
    speed=0.1, acceleration=1.0, turning=1.0, approach=0.01, retract=0.05, dwell=0.1, overhead=0.05
)


@pytest.mark.parametrize(
    ("travel", "turn", "seconds"),
    [
        (0.0, 0.0, 0.0),
        # 0.1 m/s is reached after 0.1 s and 5 mm, and lost likewise: 0.2 s for 10 mm.
        (0.110, 0.0, 1.2),
        (0.01, 0.0, 0.2),
        (0.0025, 0.0, 2 * math.sqrt(0.0025)),  # a short path never reaches the speed
        (0.01, 1.5, 1.5),  # turning and travelling happen together
    ],
)
def test_free_moves_are_trapezoids_of_speed(travel, turn, seconds):
    assert free_seconds(ARM, travel, turn) == pytest.approx(seconds)
    below, above = (free_seconds(ARM, 0.01 * by, 0.0) for by in (1 - 1e-9, 1 + 1e-9))
    assert below == pytest.approx(above, abs=1e-8)


def test_contact_is_approach_rest_retreat_and_two_commands():
    assert contact_seconds(ARM, 0.0) == pytest.approx(0.1 + 2 * 0.05)
    assert contact_seconds(ARM, 0.004) == pytest.approx(0.2 + 0.4 + 0.08)
    longest = free_seconds(ARM, 0.1, 1.0) + contact_seconds(ARM, 0.025)
    assert longest_seconds(ARM, 0.1, 1.0, 0.02) == pytest.approx(longest)
    turns = rotations_from_vectors(np.array([[0.0, 0.0, 0.1], [0.0, 0.0, 0.8]]))
    first, second = Pose(np.zeros(3), turns[0]), Pose(np.array([0.3, 0.0, 0.4]), turns[1])
    assert move_between(first, second) == pytest.approx((0.5, 0.7))
    assert move_between(None, second) == (0.0, 0.0)
    assert RobotPreset.of_array(ARM.array) == ARM


def test_presets_take_the_times_of_their_decades():
    modern, puma = (
        free_seconds(ROBOT_PRESETS[name], 0.012, 0.35) + contact_seconds(ROBOT_PRESETS[name], 0.004)
        for name in ("modern", "puma")
    )
    assert 0.9 < modern < 1.5 and 2.4 < puma < 3.6
    row = (0.0, 0.012, 0.35, 0.004)
    made = MoveGeometry.of_rows([(*row, LIFTED), *((*row, 0.006) for _ in range(20))])
    ends = {name: move_durations(made, robot).total().sum() for name, robot in ROBOTS.items()}
    assert ends["sliding"] < ends["modern"] < 0.5 * ends["puma"]


LENGTHS = st.floats(0.0, 0.3)


@settings(derandomize=True, deadline=None, max_examples=30)
@given(st.lists(st.tuples(st.floats(0.0, 5.0), LENGTHS, LENGTHS, LENGTHS), min_size=1, max_size=8))
def test_durations_of_moves_equal_single_moves(rows):
    made = MoveGeometry.of_rows([(*row, LIFTED) for row in rows])
    for robot in ROBOT_PRESETS.values():
        single = [
            wait + free_seconds(robot, travel, turn) + contact_seconds(robot, approach)
            for wait, travel, turn, approach in rows
        ]
        assert move_durations(made, robot).total() == pytest.approx(single, rel=1e-12)
    # A robot that finds no surface to slide on is the modern one.
    slid, modern = (move_durations(made, one) for one in (SLIDING, ROBOT_PRESETS["modern"]))
    assert np.array_equal(slid.total(), modern.total())


def test_sliding_has_neither_approach_nor_retreat():
    made = MoveGeometry.of_rows(
        [
            (0.5, 0.0, 0.0, 0.02, LIFTED),
            (0.0, 0.01, 0.1, 0.004, 0.01),
            (0.0, 0.01, 3.0, 0.004, 0.01),  # turning takes longer than the path
            (0.0, 0.05, 0.0, 0.03, LIFTED),
        ]
    )
    arm = SLIDING.arm
    parts = move_durations(made, SLIDING)
    assert parts.wait.tolist() == [0.5, 0.0, 0.0, 0.0]
    assert parts.approach == pytest.approx([0.02 / arm.approach, 0.0, 0.0, 0.03 / arm.approach])
    assert parts.travel[1:3] == pytest.approx([0.01 / SLIDING.speed, 3.0 / arm.turning])
    rest = arm.dwell + 2 * arm.overhead
    assert parts.dwell == pytest.approx([rest, SLIDING.frame, SLIDING.frame, rest])
    assert parts.retract == pytest.approx([0.0, 0.0, 0.02 / arm.retract, 0.03 / arm.retract])
    none = MoveGeometry.of_rows(np.zeros((0, 5)))
    assert all(len(move_durations(none, robot).total()) == 0 for robot in ROBOTS.values())


SPEEDS, TIMES = ("speed", "acceleration", "turning", "approach", "retract"), ("dwell", "overhead")
REFUSED: list[tuple[Callable[[], object], str]] = [
    *((lambda x=x: free_seconds(ARM, x, 0.1), "travel must be 0 or more and finite, got")
      for x in (-1e-9, math.nan, math.inf)),
    *((lambda x=x: free_seconds(ARM, 0.1, x), "turn must be 0 or more and finite, got")
      for x in (-1e-9, math.nan, math.inf)),
    *((lambda x=x: contact_seconds(ARM, x), "approach must be 0 or more and finite, got")
      for x in (-1e-9, math.nan, math.inf)),
    *((lambda name=name: replace(ARM, **{name: 0.0}),
       f"{name} must be positive and finite, got 0.0") for name in SPEEDS),
    *((lambda name=name: replace(ARM, **{name: -0.1}),
       f"{name} must be 0 or more and finite, got -0.1 s") for name in TIMES),
    (lambda: MoveGeometry.of_rows(np.zeros((2, 4))), r"moves must have shape \(any, 5\), got \(2,"),
    (lambda: MoveGeometry.of_rows(np.full((2, 5), np.nan)), "moves must be finite"),
    (lambda: MoveGeometry.of_rows([[0.0, -0.1, 0, 0, 0]]), "negative but for `along`, got -0.1"),
    (lambda: replace(SLIDING, speed=0.0), r"speed must be positive and finite, got 0.0 m/s"),
    (lambda: replace(SLIDING, frame=-1.0), r"frame must be positive and finite, got -1.0 s"),
]  # fmt: skip


@pytest.mark.parametrize(("call", "words"), REFUSED)
def test_bad_input_is_refused(call, words):
    with pytest.raises(ValueError, match=words):
        call()
