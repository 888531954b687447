from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from typing import Any, get_args

import msgspec
import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.explore import trace
from palpate.core.explore.aim import PRESS
from palpate.core.touch import curvature as core_curvature
from palpate.core.touch import pad
from palpate.messages.codec import encode
from palpate.messages.types import TouchGoal
from palpate.messages.types import motion as motion_types
from palpate.messages.types import touch as touch_types
from palpate.nodes.object import ObjectSpec
from palpate.nodes.sensor import SensorSpec
from palpate.nodes.simulator import NODE, Params, start, touch

Pose = Callable[[float], Floats]


def goal_at(pose: Floats, **changes: Any) -> TouchGoal:
    fields: dict[str, Any] = {
        "goal": 0,
        "touch": 0,
        "finger": 1,
        "pose": pose,
        "reach": 0.15,
        "depth": 0.001,
        "direction": np.array([0.0, 0.0, 1.0]),
        "not_before": 0.0,
    }
    return TouchGoal(**{**fields, **changes})


def test_it_tells_where_the_object_stands_and_how_high_it_is(ball: ObjectSpec) -> None:
    _, outputs = start(Params(object=ball))
    said = dict(outputs)  # type: ignore[arg-type]
    assert said["/world"].platform == pytest.approx(0.0, abs=1e-12)
    assert said["/truth"].height == pytest.approx(0.06, rel=1e-9)
    assert said["/touch/info"].dome == pytest.approx(1 / 0.015)


def test_everything_it_says_can_be_sent(ball: ObjectSpec, sideways: Pose) -> None:
    params = Params(object=ball)
    state, outputs = start(params)
    _, more = touch(params, state, goal_at(sideways(0.03)))
    for topic, message in outputs + more:  # type: ignore[misc]
        assert encode(message), topic


def test_a_touch_is_pressed_to_the_asked_depth(ball: ObjectSpec, sideways: Pose) -> None:
    params = Params(object=ball)
    state, _ = start(params)
    _, [(_, frame)] = touch(params, state, goal_at(sideways(0.03)))  # type: ignore[misc]
    assert frame.outcome == "hit"
    # The shortest time of flight belongs to the deepest taxel: t = 2 (D - c) / v.
    assert frame.array.min() == pytest.approx(2 * (0.003 - 0.001) / 1000.0, rel=1e-12)
    assert frame.array.max() == pytest.approx(2 * 0.003 / 1000.0, rel=1e-12)


def test_a_touch_beside_the_object_misses(ball: ObjectSpec, sideways: Pose) -> None:
    params = Params(object=ball)
    state, _ = start(params)
    _, [(_, frame)] = touch(params, state, goal_at(sideways(0.2)))  # type: ignore[misc]
    assert frame.outcome == "miss"
    assert np.ptp(frame.array) == 0.0


def test_robot_time_only_grows_and_waits_for_the_decision(ball: ObjectSpec, sideways: Pose) -> None:
    params = Params(object=ball)
    state, _ = start(params)
    state, [(_, first)] = touch(params, state, goal_at(sideways(0.03)))  # type: ignore[misc]
    late = goal_at(sideways(0.03), not_before=100.0)
    _, [(_, second)] = touch(params, state, late)  # type: ignore[misc]
    assert first.robot_time > 0.0
    assert second.robot_time > 100.0


def test_a_touch_leaves_the_state_it_was_given_alone(ball: ObjectSpec, sideways: Pose) -> None:
    params = Params(object=ball)
    state, _ = start(params)
    one = touch(params, state, goal_at(sideways(0.03)))[1]
    two = touch(params, state, goal_at(sideways(0.03)))[1]
    assert [encode(message) for _, message in one] == [  # type: ignore[misc]
        encode(message)
        for _, message in two  # type: ignore[misc]
    ]


def test_an_unknown_robot_is_refused_with_those_that_exist(ball: ObjectSpec) -> None:
    with pytest.raises(ValueError, match=r"robot must be one of \['modern', 'puma'\], got 'r2d2'"):
        Params(object=ball, robot="r2d2")


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({}, "an object is exactly one of superquadric, .* and mesh; got none of them"),
        (
            {
                "superquadric": {"size": [1, 1, 1], "exponents": [1, 1]},
                "mesh": {"vertices": "", "faces": ""},
            },
            "got superquadric and mesh",
        ),
        ({"superquadric": {"size": [1, -1, 1], "exponents": [1, 1]}}, "> 0"),
        ({"superquadric": {"size": [1, 1, 1], "exponents": [1, 3]}}, "<= 2"),
        (
            {
                "superquadric": {"size": [1, 1, 1], "exponents": [1, 1]},
                "pose": {"rotation": [0, 0, 0, 2]},
            },
            "quaternion of length 1",
        ),
        (
            {
                "superquadric": {"size": [1, 1, 1], "exponents": [1, 1]},
                "lattice": [{"turn": 0}, {"turn": 170}, {"turn": -170}, {"turn": 0}],
            },
            "folds",
        ),
        (
            {"mesh": {"vertices": "", "faces": ""}, "lattice": [{}, {}, {}, {}]},
            "a lattice deforms no mesh",
        ),
    ],
)
def test_an_object_that_cannot_be_is_refused(wrong: dict[str, Any], words: str) -> None:
    with pytest.raises(msgspec.ValidationError, match=words):
        msgspec.convert(wrong, ObjectSpec)


