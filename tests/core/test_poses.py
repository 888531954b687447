"""Laws of poses, rotations and their derivatives, against scipy's rotations."""

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from palpate.core import poses
from palpate.core.arrays import Floats
from palpate.core.poses import Pose

ROUNDING = 4e-15
RANDOM = Rotation.random(60, random_state=5)
UNITS = RANDOM.as_matrix()[:40, :, 0]
ANGLES = [0.0, 1e-300, 1e-12, 1e-4, 0.099, 0.101, 1.0, 3.0, math.pi - 1e-9, math.pi]


def is_rotation(matrix: Floats) -> bool:
    square = np.allclose(matrix.T @ matrix, np.eye(3), rtol=0, atol=ROUNDING)
    return square and np.linalg.det(matrix) == pytest.approx(1.0, abs=ROUNDING)


def test_matrices_and_quaternions_are_those_of_scipy():
    for turn in RANDOM:
        result = poses.quaternion_from_matrix(turn.as_matrix())
        assert abs(result @ turn.as_quat()) == pytest.approx(1.0, abs=ROUNDING)
        for sign in (1.0, -1.0, 1.0 + 5e-7):
            matrix = poses.rotation_matrix(sign * turn.as_quat())
            assert np.allclose(matrix, turn.as_matrix(), rtol=0, atol=ROUNDING)
    axes = np.array([*np.eye(3), *-np.eye(3), [1, 1, 0], [1, -2, 3], [0, 1e-9, 1]])
    half_turns = axes / np.linalg.norm(axes, axis=1, keepdims=True)
    for angle in (math.pi, math.pi + 1e-12, math.pi - 1e-8):
        for matrix in Rotation.from_rotvec(angle * half_turns).as_matrix():
            again = poses.rotation_matrix(poses.quaternion_from_matrix(matrix))
            assert np.allclose(again, matrix, rtol=0, atol=ROUNDING)


@pytest.mark.parametrize("angle", ANGLES)
def test_rotation_vectors_are_those_of_scipy(angle):
    result = poses.rotations_from_vectors(angle * UNITS)
    wanted = Rotation.from_rotvec(angle * UNITS).as_matrix()
    assert np.allclose(result, wanted, rtol=0, atol=ROUNDING)
    assert all(map(is_rotation, result))
    for base, turn, unit in zip(RANDOM.as_matrix(), result, UNITS, strict=False):
        # The matrices themselves are only right to a few roundings of 1.
        assert poses.rotation_angle(base, base @ turn) == pytest.approx(angle, rel=1e-6, abs=2e-15)
        assert np.allclose(turn @ unit, unit, rtol=0, atol=ROUNDING)
        small = poses.quaternion_from_matrix(turn)
        if angle < 1.0:  # no angle loses digits
            assert 2.0 * small[:3] == pytest.approx(2.0 * math.sin(0.5 * angle) * unit, rel=1e-12)
    if angle == 0.0:
        assert np.array_equal(result[0], np.eye(3))


@pytest.mark.parametrize("angle", [0.0, 1e-12, 1e-4, 0.099, 0.101, 1.0, 3.0])
def test_jacobians_are_those_of_finite_differences(angle):
    vectors, step = angle * UNITS, 1e-6
    result, rotations = poses.right_jacobians(vectors), poses.rotations_from_vectors(vectors)
    for axis in range(3):
        ahead, back = (
            poses.rotations_from_vectors(vectors + by * np.eye(3)[axis]) for by in (step, -step)
        )
        turn = rotations.transpose(0, 2, 1) @ (ahead - back) / (2 * step)
        column = np.stack([turn[:, 2, 1], turn[:, 0, 2], turn[:, 1, 0]], axis=1)
        assert np.allclose(result[:, :, axis], column, rtol=0, atol=1e-9)
    below, above = (poses.right_jacobians((0.1 + by) * UNITS) for by in (-1e-12, 1e-12))
    assert np.abs(below - above).max() < 2e-12  # where a series takes over


