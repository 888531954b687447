"""Polyhedra and the cutting of their faces: distances, winding, winged edges, refusals."""

import math

import numpy as np
import pytest
import trimesh

from palpate.core.arrays import Floats
from palpate.core.geometry import areas_and_normals, signed_area, solidity
from palpate.core.poses import rotations_from_vectors
from palpate.core.shapes import Polyhedron, cut_faces
from tests.core.shapes.definitions import BOX_CORNERS, BOX_FACES, DOWN

CORNERS = 0.06 * BOX_CORNERS
CUBE = BOX_FACES


def test_cube_has_its_volume_bounds_and_mesh():
    for faces in (CUBE, [face[::-1] for face in CUBE]):  # turned outwards if it must be
        cube = Polyhedron(CORNERS, faces)
        assert cube.volume == pytest.approx(0.06**3)
        assert np.allclose(cube.bounds(), [[0, 0, 0], [0.06, 0.06, 0.06]])
        assert len(cube.mesh(0).faces) == len(cube.mesh(6).faces) == 12
        assert solidity(*cube.mesh(0)).volume == pytest.approx(0.06**3)
        a, b, c = CORNERS[cube.edges.corners[cube.edges.begins[1] :][:3]]
        assert np.cross(b - a, c - a)[2] > 0.0  # the upper face looks up


def test_function_is_the_distance_with_its_slope():
    cube, rng = Polyhedron(CORNERS, CUBE), np.random.default_rng(7)
    points, towards = rng.uniform(-0.02, 0.08, (300, 3)), rng.normal(size=(300, 3))
    away = np.abs(points - 0.03) - 0.03
    wanted = np.linalg.norm(np.maximum(away, 0.0), axis=1) + np.minimum(away.max(axis=1), 0.0)
    assert np.allclose(cube.inside_out(points, towards)[0], wanted, rtol=0, atol=1e-15)
    value, slope = cube.inside_out(np.array([[0.024, 0.024, 0.06]]), np.array([[3.0, 1.0, 2.0]]))
    assert abs(value[0]) < 1e-15 and slope[0] == pytest.approx(2.0)  # on a face: its normal


def test_winged_edges_go_around_faces_in_order():
    cube = Polyhedron(CORNERS, CUBE).edges
    assert (len(cube.ends), cube.euler, cube.genus, cube.shells) == (12, 2, 0, 1)
    assert (cube.faces[:, 0] != cube.faces[:, 1]).all()
    assert np.bincount(cube.faces.ravel()).tolist() == [4] * 6
    for edge, (ends, faces) in enumerate(zip(cube.ends, cube.faces, strict=True)):
        for side, face in enumerate(faces):
            around = cube.edges_of_face(int(face)).tolist()
            place = around.index(edge)
            assert cube.after[edge, side] == around[(place + 1) % 4]
            assert cube.before[edge, side] == around[place - 1]
            corners = cube.corners[cube.begins[face] : cube.begins[face + 1]].tolist()
            first, last = ends if side == 0 else ends[::-1]
            assert corners[(corners.index(first) + 1) % 4] == last
    ends = [set(pair) for pair in cube.ends[cube.edges_of_face(2)].tolist()]
    assert ends == [{0, 1}, {1, 5}, {5, 4}, {4, 0}]
    assert cube.neighbours_of_face(2).tolist() == [0, 5, 1, 4]
    torus = trimesh.creation.torus(0.03, 0.01, 24, 12)
    ring = Polyhedron(np.array(torus.vertices), torus.faces.tolist())
    assert (ring.edges.euler, ring.edges.genus, ring.edges.shells) == (0, 1, 1)
    assert ring.volume == pytest.approx(torus.volume)
    origins = np.random.default_rng(0).uniform(-0.04, 0.04, (60, 3)) + [0.0, 0.0, 0.1]
    spans = ring.spans(origins, DOWN)[:, 0, 0]  # of over 500 faces Embree finds the first
    assert np.allclose(ring.cast(origins, DOWN, 1.0), spans, rtol=0, atol=1e-12)
    assert ring.spans(np.zeros((0, 3)), DOWN).shape == (0, 1, 2)


def bent(corner: int, *by: float) -> Floats:
    moved = CORNERS.copy()
    moved[corner] += by
    return moved


CROSSED = CORNERS[[0, 3, 2, 1, 4, 7, 6, 5]]
CROSSED[[1, 5], 1] = 0.04
SHEET = np.array([[0, 0, 0], [0.04, 0, 0.03], [0.04, 0.04, 0.07], [0, 0.04, 0.04]])
NINE = np.concatenate([CORNERS, [[1.0, 1.0, 1.0]]])
TOUCHING = np.concatenate([CORNERS, -CORNERS[1:]])


