"""A hand that turns an object over: it rests on one of its sides, near to where it was asked."""

import numpy as np
import pytest

from palpate.core.geometry import RestingSolid
from palpate.core.poses import Pose
from palpate.core.shapes import Superquadric
from palpate.core.touch import set_down

PLATFORM = 0.02
BRICK = Superquadric(np.array([0.03, 0.02, 0.012]), np.array([0.1, 0.1])).mesh(5)
ASKED = Pose(np.array([0.0, 0.0, 0.05]), np.array([[1.0, 0, 0], [0, 0, -1.0], [0, 1.0, 0]]))
RESTING = RestingSolid(*BRICK)


def test_object_rests_on_requested_side_shifted_and_spun_freely():
    poses = [set_down(RESTING, ASKED, PLATFORM, seed, 1) for seed in range(200)]
    for pose in poses[:10]:
        heights = pose.to_outer(BRICK.vertices)[:, 2] - PLATFORM
        assert heights.min() == pytest.approx(0.0, abs=1e-12)
        assert (heights < 1e-4).sum() >= 3 and np.linalg.det(pose.axes) == pytest.approx(1.0)
        assert pose.axes[2] @ ASKED.axes[2] > np.cos(np.radians(3.0))
    places = np.array([one.position for one in poses])
    assert places[:, :2].std(axis=0) == pytest.approx(2e-3, rel=0.2)
    assert abs(places[:, :2].mean(axis=0)).max() < 6e-4
    turns = np.array([np.arctan2(one.axes[1, 0], one.axes[0, 0]) for one in poses])
    assert abs(np.exp(1j * turns).mean()) < 0.2


def test_errors_depend_on_seed_and_number_of_turn():
    one, again, other = (set_down(RESTING, ASKED, PLATFORM, 3, number) for number in (1, 1, 2))
    assert again.array == pytest.approx(one.array, abs=0.0)
    assert np.abs(other.array - again.array).max() > 1e-4
