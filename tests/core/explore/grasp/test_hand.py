import math

import numpy as np
import pytest

from palpate.core.explore.grasp.hand import (
    FINGERTIP,
    MARGIN,
    SEARCH_HEIGHTS,
    Hand,
    brought_near,
    contact_of,
    expected_ellipsoid,
    fingertip_starts,
    next_pose,
    search_pose,
)
from palpate.core.poses import FACING_DOWN, compose_poses, pad_rotation, pose_of, split_pose
from palpate.core.shapes.protocol import PosedShape
from palpate.core.touch.effects.arm import PoseError

TOP = np.array([[0.0, 0.0, 0.06]]), np.array([[0.0, 0.0, 1.0]])


def standing(shape, half, x=0.0):
    return PosedShape(shape, pose_of(np.array([x, 0.0, half]), np.eye(3)))


def test_the_search_goes_on_until_every_place_was_tried():
    places = [np.array([0.0, 0.0]), np.array([0.04, 0.0])]
    poses = [search_pose(places, number, 0.1) for number in range(5)]
    assert poses[-1] is None
    heights = [pose[2] - 0.1 for pose in poses[:-1] if pose is not None]
    assert heights == pytest.approx(2 * SEARCH_HEIGHTS)
    assert poses[2] is not None and poses[2][0] == 0.04


def test_a_pose_depends_on_nothing_but_the_contacts():
    one, two = (next_pose(Hand(), *TOP, 0.0) for _ in range(2))
    assert one.tobytes() == two.tobytes()


def test_one_contact_is_enough_to_go_on():
    pose = next_pose(Hand(), *TOP, 0.0)
    assert np.isfinite(pose).all()
    assert 0.0 < pose[2] < 0.1


def test_what_is_expected_reaches_down_to_the_platform(ball, grasped):
    points, normals = grasped(standing(ball, 0.03), 30)
    middle, axes, size = expected_ellipsoid(points, normals, 0.0)
    assert middle == pytest.approx([0.0, 0.0, 0.03], abs=5e-3)
    assert size == pytest.approx(np.full(3, 0.03), abs=5e-3)
    assert axes.T @ axes == pytest.approx(np.eye(3), abs=1e-12)


def test_contacts_come_from_all_sides_that_the_platform_leaves_free(ball, grasped):
    points, _ = grasped(standing(ball, 0.03), 60)
    directions = (points - [0.0, 0.0, 0.03]) / 0.03
    ask = np.random.default_rng(0).normal(size=(500, 3))
    ask /= np.linalg.norm(ask, axis=1)[:, None]
    nearest = np.arccos(np.clip(ask @ directions.T, -1.0, 1.0)).min(axis=1)
    assert nearest[ask[:, 2] > 0.0].max() < np.radians(35.0)


def test_an_object_beside_the_axis_is_found(cylinder, grasped):
    points, _ = grasped(standing(cylinder, 0.04, x=0.06), 30)
    assert np.abs(points[:, 0] - 0.06).max() < 0.0255


def test_few_closings_are_needed(cylinder, grasped):
    points, normals = grasped(standing(cylinder, 0.04), 60)
    assert len(points) == len(normals) < 66
    spread = np.linalg.norm(points[:, None] - points, axis=2) + np.eye(len(points))
    assert np.median(spread.min(axis=1)) > 5e-3


HAND = Hand(fingers=4, opening=0.1, reach=0.08)
OVER = pose_of(np.array([0.01, 0.02, 0.05]), FACING_DOWN)


def test_fingers_close_towards_the_axis_and_the_palm_along_it():
    poses, _ = fingertip_starts(HAND, OVER, 0.0)
    for pose in poses[:-1]:
        place, axes = split_pose(pose)
        assert place + HAND.opening * axes[:, 2] == pytest.approx(OVER[:3])
        assert axes[2, 2] == pytest.approx(0.0, abs=1e-12)
    place, axes = split_pose(poses[-1])
    assert place == pytest.approx([0.01, 0.02, 0.15])
    assert axes[:, 2] == pytest.approx([0.0, 0.0, -1.0])


