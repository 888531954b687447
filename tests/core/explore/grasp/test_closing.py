from __future__ import annotations

import numpy as np
import pytest

from palpate.core.explore.grasp.closing import contact_of
from palpate.core.explore.grasp.hand import Hand
from palpate.core.poses import FACING_DOWN, pose_of
from palpate.core.shapes.protocol import PosedShape
from palpate.core.touch.effects.pose_error import PoseError

HAND = Hand(fingers=5, opening=0.1, reach=0.1)
MIDDLE = pose_of(np.zeros(3), FACING_DOWN)


def test_contacts_of_a_ball_lie_on_it_and_their_normals_point_away(ball, close) -> None:
    grasp = close(ball, MIDDLE, HAND)
    assert len(grasp.points) == 6 and (grasp.missed, grasp.blocked) == (0, 0)
    assert np.linalg.norm(grasp.points, axis=1) == pytest.approx(0.03, abs=1e-7)
    assert grasp.normals == pytest.approx(grasp.points / 0.03, abs=1e-4)
    assert grasp.fingers == (0, 1, 2, 3, 4, 5)


def test_fingers_that_meet_nothing_are_counted(ball, close) -> None:
    long = Hand(opening=0.1, reach=0.13)
    grasp = close(ball, pose_of(np.array([0.0, 0.0, 0.05]), FACING_DOWN), long)
    assert grasp.fingers == (5,)
    assert (grasp.missed, grasp.blocked) == (5, 0)
    assert grasp.advance == pytest.approx(0.13)  # of those that missed


def test_fingers_that_start_inside_or_under_the_platform_are_counted_apart(ball, close) -> None:
    inside = close(ball, MIDDLE, Hand(opening=0.01))
    under = close(ball, MIDDLE, HAND, platform=0.01)
    assert (len(inside.points), inside.missed, inside.blocked) == (0, 0, 6)
    assert (under.fingers, under.blocked) == ((5,), 5)


def test_a_hand_that_misses_altogether_has_no_contact(ball, close) -> None:
    grasp = close(ball, pose_of(np.array([1.0, 0.0, 0.0]), FACING_DOWN), HAND)
    assert grasp.points.shape == grasp.normals.shape == (0, 3)
    assert grasp.missed == 6


def test_the_arm_errs_as_the_scene_says_and_each_finger_by_itself(ball, close) -> None:
    sigma = 0.2e-3
    errors = []
    for number in range(40):
        effect = PoseError(sigma=sigma, rotation=0.0)
        grasp = close(ball, MIDDLE, HAND, effect, number=number)
        errors.append(np.linalg.norm(grasp.points, axis=1) - 0.03)
    off = np.array(errors)
    assert off.std() == pytest.approx(sigma, rel=0.25)
    assert np.abs(np.corrcoef(off.T) - np.eye(6)).max() < 0.5


def test_closing_again_with_the_same_number_is_the_same(ball, close) -> None:
    effect = PoseError(sigma=0.2e-3)
    one, two, other = (close(ball, MIDDLE, HAND, effect, number=n) for n in (1, 1, 2))
    assert one.points.tobytes() == two.points.tobytes() != other.points.tobytes()


def test_a_flat_face_is_felt_with_its_normal(box, close) -> None:
    standing = PosedShape(box, pose_of(np.array([0.0, 0.0, 0.04]), np.eye(3)))
    grasp = close(standing, pose_of(np.array([0.0, 0.0, 0.04]), FACING_DOWN), HAND, platform=0.0)
    assert grasp.points[-1, 2] == pytest.approx(0.08, abs=1e-5)
    assert grasp.normals[-1] == pytest.approx([0.0, 0.0, 1.0], abs=1e-3)


def test_a_fingertip_that_reads_nothing_has_no_contact(flat) -> None:
    assert contact_of(flat, MIDDLE, np.zeros((16, 16)), 0.0) is None


def test_an_edge_is_met_at_its_deepest_taxel(flat) -> None:
    x, _ = flat.grid()
    pressed = np.maximum(1e-3 - np.abs(x - 0.5e-3), 0.0)
    found = contact_of(flat, pose_of(np.zeros(3), np.eye(3)), pressed, 0.0)
    assert found is not None
    assert found.point[0] == pytest.approx(0.5e-3)
    assert found.point[2] == pytest.approx(-1e-3)
