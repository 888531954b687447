from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.linalg import expm

from palpate.core.rotation import right_jacobians, rotations_of_vectors, vector_of_rotation

RNG = np.random.default_rng(0)
DIRECTIONS = RNG.normal(size=(40, 3))
DIRECTIONS /= np.linalg.norm(DIRECTIONS, axis=1, keepdims=True)


@pytest.mark.parametrize("angle", [0.0, 1e-300, 1e-12, 1e-3, 0.1, 1.0, 3.0, math.pi])
def test_a_vector_survives_the_way_through_a_matrix(angle: float) -> None:
    for vector in angle * DIRECTIONS:
        matrix = rotations_of_vectors(vector[None])[0]
        back = vector_of_rotation(matrix)
        if angle == math.pi and back @ vector < 0:
            back = -back  # the other name of the same half turn
        assert back == pytest.approx(vector, rel=1e-14, abs=4e-15)


def test_rotations_are_those_of_the_matrix_exponential() -> None:
    for vector in DIRECTIONS * RNG.uniform(0, 4, (40, 1)):
        x, y, z = vector
        cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
        assert np.allclose(rotations_of_vectors(vector[None])[0], expm(cross), rtol=0, atol=4e-14)


@pytest.mark.parametrize("angle", [0.0, 1e-12, 1e-4, 0.099, 0.101, 1.0, 3.0])
def test_the_jacobian_says_how_small_changes_turn_the_body(angle: float) -> None:
    vectors = angle * DIRECTIONS
    found, step = right_jacobians(vectors), 1e-6
    rotations = rotations_of_vectors(vectors)
    for axis in range(3):
        ahead, back = (
            rotations_of_vectors(vectors + way * step * np.eye(3)[axis]) for way in (1, -1)
        )
        turn = rotations.transpose(0, 2, 1) @ (ahead - back) / (2 * step)
        column = np.stack([turn[:, 2, 1], turn[:, 0, 2], turn[:, 1, 0]], axis=1)
        assert np.allclose(found[:, :, axis], column, rtol=0, atol=1e-9)


def test_the_jacobian_is_continuous_where_its_series_ends() -> None:
    below, above = (right_jacobians(angle * DIRECTIONS) for angle in (0.1 - 1e-12, 0.1 + 1e-12))
    assert np.abs(below - above).max() < 2e-12