def test_fingers_are_evenly_spread():
    at = fingertip_starts(HAND, OVER, 0.0)[0][:-1, :3]
    gaps = np.linalg.norm(at - np.roll(at, 1, axis=0), axis=1)
    assert gaps == pytest.approx(np.full(4, math.sqrt(2.0) * HAND.opening))


def test_a_moved_hand_moves_its_fingers_with_it():
    motion = pose_of(np.array([0.3, -0.1, 0.2]), pad_rotation(0.7, 0.2))
    here, there = (
        fingertip_starts(HAND, pose, -9.0)[0] for pose in (OVER, compose_poses(motion, OVER))
    )
    expected = np.stack([compose_poses(motion, pose) for pose in here])
    assert there[:, :3] == pytest.approx(expected[:, :3])
    assert np.abs((there[:, 3:] * expected[:, 3:]).sum(axis=1)) == pytest.approx(1.0)


def test_a_finger_that_would_start_below_the_platform_stays_open():
    sideways = pose_of(np.array([0.0, 0.0, 0.05]), pad_rotation(0.0, 0.0))
    poses, reach = fingertip_starts(HAND, sideways, 0.0)
    below = poses[:, 2] < 0.0
    assert below.any()
    assert (reach[below] == 0.0).all()
    assert (reach[~below] > 0.0).all()


def test_no_finger_goes_through_the_platform():
    for lean in (0.0, 0.5, 1.0):
        pose = pose_of(np.array([0.0, 0.0, 0.02]), pad_rotation(0.3, lean))
        poses, reach = fingertip_starts(HAND, pose, 0.0)
        along = np.stack([split_pose(tip)[1][2, 2] for tip in poses])
        moved = reach > 0.0
        assert (poses[moved, 2] + reach[moved] * along[moved] >= -1e-12).all()


def test_a_level_finger_keeps_half_its_width_above_the_platform():
    for height, free in ((FINGERTIP * 0.99, False), (FINGERTIP * 1.01, True)):
        _poses, reach = fingertip_starts(
            HAND, pose_of(np.array([0.0, 0.0, height]), FACING_DOWN), 0.0
        )
        assert (reach[:-1] > 0.0).all() == free


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"fingers": 0}, "fingers must be from 1 to 20, got 0"),
        ({"fingers": 21}, "fingers must be from 1 to 20, got 21"),
        ({"opening": 0.0}, "opening must be positive and finite, got 0.0 m"),
        ({"reach": math.inf}, "reach must be positive and finite, got inf m"),
    ],
)
def test_a_hand_that_cannot_close_is_refused(wrong, words):
    with pytest.raises(ValueError, match=words):
        Hand(**wrong)


CLOSING_HAND = Hand(fingers=5, opening=0.1, reach=0.1)
MIDDLE = pose_of(np.zeros(3), FACING_DOWN)


def test_contacts_of_a_ball_lie_on_it_and_their_normals_point_away(ball, close):
    grasp = close(ball, MIDDLE, CLOSING_HAND)
    assert len(grasp.points) == 6 and (grasp.missed, grasp.blocked) == (0, 0)
    assert np.linalg.norm(grasp.points, axis=1) == pytest.approx(0.03, abs=1e-7)
    assert grasp.normals == pytest.approx(grasp.points / 0.03, abs=1e-4)
    assert grasp.fingers == (0, 1, 2, 3, 4, 5)


def test_fingers_that_meet_nothing_are_counted(ball, close):
    long = Hand(opening=0.1, reach=0.13)
    grasp = close(ball, pose_of(np.array([0.0, 0.0, 0.05]), FACING_DOWN), long)
    assert grasp.fingers == (5,)
    assert (grasp.missed, grasp.blocked) == (5, 0)
    assert grasp.advance == pytest.approx(0.13)  # of those that missed


