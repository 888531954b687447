from __future__ import annotations

import numpy as np
import pytest

from palpate.core.arrays import Bools, Floats
from palpate.core.geometry.mesh_normals import are_outside, corner_normals, facet_sag
from palpate.core.geometry.meshes import areas_and_normals
from palpate.core.geometry.nearest import nearest_points, nearest_search
from palpate.core.shapes.protocol import Mesh
from palpate.core.shapes.tessellations import icosphere


def found(mesh: Mesh, points: Floats) -> Bools:
    nearest = nearest_points(nearest_search(mesh.vertices[mesh.faces]), points)
    return are_outside(mesh.vertices, mesh.faces, points, nearest)


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


def cylinder(count: int) -> tuple[Floats, Floats]:
    """Of radius 1 and height 2, each side a single rectangle."""
    angle = 2 * np.pi * np.arange(count) / count
    ring = np.column_stack([np.cos(angle), np.sin(angle)])
    low, high = (np.column_stack([ring, np.full(count, z)]) for z in (-1.0, 1.0))
    here, after = np.arange(count), (np.arange(count) + 1) % count
    faces = np.concatenate(
        [
            np.column_stack([here, after, after + count]),
            np.column_stack([here, after + count, here + count]),
            np.column_stack([after, here, np.full(count, 2 * count)]),
            np.column_stack([here + count, after + count, np.full(count, 2 * count + 1)]),
        ]
    )
    return np.concatenate([low, high, [[0, 0, -1], [0, 0, 1]]]), faces.astype(np.int32)


@pytest.mark.parametrize("level", [2, 3, 4])
def test_the_sag_of_a_sphere_is_its_mean_distance_from_the_facets(level: int) -> None:
    directions, faces = icosphere(level)
    corners = directions[faces]
    shares = np.random.default_rng(0).dirichlet([1, 1, 1], 200)
    off = 1.0 - np.linalg.norm(np.einsum("bi,fij->fbj", shares, corners), axis=2)
    mean = np.average(off.mean(axis=1), weights=areas_and_normals(corners)[0])
    assert facet_sag(0.05 * directions, faces) == pytest.approx(0.05 * mean, rel=0.05)


def test_a_box_has_no_sag(box: Mesh) -> None:
    assert facet_sag(box.vertices, box.faces) == pytest.approx(0.0, abs=1e-15)


def test_the_sharp_rim_of_a_cylinder_does_not_hide_the_sag_of_its_side() -> None:
    vertices, faces = cylinder(48)
    # A chord of angle 2 pi / 48 leaves its circle by two thirds of the sagitta on average.
    side = 2.0 / 3.0 * (1.0 - np.cos(np.pi / 48))
    share = 4.0 * np.pi / (4.0 * np.pi + 2.0 * np.pi)  # of the side in the area
    assert facet_sag(vertices, faces) == pytest.approx(side * share, rel=0.05)


def test_normals_are_shared_across_blunt_edges_alone(box: Mesh) -> None:
    apart = corner_normals(box.vertices, box.faces, np.radians(30))
    shared = corner_normals(box.vertices, box.faces, np.pi)
    flat = areas_and_normals(box.vertices[box.faces])[1]
    np.testing.assert_allclose(apart, np.repeat(flat[:, None], 3, axis=1), atol=1e-15)
    outwards = (box.vertices - 0.5) / np.sqrt(0.75)
    np.testing.assert_allclose(shared, outwards[box.faces], atol=1e-12)


def test_a_single_face_has_its_own_normal() -> None:
    found = corner_normals(np.eye(3), np.array([[0, 1, 2]], np.int32), np.pi)
    np.testing.assert_allclose(found, np.full((1, 3, 3), np.sqrt(1 / 3)))
