from __future__ import annotations

import numpy as np
import pytest

from palpate.core.arrays import Bools, Floats
from palpate.core.measure.nearest import nearest_points, search_of
from palpate.core.measure.outside import outside
from palpate.core.shapes.protocol import Mesh


def found(mesh: Mesh, points: Floats) -> Bools:
    nearest = nearest_points(search_of(mesh.vertices[mesh.faces]), points)
    return outside(mesh.vertices, mesh.faces, points, nearest)


def test_points_about_a_box_are_outside_whatever_part_is_nearest(box: Mesh) -> None:
    points = np.random.default_rng(0).uniform(-1.0, 2.0, size=(5000, 3))

    expected = ((points < 0.0) | (points > 1.0)).any(axis=1)
    np.testing.assert_array_equal(found(box, points), expected)


@pytest.mark.parametrize("corner", [[0, 0, 0], [1, 1, 1], [1, 0, 1]])
def test_straight_out_of_a_corner_is_outside(box: Mesh, corner: list[float]) -> None:
    away = np.asarray(corner) - 0.5

    assert found(box, np.array([corner + 1e-6 * away])).all()
    assert not found(box, np.array([corner - 1e-6 * away])).any()


def test_the_hole_of_a_torus_is_outside(torus: Mesh) -> None:
    assert found(torus, np.zeros((1, 3))).all()
    assert not found(torus, np.array([[3.0, 0.0, 0.0]])).any()


def test_beside_a_thin_blade_the_vertex_is_judged_by_the_angles_of_its_faces() -> None:
    # Many narrow faces on one side of the tip, one wide face on the other: plain sums go wrong.
    fan = np.linspace(-0.5, 0.5, 21)
    rim = np.column_stack([np.ones(21), fan, np.full(21, 0.1)])
    vertices = np.concatenate([[[0.0, 0.0, 0.0]], rim, [[1.0, 0.0, -2.0]]])
    last = len(vertices) - 1
    upper = [[0, 1 + i, 2 + i] for i in range(20)]
    back = [[last, 2 + i, 1 + i] for i in range(20)]
    blade = Mesh(vertices, np.array([*upper, *back, [0, last, 1], [0, 21, last]], np.int32))

    before = np.array([[-0.1, 0.0, 0.3], [-0.1, 0.0, 0.0], [-0.1, 0.0, -0.3], [-0.1, 0.05, 0.02]])
    assert found(blade, before).all()
