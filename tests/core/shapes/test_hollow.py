from __future__ import annotations

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.shapes.hollow import deepest, in_one_point

PLANES = np.array([[20.0, 0, 0, 0.1], [0, 30.0, 0, -0.2], [0, 5.0, 10.0, 0.3], [10.0, 10, 10, 0]])
BOX = np.array([[-0.1, -0.1, -0.1], [0.1, 0.1, 0.1]])


def test_the_deepest_point_of_a_tilted_bowl_is_found() -> None:
    middle = np.array([0.03, -0.02, 0.071])

    def level(points: Floats) -> Floats:
        away = points - middle
        return np.asarray((away @ [5.0, 1.0, 0.0]) ** 2 + (away**2).sum(axis=1) - 1.0)

    place, least = deepest(level, BOX, PLANES)
    assert np.abs(place - middle).max() < 1e-4
    assert abs(least + 1.0) < 1e-8


def test_a_corner_of_planes_that_no_grid_meets_is_looked_at() -> None:
    corner = np.linalg.solve(PLANES[:3, :3], -PLANES[:3, 3])

    def level(points: Floats) -> Floats:
        forms = points @ PLANES[:3, :3].T + PLANES[:3, 3]
        return np.asarray((np.abs(forms) ** 0.1).sum(axis=1))

    place, least = deepest(level, BOX, PLANES)
    assert np.allclose(place, corner, rtol=0, atol=1e-15)
    assert least < 0.1


def test_planes_through_one_point_are_known() -> None:
    assert in_one_point(PLANES[:3])
    assert not in_one_point(PLANES)
    point = np.linalg.solve(PLANES[:3, :3], -PLANES[:3, 3])
    fourth = np.append(PLANES[3, :3], -PLANES[3, :3] @ point)
    assert in_one_point(np.vstack([PLANES[:3], fourth]))
