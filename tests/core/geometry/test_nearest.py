import numpy as np
import pytest

from palpate.core.geometry import nearest as boxes
from palpate.core.geometry.meshes import areas_and_normals, triangle_corners
from palpate.core.geometry.nearest import (
    cut_long_triangles,
    nearest_points,
    nearest_search,
)
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
