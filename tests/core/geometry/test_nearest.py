from itertools import combinations

import numpy as np
import pytest

from palpate.core.geometry import nearest as boxes
from palpate.core.geometry.meshes import areas_and_normals, triangle_corners
from palpate.core.geometry.nearest import (
    cut_long_triangles,
    nearest_points,
    nearest_search,
    self_intersection,
)
from palpate.core.poses import rotations_from_vectors
from palpate.core.shapes.protocol import Mesh
from palpate.core.shapes.tessellations import icosphere


def slow_distance(corners, point):
    """The least distance of one point from each triangle: from its edges, and from its inside."""
    following = np.roll(corners, -1, axis=1)
    along, away = following - corners, point - corners
    square = np.einsum("nij,nij->ni", along, along)
    share = np.einsum("nij,nij->ni", away, along) / np.where(square > 0, square, 1)
    feet = corners + np.clip(share, 0, 1)[:, :, None] * along
    normal = np.cross(along[:, 0], -along[:, 2])
    length = np.linalg.norm(normal, axis=1)
    whole = length > 0
    normal, corners, along = normal[whole] / length[whole, None], corners[whole], along[whole]
    foot = point - np.einsum("ni,ni->n", point - corners[:, 0], normal)[:, None] * normal
    turns = np.einsum("nij,nj->ni", np.cross(along, foot[:, None] - corners), normal)
    inside = foot[(turns >= 0).all(axis=1)]
    return float(
        np.linalg.norm(np.concatenate([feet.reshape(-1, 3), inside]) - point, axis=1).min()
    )


def random_soup(rng, faces):
    """Triangles of sizes over three decades."""
    centres = rng.normal(size=(faces, 1, 3))
    return centres + rng.normal(size=(faces, 3, 3)) * 10 ** rng.uniform(-2.5, 0.5, (faces, 1, 1))


def long_thin(rng, faces):
    """Triangles a thousand times as long as wide, in all directions."""
    start, along = rng.normal(size=(2, faces, 3))
    across = rng.normal(size=(faces, 3)) * 1e-3
    return np.stack([start, start + along, start + 0.3 * along + across], axis=1)


def degenerate(rng, faces):
    """Triangles that are segments or points, among whole ones."""
    corners = random_soup(rng, faces)
    corners[0::4, 2] = corners[0::4, 1]
    corners[1::4, 1:] = corners[1::4, :1]
    corners[2::4, 2] = 0.25 * corners[2::4, 0] + 0.75 * corners[2::4, 1]
    return corners


@pytest.mark.parametrize("make", [random_soup, long_thin, degenerate])
@pytest.mark.parametrize("faces", [1, 2, 5, 60])
def test_distances_are_those_of_the_slow_search(make, faces):
    rng = np.random.default_rng(faces)
    corners = make(rng, faces)  # type: ignore[operator]
    queries = np.concatenate([rng.normal(size=(40, 3)) * 1.5, corners.mean(axis=1)])
    nearest = nearest_points(nearest_search(corners), queries)
    slow = [slow_distance(corners, query) for query in queries]
    # Rounding costs eps times length over width, a thousand for the thin ones.
    np.testing.assert_allclose(nearest.distances, slow, atol=1e-11, rtol=1e-12)


@pytest.mark.parametrize("make", [random_soup, long_thin, degenerate])
def test_the_point_lies_on_the_named_face_at_the_named_distance(make):
    rng = np.random.default_rng(7)
    corners = make(rng, 50)  # type: ignore[operator]
    queries = rng.normal(size=(60, 3))
    distances, points, faces = nearest_points(nearest_search(corners), queries)
    offset = np.linalg.norm(points - queries, axis=1)
    np.testing.assert_allclose(offset, distances, atol=1e-14)
    on_face = [
        slow_distance(corners[face : face + 1], point)
        for face, point in zip(faces, points, strict=True)
    ]
    assert max(on_face) < 1e-12


def test_all_queries_of_a_sphere_are_found_from_near_and_far(sphere):
    corners = triangle_corners(sphere.vertices, sphere.faces)
    rng = np.random.default_rng(8)
    directions = rng.normal(size=(300, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    # From its very middle, where every face is as near as any other, to ten radii out.
    queries = directions * np.linspace(0.0, 0.4, 300)[:, None]
    distances = nearest_points(nearest_search(corners), queries).distances
    slow = [slow_distance(corners, query) for query in queries[::30]]
    np.testing.assert_allclose(distances[::30], slow, atol=1e-15)


def test_too_many_candidates_are_taken_in_parts(sphere, monkeypatch):
    search = nearest_search(triangle_corners(sphere.vertices, sphere.faces))
    queries = np.random.default_rng(9).normal(size=(200, 3)) * 1e-3
    whole = nearest_points(search, queries)
    monkeypatch.setattr(boxes, "MOST_PAIRS", 100)
    parts = nearest_points(search, queries)
    assert parts.distances.tobytes() == whole.distances.tobytes()


@pytest.mark.parametrize("scale", [1e-3, 1e3])
def test_millimetres_and_metres_give_the_same_points(sphere, scale):
    corners = triangle_corners(sphere.vertices, sphere.faces)
    queries = np.random.default_rng(10).normal(size=(500, 3)) * 0.05
    metres = nearest_points(nearest_search(corners), queries)
    scaled = nearest_points(nearest_search(corners * scale), queries * scale)
    np.testing.assert_allclose(scaled.distances, metres.distances * scale, rtol=1e-10)
    np.testing.assert_allclose(scaled.points, metres.points * scale, atol=1e-9 * scale)


def test_a_point_on_the_surface_has_no_distance(sphere):
    corners = triangle_corners(sphere.vertices, sphere.faces)
    distances = nearest_points(nearest_search(corners), corners.reshape(-1, 3)).distances
    assert distances.max() < 1e-17


def test_two_far_apart_halves_are_both_found():
    directions, faces = icosphere(2)
    far = np.concatenate([directions, directions + np.array([100.0, 0, 0])])
    corners = triangle_corners(far, np.concatenate([faces, faces + len(directions)]))
    found = nearest_points(nearest_search(corners), np.array([[-2.0, 0, 0], [103.0, 0, 0]])).faces
    assert (found >= len(faces)).tolist() == [False, True]


def test_cutting_keeps_the_surface_and_shortens_long_faces():
    corners = long_thin(np.random.default_rng(11), 40)
    pieces, faces = cut_long_triangles(corners)
    areas = np.bincount(faces, areas_and_normals(pieces)[0])
    np.testing.assert_allclose(areas, areas_and_normals(corners)[0], rtol=1e-9)
    longest = np.linalg.norm(np.roll(pieces, -1, axis=1) - pieces, axis=2).max()
    assert longest < 0.1 * np.linalg.norm(corners[:, 1] - corners[:, 0], axis=1).max()


def test_even_faces_are_not_cut(sphere):
    corners = triangle_corners(sphere.vertices, sphere.faces)
    assert len(cut_long_triangles(corners)[0]) == len(corners)


def test_a_point_as_a_face_is_found():
    corners = np.full((1, 3, 3), 2.0)
    assert nearest_points(nearest_search(corners), np.zeros((1, 3))).distances == pytest.approx(
        12**0.5
    )


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
