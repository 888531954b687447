from __future__ import annotations

import numpy as np
import pytest

from palpate.core.splines.lattice import box_lattice
from palpate.core.splines.surface import deformed_normals, same_winding

RNG = np.random.default_rng(2)


def test_normals_stay_at_right_angles_to_the_surface_and_outside() -> None:
    slopes = RNG.normal(size=(100, 3, 3))
    normals = RNG.normal(size=(100, 3))
    found = deformed_normals(slopes, normals)
    tangents = np.cross(normals, RNG.normal(size=(100, 3)))
    moved = (slopes @ tangents[:, :, None])[:, :, 0]
    assert np.allclose(np.einsum("ni,ni->n", found, moved), 0.0, rtol=0, atol=1e-12)
    assert np.allclose(np.linalg.norm(found, axis=1), 1.0, rtol=0, atol=1e-14)
    outwards = np.einsum("ni,nij,nj->n", found, slopes, normals)
    assert (outwards > 0.0).all()  # also where the derivative mirrors


def test_normals_are_the_same_in_any_unit() -> None:
    slopes, normals = RNG.normal(size=(20, 3, 3)), RNG.normal(size=(20, 3))
    plain = deformed_normals(slopes, normals)
    for scale in (1e-150, 1e100):
        assert np.allclose(deformed_normals(scale * slopes, normals), plain, rtol=0, atol=1e-13)


def test_normals_are_unit_where_everything_is_squeezed_onto_a_plane_a_line_or_a_point() -> None:
    flat, line, point = np.diag([1.0, 1.0, 0.0]), np.diag([1.0, 0.0, 0.0]), np.zeros((3, 3))
    for squeezed in (flat, line, point):
        normals = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.6, 0.0, 0.8]])
        found = deformed_normals(np.broadcast_to(squeezed, (3, 3, 3)), normals)
        assert np.allclose(np.linalg.norm(found, axis=1), 1.0, rtol=0, atol=1e-14)
    found = deformed_normals(flat[None], np.array([[0.6, 0.0, 0.8]]))
    assert np.allclose(found, [[0.0, 0.0, 1.0]], rtol=0, atol=1e-8)


def test_triangles_of_a_mirrored_surface_are_turned_round() -> None:
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]])
    faces = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]], np.int32)
    assert np.array_equal(same_winding(corners, 2.0 * corners + 1e3, faces), faces)
    mirrored = same_winding(corners, corners * [-1, 1, 1], faces)
    assert np.array_equal(mirrored, faces[:, ::-1])


@pytest.mark.parametrize("scale", [1e-110, 1e-60, 1.0, 1e110])
def test_a_mirrored_mesh_is_turned_round_in_any_unit(scale: float) -> None:
    vertices = scale * np.vstack([np.zeros(3), np.eye(3)])
    faces = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]], np.int32)
    plain = box_lattice(np.zeros(3), np.full(3, scale), (4, 4, 4))
    mirrored = plain.with_control(plain.control * [1, 1, -1])
    assert np.array_equal(plain.deform_mesh(vertices, faces)[1], faces)
    assert np.array_equal(mirrored.deform_mesh(vertices, faces)[1], faces[:, ::-1])
    assert mirrored.deform_mesh(np.zeros((0, 3)), np.zeros((0, 3), np.int32))[1].shape == (0, 3)


def test_triangles_of_vertices_that_are_not_there_are_refused() -> None:
    plain = box_lattice(np.zeros(3), np.ones(3), (4, 4, 4))
    for number in (3, -1):
        with pytest.raises(ValueError, match=f"faces must name the 3 vertices, got {number}"):
            plain.deform_mesh(np.eye(3), np.array([[0, 1, number]], np.int32))
    with pytest.raises(ValueError, match=r"faces must have shape \(any, 3\), got \(1, 4\)"):
        plain.deform_mesh(np.eye(3), np.array([[0, 1, 2, 0]], np.int32))