def test_fingers_that_start_inside_or_under_the_platform_are_counted_apart(ball, close):
    inside = close(ball, MIDDLE, Hand(opening=0.01))
    under = close(ball, MIDDLE, CLOSING_HAND, platform=0.01)
    assert (len(inside.points), inside.missed, inside.blocked) == (0, 0, 6)
    assert (under.fingers, under.blocked) == ((5,), 5)


def test_a_hand_that_misses_altogether_has_no_contact(ball, close):
    grasp = close(ball, pose_of(np.array([1.0, 0.0, 0.0]), FACING_DOWN), CLOSING_HAND)
    assert grasp.points.shape == grasp.normals.shape == (0, 3)
    assert grasp.missed == 6


def test_the_arm_errs_as_the_scene_says_and_each_finger_by_itself(ball, close):
    sigma = 0.2e-3
    errors = []
    for number in range(40):
        effect = PoseError(sigma=sigma, rotation=0.0)
        grasp = close(ball, MIDDLE, CLOSING_HAND, effect, number=number)
        errors.append(np.linalg.norm(grasp.points, axis=1) - 0.03)
    off = np.array(errors)
    assert off.std() == pytest.approx(sigma, rel=0.25)
    assert np.abs(np.corrcoef(off.T) - np.eye(6)).max() < 0.5


def test_closing_again_with_the_same_number_is_the_same(ball, close):
    effect = PoseError(sigma=0.2e-3)
    one, two, other = (close(ball, MIDDLE, CLOSING_HAND, effect, number=n) for n in (1, 1, 2))
    assert one.points.tobytes() == two.points.tobytes() != other.points.tobytes()


def test_a_flat_face_is_touched_with_its_normal(box, close):
    standing = PosedShape(box, pose_of(np.array([0.0, 0.0, 0.04]), np.eye(3)))
    grasp = close(
        standing, pose_of(np.array([0.0, 0.0, 0.04]), FACING_DOWN), CLOSING_HAND, platform=0.0
    )
    assert grasp.points[-1, 2] == pytest.approx(0.08, abs=1e-5)
    assert grasp.normals[-1] == pytest.approx([0.0, 0.0, 1.0], abs=1e-3)


def test_a_fingertip_that_reads_nothing_has_no_contact(flat):
    assert contact_of(flat, MIDDLE, np.zeros((16, 16)), 0.0) is None


def test_an_edge_is_met_at_its_deepest_taxel(flat):
    x, _ = flat.grid()
    pressed = np.maximum(1e-3 - np.abs(x - 0.5e-3), 0.0)
    found = contact_of(flat, pose_of(np.zeros(3), np.eye(3)), pressed, 0.0)
    assert found[0][0] == pytest.approx(0.5e-3)
    assert found[0][2] == pytest.approx(-1e-3)


def test_fingers_are_brought_near_what_is_expected_and_no_nearer():
    turn = np.linspace(0.0, 2.0 * np.pi, 20, endpoint=False)
    rim = np.column_stack([np.cos(turn), np.sin(turn), np.zeros(20)])
    points = 0.03 * rim + np.array([0.0, 0.0, 0.05]) + 0.02 * np.outer(np.sin(3 * turn), [0, 0, 1])
    hand, pose = (
        Hand(fingers=5, opening=0.12, reach=0.12),
        pose_of(np.array([0, 0, 0.05]), FACING_DOWN),
    )
    near = brought_near(hand, pose, points, rim, 0.0)
    starts, reaches = fingertip_starts(near, pose, 0.0)
    away = np.linalg.norm(starts[:-1, :2], axis=1)
    assert away == pytest.approx(0.03 + MARGIN, abs=8e-3)
    assert reaches[:-1] == pytest.approx(0.12 - np.array(near.advanced[:-1]))
    assert brought_near(hand, pose, points[:6], rim[:6], 0.0) is hand


@pytest.mark.parametrize("advanced", [(0.01,), (0.0, 0.0, 0.0, 0.0, 0.2)])
def test_fingers_brought_in_beyond_their_reach_are_refused(advanced):
    with pytest.raises(ValueError, match="advanced must"):
        Hand(fingers=4, opening=0.1, reach=0.08, advanced=advanced)
