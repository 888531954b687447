from itertools import combinations

import numpy as np
import pytest

from palpate.core.geometry import join_rings, self_intersection
from palpate.core.poses import rotations_from_vectors
from palpate.core.shapes.protocol import Mesh


def together(*meshes):
    firsts = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
    faces = [mesh.faces + first for mesh, first in zip(meshes, firsts, strict=False)]
    return np.concatenate([mesh.vertices for mesh in meshes]), np.concatenate(faces)


def moved(mesh, shift, size=1.0):
    return Mesh(mesh.vertices * np.asarray(size) + np.asarray(shift), mesh.faces)


def orient(a, b, c, d):
    return float(np.dot(np.cross(b - a, c - a), d - a))


def pierces(begin, end, triangle):
    a, b, c = triangle
    if orient(a, b, c, begin) * orient(a, b, c, end) >= 0.0:
        return False
    sides = [orient(begin, end, *pair) for pair in ((a, b), (b, c), (c, a))]
    return min(sides) > 0.0 or max(sides) < 0.0


def cross(one, other):
    """One pair at a time, by the edges that go through the other's inside."""
    for first, second in ((one, other), (other, one)):
        edges = zip(first, np.roll(first, -1, axis=0), strict=True)
        if any(pierces(begin, end, second) for begin, end in edges):
            return True
    return False


@pytest.mark.parametrize("seed", range(2))
def test_triangles_thrown_together_cross_where_an_edge_goes_through_a_face(seed):
    rng = np.random.default_rng(seed)
    corners = 0.3 * rng.normal(size=(60, 3, 3)) + rng.random((60, 1, 3))
    found = self_intersection(corners.reshape(-1, 3), np.arange(180).reshape(-1, 3))
    expected = [[i, j] for i, j in combinations(range(60), 2) if cross(corners[i], corners[j])]
    assert len(expected) > 30
    assert found.faces.tolist() == expected
    assert found.count == len(expected)


def test_a_sound_surface_does_not_cross_itself(sphere, torus, box):
    for mesh in (sphere, torus, box):
        assert self_intersection(mesh.vertices, mesh.faces).count == 0


def test_two_balls_cross_along_a_circle(sphere):
    shift = np.array([0.05, 0.003, 0.001])
    found = self_intersection(*together(sphere, moved(sphere, shift)))
    assert found.count > 50
    np.testing.assert_allclose(np.linalg.norm(found.places, axis=1), 0.04, rtol=0.02)
    np.testing.assert_allclose(np.linalg.norm(found.places - shift, axis=1), 0.04, rtol=0.02)
    assert (found.faces[:, 0] < 1280).all()
    assert (found.faces[:, 1] >= 1280).all()


def test_a_box_driven_squarely_through_another_crosses_it(box):
    post = moved(box, [0.25, 0.25, -1.0], [0.5, 0.5, 3.0])
    found = self_intersection(*together(box, post))
    assert found.count > 0
    assert set(np.unique(found.places[:, 2]).round(9)) <= {0.0, 1.0}


@pytest.mark.parametrize("shift", [[1, 0, 0], [1, 1, 0], [1, 1, 1], [0.3, 0.2, 1.0]])
def test_boxes_that_only_touch_do_not_cross(box, shift):
    assert self_intersection(*together(box, moved(box, shift))).count == 0


def test_neighbours_at_a_vertex_cross_where_they_have_more_in_common():
    apex = [0.0, 0.0, 0.0]
    vertices = [apex, [2, -1, 0], [2, 1, 0], [2, 0, -1], [2, 0, 1], [-2, 0, -1], [-2, 0, 1]]
    crossing = self_intersection(vertices, [[0, 1, 2], [0, 3, 4]])
    apart = self_intersection(vertices, [[0, 1, 2], [0, 5, 6]])
    assert crossing.faces.tolist() == [[0, 1]]
    np.testing.assert_allclose(crossing.places, [[1, 0, 0]], atol=1e-12)
    assert apart.count == 0


def test_vertices_in_one_place_are_one_vertex(sphere):
    torn = sphere.vertices[sphere.faces].reshape(-1, 3)
    assert self_intersection(torn, np.arange(len(torn)).reshape(-1, 3)).count == 0


def test_a_dented_ball_that_comes_out_at_the_back_crosses_itself(sphere):
    vertices = sphere.vertices.copy()
    top = vertices[:, 2] > 0.03
    vertices[top, 2] -= 0.09
    found = self_intersection(vertices, sphere.faces)
    assert found.count > 0
    assert (np.abs(found.places) < 0.04).all()


@pytest.mark.parametrize("unit", [1e-6, 1e6])
def test_crossings_depend_on_neither_unit_nor_place(sphere, unit):
    vertices, faces = together(sphere, moved(sphere, [0.05, 0.003, 0.001]))
    turn = rotations_from_vectors(np.array([[1.0, 2.0, 3.0]]))[0]
    plain = self_intersection(vertices, faces)
    scaled = self_intersection(unit * (vertices @ turn.T + [1, 2, 3]), faces)
    np.testing.assert_array_equal(scaled.faces, plain.faces)


def test_faces_without_area_cross_nothing():
    vertices = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0.2, 0.2, -1], [0.2, 0.2, 1], [0.2, 0.2, 0]]
    assert self_intersection(vertices, [[0, 1, 2], [3, 4, 5]]).count == 0


@pytest.mark.parametrize(
    ("vertices", "faces", "words"),
    [
        (np.full((3, 3), np.nan), [[0, 1, 2]], "vertices must be finite"),
        (np.eye(3), [[0, 1, 3]], "faces must name vertices from 0 to 2, got 3"),
        (np.eye(3), [[0.0, 1.0, 2.0]], "faces must be integers"),
    ],
)
def test_what_is_no_mesh_is_refused(vertices, faces, words):
    with pytest.raises(ValueError, match=words):
        self_intersection(vertices, faces)  # type: ignore[arg-type]


def test_a_fold_within_the_plane_of_a_base_is_no_crossing():
    ring = np.column_stack([np.cos(np.arange(16) * np.pi / 8), np.sin(np.arange(16) * np.pi / 8)])
    foot, top = [np.cos(np.pi / 8) * 1.001, 0.05, 0.0], [0.1, 0.0, 1.0]
    vertices = np.concatenate([[foot], np.column_stack([ring, 0.0 * ring[:, 0]]), [top]])
    assert self_intersection(vertices, join_rings(np.array([16]))).count == 0


def test_vertices_rounded_to_single_precision_cross_nothing(torus):
    vertices = (torus.vertices + 0.3).astype(np.float32)
    assert self_intersection(vertices, torus.faces).count == 0
