from __future__ import annotations

import numpy as np
import pytest

from palpate.core.measure.triangles import areas_and_normals, corners_of
from palpate.core.shapes.protocol import Mesh

TRIANGLE = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])


def test_a_cube_has_six_unit_sides_whose_normals_point_outwards(box: Mesh) -> None:
    corners = corners_of(box.vertices, box.faces)

    areas, normals = areas_and_normals(corners)

    np.testing.assert_array_equal(areas, 0.5)
    outwards = corners.mean(axis=1) - 0.5
    assert np.einsum("ij,ij->i", normals, outwards) == pytest.approx(0.5)


def test_a_triangle_without_area_has_no_normal() -> None:
    flat = np.array([[[0.0, 0, 0], [1, 0, 0], [2, 0, 0]]])

    areas, normals = areas_and_normals(flat)

    assert areas.tolist() == [0.0]
    assert normals.tolist() == [[0.0, 0.0, 0.0]]


@pytest.mark.parametrize(
    ("vertices", "faces", "words"),
    [
        (TRIANGLE[:, :2], [[0, 1, 2]], r"vertices must have shape \(any, 3\), got \(3, 2\)"),
        (TRIANGLE * np.nan, [[0, 1, 2]], "vertices must be finite"),
        (TRIANGLE, np.empty((0, 3), int), "at least one row, got int64 of shape"),
        (TRIANGLE, [0, 1, 2], "faces must be integers of shape"),
        (TRIANGLE, [[0, 1, 2, 0]], "faces must be integers of shape"),
        (TRIANGLE, [[0.0, 1.0, 2.0]], "faces must be integers of shape .* got float64"),
        (TRIANGLE, [[0, 1, 3]], "faces must name vertices from 0 to 2, got 3"),
        (TRIANGLE, [[0, -1, 2]], "faces must name vertices from 0 to 2, got -1"),
    ],
)
def test_what_is_no_mesh_is_refused(vertices: np.ndarray, faces: object, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        corners_of(vertices, faces)  # type: ignore[arg-type]