def test_poses_compose_as_transformations():
    points = np.random.default_rng(1).normal(size=(20, 3))
    for number, (first, second) in enumerate(zip(RANDOM[:30], RANDOM[30:], strict=True)):
        outer = Pose(np.array([0.1, number, 0.3]), first.as_matrix())
        inner = Pose(np.array([-0.3, 0.0, 0.1]), second.as_matrix())
        assert np.allclose(
            outer.to_outer(points), first.apply(points) + outer.position, rtol=0, atol=1e-13
        )
        twice = outer.to_outer(inner.to_outer(points))
        assert np.allclose((outer @ inner).to_outer(points), twice, rtol=0, atol=1e-13)
        assert np.allclose(outer.to_local(outer.to_outer(points)), points, rtol=0, atol=1e-13)
        for back in (outer @ outer.inverse(), outer.inverse() @ outer):
            assert np.allclose(back.position, 0.0, rtol=0, atol=1e-13)
            assert poses.rotation_angle(back.axes, np.eye(3)) < 2e-15
        again = Pose.from_array(outer.array)
        assert np.array_equal(again.position, outer.position) and len(outer.array) == 7
        assert np.allclose(again.axes, outer.axes, rtol=0, atol=ROUNDING * 4)
        ahead = outer @ Pose(np.array([0.0, 0.0, 0.02]), np.eye(3))
        assert np.allclose(outer.advanced(0.02).position, ahead.position, rtol=0, atol=1e-15)
        assert np.array_equal(outer.advanced(0.02).axes, outer.axes)
        shift, turn = [0.01, -0.02, 0.03], 0.1 * number * UNITS[number]
        moved = outer @ Pose(np.array(shift), poses.rotations_from_vectors(turn[None])[0])
        result = outer.turned(shift, turn)
        assert np.allclose(result.position, moved.position, rtol=0, atol=1e-14)
        assert np.allclose(result.axes, moved.axes, rtol=0, atol=1e-15)
    assert np.array_equal(Pose.from_array(poses.IDENTITY_POSE).to_outer(points), points)
    assert not poses.IDENTITY_POSE.flags.writeable and not poses.FACING_DOWN.flags.writeable


@pytest.mark.parametrize("heading", [-3.0, 0.0, 0.7, math.pi, 9.0])
@pytest.mark.parametrize("tilt", [-math.pi / 2, -0.4, 0.0, 1.45, math.pi / 2])
def test_pad_faces_the_surface(heading, tilt):
    axes, level = poses.pad_rotation(heading, tilt), math.cos(tilt)
    assert is_rotation(axes)
    outward = [level * math.cos(heading), level * math.sin(heading), math.sin(tilt)]
    assert np.allclose(-axes[:, 2], outward, rtol=0, atol=ROUNDING)
    # x leads along the contour, counter-clockwise; y leads down where the pad is upright.
    along = [-math.sin(heading), math.cos(heading), 0.0]
    assert np.allclose(axes[:, 0], along, rtol=0, atol=ROUNDING)
    assert axes[2, 1] == pytest.approx(-level, abs=ROUNDING)


def test_axes_lie_along_directions_and_spreads():
    for direction in [*UNITS, *np.eye(3)]:
        axes = poses.axes_along(direction)
        assert is_rotation(axes) and np.array_equal(axes[:, 2], direction)
    spread = np.random.default_rng(2).normal(size=(500, 3)) * [1.0, 4.0, 2.0]
    for turn in UNITS[:3], -UNITS[:3]:
        frame = poses.axes_along(turn[0])
        axes = poses.principal_axes(spread @ frame.T)
        assert is_rotation(axes)
        assert np.abs(axes.T @ frame) == pytest.approx(np.eye(3)[[0, 2, 1]], abs=0.1)


@pytest.mark.parametrize("length", [0.0, 0.999, 1.00001, math.nan, math.inf])
def test_quaternions_of_another_length_are_refused(length):
    with pytest.raises(ValueError, match="a rotation must be a quaternion of length 1, got length"):
        poses.rotation_matrix(np.array([0.0, 0.0, 0.0, length]))
