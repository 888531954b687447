from __future__ import annotations

import numpy as np

from palpate.core.shapes.clip import through_box

HALF = np.array([1.0, 2.0, 3.0])


def test_a_ray_enters_at_the_last_face_and_leaves_at_the_first() -> None:
    origins = np.array([[-5.0, 0.0, 0.0], [-5.0, 1.9, 0.0], [0.5, 0.0, 0.0], [5.0, 0.0, 0.0]]).T
    starts, ends = through_box(origins, np.array([1.0, 0.0, 0.0]), HALF)
    assert np.allclose(starts[:3], [4.0, 4.0, 0.0], atol=1e-11)
    assert np.allclose(ends[:3], [6.0, 6.0, 0.5], atol=1e-11)
    assert starts[3] > ends[3]


def test_it_agrees_with_points_along_the_ray() -> None:
    rng = np.random.default_rng(0)
    for direction in rng.normal(size=(50, 3)):
        direction[rng.random(3) < 0.2] = 0.0
        origins = rng.uniform(-5, 5, (3, 40))
        starts, ends = through_box(origins, direction, HALF)
        ways = np.linspace(0.0, 20.0, 400)
        places = origins[:, :, None] + direction[:, None, None] * ways
        within = (np.abs(places) <= HALF[:, None, None]).all(axis=0)
        told = (starts[:, None] <= ways) & (ways <= ends[:, None])
        assert np.array_equal(within, told)


def test_rays_in_a_face_are_in_the_box_and_rays_beside_it_are_not() -> None:
    origins = np.array([[1.0, -9.0, 0.0], [1.0 + 1e-9, -9.0, 0.0], [-1.0, -9.0, 3.0]]).T
    for tiny in (0.0, 1e-250, -1e-250):
        starts, ends = through_box(origins, np.array([tiny, 1.0, 0.0]), HALF)
        assert (starts <= ends).tolist() == [True, False, True]
