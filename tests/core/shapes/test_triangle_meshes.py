from __future__ import annotations

import math
from importlib.util import find_spec

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from palpate.core.shapes.protocol import INSIDE, MISS, Mesh
from palpate.core.shapes.tessellations import icosphere
from palpate.core.shapes.triangle_meshes import MOST_LAYERS, CrossedMesh, TriangleShape

NO_EMBREE = find_spec("embreex") is None
BACKENDS = [False, pytest.param(True, marks=pytest.mark.skipif(NO_EMBREE, reason="no Embree here"))]
PLANE = 1e-13  # Ranges are those of the faces' planes in double precision, m


def some_rays(count):
    """Origins (64, 3) around a unit ball and a direction, from all sides."""
    rng = np.random.default_rng(7)
    rays = []
    for _ in range(count):
        direction = rng.normal(size=3)
        direction /= np.linalg.norm(direction)
        rays.append((rng.uniform(-1.2, 1.2, (64, 3)) - 3 * direction, direction))
    return rays


@pytest.mark.skipif(NO_EMBREE, reason="no Embree here")
def test_embree_and_the_z_buffer_agree(box):
    mesh = box.mesh(4)
    embree, zbuffer = TriangleShape(*mesh), TriangleShape(*mesh, embree=False)
    hits = 0
    for origins, direction in some_rays(10):
        first = embree.cast(0.05 * origins, direction, 0.4)
        second = zbuffer.cast(0.05 * origins, direction, 0.4)
        met = np.isfinite(first)
        assert np.array_equal(met, np.isfinite(second))
        assert np.allclose(first[met], second[met], rtol=0, atol=1e-9)
        hits += int(met.sum())
    assert hits > 100


@pytest.mark.parametrize("embree", BACKENDS)
def test_facets_stand_off_from_the_ball_by_no_more_than_their_sag(embree, ball):
    level = 4
    directions, faces = icosphere(level)
    facets = TriangleShape(0.03 * directions, faces, embree)
    # The farthest that a point of a face lies below the sphere.
    sag = 0.03 * (1 - np.linalg.norm(directions[faces].mean(axis=1), axis=1).min())
    for origins, direction in some_rays(5):
        exact = ball.cast(0.03 * origins, direction, 0.3)
        found = facets.cast(0.03 * origins, direction, 0.3)
        met = np.isfinite(found)
        assert np.isfinite(exact[met]).all()  # the facets lie within the ball
        place = 0.03 * origins[met] + found[met, None] * direction
        depth = 0.03 - np.linalg.norm(place, axis=1)
        assert (depth > -1e-9).all()
        assert (depth < sag + 1e-9).all()


@pytest.mark.parametrize("embree", BACKENDS)
def test_a_ray_inside_says_so_even_if_its_exit_is_out_of_reach(embree, ball):
    facets = TriangleShape(*ball.mesh(2), embree)
    origins = np.array([[0.0, 0.0, 0.0], [0.01, 0.0, -0.01]])
    assert (facets.cast(origins, np.array([0.6, 0.0, 0.8]), 1e-6) == INSIDE).all()


@pytest.mark.parametrize("embree", BACKENDS)
def test_a_ray_stops_at_its_reach_and_does_not_look_back(embree, ball):
    facets = TriangleShape(*ball.mesh(3), embree)
    origin, up = np.array([[0.0, 0.0, -0.1]]), np.array([0.0, 0.0, 1.0])
    assert facets.cast(origin, up, 0.0699)[0] == MISS
    assert facets.cast(origin, up, 0.0701)[0] == pytest.approx(0.07, abs=PLANE)
    assert facets.cast(origin, -up, 1.0)[0] == MISS
    assert facets.cast(origin + np.array([0.05, 0, 0]), up, 1.0)[0] == MISS


@pytest.mark.parametrize("embree", BACKENDS)
def test_faces_seen_edge_on_are_neither_met_nor_an_error(embree):
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], float)
    quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    faces = np.array([[q[0], q[i], q[i + 1]] for q in quads for i in (1, 2)], np.int32)
    cube = TriangleShape(corners, faces, embree)
    origins = np.array([[0.5, 0.25, -2.0], [1.25, 0.5, -2.0], [0.25, 0.5, 0.5], [0.5, 0.5, 3.0]])
    found = cube.cast(origins, np.array([0.0, 0.0, 1.0]), 5.0)
    assert found[0] == pytest.approx(2.0)
    assert found[1:].tolist() == [MISS, INSIDE, MISS]


