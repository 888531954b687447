from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from palpate.core.geometry.meshes import is_closed
from palpate.core.shapes.polyhedra import FEW_TRIANGLES, Polyhedron, winged_edges
from palpate.core.shapes.protocol import INSIDE, MISS

CORNERS = np.array([[x, y, z] for z in (0, 1) for y in (0, 1) for x in (0, 1)], float) * 0.06
CUBE = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]]
DOWN = np.array([0.0, 0.0, -1.0])


def prism(outline, height):
    """A polygon (n, 2) carried upwards."""
    flat = np.asarray(outline, float)
    n = len(flat)
    corners = np.concatenate([np.column_stack([flat, np.full(n, z)]) for z in (0.0, height)])
    sides = [[i, (i + 1) % n, (i + 1) % n + n, i + n] for i in range(n)]
    return corners, [list(range(n))[::-1], list(range(n, 2 * n)), *sides]


STAR = np.array(
    [[r * math.cos(a), r * math.sin(a)] for k in range(10)
     for r, a in [((0.04, 0.016)[k % 2], k * math.pi / 5)]]
)  # fmt: skip
L_SHAPE = [[0, 0], [0.04, 0], [0.04, 0.02], [0.02, 0.02], [0.02, 0.04], [0, 0.04]]


def winding(vertices, faces, points):
    """Winding number of a closed mesh about points, by solid angles (van Oosterom, 1983)."""
    a, b, c = vertices[faces].transpose(1, 0, 2)[:, None] - points[:, None]
    na, nb, nc = (np.linalg.norm(v, axis=2) for v in (a, b, c))
    above = np.einsum("nij,nij->ni", a, np.cross(b, c))
    below = na * nb * nc + (a * b).sum(2) * nc + (b * c).sum(2) * na + (c * a).sum(2) * nb
    return np.asarray(np.arctan2(above, below).sum(axis=1) / (2 * math.pi))


def test_a_cube_knows_its_volume_bounds_and_edges():
    cube = Polyhedron(CORNERS, CUBE)
    assert cube.volume == pytest.approx(0.06**3)
    assert np.allclose(cube.bounds(), [[0, 0, 0], [0.06, 0.06, 0.06]])
    assert cube.edges.genus == 0
    assert len(cube.mesh(0).faces) == len(cube.mesh(6).faces) == 12
    assert is_closed(cube.mesh(0).faces)


def test_faces_that_all_look_inwards_are_turned():
    turned = Polyhedron(CORNERS, [face[::-1] for face in CUBE])
    assert turned.volume == pytest.approx(0.06**3)
    origins = np.array([[0.01, 0.01, 0.1], [0.01, 0.01, 0.03], [0.07, 0.01, 0.1]])
    found = turned.cast(origins, DOWN, 1.0)
    assert found.tolist() == [pytest.approx(0.04, abs=1e-16), INSIDE, MISS]
    a, b, c = CORNERS[turned.edges.corners[turned.edges.begins[1] :][:3]]
    assert np.cross(b - a, c - a)[2] > 0.0  # the upper face looks up


@pytest.mark.parametrize("outline", [L_SHAPE, STAR])
def test_faces_that_are_not_convex_are_cut_right(outline):
    corners, faces = prism(outline, 0.03)
    solid = Polyhedron(corners, faces)
    flat = np.asarray(outline)
    after = np.roll(flat, -1, axis=0)
    area = 0.5 * float((flat[:, 0] * after[:, 1] - flat[:, 1] * after[:, 0]).sum())
    assert solid.volume == pytest.approx(0.03 * area)
    assert is_closed(solid.mesh(0).faces)


def test_rays_agree_with_the_winding_number_along_them():
    corners, faces = prism(STAR, 0.05)
    solid, rng = Polyhedron(corners, faces), np.random.default_rng(3)
    mesh = solid.mesh(0)
    for _ in range(4):
        towards = rng.normal(size=3)
        towards /= np.linalg.norm(towards)
        origins = rng.uniform([-0.04, -0.04, 0], [0.04, 0.04, 0.05], (30, 3))
        origins -= rng.choice([0.0, 0.1], 30)[:, None] * towards
        found = solid.cast(origins, towards, 1.0)
        started = winding(*mesh, origins) > 0.5
        assert np.array_equal(found == INSIDE, started)
        met = np.isfinite(found)
        behind = origins[met] + (found[met, None] + 1e-7) * towards
        before = origins[met] + (found[met, None] - 1e-7) * towards
        assert (winding(*mesh, before) < 0.5).all()
        assert (winding(*mesh, behind) > 0.5).mean() > 0.95  # but where an edge is grazed
        ways = rng.uniform(0.0, 0.3, 30)
        early = ways < np.where(met, found, 0.3)
        places = origins + ways[:, None] * towards
        assert (winding(*mesh, places)[early & ~started] < 0.5).all()


