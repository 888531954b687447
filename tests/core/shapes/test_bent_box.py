from __future__ import annotations

import math

import numpy as np
import pytest

from palpate.core.shapes.bend import Bend
from palpate.core.shapes.bent_box import through_bent_box

HALF = np.array([0.02, 0.015, 0.05])
WAYS = np.linspace(0.0, 0.6, 1201)


@pytest.mark.parametrize(
    "curvature", [0.0, 1e-300, 1e-16, 1e-3, 8.0, -8.0, 31.0, 32.0, 45.0, -49.0]
)
def test_rays_are_in_the_box_just_where_they_are_when_it_is_straightened(curvature: float) -> None:
    rng = np.random.default_rng(2)
    bend = Bend(curvature)
    for number in range(60):
        direction = rng.normal(size=3)
        direction[rng.random(3) < 0.15 * (number % 3)] = 0.0
        if not direction.any():
            continue
        direction /= np.linalg.norm(direction)
        origins = rng.uniform(-0.06, 0.06, (30, 3))
        origins[:2] = np.zeros(3), [1 / curvature if abs(curvature) > 1 else 0.02, 0.0, 0.0]
        starts, ends, gaps = through_bent_box(origins.T, direction, HALF, curvature)
        told = (starts[:, None] <= WAYS) & (ends[:, None] >= WAYS)
        for begin, end in gaps:
            told &= ~((begin[:, None] < WAYS) & (end[:, None] > WAYS))
        places = origins[:, None] + WAYS[None, :, None] * direction
        straight = bend.inverse(places.reshape(-1, 3)).reshape(places.shape)
        depth = (1.0 - np.abs(straight) / HALF).min(axis=2)
        clear = np.abs(depth) > 1e-9
        assert np.array_equal(told[clear], depth[clear] > 0)


@pytest.mark.parametrize("curvature", [8.0, 40.0])
def test_no_two_gaps_of_a_ray_meet_unless_they_are_one(curvature: float) -> None:
    rng = np.random.default_rng(3)
    origins = rng.uniform(-0.1, 0.1, (200, 3))
    gaps = through_bent_box(origins.T, np.array([0.6, 0.0, 0.8]), HALF, curvature).gaps
    assert len(gaps) == (1 if curvature * HALF[2] < math.pi / 2 else 2)
    first, second = gaps[0], gaps[-1]
    same = (first[0] == second[0]) & (first[1] == second[1])
    assert (same | (first[1] < second[0]) | (second[1] < first[0])).all()
