"""Rotations that the text's formulas get wrong."""

from __future__ import annotations

import math

import numpy as np
import pytest

from palpate.core.frames import quaternion, rotation_matrix
from palpate.core.rotation import right_jacobians, rotations_of_vectors, vector_of_rotation


def test_rotations_are_orthonormal_where_the_printed_matrix_is_not() -> None:
    vectors = np.random.default_rng(0).normal(size=(200, 3))
    for matrix in rotations_of_vectors(vectors):
        assert np.abs(matrix.T @ matrix - np.eye(3)).max() < 2e-15
        assert np.linalg.det(matrix) == pytest.approx(1.0, abs=2e-15)
        again = rotation_matrix(quaternion(matrix))
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


def test_no_turn_at_all_is_the_identity_and_the_least_turn_is_kept() -> None:
    assert np.array_equal(rotations_of_vectors(np.zeros((1, 3)))[0], np.eye(3))
    assert np.array_equal(right_jacobians(np.zeros((1, 3)))[0], np.eye(3))
    assert vector_of_rotation(np.eye(3)).tolist() == [0.0, 0.0, 0.0]
    small = np.array([[3e-13, -4e-13, 0.0]])
    assert vector_of_rotation(rotations_of_vectors(small)[0]) == pytest.approx(small[0], rel=1e-12)


def test_rotations_are_continuous_across_half_a_turn() -> None:
    axis = np.array([2.0, -1.0, 2.0]) / 3.0
    angles = math.pi + np.array([-1e-9, 0.0, 1e-9])
    matrices = rotations_of_vectors(angles[:, None] * axis)
    assert np.isfinite(matrices).all()
    assert np.abs(np.diff(matrices, axis=0)).max() < 3e-9
    for matrix in matrices:
        vector = vector_of_rotation(matrix)
        assert np.linalg.norm(vector) == pytest.approx(math.pi, abs=2e-9)
        assert np.abs(rotations_of_vectors(vector[None])[0] - matrix).max() < 4e-15