@given(
    turn=st.floats(-3.0, 3.0),
    scale=st.floats(0.01, 100.0),
    shift=st.tuples(*[st.floats(-1.0, 1.0)] * 3),
)
@settings(derandomize=True, deadline=None, max_examples=20)
def test_turn_scale_and_shift_carry_over(
    turn: float, scale: float, shift: tuple[float, ...]
) -> None:
    matrix = np.array(
        [[math.cos(turn), -math.sin(turn), 0], [math.sin(turn), math.cos(turn), 0], [0, 0, 1]]
    )
    moved = Polyhedron(scale * (CORNERS @ matrix.T + shift), CUBE)
    rng = np.random.default_rng(0)
    towards = np.array([0.3, -0.5, -0.8]) / np.linalg.norm([0.3, -0.5, -0.8])
    origins = rng.uniform(0.0, 0.06, (40, 3)) - 0.2 * towards
    wanted = Polyhedron(CORNERS, CUBE).cast(origins, towards, 1.0)
    found = moved.cast(scale * (origins @ matrix.T + shift), matrix @ towards, scale) / scale
    both = np.isfinite(wanted) & np.isfinite(found)
    assert (np.isfinite(wanted) == np.isfinite(found)).mean() > 0.95
    assert np.allclose(found[both], wanted[both], rtol=0, atol=1e-12)
    assert moved.volume == pytest.approx(scale**3 * 0.06**3, rel=1e-9)


def test_many_faces_are_cast_as_well():
    from palpate.core.shapes.tessellations import icosphere

    directions, faces = icosphere(3)
    assert len(faces) > FEW_TRIANGLES
    ball = Polyhedron(0.03 * directions, faces.tolist())
    found = ball.cast(np.array([[0.0, 0.0, 0.1]]), DOWN, 1.0)
    assert found[0] == pytest.approx(0.07, abs=1e-7)


def bent(corner, by):
    moved = CORNERS.copy()
    moved[corner] += by
    return moved


@pytest.mark.parametrize(
    ("vertices", "faces", "sentence"),
    [
        (CORNERS[:, :2], CUBE, r"vertices must have shape \(any, 3\)"),
        (bent(7, [math.nan, 0, 0]), CUBE, "vertices must be finite"),
        (
            bent(7, [0, 0, 0.01]),
            CUBE,
            r"faces\[1\] is not plane: vertex \d lies 0.00.* m beside it",
        ),
        (bent(7, [0, 0, -0.06]), CUBE, r"vertices\[3\] and vertices\[7\] are an edge without"),
        (
            np.concatenate([CORNERS, CORNERS + 1]),
            CUBE + [[c + 8 for c in face] for face in CUBE],
            "faces must form one surface, got 2 that do not touch",
        ),
        (CORNERS, CUBE[:5], "the surface must be closed"),
    ],
)
def test_what_is_no_polyhedron_is_refused(vertices, faces, sentence):
    with pytest.raises(ValueError, match=sentence):
        Polyhedron(vertices, faces)


def test_a_face_that_crosses_itself_or_has_no_area_is_refused():
    bow = [[0, 0], [0.04, 0.03], [0.04, 0], [0, 0.04]]
    with pytest.raises(ValueError, match=r"faces\[0\] crosses itself"):
        Polyhedron(*prism(bow, 0.03))
    line = [[0, 0], [0.02, 0], [0.04, 0]]
    with pytest.raises(ValueError, match=r"faces\[0\] has no area"):
        Polyhedron(*prism(line, 0.03))


def test_a_polyhedron_that_encloses_nothing_is_refused_however_it_lies():
    sheet = np.array([[0, 0, 0], [0.04, 0, 0.03], [0.04, 0.04, 0.07], [0, 0.04, 0.04]])
    with pytest.raises(ValueError, match="faces enclose nothing"):
        Polyhedron(sheet, [[0, 1, 2], [0, 2, 3], [0, 3, 1], [1, 3, 2]])


def test_the_function_is_the_distance_and_its_slope():
    cube = Polyhedron(CORNERS, CUBE)
    low, high = cube.enclosure()
    rng = np.random.default_rng(7)
    points = rng.uniform(low - 0.02, high + 0.02, (200, 3))
    away = np.abs(points - (low + high) / 2) - (high - low) / 2
    wanted = np.linalg.norm(np.maximum(away, 0.0), axis=1) + np.minimum(away.max(axis=1), 0.0)
    value = cube.inside_out(points, rng.normal(size=(200, 3)))[0]
    assert np.allclose(value, wanted, rtol=0, atol=1e-15)
    towards, step = rng.normal(size=(200, 3)), 1e-7
    ahead, behind = (cube.inside_out(points + s * towards, towards)[0] for s in (step, -step))
    numeric = (ahead - behind) / (2 * step)
    assert np.median(np.abs(cube.inside_out(points, towards)[1] - numeric)) < 1e-8


