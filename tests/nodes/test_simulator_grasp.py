from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.explore.robot_time import LIFTED, ROBOTS, Moves, seconds
from palpate.core.frames import DOWN, pose_of
from palpate.messages.codec import encode
from palpate.messages.types import GraspContacts, GraspGoal, TactileFrame, TouchGoal
from palpate.nodes import simulator
from palpate.nodes.object import ObjectSpec
from palpate.nodes.simulator import Params, State, start, take_grasp, touch

MIDDLE = pose_of(np.array([0.0, 0.0, 0.03]), DOWN)


def goal(**changes: Any) -> GraspGoal:
    fields: dict[str, Any] = {
        "number": 4,
        "pose": MIDDLE,
        "fingers": 5,
        "opening": 0.1,
        "reach": 0.1,
        "not_before": 0.0,
    }
    return GraspGoal(**{**fields, **changes})


def grasp(params: Params, state: State, **changes: Any) -> tuple[State, GraspContacts]:
    state, [(topic, contacts)] = take_grasp(params, state, goal(**changes))  # type: ignore[misc]
    assert topic == "/hand/contacts" and isinstance(contacts, GraspContacts)
    assert encode(contacts)
    return state, contacts


def touch_goal(number: int, contour: int, pose: Floats, not_before: float = 0.0) -> TouchGoal:
    return TouchGoal(
        goal=contour,
        touch=number,
        finger=1,
        pose=pose,
        reach=0.15,
        depth=0.001,
        direction=np.array([0.0, 0.0, 1.0]),
        not_before=not_before,
    )


def felt(params: Params, state: State, asked: TouchGoal) -> tuple[State, TactileFrame]:
    state, [(_, frame)] = touch(params, state, asked)  # type: ignore[misc]
    assert isinstance(frame, TactileFrame)
    return state, frame


def test_the_hand_says_where_its_fingers_met_the_ball(ball: ObjectSpec) -> None:
    params = Params(object=ball)
    _, contacts = grasp(params, start(params)[0])

    assert (contacts.number, contacts.missed, contacts.blocked) == (4, 0, 0)
    away = contacts.points - [0.0, 0.0, 0.03]
    assert np.linalg.norm(away, axis=1) == pytest.approx(np.full(6, 0.03), abs=1e-6)
    assert contacts.fingers.tolist() == [0, 1, 2, 3, 4, 5]


def test_fingers_that_miss_or_are_blocked_are_told(ball: ObjectSpec) -> None:
    params = Params(object=ball)
    state = start(params)[0]

    _, beside = grasp(params, state, pose=pose_of(np.array([0.5, 0.0, 0.03]), DOWN))
    _, low = grasp(params, state, pose=pose_of(np.array([0.0, 0.0, 0.001]), DOWN))
    assert (len(beside.points), beside.missed) == (0, 6)
    assert (low.fingers.tolist(), low.blocked) == ([5], 5)


def test_robot_time_is_that_of_the_finger_that_went_farthest(ball: ObjectSpec) -> None:
    params = Params(object=ball)
    _, contacts = grasp(params, start(params)[0], not_before=2.0)

    assert contacts.move[[0, 1, 2, 4]] == pytest.approx([2.0, 0.0, 0.0, LIFTED])
    assert contacts.move[3] == pytest.approx(0.071, abs=1e-4)
    assert contacts.robot_time == pytest.approx(2.0 + 0.071 / 0.01 + 0.071 / 0.05 + 0.2, abs=1e-2)


def test_the_hand_errs_without_shifting_what_the_finger_draws(ball: ObjectSpec) -> None:
    params = Params(object=ball, effects={"pose_error": {"sigma": 1e-4}, "gaussian_noise": {}})
    state, _ = start(params)
    grasped, one = grasp(params, state)
    _, two = grasp(params, grasped)
    arrays = []
    for before in (state, grasped):
        above = touch_goal(0, 0, pose_of(np.array([0, 0, 0.1]), DOWN))
        arrays.append(felt(params, before, above)[1].array)

    assert one.points.shape == two.points.shape
    assert 1e-6 < np.abs(one.points - two.points).max() < 2e-3
    assert np.array_equal(arrays[0], arrays[1])


def test_a_hand_of_another_number_of_fingers_is_another_hand(ball: ObjectSpec) -> None:
    params = Params(object=ball)
    state, _ = grasp(params, start(params)[0])
    state, contacts = grasp(params, state, fingers=3)

    assert len(contacts.points) == 4
    assert state.hand is not None and state.hand.closings == 1


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"fingers": 0}, "fingers must be from 1 to 20, got 0"),
        ({"opening": -0.1}, "opening must be positive and finite, got -0.1 m"),
    ],
)
def test_a_hand_that_cannot_close_is_refused(
    ball: ObjectSpec, changes: dict[str, Any], words: str
) -> None:
    params = Params(object=ball)

    with pytest.raises(ValueError, match=words):
        take_grasp(params, start(params)[0], goal(**changes))


@pytest.mark.parametrize("effects", [{}, {"transport": {"latency": 0.02}, "pose_error": {}}])
@pytest.mark.parametrize("robot", ["modern", "puma"])
def test_the_moves_with_their_own_preset_give_the_robot_time_back(
    ball: ObjectSpec,
    sideways: Callable[[float], Floats],
    robot: str,
    effects: dict[str, dict[str, float]],
) -> None:
    params = Params(object=ball, robot=robot, effects=effects)
    state, _ = start(params)
    state, contacts = grasp(params, state)
    rows, times = [contacts.move], [contacts.robot_time]
    for number, (contour, height) in enumerate([(0, 0.03), (0, 0.035), (1, 0.04), (1, 0.3)]):
        asked = touch_goal(number, contour, sideways(height), not_before=30.0 * number)
        state, frame = felt(params, state, asked)
        rows.append(frame.move)
        times.append(frame.robot_time)
    moves = Moves.of_rows(np.array(rows))

    assert seconds(moves, ROBOTS[robot]) == pytest.approx(times, rel=1e-12)
    assert (moves.along >= 0.0).tolist() == [False, False, True, False, False]


def test_the_words_for_a_finger_that_was_lifted_are_the_same() -> None:
    assert simulator.LIFTED == LIFTED
