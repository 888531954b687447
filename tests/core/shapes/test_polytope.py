from __future__ import annotations

import numpy as np
from scipy.optimize import linprog

from palpate.core.shapes.polytope import polytope_box


def test_the_box_of_a_cube_is_the_cube() -> None:
    normals = np.concatenate([np.eye(3), -2.0 * np.eye(3)])
    found = polytope_box(normals, np.array([1.0, 2, 3, 8, 10, 12]))
    assert np.allclose(found, [[-4, -5, -6], [1, 2, 3]], rtol=0, atol=1e-15)


def test_boxes_agree_with_linear_programming() -> None:
    rng = np.random.default_rng(4)
    for count in (4, 5, 7, 9):
        for _ in range(6):
            normals = rng.normal(size=(count, 3)) * 10 ** rng.uniform(-2, 2, (count, 1))
            offsets = rng.uniform(0.1, 2.0, count) * np.linalg.norm(normals, axis=1)
            found = polytope_box(normals, offsets)
            for axis in range(3):
                for row, sign in ((0, 1.0), (1, -1.0)):
                    wanted = linprog(sign * np.eye(3)[axis], normals, offsets, bounds=(None, None))
                    if wanted.status == 3:  # unbounded
                        assert found[row, axis] == -sign * np.inf
                    else:
                        assert np.isclose(found[row, axis], sign * wanted.fun, rtol=1e-7)


def test_what_is_not_bounded_is_infinite() -> None:
    found = polytope_box(np.array([[0.0, 0, 2]]), np.array([3.0]))
    assert found[1, 2] == 1.5
    assert np.isinf(found).sum() == 5
    slanted = polytope_box(np.array([[0.0, 1, 1]]), np.array([1.0]))
    assert np.isinf(slanted).all()


def test_half_spaces_without_a_common_point_give_a_box_turned_over() -> None:
    found = polytope_box(np.array([[0.0, 0, 1], [0, 0, -1]]), np.array([-1.0, -1.0]))
    assert found[0, 2] > found[1, 2]
