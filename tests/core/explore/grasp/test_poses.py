from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.explore.grasp.hand import Hand
from palpate.core.explore.grasp.poses import SEARCH_HEIGHTS, expected, next_pose, search_pose
from palpate.core.frames import pose_of
from palpate.core.shapes.posed import PosedShape
from palpate.core.shapes.superquadric import Superquadric

Grasped = Callable[..., tuple[Floats, Floats]]
TOP = np.array([[0.0, 0.0, 0.06]]), np.array([[0.0, 0.0, 1.0]])


def standing(shape: Superquadric, half: float, x: float = 0.0) -> PosedShape:
    return PosedShape(shape, pose_of(np.array([x, 0.0, half]), np.eye(3)))


def test_the_search_goes_on_until_every_place_was_tried() -> None:
    places = [np.array([0.0, 0.0]), np.array([0.04, 0.0])]
    poses = [search_pose(places, number, 0.1) for number in range(5)]

    assert poses[-1] is None
    heights = [pose[2] - 0.1 for pose in poses[:-1] if pose is not None]
    assert heights == pytest.approx(2 * SEARCH_HEIGHTS)
    assert poses[2] is not None and poses[2][0] == 0.04


def test_a_pose_depends_on_nothing_but_the_contacts() -> None:
    one, two = (next_pose(Hand(), *TOP, 0.0) for _ in range(2))

    assert one.tobytes() == two.tobytes()


def test_one_contact_is_enough_to_go_on() -> None:
    pose = next_pose(Hand(), *TOP, 0.0)

    assert np.isfinite(pose).all()
    assert 0.0 < pose[2] < 0.1


def test_what_is_expected_reaches_down_to_the_platform(
    ball: Superquadric, grasped: Grasped
) -> None:
    points, normals = grasped(standing(ball, 0.03), 30)
    middle, axes, size = expected(points, normals, 0.0)

    assert middle == pytest.approx([0.0, 0.0, 0.03], abs=5e-3)
    assert size == pytest.approx(np.full(3, 0.03), abs=5e-3)
    assert axes.T @ axes == pytest.approx(np.eye(3), abs=1e-12)


def test_contacts_come_from_all_sides_that_the_platform_leaves_free(
    ball: Superquadric, grasped: Grasped
) -> None:
    points, _ = grasped(standing(ball, 0.03), 60)
    directions = (points - [0.0, 0.0, 0.03]) / 0.03

    ask = np.random.default_rng(0).normal(size=(500, 3))
    ask /= np.linalg.norm(ask, axis=1)[:, None]
    nearest = np.arccos(np.clip(ask @ directions.T, -1.0, 1.0)).min(axis=1)
    assert nearest[ask[:, 2] > 0.0].max() < np.radians(35.0)


def test_an_object_beside_the_axis_is_found(cylinder: Superquadric, grasped: Grasped) -> None:
    points, _ = grasped(standing(cylinder, 0.04, x=0.06), 30)

    assert np.abs(points[:, 0] - 0.06).max() < 0.0255


def test_few_closings_are_needed(cylinder: Superquadric, grasped: Grasped) -> None:
    points, normals = grasped(standing(cylinder, 0.04), 60)

    assert len(points) == len(normals) < 66
    spread = np.linalg.norm(points[:, None] - points, axis=2) + np.eye(len(points))
    assert np.median(spread.min(axis=1)) > 5e-3
