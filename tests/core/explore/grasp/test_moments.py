from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.explore.grasp.moments import body_of
from palpate.core.shapes.superquadric import Superquadric


def test_an_ellipsoid_has_a_fifth_of_its_squared_semi_axes(
    rotations: Callable[[int], Floats],
) -> None:
    vertices, faces = Superquadric(np.array([0.03, 0.02, 0.05]), np.ones(2)).mesh(5)
    turn = rotations(1)[0]
    body = body_of(vertices @ turn.T + [1.0, 2.0, 3.0], faces)

    assert body.volume == pytest.approx(4 / 3 * np.pi * 0.03 * 0.02 * 0.05, rel=3e-3)
    assert body.centroid == pytest.approx([1.0, 2.0, 3.0], abs=1e-9)
    assert body.spread == pytest.approx(np.square([0.02, 0.03, 0.05]) / 5.0, rel=3e-3)
    assert np.abs(body.axes.T @ turn[:, [1, 0, 2]]) == pytest.approx(np.eye(3), abs=1e-6)
    assert np.linalg.det(body.axes) == pytest.approx(1.0)


def test_a_tetrahedron_is_exact() -> None:
    vertices = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    faces = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]], np.int32)
    body = body_of(vertices, faces)

    assert (body.volume, *body.centroid) == pytest.approx((1 / 6, 0.25, 0.25, 0.25))
    assert body.spread.sum() == pytest.approx(3 * (1 / 10 - 1 / 16))


def test_a_surface_that_is_inside_out_is_not_sound() -> None:
    vertices, faces = Superquadric(np.full(3, 0.03), np.ones(2)).mesh(3)

    assert body_of(vertices, faces).sound
    assert not body_of(vertices, faces[:, ::-1]).sound
