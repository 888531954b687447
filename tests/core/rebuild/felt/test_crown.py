from __future__ import annotations

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.rebuild.felt.crown import crown_height
from palpate.core.rebuild.felt.felt_ends import touched_end
from palpate.core.rebuild.felt.felt_points import FeltPoints

RADIUS, TOP, POSE = 0.08, 0.1, 1e-4
PLACES = np.array([[0.0, 0.0], [0.01, 0.0], [-0.01, 0.0], [0.0, 0.01], [0.0, -0.01]])


def domed(shifts: Floats, way: float = 1.0) -> FeltPoints:
    """Touches of a ball's top, each off along the axis."""
    x, y = (1e-3 * part.ravel() for part in np.meshgrid(*2 * (np.arange(-4.0, 5.0),)))
    parts, normals = [], []
    for place, shift in zip(PLACES, shifts, strict=False):
        at = np.column_stack([x, y]) + place
        depth = np.sqrt(RADIUS**2 - (at**2).sum(axis=1))
        normals.append(np.column_stack([at, way * depth]) / RADIUS)
        parts.append(np.column_stack([at, way * (TOP - RADIUS + depth + shift)]))
    touch = np.repeat(np.arange(len(parts), dtype=np.int32), len(x))
    points = np.concatenate([*parts, [[0.08, 0.0, -way * 0.1]]])
    normals.append(np.array([[1.0, 0.0, 0.0]]))
    return FeltPoints(points, np.concatenate(normals), np.append(touch, 0).astype(np.int32))


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_touches_beside_the_top_tell_how_high_it_is(way: float) -> None:
    felt = domed(np.zeros(5), way)
    on = np.arange(len(felt.points)) < len(felt.points) - 1
    assert crown_height(felt, on, way) == pytest.approx(TOP, abs=1e-5)


def test_the_errors_of_the_poses_average_out() -> None:
    rng = np.random.default_rng(0)
    off = []
    for _ in range(200):
        felt = domed(rng.normal(0.0, POSE, 5))
        off.append(touched_end(felt, 0.09, 1.0, POSE, None))
    errors = np.array(off, np.float64) - TOP
    assert abs(errors.mean()) < 0.15 * POSE
    assert errors.std() < 0.55 * POSE  # of the highest alone it is .67, and the mean is off by 1.2


def test_noise_that_hides_a_dome_does_not_lower_it() -> None:
    rng = np.random.default_rng(0)
    x, y = (1e-3 * part.ravel() for part in np.meshgrid(*2 * (np.arange(-5.0, 6.0),)))
    off = []
    for _ in range(60):
        parts, normals = [], []
        for place in PLACES:
            at = np.column_stack([x, y]) + place
            heights = TOP - (at**2).sum(axis=1) / 1.2 + rng.normal(0.0, POSE)
            parts.append(np.column_stack([at, heights + rng.normal(0.0, 1e-5, len(x))]))
            normals.append(np.column_stack([at / 0.6, np.ones(len(x))]))
        points = np.concatenate([*parts, [[0.08, 0.0, 0.0]]])
        touch = np.append(np.repeat(np.arange(5), len(x)), 0).astype(np.int32)
        felt = FeltPoints(points, np.concatenate([*normals, [[1.0, 0.0, 0.0]]]), touch)
        off.append(touched_end(felt, 0.09, 1.0, POSE, None))
    assert abs(np.mean(np.array(off, np.float64) - TOP)) < 0.3 * POSE


def test_two_touches_are_as_they_are() -> None:
    felt = domed(np.array([0.0, 2e-5]))
    on = np.arange(len(felt.points)) < len(felt.points) - 1
    assert crown_height(felt, on, 1.0) is None
    assert touched_end(felt, 0.09, 1.0, 1e-6, None) == pytest.approx(TOP, abs=2e-5)