@pytest.mark.parametrize(("vertices", "faces", "sentence"), [
    (CORNERS[:, :2], CUBE, r"vertices must have shape \(any, 3\)"),
    (bent(7, math.nan, 0, 0), CUBE, "vertices must be finite"),
    (bent(7, 0, 0, 0.01), CUBE, r"faces\[1\] is not plane: vertex \d lies 0.00.* m beside it"),
    (bent(7, 0, 0, -0.06), CUBE, r"vertices\[3\] and vertices\[7\] are an edge without"),
    (np.concatenate([CORNERS, CORNERS + 1]), CUBE + [[c + 8 for c in face] for face in CUBE],
     "faces must form one surface, got 2 that do not touch"),
    (CROSSED, CUBE, r"faces\[0\] crosses itself"),
    (CORNERS @ [[1, 0, 0], [0.5, 0, 0], [0, 0, 1]], CUBE, r"faces\[0\] has no area"),
    (SHEET, [[0, 1, 2], [0, 2, 3], [0, 3, 1], [1, 3, 2]], "faces enclose nothing"),
    (CORNERS, [*CUBE, [0, 1]], r"faces\[6\] must have at least 3 corners, got 2"),
    (CORNERS, [[0, 2, 3, 9], *CUBE[1:]], r"faces\[0\] names vertex 9, but there are only 8"),
    (CORNERS, [[0, 2, 3, -1], *CUBE[1:]], r"faces\[0\] names vertex -1"),
    (CORNERS, [[0, 2, 2, 1], *CUBE[1:]], r"faces\[0\] has the corner 2 twice"),
    (NINE, CUBE, r"vertices\[8\] belongs to no face"),
    (CORNERS, CUBE[1:], r"faces\[1\] has no neighbour at the edge from vertex 0 to 1"),
    (CORNERS, CUBE[:5], "the surface must be closed"),
    (CORNERS, [CUBE[0][::-1], *CUBE[1:]],
     r"faces\[0\] and faces\[2\] both pass the edge from vertex 0 to 1 in this direction"),
    (TOUCHING, [*CUBE, *[[c and c + 7 for c in face[::-1]] for face in CUBE]],
     r"vertices\[0\] joins 2 parts of the surface that only touch there"),
])  # fmt: skip
def test_bad_polyhedra_are_refused(vertices, faces, sentence):
    with pytest.raises(ValueError, match=sentence):
        Polyhedron(vertices, faces)


@pytest.mark.parametrize("straight", [False, True])
@pytest.mark.parametrize("repeated", [False, True])
def test_simple_outlines_are_covered_once_from_any_first_corner(straight, repeated):
    rng = np.random.default_rng(5)
    for count in rng.integers(5, 30, 20):
        # Around the origin, no gap wider than half a turn: a star seen from there.
        turns = 2.0 * np.pi * (np.arange(count) + rng.uniform(0.0, 0.9, count)) / count
        around = np.column_stack([np.cos(turns), np.sin(turns)])
        outline = rng.uniform(0.1, 1.0, (count, 1)) * around
        if straight:
            middle = 0.5 * (outline + np.roll(outline, -1, axis=0))
            outline = np.stack([outline, middle], axis=1).reshape(-1, 2)
        height = np.zeros(len(outline)) if straight else 0.01 * rng.normal(size=len(outline))
        places = np.column_stack([outline, height])
        places = places @ rotations_from_vectors(rng.normal(size=(1, 3)))[0].T + rng.normal(size=3)
        places = np.roll(np.repeat(places, 1 + repeated, axis=0), rng.integers(count), axis=0)
        result = cut_faces(places, np.array([len(places)]), np.arange(len(places)))
        area, relative = signed_area(outline), 1e-9 if straight else 0.2  # it leaves its plane
        areas, normals = areas_and_normals(places[result])
        assert areas.sum() == pytest.approx(area, rel=relative)
        total = np.linalg.norm(areas @ normals)  # all turned alike
        assert total == pytest.approx(areas.sum(), rel=relative)
        assert areas.min() > 1e-9  # corners on straight edges make no flat one


def test_many_faces_are_cut_and_a_crossed_one_is_named():
    places = np.array([[0, 0, 0], [2, 2, 0], [2, 0, 0], [0, 1, 0], [1, 0.2, 0]], float)
    numbers = np.array([0, 2, 1, 0, 2, 1, 3, 0, 4, 2, 1])
    result = cut_faces(places, np.array([3, 4, 4]), numbers)
    assert areas_and_normals(places[result])[0].sum() == pytest.approx(2.0 + 3.0 + 1.8)
    only = cut_faces(places, np.array([3, 3]), np.array([0, 2, 1, 0, 1, 3]))
    assert only.tolist() == [[0, 2, 1], [0, 1, 3]]
    with pytest.raises(ValueError, match="has a face, number 2, that lies in no plane or whose"):
        cut_faces(places, np.array([3, 4]), np.array([0, 1, 2, 0, 1, 2, 3]))