def test_no_ray_of_the_z_buffer_slips_between_two_triangles(ball):
    directions, faces = icosphere(2)
    facets = TriangleShape(directions, faces, embree=False)
    a, b, c = directions[faces].transpose(1, 0, 2)
    targets = np.concatenate([directions, (a + b) / 2, (a + b + c) / 3])
    for direction in (np.array([0.0, 0.0, 1.0]), np.array([0.36, 0.48, 0.8])):
        in_view = targets[np.linalg.norm(np.cross(targets, direction), axis=1) < 0.9]
        assert np.isfinite(facets.cast(in_view - 3 * direction, direction, 9.0)).all()


@pytest.mark.parametrize("embree", BACKENDS)
def test_bounds_and_mesh_are_those_given(embree, box):
    mesh = box.mesh(2)
    facets = TriangleShape(*mesh, embree)
    assert facets.bounds().tolist() == [
        mesh.vertices.min(axis=0).tolist(),
        mesh.vertices.max(axis=0).tolist(),
    ]
    assert facets.mesh(0) == Mesh(*mesh)
    assert math.isclose(facets.bounds()[1, 2], 0.04)


@pytest.mark.parametrize("embree", BACKENDS)
def test_first_hits_tell_the_face_and_the_place_in_it(embree, box):
    facets = TriangleShape(*box.mesh(4), embree)
    for origins, direction in some_rays(5):
        hits = facets.first_hits(0.05 * origins, direction)
        met = np.isfinite(hits.ranges)
        assert np.array_equal(met, hits.faces >= 0)
        corners = box.mesh(4).vertices[box.mesh(4).faces[hits.faces[met]]]
        second, third = hits.weights[met].T
        weights = np.stack([1 - second - third, second, third])
        place = np.einsum("kn,nkc->nc", weights, corners)
        wanted = 0.05 * origins[met] + hits.ranges[met, None] * direction
        assert np.allclose(place, wanted, rtol=0, atol=1e-6)
        assert met.sum() > 5


@pytest.mark.parametrize("embree", BACKENDS)
def test_a_closed_mesh_has_an_inside_and_one_with_holes_has_none(embree, ball):
    vertices, faces = ball.mesh(3)
    origin, up = np.zeros((1, 3)), np.array([0.0, 0.0, 1.0])
    whole, holed = (TriangleShape(vertices, some, embree) for some in (faces, faces[1:]))
    assert (whole.closed, holed.closed) == (True, False)
    assert (whole.cast(origin, up, 1.0)[0], holed.cast(origin, up, 1.0)[0]) == (INSIDE, MISS)
    outside = np.array([[0.0, 0.0, -0.1], [0.0, 0.0, 0.1]])
    assert holed.cast(outside, up, 1.0)[0] == whole.cast(outside, up, 1.0)[0]
    assert holed.cast(outside, up, 1.0)[1] == MISS


@pytest.mark.parametrize("embree", BACKENDS)
def test_a_mesh_given_inside_out_is_turned_wherever_it_stands(embree, ball, signed_volume):
    vertices, faces = ball.mesh(3)
    for shift in (0.0, 5.0):
        for some in (faces, faces[9:]):
            right = TriangleShape(vertices + shift, some, embree)
            turned = TriangleShape(vertices + shift, some[:, ::-1], embree)
            assert (right.flipped, turned.flipped) == (False, True)
            assert np.array_equal(turned.mesh(0).faces, some)
            origins = vertices[:200] * [1, 1, 0] + [shift, shift, shift + 0.1]
            first, second = (s.cast(origins, -np.eye(3)[2], 1.0) for s in (right, turned))
            met = np.isfinite(first)
            assert np.array_equal(met, np.isfinite(second))
            assert np.allclose(first[met], second[met], rtol=0, atol=1e-9)
            assert met.sum() > 100


