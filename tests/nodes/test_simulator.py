from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from typing import Any, get_args

import msgspec
import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.explore.tracing import contour_trace as trace
from palpate.core.explore.tracing.contour_path import TOUCH_DEPTH
from palpate.core.poses import FACING_DOWN, pose_of
from palpate.core.robot_time import LIFTED, ROBOTS, MoveGeometry, elapsed_seconds
from palpate.core.touch import curvature as core_curvature, pad
from palpate.messages.codec import encode
from palpate.messages.types import motion as motion_types, touch as touch_types
from palpate.messages.types.motion import GraspContacts, GraspGoal, TouchGoal
from palpate.messages.types.touch import TactileFrame
from palpate.nodes import simulator
from palpate.nodes.runtime.testing import example
from palpate.nodes.simulator import NODE, Params, State, start, take_grasp, touch
from palpate.nodes.specs.objects import ObjectSpec, PoseSpec
from palpate.nodes.specs.sensors import SensorSpec

Pose = Callable[[float], Floats]


def goal_at(pose: Floats, **changes: Any) -> TouchGoal:
    up = np.array([0.0, 0.0, 1.0])
    asked = example(TouchGoal, finger=1, pose=pose, reach=0.15, depth=0.001, direction=up)
    return replace(asked, **changes)


def pressed(ball: ObjectSpec, pose: Floats, effects: Any = None, **more: Any) -> TactileFrame:
    """The frame of the first touch of a ball."""
    params = Params(object=ball, effects=effects or {})
    _, [(_, frame)] = touch(params, start(params)[0], goal_at(pose, **more))  # type: ignore[misc]
    assert isinstance(frame, TactileFrame)
    return frame


def test_it_tells_where_the_object_stands_and_how_high_it_is(ball: ObjectSpec):
    _, outputs = start(Params(object=ball))
    published = dict(outputs)  # type: ignore[arg-type]
    assert published["/world"].platform == pytest.approx(0.0, abs=1e-12)
    assert published["/truth"].height == pytest.approx(0.06, rel=1e-9)
    assert published["/touch/info"].dome == pytest.approx(1 / 0.015)


def test_its_reach_fits_the_object_unless_one_is_given(ball: ObjectSpec):
    wide = msgspec.structs.replace(ball, pose=PoseSpec(position=(0.3, 0.0, 0.0)))
    fitted = dict(start(Params(object=wide))[1])  # type: ignore[arg-type]
    assert fitted["/world"].reach == pytest.approx(1.25 * 0.33)
    given = dict(start(Params(object=wide, reach=0.2))[1])  # type: ignore[arg-type]
    assert given["/world"].reach == 0.2


def test_everything_it_publishes_can_be_sent(ball: ObjectSpec, sideways: Pose):
    params = Params(object=ball)
    state, outputs = start(params)
    _, more = touch(params, state, goal_at(sideways(0.03)))
    for topic, message in outputs + more:  # type: ignore[misc]
        assert encode(message), topic


def test_a_touch_is_pressed_to_the_asked_depth(ball: ObjectSpec, sideways: Pose):
    frame = pressed(ball, sideways(0.03))
    assert frame.outcome == "hit"
    # The shortest time of flight belongs to the deepest taxel: t = 2 (D - c) / v.
    assert frame.array.min() == pytest.approx(2 * (0.003 - 0.001) / 1000.0, rel=1e-12)
    assert frame.array.max() == pytest.approx(2 * 0.003 / 1000.0, rel=1e-12)


def test_a_touch_beside_the_object_misses(ball: ObjectSpec, sideways: Pose):
    frame = pressed(ball, sideways(0.2))
    assert frame.outcome == "miss"
    assert np.ptp(frame.array) == 0.0


def test_robot_time_only_grows_and_waits_for_the_decision(ball: ObjectSpec, sideways: Pose):
    params = Params(object=ball)
    state, _ = start(params)
    state, [(_, first)] = touch(params, state, goal_at(sideways(0.03)))  # type: ignore[misc]
    late = goal_at(sideways(0.03), not_before=100.0)
    _, [(_, second)] = touch(params, state, late)  # type: ignore[misc]
    assert first.robot_time > 0.0
    assert second.robot_time > 100.0