def test_on_a_face_the_slope_is_that_along_its_normal():
    cube = Polyhedron(CORNERS, CUBE)
    low, high = cube.enclosure()
    on_top = np.append((0.6 * low + 0.4 * high)[:2], high[2])[None]
    value, slope = cube.inside_out(on_top, np.array([[3.0, 1.0, 2.0]]))
    assert abs(value[0]) < 1e-15
    assert slope[0] == pytest.approx(2.0)


def other(faces, by):
    return [[corner + by for corner in face] for face in faces]


def frame():
    """A square ring with a square hole: 16 vertices, genus 1."""
    found = []
    for k in range(4):
        i, j = k, (k + 1) % 4
        # Corners 0 to 3 outside below, 4 to 7 inside below, and 8 more for the same above.
        found += [[i, j, j + 8, i + 8], [j + 4, i + 4, i + 12, j + 12]]
        found += [[j, i, i + 4, j + 4], [i + 8, j + 8, j + 12, i + 12]]
    return found


@pytest.fixture
def cube():
    return winged_edges(CUBE, 8)


def test_a_cube_has_its_twelve_edges_each_with_two_faces(cube):
    assert len(cube.ends) == 12
    assert cube.euler == 2
    assert (cube.genus, cube.shells) == (0, 1)
    assert (cube.faces[:, 0] != cube.faces[:, 1]).all()
    assert np.bincount(cube.faces.ravel()).tolist() == [4] * 6


def test_wings_go_around_the_faces(cube):
    for edge, (ends, faces) in enumerate(zip(cube.ends, cube.faces, strict=True)):
        for side, face in enumerate(faces):
            around = cube.edges_of_face(int(face)).tolist()
            place = around.index(edge)
            assert cube.after[edge, side] == around[(place + 1) % 4]
            assert cube.before[edge, side] == around[place - 1]
            corners = cube.corners[cube.begins[face] : cube.begins[face + 1]].tolist()
            first, last = ends if side == 0 else ends[::-1]
            assert corners[(corners.index(first) + 1) % 4] == last


def test_a_faces_edges_and_neighbours_are_told_in_order(cube):
    ends = [set(pair) for pair in cube.ends[cube.edges_of_face(2)].tolist()]
    assert ends == [{0, 1}, {1, 5}, {5, 4}, {4, 0}]
    assert cube.neighbours_of_face(2).tolist() == [0, 5, 1, 4]


def test_a_ring_has_a_hole_and_two_cubes_are_two_shells():
    ring = winged_edges(frame(), 16)
    assert (ring.euler, ring.genus, ring.shells) == (0, 1, 1)
    two = winged_edges(CUBE + other(CUBE, 8), 16)
    assert (two.euler, two.genus, two.shells) == (4, 0, 2)


def test_many_faces_hang_together():
    from palpate.core.shapes.tessellations import icosphere

    directions, faces = icosphere(4)
    ball = winged_edges(faces.tolist(), len(directions))
    assert (ball.euler, ball.shells, len(ball.ends)) == (2, 1, 7680)


@pytest.mark.parametrize(
    ("faces", "vertices", "sentence"),
    [
        ([*CUBE, [0, 1]], 8, r"faces\[6\] must have at least 3 corners, got 2"),
        ([[0, 2, 3, 9], *CUBE[1:]], 8, r"faces\[0\] names vertex 9, but there are only 8"),
        ([[0, 2, 3, -1], *CUBE[1:]], 8, r"faces\[0\] names vertex -1"),
        ([[0, 2, 2, 1], *CUBE[1:]], 8, r"faces\[0\] has the corner 2 twice"),
        (CUBE, 9, r"vertices\[8\] belongs to no face"),
        (CUBE[1:], 8, r"faces\[1\] has no neighbour at the edge from vertex 0 to 1"),
        (
            [CUBE[0][::-1], *CUBE[1:]],
            8,
            r"faces\[0\] and faces\[2\] both walk the edge from vertex 0 to 1 in this direction",
        ),
        (
            [*CUBE, *[[c and c + 7 for c in face] for face in CUBE]],
            15,
            r"vertices\[0\] joins 2 parts of the surface that only touch there",
        ),
    ],
)
def test_what_is_no_closed_surface_is_refused(faces, vertices, sentence):
    with pytest.raises(ValueError, match=sentence):
        winged_edges(faces, vertices)
