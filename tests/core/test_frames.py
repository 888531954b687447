from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.frames import (
    DOWN,
    IDENTITY,
    compose,
    inverse,
    pad_rotation,
    pose_of,
    quaternion,
    rotation_matrix,
    split_pose,
    transform,
    turn_angle,
)

Draw = Callable[[int], Floats]
ROUNDING = 4e-15


def about(axis: Floats, angle: float) -> Floats:
    """Rotation about an axis, by Rodrigues's formula."""
    x, y, z = axis / np.linalg.norm(axis)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.asarray(np.eye(3) + math.sin(angle) * cross + (1 - math.cos(angle)) * cross @ cross)


def test_a_matrix_survives_the_way_through_a_quaternion(rotations: Draw) -> None:
    for matrix in rotations(200):
        there = quaternion(matrix)
        assert float(there @ there) == pytest.approx(1.0, abs=ROUNDING)
        assert np.allclose(rotation_matrix(there), matrix, rtol=0, atol=ROUNDING)


@pytest.mark.parametrize("axis", [*np.eye(3), *-np.eye(3), [1, 1, 0], [1, -2, 3], [0, 1e-9, 1]])
@pytest.mark.parametrize("off", [0.0, 1e-12, -1e-8])
def test_half_turns_survive_the_way_through_a_quaternion(axis: Floats, off: float) -> None:
    matrix = about(np.array(axis, float), math.pi + off)
    assert np.allclose(rotation_matrix(quaternion(matrix)), matrix, rtol=0, atol=ROUNDING)


def test_a_quaternion_and_its_negative_are_one_rotation(rotations: Draw) -> None:
    there = quaternion(rotations(1)[0])
    assert np.array_equal(rotation_matrix(there), rotation_matrix(-there))


def test_a_quaternion_turns_about_its_axis() -> None:
    half = math.sin(math.pi / 4)
    turned = rotation_matrix(np.array([0.0, 0.0, half, half]))
    assert np.allclose(turned @ [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], atol=ROUNDING)


@pytest.mark.parametrize("length", [0.0, 0.999, 1.00001, math.nan, math.inf])
def test_a_quaternion_that_is_not_of_length_1_is_refused(length: float) -> None:
    with pytest.raises(ValueError, match="a rotation must be a quaternion of length 1, got length"):
        rotation_matrix(np.array([0.0, 0.0, 0.0, length]))


def test_a_quaternion_within_rounding_of_length_1_is_normalised() -> None:
    turned = rotation_matrix(np.array([0.5, 0.5, 0.5, 0.5]) * (1.0 + 5e-7))
    assert np.allclose(turned @ turned.T, np.eye(3), atol=ROUNDING)


def test_a_pose_after_its_inverse_is_no_motion(rotations: Draw) -> None:
    for number, matrix in enumerate(rotations(50)):
        pose = pose_of(np.array([number, -2.0, 0.3]), matrix)
        for both in (compose(pose, inverse(pose)), compose(inverse(pose), pose)):
            place, axes = split_pose(both)
            assert np.allclose(place, 0.0, atol=1e-13)
            assert turn_angle(axes, np.eye(3)) < 1e-14


def test_composing_poses_is_transforming_twice(rotations: Draw) -> None:
    first, second = rotations(2)
    outer = pose_of(np.array([0.1, 0.2, 0.3]), first)
    inner = pose_of(np.array([-0.3, 0.0, 0.1]), second)
    points = np.random.default_rng(1).normal(size=(20, 3))
    twice = transform(outer, transform(inner, points))
    assert np.allclose(transform(compose(outer, inner), points), twice, rtol=0, atol=1e-14)


def test_the_identity_moves_nothing() -> None:
    points = np.random.default_rng(1).normal(size=(5, 3))
    assert np.array_equal(transform(IDENTITY, points), points)
    assert not IDENTITY.flags.writeable
    assert not DOWN.flags.writeable


@pytest.mark.parametrize("heading", [-3.0, 0.0, 0.7, math.pi, 9.0])
@pytest.mark.parametrize("tilt", [-math.pi / 2, -0.4, 0.0, 1.45, math.pi / 2])
def test_a_pad_is_right_handed_and_faces_the_surface(heading: float, tilt: float) -> None:
    axes = pad_rotation(heading, tilt)
    assert np.allclose(axes.T @ axes, np.eye(3), atol=ROUNDING)
    assert np.linalg.det(axes) == pytest.approx(1.0, abs=ROUNDING)
    away = -axes[:, 2]
    level = math.cos(tilt)
    outward = [level * math.cos(heading), level * math.sin(heading), math.sin(tilt)]
    assert np.allclose(away, outward, atol=ROUNDING)


@pytest.mark.parametrize("heading", [-2.0, 0.0, 1.0])
def test_the_pads_x_axis_leads_counter_clockwise_and_y_leads_down(heading: float) -> None:
    axes = pad_rotation(heading, 0.0)
    outward = np.array([math.cos(heading), math.sin(heading)])
    assert outward[0] * axes[1, 0] - outward[1] * axes[0, 0] == pytest.approx(1.0)
    assert np.allclose(axes[:, 1], [0.0, 0.0, -1.0], atol=ROUNDING)
    assert axes[2, 0] == 0.0


def test_a_pad_over_the_pole_looks_down() -> None:
    assert np.allclose(pad_rotation(0.0, math.pi / 2)[:, 2], [0, 0, -1], atol=ROUNDING)


@pytest.mark.parametrize("angle", [0.0, 1e-12, 1e-9, 1e-3, 1.0, 3.0, math.pi - 1e-9, math.pi])
def test_angles_between_rotations_keep_all_their_digits(angle: float, rotations: Draw) -> None:
    base = rotations(1)[0]
    turned = base @ about(np.array([1.0, -2.0, 0.5]), angle)
    # The matrices themselves are only right to a few roundings of 1.
    assert turn_angle(base, turned) == pytest.approx(angle, rel=1e-6, abs=2e-15)
