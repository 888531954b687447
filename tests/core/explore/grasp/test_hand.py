"""A closing hand: where its fingers go, what they touch, and where it closes next."""

import math
from collections.abc import Sequence

import numpy as np
import pytest

from palpate.core import touch
from palpate.core.arrays import Floats
from palpate.core.explore import grasp as room
from palpate.core.explore.grasp import Closing, Hand, next_pose, search_places, search_pose
from palpate.core.poses import FACING_DOWN, Pose, pad_rotation
from palpate.core.robot_time import ROBOT_PRESETS
from palpate.core.shapes import PosedShape, Shape, Superquadric
from palpate.core.touch.effects import effect_type

PAD = touch.Pad(rows=16, cols=16, pitch=1e-3, thickness=3e-3, dome=0.0, saturation=0.8)
BALL = Superquadric(np.full(3, 0.03), np.ones(2))
BOX = Superquadric(np.array([0.03, 0.02, 0.04]), np.array([0.1, 0.1]))
CYLINDER = Superquadric(np.array([0.025, 0.025, 0.04]), np.array([0.1, 1.0]))
HAND = Hand(fingers=5, opening=0.1, reach=0.1)


def at(x: float, z: float) -> Pose:
    return Pose(np.array([x, 0.0, z]), FACING_DOWN)


def standing(shape: Superquadric, x: float = 0.0) -> PosedShape:
    return PosedShape(shape, Pose(np.array([x, 0.0, shape.size[2]]), np.eye(3)))


def tips(hand: Hand, effects: Sequence[touch.Effect] = ()) -> list[touch.Pipeline]:
    """Fingertips of a hand, the palm last."""
    sheet, robot = touch.Calibration("time", PAD.thickness, 1e3, 0.2e3), ROBOT_PRESETS["modern"]
    fingers = [touch.Fingertip(PAD, sheet, robot, 100 + i, 3) for i in range(hand.fingers + 1)]
    return [touch.assemble(one, effects) for one in fingers]


def close(shape: Shape, pose: Pose, hand: Hand = HAND, *effects, platform=-1.0, number=0):
    fingers = tips(hand, effects)
    states, when = [one.begin() for one in fingers], Closing(number, 0.0, 0.0)
    return room.close_hand(shape, fingers, states, hand, pose, platform, when)[0]


def grasped(name: str, wanted: int) -> tuple[Floats, Floats, int]:
    """Points and normals of at least `wanted` contacts, and the number of closings."""
    shape = {"ball": standing(BALL), "aside": standing(CYLINDER, 0.06)}[name]
    hand, places = Hand(), search_places(0.08, 0.04)
    fingers = tips(hand)
    states = tuple(one.begin() for one in fingers)
    points, normals, number = np.zeros((0, 3)), np.zeros((0, 3)), 0
    while len(points) < wanted:
        pose = search_pose(places, number, 0.0)
        pose = next_pose(hand, points, normals, 0.0) if len(points) else pose
        when = Closing(number, 0.0, 0.0)
        grasp, states = room.close_hand(shape, fingers, states, hand, pose, 0.0, when)
        points, normals = np.vstack([points, grasp.points]), np.vstack([normals, grasp.normals])
        number += 1
        assert number < 40
    return points, normals, number


def test_contacts_of_ball_lie_on_it_evenly_spread():
    grasp = close(BALL, at(0.0, 0.0))
    assert (grasp.fingers, grasp.missed, grasp.blocked) == ((0, 1, 2, 3, 4, 5), 0, 0)
    assert np.linalg.norm(grasp.points, axis=1) == pytest.approx(0.03, abs=1e-7)
    assert grasp.normals == pytest.approx(grasp.points / 0.03, abs=1e-4)
    assert grasp.points[-1] == pytest.approx([0.0, 0.0, 0.03], abs=1e-6)  # the palm, from behind
    turns = np.unwrap(np.arctan2(grasp.points[:-1, 1], grasp.points[:-1, 0]))
    assert np.abs(np.diff(turns)) == pytest.approx(2.0 * math.pi / 5, abs=1e-4)
    assert grasp.points[:-1, 2] == pytest.approx(0.0, abs=1e-6)
    assert grasp.advance == pytest.approx(0.071, abs=2e-5)  # pressed by 1 mm at a taxel
    motion = Pose(np.array([0.3, -0.1, 0.2]), pad_rotation(0.7, 0.2))
    moved = close(PosedShape(BALL, motion), (motion @ at(0.0, 0.0)))
    position, axes = motion
    assert moved.points == pytest.approx(grasp.points @ axes.T + position, abs=1e-7)
    assert moved.normals == pytest.approx(grasp.normals @ axes.T, abs=1e-5)


def test_flat_face_is_touched_with_its_normal_and_edge_at_deepest_place():
    grasp = close(standing(BOX), at(0.0, 0.04), platform=0.0)
    assert grasp.points[-1, 2] == pytest.approx(0.08, abs=1e-5)
    assert grasp.normals[-1] == pytest.approx([0.0, 0.0, 1.0], abs=1e-3)
    aside = close(standing(BOX), at(0.0345, 0.04), platform=0.0)
    palm = aside.points[aside.fingers.index(5)]
    assert 0.0265 < palm[0] < 0.03 and palm[2] > 0.075


