"""Simulator node: one guarded move a goal, its frame, time and errors; closings of the hand."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from typing import Any

import msgspec
import numpy as np
import pytest

from palpate.core.poses import FACING_DOWN, Pose
from palpate.core.robot_time import ROBOT_PRESETS, MoveGeometry, move_durations
from palpate.messages import encode
from palpate.messages.types import GraspContacts, GraspGoal, TactileFrame, TouchGoal
from palpate.nodes.runtime.testing import drive, example, messages_on
from palpate.nodes.simulator import NODE, Params
from palpate.nodes.specs.objects import PoseSpec
from tests.messages.cases import cases
from tests.nodes.loop import ball_spec, sideways

BALL = ball_spec()
MIDDLE = Pose(np.array([0.0, 0.0, 0.03]), FACING_DOWN).array


def goal(height: float = 0.03, **changes: Any) -> TouchGoal:
    up = np.array([0.0, 0.0, 1.0])
    fields = {"finger": 1, "pose": sideways(height), "reach": 0.15, "depth": 0.001}
    return example(TouchGoal, **{**fields, "direction": up, **changes})


def grasp(**changes: Any) -> GraspGoal:
    asked = GraspGoal(number=4, pose=MIDDLE, fingers=5, opening=0.1, reach=0.1, not_before=0.0)
    return replace(asked, **changes)


def answers(params: Params, *goals: TouchGoal | GraspGoal) -> list[Any]:
    """Frames and contacts that follow from goals."""
    asked = [("/finger/goal" if isinstance(g, TouchGoal) else "/hand/goal", g) for g in goals]
    published = [message for _, message in drive(NODE, asked, params)]
    return [one for one in published if isinstance(one, TactileFrame | GraspContacts)]


def test_start_tells_object_sensor_and_reach():
    published = drive(NODE, params=Params(object=BALL))
    assert [topic for topic, _ in published] == ["/world", "/touch/info", "/truth"]
    [world], [info], [truth] = (messages_on(published, topic) for topic, _ in published)
    assert world.platform == pytest.approx(0.0, abs=1e-12) and world.fingers == 1
    assert truth.height == pytest.approx(0.06, rel=1e-9) and info.dome == pytest.approx(1 / 0.015)
    off = np.linalg.norm(truth.vertices - [0, 0, 0.03], axis=1) - 0.03
    assert np.abs(off).max() < 1e-9 and len(truth.faces) > 2 * len(truth.floor_faces)
    wide = msgspec.structs.replace(BALL, pose=PoseSpec(position=(0.3, 0.0, 0.0)))
    for own, reach in ((None, 1.25 * 0.33), (0.2, 0.2)):
        published = drive(NODE, params=Params(object=wide, reach=own))
        assert messages_on(published, "/world")[0].reach == pytest.approx(reach)
    assert drive(NODE, params=Params(object=BALL, finger=2, fingers=2)) == []


def test_touch_is_pressed_to_the_asked_depth_or_misses():
    hit, missed = answers(Params(object=BALL), goal(), goal(0.2))
    assert (hit.outcome, missed.outcome) == ("hit", "miss")
    # The shortest time of flight belongs to the deepest taxel: t = 2 (D - c) / v.
    assert hit.array.min() == pytest.approx(2 * (0.003 - 0.001) / 1000.0, rel=1e-12)
    assert hit.array.max() == pytest.approx(2 * 0.003 / 1000.0, rel=1e-12)
    assert np.ptp(missed.array) == 0.0
    # The four middle taxels, half a pitch from the axis both ways, touch first: of ball and dome.
    sagitta = 0.5e-3**2 * (1.0 / 0.03 + 1.0 / 0.015)
    assert hit.pose[0] == pytest.approx(0.03 - 0.001 - sagitta, abs=1e-7)
    assert missed.pose[0] == pytest.approx(0.1 - 0.15)


def test_same_goals_give_same_bytes_and_robot_time_waits_for_decisions():
    asked = [goal(), goal(not_before=100.0), goal()]
    one, other = (answers(Params(object=BALL, effects={"creep": {}}), *asked) for _ in range(2))
    assert [encode(frame) for frame in one] == [encode(frame) for frame in other]
    times = [frame.robot_time for frame in one]
    assert 0.0 < times[0] < 100.0 < times[1] < times[2]


@cases(
    "params, words",
    ({"robot": "r2d2"}, r"robot must be one of \['modern', 'puma'\], got 'r2d2'"),
    ({"finger": 3, "fingers": 2}, "finger must be at most fingers, 2, got 3"),
    ({"effects": {"drift": {"rat": 1}}}, "effects.drift has no parameter 'rat'; it has"),
    ({"effects": {"drift": {"rate": "x"}}}, "effects.drift: Expected `float`, got `str`"),
    ({"effects": {"drift": {"rate": -1.0}}}, "rate is -1 m/sqrt"),
)
def test_parameters_that_cannot_be_are_refused(params: dict[str, Any], words: str):
    with pytest.raises(ValueError, match=words):
        Params(object=BALL, **params)


@cases(
    "asked, words",
    (goal(goal=4, finger=2), "goal 4 is for finger 2; the fingers are 1 to 1"),
    (grasp(fingers=0), "fingers must be from 1 to 20, got 0"),
    (grasp(opening=-0.1), "opening must be positive and finite, got -0.1 m"),
)
def test_goal_that_cannot_be_met_is_refused(asked: TouchGoal | GraspGoal, words: str):
    with pytest.raises(ValueError, match=words):
        answers(Params(object=BALL), asked)


SCRIPT = """
import sys
import numpy as np
from palpate.nodes.runtime.testing import drive, example
from palpate.messages.types import TouchGoal
from palpate.nodes.simulator import NODE, Params
from palpate.nodes.specs.objects import ObjectSpec, SuperquadricSpec
solid = SuperquadricSpec(size=(0.03, 0.03, 0.04), exponents=(1.0, 1.0), {solid})
pose = np.array([0.1, 0.0, 0.0, -0.5, -0.5, 0.5, 0.5])
goal = example(TouchGoal, finger=1, pose=pose, reach=0.15, depth=0.001)
params = Params(object=ObjectSpec(superquadric=solid), effects={effects})
drive(NODE, [("/finger/goal", goal)], params)
print(*sys.modules)
"""
EFFECTS = "palpate.core.touch.effects."


@cases(
    "solid, effects, files",
    ("", {}, {"catalogue"}),
    ("taper=(-0.2, -0.2), bend=4.0", {}, {"catalogue"}),
    ("", {"crosstalk": {}, "saturation": {"share": 0.3}}, {"catalogue", "echoes", "rubber"}),
)
def test_plain_scene_imports_nothing_that_it_does_not_use(solid: str, effects: Any, files: set):
    script = SCRIPT.format(solid=solid, effects=repr(effects))
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, timeout=300, check=True
    )
    modules = set(done.stdout.split())
    assert not {"numpy.random", "scipy.linalg", "trimesh", "embreex", "manifold3d"} & modules
    imported = {name.removeprefix(EFFECTS) for name in modules if name.startswith(EFFECTS)}
    assert imported == files


def test_effects_act_in_one_order_and_each_finger_draws_its_own_numbers():
    effects = {"quantisation": {}, "gaussian_noise": {}, "creep": {}, "pose_error": {}}
    first, second, ideal = (
        [frame.array for frame in answers(Params(object=BALL, effects=some), *[goal()] * 3)]
        for some in (effects, dict(reversed(effects.items())), {})
    )
    assert np.array_equal(first, second) and not np.array_equal(first, ideal)
    asked = [goal(finger=1), goal(finger=2)]
    arrays = []
    for finger in (1, 2):
        params = Params(object=BALL, effects={"gaussian_noise": {}}, finger=finger, fingers=2)
        [frame] = answers(params, *asked)
        assert frame.finger == finger
        arrays.append(frame.array)
    assert not np.array_equal(*arrays)


def test_effects_of_link_arm_and_face_are_told_or_seen():
    twice = {"transport": {"duplicate": 1.0, "drop": 0.0}}
    first, second = answers(Params(object=BALL, effects=twice), goal())
    assert encode(first) == encode(second)
    [ideal] = answers(Params(object=BALL), goal())
    [off] = answers(Params(object=BALL, effects={"pose_error": {"sigma": 1e-3}}), goal())
    # Only the way along the normal, which the move measures, can tell.
    assert np.allclose(ideal.pose[1:], off.pose[1:], atol=1e-15)
    assert not np.allclose(ideal.array, off.array, atol=1e-8)
    listed = {"gaussian_noise": {"sigma": 3e-6}, "tenting": {"decay": 2e-3}}
    [info] = messages_on(drive(NODE, params=Params(object=BALL, effects=listed)), "/touch/info")
    assert info.noise == pytest.approx(3e-6)
    assert (info.face, info.face_decay) == ("membrane", 2e-3)


def test_hand_tells_where_its_fingers_met_and_another_number_is_another_hand():
    places = np.array([[0.5, 0.0, 0.03], [0.0, 0.0, 0.001]])
    beside, low = (grasp(pose=Pose(at, FACING_DOWN).array) for at in places)
    met, nothing, blocked = results = answers(Params(object=BALL), grasp(), beside, low)
    assert [one.number for one in results] == [4, 4, 4]
    assert [(one.missed, one.blocked) for one in results] == [(0, 0), (6, 0), (0, 5)]
    away = met.points - [0.0, 0.0, 0.03]
    assert np.linalg.norm(away, axis=1) == pytest.approx(np.full(6, 0.03), abs=1e-6)
    assert np.einsum("ij,ij->i", away, met.normals) == pytest.approx(np.full(6, 0.03), abs=1e-6)
    assert met.fingers.tolist() == [0, 1, 2, 3, 4, 5]
    assert (len(nothing.points), blocked.fingers.tolist()) == (0, [5])
    effects = {"pose_error": {"sigma": 1e-4}}
    asked = [grasp(), grasp(fingers=3), grasp(), grasp()]
    first, few, again, later = answers(Params(object=BALL, effects=effects), *asked)
    assert len(few.points) == 4
    assert np.array_equal(first.points, again.points)  # its draws begin anew
    assert 1e-6 < np.abs(again.points - later.points).max() < 2e-3
    noisy = Params(object=BALL, effects={**effects, "gaussian_noise": {}})
    [alone] = answers(noisy, goal())  # the hand does not shift what the finger draws
    assert np.array_equal(answers(noisy, grasp(), grasp(), goal())[2].array, alone.array)


@pytest.mark.parametrize("effects", [{}, {"transport": {"latency": 0.02}, "pose_error": {}}])
@pytest.mark.parametrize("robot", ["modern", "puma"])
def test_moves_give_the_robot_time_back(robot: str, effects: dict[str, Any]):
    heights = [(0, 0.03), (0, 0.035), (1, 0.04), (1, 0.3)]
    asked = [
        goal(height, goal=contour, touch=number, not_before=30.0 * number)
        for number, (contour, height) in enumerate(heights)
    ]
    params = Params(object=BALL, robot=robot, effects=effects)
    results = answers(params, grasp(not_before=2.0), *asked)
    moves = MoveGeometry.of_rows(np.array([one.move for one in results]))
    times = [one.robot_time for one in results]
    spent = np.cumsum(move_durations(moves, ROBOT_PRESETS[robot]).total())
    assert spent == pytest.approx(times, rel=1e-12)
    assert (moves.along >= 0.0).tolist() == [False, False, True, False, False]
    contacts = results[0]  # of which the finger that went farthest tells the time
    assert contacts.move[[0, 1, 2]] == pytest.approx([2.0, 0.0, 0.0])
    if not effects:
        assert contacts.move[3] == pytest.approx(0.071, abs=1e-4)
    if robot == "modern" and not effects:
        wanted = 2.0 + 0.071 / 0.01 + 0.071 / 0.05 + 0.2
        assert contacts.robot_time == pytest.approx(wanted, abs=1e-2)