IDEAL_TOUCH = """
import sys
import numpy as np
from palpate.core.frames import pad_rotation, pose_of
from palpate.messages.types import TouchGoal
from palpate.nodes.object import ObjectSpec, SuperquadricSpec
from palpate.nodes.simulator import Params, start, touch
ball = SuperquadricSpec(size=(0.03,) * 3, exponents=(1.0, 1.0))
params = Params(object=ObjectSpec(superquadric=ball), effects={effects})
state, _ = start(params)
pose = pose_of(np.array([0.1, 0.0, 0.0]), pad_rotation(0.0, 0.0))
up = np.array([0.0, 0.0, 1.0])
goal = dict(goal=0, touch=0, finger=1, pose=pose, reach=0.15, depth=0.001, direction=up)
touch(params, state, TouchGoal(**goal, not_before=0.0))
"""


def modules_after(effects: dict[str, Any]) -> set[str]:
    """What a process has imported once it has simulated a touch."""
    script = IDEAL_TOUCH.replace("{effects}", repr(effects)) + "print(*sys.modules)"
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, timeout=60, check=True
    )
    return set(done.stdout.split())


EFFECTS = "palpate.core.touch.effects."


def test_an_ideal_analytic_scene_imports_neither_effects_meshes_nor_random_numbers() -> None:
    modules = modules_after({})
    assert not {"numpy.random", "scipy", "trimesh", "embreex"} & modules
    assert {name for name in modules if name.startswith(EFFECTS)} == {EFFECTS + "catalogue"}


def test_of_the_effects_only_what_is_listed_is_imported() -> None:
    modules = modules_after({"crosstalk": {}, "saturation": {"share": 0.3}})
    found = {name.removeprefix(EFFECTS) for name in modules if name.startswith(EFFECTS)}
    assert found == {"catalogue", "crosstalk", "saturation"}
    assert "numpy.random" not in modules  # neither of them draws


def frames_of(ball: ObjectSpec, pose: Floats, effects: dict[str, Any]) -> list[Any]:
    params = Params(object=ball, effects=effects, seed=11)
    state, _ = start(params)
    frames = []
    for _ in range(3):
        state, said = touch(params, state, goal_at(pose))
        frames += [encode(frame) for _, frame in said]  # type: ignore[misc]
    return frames


def test_the_order_of_the_list_does_not_matter(ball: ObjectSpec, sideways: Pose) -> None:
    effects = {"quantisation": {}, "gaussian_noise": {}, "creep": {}, "pose_error": {}}
    backwards = dict(reversed(effects.items()))
    pose = sideways(0.03)
    assert frames_of(ball, pose, effects) == frames_of(ball, pose, backwards)
    assert frames_of(ball, pose, effects) != frames_of(ball, pose, {})


def test_an_effect_without_strength_leaves_the_frames_byte_for_byte(
    ball: ObjectSpec, sideways: Pose
) -> None:
    pose = sideways(0.03)
    listed = {"gaussian_noise": {"sigma": 0.0}, "salt_and_pepper": {"rate": 0.0}}
    assert frames_of(ball, pose, listed) == frames_of(ball, pose, {})


def test_adding_an_effect_leaves_the_draws_of_the_others(ball: ObjectSpec, sideways: Pose) -> None:
    def reading(effects: dict[str, Any]) -> Floats:
        params = Params(object=ball, effects=effects, seed=11)
        state, _ = start(params)
        state, _ = touch(params, state, goal_at(sideways(0.2)))  # a miss draws as well
        _, [(_, frame)] = touch(params, state, goal_at(sideways(0.03)))  # type: ignore[misc]
        return np.asarray(frame.array)

    noise, offset = {"gaussian_noise": {}}, {"gain_offset": {"sigma_gain": 0.0}}
    alone = reading(noise) - reading({})
    beside = reading({**noise, **offset}) - reading(offset)
    assert np.abs(alone).max() > 1e-9
    assert np.allclose(alone, beside, rtol=0, atol=1e-20)


