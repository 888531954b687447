import math

import numpy as np
import pytest
from scipy.linalg import expm

from palpate.core.poses import (
    FACING_DOWN,
    IDENTITY_POSE,
    compose_poses,
    inverse_pose,
    pad_rotation,
    pose_of,
    quaternion_from_matrix,
    right_jacobians,
    rotation_angle,
    rotation_matrix,
    rotations_from_vectors,
    split_pose,
    transform_points,
)

ROUNDING = 4e-15


def vector_from_rotation(matrix):
    """Rotation vector of angle 0 to pi, by way of the quaternion: no angle loses digits."""
    turn = quaternion_from_matrix(matrix)
    turn = -turn if turn[3] < 0.0 else turn
    sine = np.linalg.norm(turn[:3])
    return np.asarray(turn[:3] * (2.0 * np.arctan2(sine, turn[3]) / sine if sine > 0.0 else 2.0))


def about(axis, angle):
    """Rotation about an axis, by Rodrigues's formula."""
    x, y, z = axis / np.linalg.norm(axis)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.asarray(np.eye(3) + math.sin(angle) * cross + (1 - math.cos(angle)) * cross @ cross)


def test_a_matrix_survives_the_way_through_a_quaternion(rotations):
    for matrix in rotations(200):
        there = quaternion_from_matrix(matrix)
        assert float(there @ there) == pytest.approx(1.0, abs=ROUNDING)
        assert np.allclose(rotation_matrix(there), matrix, rtol=0, atol=ROUNDING)


@pytest.mark.parametrize("axis", [*np.eye(3), *-np.eye(3), [1, 1, 0], [1, -2, 3], [0, 1e-9, 1]])
@pytest.mark.parametrize("off", [0.0, 1e-12, -1e-8])
def test_half_turns_survive_the_way_through_a_quaternion(axis, off):
    matrix = about(np.array(axis, float), math.pi + off)
    assert np.allclose(
        rotation_matrix(quaternion_from_matrix(matrix)), matrix, rtol=0, atol=ROUNDING
    )


def test_a_quaternion_and_its_negative_are_one_rotation(rotations):
    there = quaternion_from_matrix(rotations(1)[0])
    assert np.array_equal(rotation_matrix(there), rotation_matrix(-there))


def test_a_quaternion_turns_about_its_axis():
    half = math.sin(math.pi / 4)
    turned = rotation_matrix(np.array([0.0, 0.0, half, half]))
    assert np.allclose(turned @ [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], atol=ROUNDING)


@pytest.mark.parametrize("length", [0.0, 0.999, 1.00001, math.nan, math.inf])
def test_a_quaternion_that_is_not_of_length_1_is_refused(length):
    with pytest.raises(ValueError, match="a rotation must be a quaternion of length 1, got length"):
        rotation_matrix(np.array([0.0, 0.0, 0.0, length]))


def test_a_quaternion_within_rounding_of_length_1_is_normalised():
    turned = rotation_matrix(np.array([0.5, 0.5, 0.5, 0.5]) * (1.0 + 5e-7))
    assert np.allclose(turned @ turned.T, np.eye(3), atol=ROUNDING)


def test_a_pose_after_its_inverse_is_no_motion(rotations):
    for number, matrix in enumerate(rotations(50)):
        pose = pose_of(np.array([number, -2.0, 0.3]), matrix)
        for both in (
            compose_poses(pose, inverse_pose(pose)),
            compose_poses(inverse_pose(pose), pose),
        ):
            place, axes = split_pose(both)
            assert np.allclose(place, 0.0, atol=1e-13)
            assert rotation_angle(axes, np.eye(3)) < 1e-14


def test_composing_poses_is_transforming_twice(rotations):
    first, second = rotations(2)
    outer = pose_of(np.array([0.1, 0.2, 0.3]), first)
    inner = pose_of(np.array([-0.3, 0.0, 0.1]), second)
    points = np.random.default_rng(1).normal(size=(20, 3))
    twice = transform_points(outer, transform_points(inner, points))
    assert np.allclose(
        transform_points(compose_poses(outer, inner), points), twice, rtol=0, atol=1e-14
    )


def test_the_identity_moves_nothing():
    points = np.random.default_rng(1).normal(size=(5, 3))
    assert np.array_equal(transform_points(IDENTITY_POSE, points), points)
    assert not IDENTITY_POSE.flags.writeable
    assert not FACING_DOWN.flags.writeable


@pytest.mark.parametrize("heading", [-3.0, 0.0, 0.7, math.pi, 9.0])
@pytest.mark.parametrize("tilt", [-math.pi / 2, -0.4, 0.0, 1.45, math.pi / 2])
def test_a_pad_is_right_handed_and_faces_the_surface(heading, tilt):
    axes = pad_rotation(heading, tilt)
    assert np.allclose(axes.T @ axes, np.eye(3), atol=ROUNDING)
    assert np.linalg.det(axes) == pytest.approx(1.0, abs=ROUNDING)
    away = -axes[:, 2]
    level = math.cos(tilt)
    outward = [level * math.cos(heading), level * math.sin(heading), math.sin(tilt)]
    assert np.allclose(away, outward, atol=ROUNDING)