@pytest.mark.parametrize(
    ("pose", "hand", "platform", "fingers", "missed", "blocked"),
    [
        (at(0.0, 0.05), Hand(opening=0.1, reach=0.13), -1.0, (5,), 5, 0),
        (at(0.0, 0.0), Hand(opening=0.01), -1.0, (), 0, 6),  # inside
        (at(0.0, 0.0), HAND, 0.01, (5,), 0, 5),  # under the platform
        (at(1.0, 0.05), HAND, -1.0, (), 6, 0),
        (at(1.0, 0.99 * 0.008), HAND, 0.0, (), 1, 5),  # half a fingertip above it
        (at(1.0, 1.01 * 0.008), HAND, 0.0, (), 6, 0),
    ],
)
def test_missed_and_blocked_fingers_are_counted(pose, hand, platform, fingers, missed, blocked):
    grasp = close(BALL, pose, hand, platform=platform)
    assert (grasp.fingers, grasp.missed, grasp.blocked) == (fingers, missed, blocked)
    assert grasp.points.shape == grasp.normals.shape == (len(fingers), 3)
    if missed > 1:
        assert grasp.advance == pytest.approx(hand.reach)


def test_arm_errs_as_configured_and_each_finger_by_itself():
    effect = effect_type("pose_error")(sigma=0.2e-3, rotation=0.0)
    runs = [close(BALL, at(0.0, 0.0), HAND, effect, number=one) for one in (*range(14), 0)]
    errors = np.array([np.linalg.norm(one.points, axis=1) - 0.03 for one in runs[:-1]])
    assert errors.std() == pytest.approx(0.2e-3, rel=0.25)  # of 84 draws: 3 standard errors
    assert np.abs(np.corrcoef(errors.T) - np.eye(6)).max() < 0.8
    assert runs[0].points.tobytes() == runs[-1].points.tobytes() != runs[1].points.tobytes()


@pytest.mark.parametrize(("reach", "spacing", "most"), [(0.05, 0.012, None), (0.1, 0.015, 3)])
def test_search_places_fill_disc_from_middle_out(reach, spacing, most):
    places = np.array(search_places(reach, spacing, most))
    distances, rings = np.linalg.norm(places, axis=1), min(int(reach / spacing), most or 99)
    assert len(places) == 1 + 3 * rings * (rings + 1)
    assert distances[0] == 0.0 and (np.diff(distances) > -1e-12).all()
    assert distances[-1] == pytest.approx(rings * spacing)
    apart = np.linalg.norm(places[:, None] - places, axis=2) + np.eye(len(places))
    assert apart.min(axis=1) == pytest.approx(spacing, rel=0.06)
    assert len(search_places(0.9 * spacing, spacing)) == 1
    *poses, none = (search_pose(list(places[:2]), number, 0.1) for number in range(5))
    assert none is None  # every height of every place was tried
    heights = 2 * room.HandSettings().search_heights
    for pose, place, height in zip(poses, places[[0, 0, 1, 1]], heights, strict=True):
        assert pose.position == pytest.approx([*place, 0.1 + height])
        assert np.array_equal(pose.axes, FACING_DOWN)


def test_contacts_come_from_all_free_sides_in_few_closings():
    points, normals, closings = grasped("ball", 60)
    assert len(points) == len(normals) < 66 and closings <= 16
    ask = np.random.default_rng(0).normal(size=(500, 3))
    ask /= np.linalg.norm(ask, axis=1)[:, None]
    cosines = ask @ (points - [0.0, 0.0, 0.03]).T / 0.03
    nearest = np.arccos(np.clip(cosines, -1.0, 1.0)).min(axis=1)
    assert nearest[ask[:, 2] > 0.0].max() < math.radians(35.0)
    top = points[:1], normals[:1]  # one contact is enough to go on, and nothing else counts
    assert np.array_equal(*(next_pose(Hand(), *top, 0.0).array for _ in range(2)))
    aside = grasped("aside", 40)[0]  # an object beside the axis is found
    assert np.hypot(aside[:, 0] - 0.06, aside[:, 1]).max() < 0.0255
    apart = np.linalg.norm(aside[:, None] - aside, axis=2) + np.eye(len(aside))
    assert apart.min() > 1e-3  # no place is touched twice


def test_fingers_are_brought_near_and_touch_same_contacts():
    turn = np.linspace(0.0, 2.0 * math.pi, 20, endpoint=False)
    rim = np.column_stack([np.cos(turn), np.sin(turn), np.zeros(20)])
    points = 0.03 * rim + 0.02 * np.outer(np.sin(3 * turn), [0, 0, 1]) + [0, 0, 0.05]
    hand, pose = Hand(opening=0.12, reach=0.12), at(0.0, 0.05)
    near = room.brought_near(hand, pose, points, rim, 0.0)
    assert np.array(near.advanced[:-1]) == pytest.approx(0.12 - 0.03 - 0.02, abs=8e-3)
    assert room.brought_near(hand, pose, points[:6], rim[:6], 0.0) is hand
    ball = PosedShape(BALL, Pose(np.array([0.0, 0.0, 0.05]), np.eye(3)))
    slow, quick = close(ball, pose, hand), close(ball, pose, near)
    assert quick.points == pytest.approx(slow.points, abs=1e-6)
    assert quick.advance < slow.advance - 0.05
    assert close(BALL, at(1.0, 0.05), near).advance == pytest.approx(0.12 - min(near.advanced))


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"fingers": 0}, "fingers must be from 1 to 20, got 0"),
        ({"fingers": 21}, "fingers must be from 1 to 20, got 21"),
        ({"opening": 0.0}, "opening must be positive and finite, got 0.0 m"),
        ({"reach": math.inf}, "reach must be positive and finite, got inf m"),
        ({"advanced": (0.01,)}, "advanced must have 6 lengths or none, got 1"),
        ({"advanced": (0.0,) * 5 + (0.12,)}, "advanced must be below the reach 0.12 m, got 0.12"),
    ],
)
def test_hand_that_cannot_close_is_refused(wrong, words):
    with pytest.raises(ValueError, match=words):
        Hand(**wrong)