@pytest.mark.parametrize("embree", BACKENDS)
def test_after_many_back_faces_a_ray_gives_up(embree):
    triangle = np.array([[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [0.0, 1.0, 0.0]])
    count = MOST_LAYERS + 2
    sheets = np.concatenate([triangle + [0.0, 0.0, 0.1 * i] for i in range(count)])
    faces = np.arange(3 * count, dtype=np.int32).reshape(-1, 3)
    wall = TriangleShape(sheets, faces, embree)
    assert not wall.closed
    up = np.array([0.0, 0.0, 1.0])
    seen_from = up if (wall._normals[0] @ up) > 0 else -up
    origin = np.array([[0.0, -0.2, -1.0 if seen_from[2] > 0 else 0.1 * count]])
    hits = wall.first_hits(origin, seen_from)
    assert (hits.ranges[0], hits.faces[0]) == (MISS, -1)


H = 0.025
CORNERS = H * np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
SQUARES = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
TRIANGLES = np.array(
    [part for a, b, c, d in SQUARES for part in ((a, b, c), (a, c, d))], dtype=np.int32
)
CUBE = CrossedMesh(CORNERS, TRIANGLES)
DOWN = np.array([0.0, 0.0, -1.0])
STEPS = st.integers(-4, 4).map(lambda n: n * H / 2)


def in_cube(origin, direction):
    """Where a line is in the closed cube, by its three slabs."""
    begin, end = -np.inf, np.inf
    for place, slope in zip(origin, direction, strict=True):
        if slope == 0.0:
            if abs(place) > H:
                return np.inf, -np.inf
        else:
            ways = sorted(((-H - place) / slope, (H - place) / slope))
            begin, end = max(begin, ways[0]), min(end, ways[1])
    return begin, end


@given(st.tuples(STEPS, STEPS, STEPS), st.tuples(*[st.integers(-2, 2)] * 3).filter(any))
@settings(max_examples=50, derandomize=True, deadline=None)
def test_rays_through_corners_and_edges_count_them_once(
    place: tuple[float, float, float], towards: tuple[int, int, int]
) -> None:
    direction = np.array(towards) / np.linalg.norm(towards)
    origin = np.array(place) - 0.2 * direction
    spans = CUBE.spans(origin[None], direction)
    begin, end = in_cube(origin, direction)
    assert spans.shape == (1, 1, 2)
    flat = (np.isclose(np.abs(place), H) & (direction == 0.0)).any()  # runs along a face
    if end - begin > 1e-9 and not flat:
        assert np.allclose(spans[0, 0], [begin, end], rtol=0, atol=1e-14)
    elif np.isfinite(spans[0, 0, 0]) and not flat:
        assert spans[0, 0, 1] - spans[0, 0, 0] < 1e-15


def test_rays_at_the_corners_of_a_ball_miss_none_of_its_faces():
    vertices, faces = icosphere(3)
    ball = CrossedMesh(vertices, faces)
    rng = np.random.default_rng(0)
    for direction in rng.normal(size=(5, 3)):
        towards = direction / np.linalg.norm(direction)
        inner = vertices[np.linalg.norm(np.cross(vertices, towards), axis=1) < 0.95]
        spans = ball.spans(inner - 2.0 * (inner @ towards)[:, None] * towards, -towards)
        assert spans.shape[1] == 1
        assert np.isfinite(spans[:, 0, 1]).sum() == (inner @ towards < 0.0).sum()


def test_a_start_inside_is_told_and_what_lies_behind_is_not():
    origins = np.array([[0.0, 0.01, z] for z in (0.1, 0.01, -H, -0.1)])
    spans = CUBE.spans(origins, DOWN)[:, 0]
    assert np.allclose(spans[0], [0.075, 0.125], rtol=0, atol=1e-15)
    assert spans[1, 0] == INSIDE
    assert spans[1, 1] == pytest.approx(0.035, abs=1e-15)
    assert np.isinf(spans[2:]).all()


def test_many_rays_are_taken_in_parts_and_none_at_all_are_no_spans():
    rng = np.random.default_rng(1)
    origins = np.column_stack([rng.uniform(-0.03, 0.03, (60_000, 2)), np.full(60_000, 0.1)])
    met = np.isfinite(CUBE.spans(origins, DOWN)[:, 0, 0])
    assert np.array_equal(met, (np.abs(origins[:, :2]) < H).all(axis=1))
    assert CUBE.spans(np.zeros((0, 3)), DOWN).shape == (0, 1, 2)