def test_a_frame_is_sent_as_often_as_the_link_delivers_it(ball: ObjectSpec, sideways: Pose) -> None:
    params = Params(object=ball, effects={"transport": {"duplicate": 1.0, "drop": 0.0}})
    state, _ = start(params)
    _, said = touch(params, state, goal_at(sideways(0.03)))
    assert [encode(frame) for _, frame in said] == [encode(said[0][1])] * 2  # type: ignore


def test_the_arm_says_where_it_believes_to_be(ball: ObjectSpec, sideways: Pose) -> None:
    pose = sideways(0.03)
    believed = {}
    for name, effects in {"ideal": {}, "off": {"pose_error": {"sigma": 1e-3}}}.items():
        params = Params(object=ball, effects=effects)
        state, _ = start(params)
        _, [(_, frame)] = touch(params, state, goal_at(pose))  # type: ignore[misc]
        believed[name] = frame
    # Only the way along the normal, which the move measures, can tell.
    assert np.allclose(believed["ideal"].pose[1:], believed["off"].pose[1:], atol=1e-15)
    assert not np.allclose(believed["ideal"].array, believed["off"].array, atol=1e-8)


def test_listeners_are_told_of_noise_and_of_a_face_that_yields(ball: ObjectSpec) -> None:
    listed = {"gaussian_noise": {"sigma": 3e-6}, "tenting": {"decay": 2e-3}}
    _, said = start(Params(object=ball, effects=listed))
    info = dict(said)["/touch/info"]  # type: ignore[arg-type]
    assert info.noise == pytest.approx(3e-6)
    assert (info.face, info.face_decay) == ("membrane", 2e-3)


@pytest.mark.parametrize(
    ("effects", "words"),
    [
        ({"noise": {}}, "there is no effect 'noise'"),
        ({"drift": {"rat": 1}}, "effects.drift has no parameter 'rat'; it has"),
        ({"drift": {"rate": "x"}}, "effects.drift: Expected `float`, got `str`"),
        ({"drift": {"rate": -1.0}}, "rate is -1 m/sqrt"),
    ],
)
def test_a_bad_effect_is_refused(ball: ObjectSpec, effects: dict[str, Any], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        Params(object=ball, effects=effects)


def test_only_the_first_finger_tells_what_all_may_know(ball: ObjectSpec) -> None:
    _, said = start(Params(object=ball, finger=1, fingers=2))
    assert dict(said)["/world"].fingers == 2  # type: ignore[arg-type]
    assert [topic for topic, _ in said] == ["/world", "/touch/info", "/truth"]  # type: ignore[misc]
    assert start(Params(object=ball, finger=2, fingers=2))[1] == []


def test_fingers_have_random_numbers_of_their_own(ball: ObjectSpec, sideways: Pose) -> None:
    frames = []
    for finger in (1, 2):
        params = Params(object=ball, effects={"gaussian_noise": {}}, finger=finger, fingers=2)
        goal = goal_at(sideways(0.03), finger=finger)
        _, [(_, frame)] = touch(params, start(params)[0], goal)  # type: ignore[misc]
        frames.append(frame)
    assert [frame.finger for frame in frames] == [1, 2]
    assert not np.array_equal(frames[0].array, frames[1].array)


def test_a_finger_that_is_not_there_is_refused(ball: ObjectSpec) -> None:
    with pytest.raises(ValueError, match="finger must be at most fingers, 2, got 3"):
        Params(object=ball, finger=3, fingers=2)


def test_a_touch_for_another_finger_is_refused(ball: ObjectSpec, sideways: Pose) -> None:
    params = Params(object=ball)
    asked = goal_at(sideways(0.03), goal=4, finger=2)
    with pytest.raises(ValueError, match="touch 0 of goal 4 is for finger 2, but this is finger 1"):
        touch(params, start(params)[0], asked)


def test_the_node_declares_what_its_handlers_take() -> None:
    assert set(NODE.inputs) == {"/finger/goal", "/hand/goal"}


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"rows": 5}, "an array of 4 by 15 mm; contours are followed with 5 to 40 mm"),
        ({"cols": 42}, "an array of 15 by 41 mm; contours are followed with 5 to 40 mm"),
        ({"pad": {"radius": 0.01}}, "a dome over this array needs more than 0.0106 m"),
        ({"pad": {"thickness": 0.001}}, f"it must be at least {PRESS / 0.8:.3g} m, to"),
    ],
)
def test_a_sensor_that_could_not_work_is_refused(wrong: dict[str, Any], words: str) -> None:
    with pytest.raises(msgspec.ValidationError, match=words):
        msgspec.convert(wrong, SensorSpec)


def test_the_words_of_core_and_messages_are_the_same() -> None:
    assert get_args(pad.Outcome) == get_args(touch_types.Outcome)
    assert get_args(core_curvature.Kind) == get_args(touch_types.Kind)
    assert get_args(trace.Status) == get_args(motion_types.Status)
