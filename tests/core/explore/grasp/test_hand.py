from __future__ import annotations

import math

import numpy as np
import pytest

from palpate.core.explore.grasp.hand import FINGERTIP, Hand, fingertips
from palpate.core.frames import DOWN, compose, pad_rotation, pose_of, split_pose

HAND = Hand(fingers=4, opening=0.1, reach=0.08)
OVER = pose_of(np.array([0.01, 0.02, 0.05]), DOWN)


def test_fingers_close_towards_the_axis_and_the_palm_along_it() -> None:
    tips = fingertips(HAND, OVER, 0.0)

    for pose in tips.poses[:-1]:
        place, axes = split_pose(pose)
        assert place + HAND.opening * axes[:, 2] == pytest.approx(OVER[:3])
        assert axes[2, 2] == pytest.approx(0.0, abs=1e-12)
    place, axes = split_pose(tips.poses[-1])
    assert place == pytest.approx([0.01, 0.02, 0.15])
    assert axes[:, 2] == pytest.approx([0.0, 0.0, -1.0])


def test_fingers_are_evenly_spread() -> None:
    at = fingertips(HAND, OVER, 0.0).poses[:-1, :3]

    gaps = np.linalg.norm(at - np.roll(at, 1, axis=0), axis=1)
    assert gaps == pytest.approx(np.full(4, math.sqrt(2.0) * HAND.opening))


def test_a_moved_hand_moves_its_fingers_with_it() -> None:
    motion = pose_of(np.array([0.3, -0.1, 0.2]), pad_rotation(0.7, 0.2))
    here, there = (fingertips(HAND, pose, -9.0) for pose in (OVER, compose(motion, OVER)))

    expected = np.stack([compose(motion, pose) for pose in here.poses])
    assert there.poses[:, :3] == pytest.approx(expected[:, :3])
    assert np.abs((there.poses[:, 3:] * expected[:, 3:]).sum(axis=1)) == pytest.approx(1.0)


def test_a_finger_that_would_start_below_the_platform_stays_open() -> None:
    sideways = pose_of(np.array([0.0, 0.0, 0.05]), pad_rotation(0.0, 0.0))
    tips = fingertips(HAND, sideways, 0.0)

    below = tips.poses[:, 2] < 0.0
    assert below.any()
    assert (tips.reach[below] == 0.0).all()
    assert (tips.reach[~below] > 0.0).all()


def test_no_finger_goes_through_the_platform() -> None:
    for lean in (0.0, 0.5, 1.0):
        pose = pose_of(np.array([0.0, 0.0, 0.02]), pad_rotation(0.3, lean))
        tips = fingertips(HAND, pose, 0.0)
        along = np.stack([split_pose(tip)[1][2, 2] for tip in tips.poses])
        moved = tips.reach > 0.0
        assert (tips.poses[moved, 2] + tips.reach[moved] * along[moved] >= -1e-12).all()


def test_a_level_finger_keeps_half_its_width_above_the_platform() -> None:
    for height, free in ((FINGERTIP * 0.99, False), (FINGERTIP * 1.01, True)):
        tips = fingertips(HAND, pose_of(np.array([0.0, 0.0, height]), DOWN), 0.0)
        assert (tips.reach[:-1] > 0.0).all() == free


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"fingers": 0}, "fingers must be from 1 to 20, got 0"),
        ({"fingers": 21}, "fingers must be from 1 to 20, got 21"),
        ({"opening": 0.0}, "opening must be positive and finite, got 0.0 m"),
        ({"reach": math.inf}, "reach must be positive and finite, got inf m"),
    ],
)
def test_a_hand_that_cannot_close_is_refused(wrong: dict[str, float], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        Hand(**wrong)  # type: ignore[arg-type]