@pytest.mark.parametrize("heading", [-2.0, 0.0, 1.0])
def test_the_pads_x_axis_leads_counter_clockwise_and_y_leads_down(heading):
    axes = pad_rotation(heading, 0.0)
    outward = np.array([math.cos(heading), math.sin(heading)])
    assert outward[0] * axes[1, 0] - outward[1] * axes[0, 0] == pytest.approx(1.0)
    assert np.allclose(axes[:, 1], [0.0, 0.0, -1.0], atol=ROUNDING)
    assert axes[2, 0] == 0.0


def test_a_pad_over_the_pole_looks_down():
    assert np.allclose(pad_rotation(0.0, math.pi / 2)[:, 2], [0, 0, -1], atol=ROUNDING)


@pytest.mark.parametrize("angle", [0.0, 1e-12, 1e-9, 1e-3, 1.0, 3.0, math.pi - 1e-9, math.pi])
def test_angles_between_rotations_keep_all_their_digits(angle, rotations):
    base = rotations(1)[0]
    turned = base @ about(np.array([1.0, -2.0, 0.5]), angle)
    # The matrices themselves are only right to a few roundings of 1.
    assert rotation_angle(base, turned) == pytest.approx(angle, rel=1e-6, abs=2e-15)


RNG = np.random.default_rng(0)
DIRECTIONS = RNG.normal(size=(40, 3))


DIRECTIONS /= np.linalg.norm(DIRECTIONS, axis=1, keepdims=True)


@pytest.mark.parametrize("angle", [0.0, 1e-300, 1e-12, 1e-3, 0.1, 1.0, 3.0, math.pi])
def test_a_vector_survives_the_way_through_a_matrix(angle):
    for vector in angle * DIRECTIONS:
        matrix = rotations_from_vectors(vector[None])[0]
        back = vector_from_rotation(matrix)
        if angle == math.pi and back @ vector < 0:
            back = -back  # the other name of the same half turn
        assert back == pytest.approx(vector, rel=1e-14, abs=4e-15)


def test_rotations_are_those_of_the_matrix_exponential():
    for vector in DIRECTIONS * RNG.uniform(0, 4, (40, 1)):
        x, y, z = vector
        cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
        assert np.allclose(rotations_from_vectors(vector[None])[0], expm(cross), rtol=0, atol=4e-14)


@pytest.mark.parametrize("angle", [0.0, 1e-12, 1e-4, 0.099, 0.101, 1.0, 3.0])
def test_the_jacobian_says_how_small_changes_turn_the_body(angle):
    vectors = angle * DIRECTIONS
    found, step = right_jacobians(vectors), 1e-6
    rotations = rotations_from_vectors(vectors)
    for axis in range(3):
        ahead, back = (
            rotations_from_vectors(vectors + way * step * np.eye(3)[axis]) for way in (1, -1)
        )
        turn = rotations.transpose(0, 2, 1) @ (ahead - back) / (2 * step)
        column = np.stack([turn[:, 2, 1], turn[:, 0, 2], turn[:, 1, 0]], axis=1)
        assert np.allclose(found[:, :, axis], column, rtol=0, atol=1e-9)


def test_the_jacobian_is_continuous_where_its_series_ends():
    below, above = (right_jacobians(angle * DIRECTIONS) for angle in (0.1 - 1e-12, 0.1 + 1e-12))
    assert np.abs(below - above).max() < 2e-12


def test_rotations_are_orthonormal_where_the_printed_matrix_is_not():
    vectors = np.random.default_rng(0).normal(size=(200, 3))
    for matrix in rotations_from_vectors(vectors):
        assert np.abs(matrix.T @ matrix - np.eye(3)).max() < 2e-15
        assert np.linalg.det(matrix) == pytest.approx(1.0, abs=2e-15)
        again = rotation_matrix(quaternion_from_matrix(matrix))
        assert np.abs(again.T @ again - np.eye(3)).max() < 2e-15
    phi, psi = 0.4, 0.3
    printed = np.array(
        [
            [math.cos(phi) * math.cos(psi), -math.sin(phi), math.cos(phi) * math.sin(psi)],
            [math.sin(phi) * math.cos(psi), math.cos(phi), math.sin(phi) * math.sin(psi)],
            [-math.sin(phi), 0.0, math.cos(psi)],  # - sin(psi) is right: Fung, 1999, (1.6)
        ]
    )
    assert np.linalg.det(printed) > 1.01


def test_no_turn_at_all_is_the_identity_and_the_least_turn_is_kept():
    assert np.array_equal(rotations_from_vectors(np.zeros((1, 3)))[0], np.eye(3))
    assert np.array_equal(right_jacobians(np.zeros((1, 3)))[0], np.eye(3))
    assert vector_from_rotation(np.eye(3)).tolist() == [0.0, 0.0, 0.0]
    small = np.array([[3e-13, -4e-13, 0.0]])
    assert vector_from_rotation(rotations_from_vectors(small)[0]) == pytest.approx(
        small[0], rel=1e-12
    )


def test_rotations_are_continuous_across_half_a_turn():
    axis = np.array([2.0, -1.0, 2.0]) / 3.0
    angles = math.pi + np.array([-1e-9, 0.0, 1e-9])
    matrices = rotations_from_vectors(angles[:, None] * axis)
    assert np.isfinite(matrices).all()
    assert np.abs(np.diff(matrices, axis=0)).max() < 3e-9
    for matrix in matrices:
        vector = vector_from_rotation(matrix)
        assert np.linalg.norm(vector) == pytest.approx(math.pi, abs=2e-9)
        assert np.abs(rotations_from_vectors(vector[None])[0] - matrix).max() < 4e-15