def test_a_touch_leaves_the_state_it_was_given_alone(ball: ObjectSpec, sideways: Pose):
    params = Params(object=ball)
    state, _ = start(params)
    one = touch(params, state, goal_at(sideways(0.03)))[1]
    two = touch(params, state, goal_at(sideways(0.03)))[1]
    assert [encode(message) for _, message in one] == [  # type: ignore[misc]
        encode(message)
        for _, message in two  # type: ignore[misc]
    ]


def test_an_unknown_robot_is_refused_with_those_that_exist(ball: ObjectSpec):
    with pytest.raises(ValueError, match=r"robot must be one of \['modern', 'puma'\], got 'r2d2'"):
        Params(object=ball, robot="r2d2")


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({}, "an object is exactly one of sphere, .* and mesh; got none of them"),
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
def test_an_object_that_cannot_be_is_refused(wrong: dict[str, Any], words: str):
    with pytest.raises(msgspec.ValidationError, match=words):
        msgspec.convert(wrong, ObjectSpec)


IDEAL_TOUCH = """
import sys
import numpy as np
from palpate.core.poses import pad_rotation, pose_of
from palpate.messages.types.motion import TouchGoal
from palpate.nodes.specs.objects import ObjectSpec, PoseSpec
from palpate.nodes.specs.objects import SuperquadricSpec
from palpate.nodes.runtime.testing import example
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
        [sys.executable, "-c", script], capture_output=True, text=True, timeout=300, check=True
    )
    return set(done.stdout.split())


EFFECTS = "palpate.core.touch.effects."


def test_an_ideal_analytic_scene_imports_neither_effects_meshes_nor_random_numbers():
    modules = modules_after({})
    assert not {"numpy.random", "scipy", "trimesh", "embreex"} & modules
    assert {name for name in modules if name.startswith(EFFECTS)} == {EFFECTS + "catalogue"}


def test_of_the_effects_only_the_files_are_imported_of_which_something_is_listed():
    modules = modules_after({"crosstalk": {}, "saturation": {"share": 0.3}})
    found = {name.removeprefix(EFFECTS) for name in modules if name.startswith(EFFECTS)}
    assert found == {"catalogue", "echoes", "rubber"}
    assert "numpy.random" not in modules  # neither of them draws


def frames_of(ball: ObjectSpec, pose: Floats, effects: dict[str, Any]) -> list[Any]:
    params = Params(object=ball, effects=effects, seed=11)
    state, _ = start(params)
    frames = []
    for _ in range(3):
        state, published = touch(params, state, goal_at(pose))
        frames += [encode(frame) for _, frame in published]  # type: ignore[misc]
    return frames


def test_the_order_of_the_list_does_not_matter(ball: ObjectSpec, sideways: Pose):
    effects = {"quantisation": {}, "gaussian_noise": {}, "creep": {}, "pose_error": {}}
    backwards = dict(reversed(effects.items()))
    pose = sideways(0.03)
    assert frames_of(ball, pose, effects) == frames_of(ball, pose, backwards)
    assert frames_of(ball, pose, effects) != frames_of(ball, pose, {})


def test_an_effect_without_strength_leaves_the_frames_byte_for_byte(
    ball: ObjectSpec, sideways: Pose
):
    pose = sideways(0.03)
    listed = {"gaussian_noise": {"sigma": 0.0}, "salt_and_pepper": {"rate": 0.0}}
    assert frames_of(ball, pose, listed) == frames_of(ball, pose, {})


def test_adding_an_effect_leaves_the_draws_of_the_others(ball: ObjectSpec, sideways: Pose):
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


def test_a_frame_is_sent_as_often_as_the_link_delivers_it(ball: ObjectSpec, sideways: Pose):
    params = Params(object=ball, effects={"transport": {"duplicate": 1.0, "drop": 0.0}})
    state, _ = start(params)
    _, published = touch(params, state, goal_at(sideways(0.03)))
    assert [encode(frame) for _, frame in published] == [encode(published[0][1])] * 2  # type: ignore


def test_the_arm_tells_where_it_believes_to_be(ball: ObjectSpec, sideways: Pose):
    ideal = pressed(ball, sideways(0.03))
    off = pressed(ball, sideways(0.03), {"pose_error": {"sigma": 1e-3}})
    # Only the way along the normal, which the move measures, can tell.
    assert np.allclose(ideal.pose[1:], off.pose[1:], atol=1e-15)
    assert not np.allclose(ideal.array, off.array, atol=1e-8)


def test_subscribers_are_told_of_noise_and_of_a_face_that_yields(ball: ObjectSpec):
    listed = {"gaussian_noise": {"sigma": 3e-6}, "tenting": {"decay": 2e-3}}
    _, published = start(Params(object=ball, effects=listed))
    info = dict(published)["/touch/info"]  # type: ignore[arg-type]
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
def test_a_bad_effect_is_refused(ball: ObjectSpec, effects: dict[str, Any], words: str):
    with pytest.raises(ValueError, match=words):
        Params(object=ball, effects=effects)


def test_only_the_first_finger_tells_what_all_may_know(ball: ObjectSpec):
    _, published = start(Params(object=ball, finger=1, fingers=2))
    assert dict(published)["/world"].fingers == 2  # type: ignore[arg-type]
    assert [topic for topic, _ in published] == ["/world", "/touch/info", "/truth"]  # type: ignore[misc]
    assert start(Params(object=ball, finger=2, fingers=2))[1] == []


def test_fingers_have_random_numbers_of_their_own(ball: ObjectSpec, sideways: Pose):
    frames = []
    for finger in (1, 2):
        params = Params(object=ball, effects={"gaussian_noise": {}}, finger=finger, fingers=2)
        goal = goal_at(sideways(0.03), finger=finger)
        _, [(_, frame)] = touch(params, start(params)[0], goal)  # type: ignore[misc]
        frames.append(frame)
    assert [frame.finger for frame in frames] == [1, 2]
    assert not np.array_equal(frames[0].array, frames[1].array)


def test_a_finger_that_is_not_there_is_refused(ball: ObjectSpec):
    with pytest.raises(ValueError, match="finger must be at most fingers, 2, got 3"):
        Params(object=ball, finger=3, fingers=2)


def test_a_touch_for_another_finger_is_refused(ball: ObjectSpec, sideways: Pose):
    params = Params(object=ball)
    asked = goal_at(sideways(0.03), goal=4, finger=2)
    with pytest.raises(ValueError, match="goal 4 is for finger 2; the fingers are 1 to 1"):
        touch(params, start(params)[0], asked)


def test_each_finger_takes_its_own_of_one_topic_of_goals(ball: ObjectSpec, sideways: Pose):
    asked = goal_at(sideways(0.03), goal=4, finger=2)
    for finger, frames in ((1, 0), (2, 1)):
        params = Params(object=ball, finger=finger, fingers=2)
        assert len(touch(params, start(params)[0], asked)[1]) == frames


def test_the_node_declares_what_its_handlers_take():
    assert set(NODE.inputs) == {"/finger/goal", "/hand/goal"}


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"rows": 5}, "an array of 4 by 15 mm; contours are followed with 5 to 40 mm"),
        ({"cols": 42}, "an array of 15 by 41 mm; contours are followed with 5 to 40 mm"),
        ({"pad": {"radius": 0.01}}, "a dome over this array needs more than 0.0106 m"),
        ({"pad": {"thickness": 0.001}}, f"it must be at least {TOUCH_DEPTH / 0.8:.3g} m, to"),
    ],
)
def test_a_sensor_that_could_not_work_is_refused(wrong: dict[str, Any], words: str):
    with pytest.raises(msgspec.ValidationError, match=words):
        msgspec.convert(wrong, SensorSpec)


def test_the_words_of_core_and_messages_are_the_same():
    assert get_args(pad.TouchOutcome) == get_args(touch_types.Outcome)
    assert get_args(core_curvature.PatchKind) == get_args(touch_types.SurfaceKind)
    assert get_args(trace.TraceStatus) == get_args(motion_types.ContourStatus)


MIDDLE = pose_of(np.array([0.0, 0.0, 0.03]), FACING_DOWN)


def goal(**changes: Any) -> GraspGoal:
    asked = GraspGoal(number=4, pose=MIDDLE, fingers=5, opening=0.1, reach=0.1, not_before=0.0)
    return replace(asked, **changes)


def grasp(params: Params, state: State, **changes: Any) -> tuple[State, GraspContacts]:
    state, [(topic, contacts)] = take_grasp(params, state, goal(**changes))  # type: ignore[misc]
    assert topic == "/hand/contacts" and isinstance(contacts, GraspContacts)
    assert encode(contacts)
    return state, contacts


def felt(params: Params, state: State, asked: TouchGoal) -> tuple[State, TactileFrame]:
    state, [(_, frame)] = touch(params, state, asked)  # type: ignore[misc]
    assert isinstance(frame, TactileFrame)
    return state, frame


def test_the_hand_tells_where_its_fingers_met_the_ball(ball: ObjectSpec):
    params = Params(object=ball)
    _, contacts = grasp(params, start(params)[0])
    assert (contacts.number, contacts.missed, contacts.blocked) == (4, 0, 0)
    away = contacts.points - [0.0, 0.0, 0.03]
    assert np.linalg.norm(away, axis=1) == pytest.approx(np.full(6, 0.03), abs=1e-6)
    assert contacts.fingers.tolist() == [0, 1, 2, 3, 4, 5]


def test_fingers_that_miss_or_are_blocked_are_told(ball: ObjectSpec):
    params = Params(object=ball)
    state = start(params)[0]
    _, beside = grasp(params, state, pose=pose_of(np.array([0.5, 0.0, 0.03]), FACING_DOWN))
    _, low = grasp(params, state, pose=pose_of(np.array([0.0, 0.0, 0.001]), FACING_DOWN))
    assert (len(beside.points), beside.missed) == (0, 6)
    assert (low.fingers.tolist(), low.blocked) == ([5], 5)


def test_robot_time_is_that_of_the_finger_that_went_farthest(ball: ObjectSpec):
    params = Params(object=ball)
    _, contacts = grasp(params, start(params)[0], not_before=2.0)
    assert contacts.move[[0, 1, 2, 4]] == pytest.approx([2.0, 0.0, 0.0, LIFTED])
    assert contacts.move[3] == pytest.approx(0.071, abs=1e-4)
    assert contacts.robot_time == pytest.approx(2.0 + 0.071 / 0.01 + 0.071 / 0.05 + 0.2, abs=1e-2)


def test_the_hand_errs_without_shifting_what_the_finger_draws(ball: ObjectSpec):
    params = Params(object=ball, effects={"pose_error": {"sigma": 1e-4}, "gaussian_noise": {}})
    state, _ = start(params)
    grasped, one = grasp(params, state)
    _, two = grasp(params, grasped)
    arrays = []
    for before in (state, grasped):
        above = goal_at(pose_of(np.array([0, 0, 0.1]), FACING_DOWN))
        arrays.append(felt(params, before, above)[1].array)
    assert one.points.shape == two.points.shape
    assert 1e-6 < np.abs(one.points - two.points).max() < 2e-3
    assert np.array_equal(arrays[0], arrays[1])


def test_a_hand_of_another_number_of_fingers_is_another_hand(ball: ObjectSpec):
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
def test_a_hand_that_cannot_close_is_refused(ball: ObjectSpec, changes: dict[str, Any], words: str):
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
):
    params = Params(object=ball, robot=robot, effects=effects)
    state, _ = start(params)
    state, contacts = grasp(params, state)
    rows, times = [contacts.move], [contacts.robot_time]
    for number, (contour, height) in enumerate([(0, 0.03), (0, 0.035), (1, 0.04), (1, 0.3)]):
        asked = goal_at(sideways(height), goal=contour, touch=number, not_before=30.0 * number)
        state, frame = felt(params, state, asked)
        rows.append(frame.move)
        times.append(frame.robot_time)
    moves = MoveGeometry.of_rows(np.array(rows))
    assert elapsed_seconds(moves, ROBOTS[robot]) == pytest.approx(times, rel=1e-12)
    assert (moves.along >= 0.0).tolist() == [False, False, True, False, False]


def test_the_words_for_a_finger_that_was_lifted_are_the_same():
    assert simulator.NO_SURFACE_PATH == LIFTED
