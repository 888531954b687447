from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from palpate.core.explore.robot_time import LIFTED, ROBOTS, SLIDING, Moves, durations, seconds
from palpate.core.measure.robot_time import PRESETS, touch_seconds

LENGTHS = st.floats(0.0, 0.3)
ROWS = st.lists(st.tuples(st.floats(0.0, 5.0), LENGTHS, LENGTHS, LENGTHS), min_size=1, max_size=8)


def moves(*rows: tuple[float, ...]) -> Moves:
    return Moves.of_rows(np.array(rows))


@settings(derandomize=True, deadline=None, max_examples=50)
@given(ROWS, st.sampled_from(sorted(PRESETS)))
def test_all_moves_at_once_cost_what_each_costs_alone(
    rows: list[tuple[float, float, float, float]], name: str
) -> None:
    made = moves(*((*row, LIFTED) for row in rows))
    each = [wait + touch_seconds(PRESETS[name], *ways) for wait, *ways in rows]

    assert seconds(made, ROBOTS[name]) == pytest.approx(np.cumsum(each), rel=1e-12)


def test_durations_add_up() -> None:
    made = moves((0.3, 0.02, 0.1, 0.01, LIFTED), (0.0, 0.01, 0.5, 0.02, 0.01))
    for robot in ROBOTS.values():
        parts = durations(made, robot)
        assert np.sum(parts, axis=0) == pytest.approx(parts.total())
        assert np.cumsum(parts.total()) == pytest.approx(seconds(made, robot))


def test_sliding_between_touches_has_neither_approach_nor_retreat() -> None:
    made = moves(
        (0.0, 0.0, 0.0, 0.02, LIFTED),
        (0.0, 0.01, 0.1, 0.004, 0.01),
        (0.0, 0.01, 0.1, 0.004, 0.01),
        (0.0, 0.05, 0.0, 0.03, LIFTED),
    )
    parts = durations(made, SLIDING)

    assert parts.approach == pytest.approx([2.0, 0.0, 0.0, 3.0])
    assert parts.travel[1:3] == pytest.approx([1.0, 1.0])  # 10 mm at 10 mm/s
    assert parts.dwell[1:3] == pytest.approx([SLIDING.frame] * 2)
    assert parts.retract == pytest.approx([0.0, 0.0, 0.02 / 0.05, 0.03 / 0.05])


def test_a_robot_that_never_finds_a_surface_to_slide_on_is_the_modern_one() -> None:
    made = moves((0.1, 0.02, 0.1, 0.01, LIFTED), (0.0, 0.01, 0.5, 0.02, LIFTED))

    assert np.array_equal(seconds(made, SLIDING), seconds(made, PRESETS["modern"]))


def test_turning_may_take_longer_than_the_way() -> None:
    made = moves((0.0, 0.0, 0.0, 0.01, LIFTED), (0.0, 0.0, 3.0, 0.01, 0.001))

    assert durations(made, SLIDING).travel[1] == pytest.approx(3.0 / SLIDING.arm.turning)


def test_sliding_is_faster_where_touches_are_near_each_other() -> None:
    row = (0.0, 0.012, 0.35, 0.004)
    made = moves((*row, LIFTED), *((*row, 0.006) for _ in range(20)))

    ends = {name: seconds(made, robot)[-1] for name, robot in ROBOTS.items()}
    assert ends["sliding"] < ends["modern"] < 0.5 * ends["puma"]


def test_no_move_costs_no_time() -> None:
    none = Moves.of_rows(np.zeros((0, 5)))

    assert all(len(seconds(none, robot)) == 0 for robot in ROBOTS.values())


@pytest.mark.parametrize(
    ("rows", "words"),
    [
        (np.zeros((2, 4)), r"moves must have shape \(any, 5\), got \(2, 4\)"),
        (np.full((2, 5), np.nan), "moves must be finite"),
        (np.array([[0.0, -0.1, 0.0, 0.0, 0.0]]), "moves must not be negative but for `along`"),
    ],
)
def test_what_are_no_moves_is_refused(rows: np.ndarray, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        Moves.of_rows(rows)


def test_a_robot_that_cannot_slide_is_refused() -> None:
    with pytest.raises(ValueError, match=r"speed must be positive and finite, got 0.0 m/s"):
        replace(SLIDING, speed=0.0)
    with pytest.raises(ValueError, match=r"frame must be positive and finite, got -1.0 s"):
        replace(SLIDING, frame=-1.0)
