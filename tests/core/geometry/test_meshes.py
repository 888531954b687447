"""Laws of triangle meshes: solidity, rings, normals, sides, sag, self-intersection."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from palpate.core import geometry
from palpate.core.arrays import Floats, Ints
from palpate.core.shapes import Mesh
from tests.core.geometry.bodies import BOX, SPHERE, TORUS, ball, joined, moved

EXACT = 1e-12


SECOND = BOX.faces + 8
# Two cubes with an edge in common: four faces at one edge.
EDGE = np.where(BOX.faces == 0, 6, np.where(BOX.faces == 1, 7, SECOND))
DOUBLED_EDGE = joined(BOX, moved(BOX, [1.0, 1.0, 0.0]))._replace(
    faces=np.concatenate([BOX.faces, EDGE])
)
# Two cubes that touch in a vertex, which both name.
CORNER = np.where(BOX.faces == 0, 7, SECOND)
COMMON_VERTEX = joined(BOX, moved(BOX, 1.0))._replace(faces=np.concatenate([BOX.faces, CORNER]))


def flipped(face: int) -> Ints:
    faces = BOX.faces.copy()
    faces[face] = faces[face, ::-1]
    return faces


SECTION = 20 / 2 * np.sin(2 * np.pi / 20)  # Area of the torus's section
FACES = BOX.faces


@pytest.mark.parametrize(("mesh", "watertight", "components", "genus", "volume"), [
    (BOX, True, 1, 0, 1.0),
    (moved(BOX, 1e6), True, 1, 0, 1.0),
    (Mesh(BOX.vertices, FACES[:, ::-1]), True, 1, 0, -1.0),
    (Mesh(np.vstack([BOX.vertices, [9.0] * 3]), FACES), True, 1, 0, 1.0),
    (TORUS, True, 1, 1, 2 * np.pi * 3 * SECTION),
    (Mesh(TORUS.vertices, np.random.default_rng(0).permutation(TORUS.faces)), True, 1, 1, None),
    (joined(TORUS, moved(TORUS, 10.0), BOX), True, 3, 2, None),
    (COMMON_VERTEX, True, 2, 0, 2.0),
    (Mesh(BOX.vertices, FACES[1:]), False, 1, None, None),
    (joined(Mesh(BOX.vertices, FACES[1:]), moved(TORUS, 9.0), BOX), False, 3, None, None),
    (Mesh(BOX.vertices, flipped(3)), False, 1, None, None),
    (Mesh(BOX.vertices, np.concatenate([FACES, FACES[:1]])), False, 1, None, None),
    (DOUBLED_EDGE, False, 1, None, 2.0),
    (Mesh(np.eye(3), np.array([[0, 1, 1], [1, 0, 0]])), False, 1, None, 0.0),
])  # fmt: skip
def test_solidity_of_known_meshes(mesh, watertight, components, genus, volume):
    result = geometry.solidity(*mesh)
    assert result[:3] == (watertight, components, genus)
    assert volume is None or result.volume == pytest.approx(volume, rel=0.01 if genus else 1e-9)
    assert geometry.is_closed(mesh.faces) == watertight
    paired = geometry.face_edges(mesh.faces).counts
    assert geometry.has_paired_edges(mesh.faces) == (paired == 2).all()


def test_edges_are_listed_once_each():
    for mesh, genus in ((BOX, 0), (SPHERE, 0), (TORUS, 1)):
        edges = geometry.face_edges(mesh.faces)
        assert len(mesh.vertices) - len(edges.ends) + len(mesh.faces) == 2 - 2 * genus
        assert (edges.ends[:, 0] < edges.ends[:, 1]).all() and (edges.counts == 2).all()
        ends = np.sort(np.stack([mesh.faces, np.roll(mesh.faces, -1, axis=1)], axis=2), axis=2)
        assert np.array_equal(edges.ends[edges.numbers], ends)
    assert not geometry.has_paired_edges(FACES[1:]) and geometry.has_paired_edges(flipped(3))
    fin = np.concatenate([FACES, [[0, 1, 8]]]).astype(np.int32)
    assert geometry.face_edges(fin).counts.max() == 3 and not geometry.is_closed(fin)
    assert not geometry.is_closed(FACES[:0]) and not geometry.has_paired_edges(FACES[:0])


@pytest.mark.parametrize(
    "sizes", [[3], [8, 8], [4, 8, 16, 16, 8, 4], [16, 8], [8, 16], [12, 6, 3, 6, 12]]
)
def test_rings_of_half_or_twice_as_many_points_are_joined(sizes):
    rings = [[[0.0, 0.0, 0.0]]]
    for height, size in enumerate(sizes, 1):
        angle = 2 * np.pi * np.arange(size) / size
        rings.append(np.column_stack([np.cos(angle), np.sin(angle), np.full(size, height)]))
    top = [[0.0, 0.0, len(sizes) + 1.0]]
    vertices = np.concatenate([*rings, top])
    if len(set(sizes)) == 1:
        closed = geometry.close_rings(np.zeros(3), np.stack(rings[1:]), np.array(top[0]))
        assert np.array_equal(closed[0], vertices)
        assert np.array_equal(closed[1], geometry.join_rings(np.array(sizes)))
        area = 0.5 * sizes[0] * np.sin(2 * np.pi / sizes[0])
        assert geometry.solidity(*closed).volume == pytest.approx(area * (len(sizes) - 1 + 2 / 3))
    result = geometry.solidity(vertices, geometry.join_rings(np.array(sizes)))
    assert result[:3] == (True, 1, 0) and result.volume > 0.0
    assert geometry.self_intersection(vertices, geometry.join_rings(np.array(sizes))).count == 0


def is_outside(mesh: Mesh, points: Floats) -> Floats:
    nearest = geometry.nearest_points(geometry.nearest_search(mesh.vertices[mesh.faces]), points)
    return geometry.are_outside(mesh.vertices, mesh.faces, points, nearest)


def test_sides_of_a_box_and_a_torus_are_known():
    points = np.random.default_rng(0).uniform(-1.0, 2.0, size=(2000, 3))
    wanted = ((points < 0.0) | (points > 1.0)).any(axis=1)
    assert np.array_equal(is_outside(BOX, points), wanted)
    for corner in ([0, 0, 0], [1, 1, 1], [1, 0, 1]):
        away = np.asarray(corner) - 0.5
        both = np.array([corner + 1e-6 * away, corner - 1e-6 * away])
        assert is_outside(BOX, both).tolist() == [True, False]
    assert is_outside(TORUS, np.array([[0.0, 0, 0], [3.0, 0, 0]])).tolist() == [True, False]


def test_sides_of_a_blade_need_the_angles_of_its_faces():
    # Many narrow faces on one side of the tip, one wide face on the other: plain sums go wrong.
    rim = np.column_stack([np.ones(21), np.linspace(-0.5, 0.5, 21), np.full(21, 0.1)])
    vertices = np.concatenate([[[0.0, 0.0, 0.0]], rim, [[1.0, 0.0, -2.0]]])
    upper = [[0, 1 + i, 2 + i] for i in range(20)]
    back = [[22, 2 + i, 1 + i] for i in range(20)]
    blade = Mesh(vertices, np.array([*upper, *back, [0, 22, 1], [0, 21, 22]], np.int32))
    before = np.array([[-0.1, 0.0, 0.3], [-0.1, 0.0, 0.0], [-0.1, 0.0, -0.3], [-0.1, 0.05, 0.02]])
    assert is_outside(blade, before).all()


@pytest.mark.parametrize("level", [2, 3, 4])
def test_sag_of_a_sphere_is_its_mean_distance(level):
    directions, faces = ball(1.0, level)
    shares = np.random.default_rng(0).dirichlet([1, 1, 1], 200)
    off = 1.0 - np.linalg.norm(np.einsum("bi,fij->fbj", shares, directions[faces]), axis=2)
    mean = np.average(off.mean(axis=1), weights=geometry.areas_and_normals(directions[faces])[0])
    assert geometry.facet_sag(0.05 * directions, faces) == pytest.approx(0.05 * mean, rel=0.05)
    assert geometry.facet_sag(*BOX) == pytest.approx(0.0, abs=1e-15)  # sharp edges have none


def test_corner_normals_are_shared_across_blunt_edges():
    areas, flat = geometry.areas_and_normals(BOX.vertices[FACES])
    assert (areas == 0.5).all()
    point = geometry.areas_and_normals(np.array([[[0.0, 0, 0], [1, 0, 0], [2, 0, 0]]]))
    assert not point[0].any() and not point[1].any()
    apart = geometry.corner_normals(*BOX, np.radians(30))
    assert np.allclose(apart, np.repeat(flat[:, None], 3, axis=1), atol=1e-15)
    shared = geometry.corner_normals(*BOX, np.pi)
    assert np.allclose(shared, ((BOX.vertices - 0.5) / np.sqrt(0.75))[FACES], atol=EXACT)
    alone = geometry.corner_normals(np.eye(3), np.array([[0, 1, 2]], np.int32), np.pi)
    assert np.allclose(alone, np.sqrt(1 / 3))
    corners = SPHERE.vertices[SPHERE.faces]
    smooth = geometry.corner_normals(*SPHERE, np.pi)
    assert np.allclose(smooth, corners / 0.04, atol=0.01)  # facets turn by 0.14 rad
    for shares in ([1.0, 0.0, 0.0], [0.25, 0.25, 0.5]):  # at vertices, and inside faces
        near = geometry.nearest_points(
            geometry.nearest_search(corners), np.einsum("j,mjk->mk", shares, corners)
        )
        between = np.einsum("j,mjk->mk", shares, smooth)
        between /= np.linalg.norm(between, axis=1, keepdims=True)
        assert np.allclose(geometry.normals_at(corners, smooth, near), between, rtol=0, atol=1e-9)


def volumes(a: Floats, b: Floats, c: Floats, d: Floats) -> Floats:
    return np.einsum("...i,...i", np.cross(b - a, c - a), d - a)


def test_random_triangles_cross_where_an_edge_pierces_a_face():
    rng = np.random.default_rng(0)
    corners = 0.3 * rng.normal(size=(40, 3, 3)) + rng.random((40, 1, 3))
    result = geometry.self_intersection(corners.reshape(-1, 3), np.arange(120).reshape(-1, 3))
    begin, end = corners[:, None], np.roll(corners, -1, axis=1)[:, None]  # edges of the first
    a, b, c = (corners[:, i : i + 1] for i in range(3))  # corners of the second
    parted = volumes(a, b, c, begin) * volumes(a, b, c, end) < 0.0
    turns = [np.sign(volumes(begin, end, *pair)) for pair in ((a, b), (b, c), (c, a))]
    pierced = (parted & (np.abs(sum(turns)) == 3.0)).any(axis=2)
    wanted = np.argwhere(np.triu(pierced | pierced.T))
    assert np.array_equal(result.faces, wanted) and result.count == len(wanted) > 20
    for pair, place in zip(result.faces, result.places, strict=True):  # in both planes
        a, b, c = corners[pair].transpose(1, 0, 2)
        areas = np.linalg.norm(np.cross(b - a, c - a), axis=1)
        assert (np.abs(volumes(a, b, c, place)) < 1e-11 * areas).all()


@pytest.mark.parametrize("unit", [1e-6, 1.0, 1e6])
def test_two_balls_cross_along_a_circle_in_any_unit(unit):
    shift = np.array([0.05, 0.003, 0.001])
    both = joined(SPHERE, moved(SPHERE, shift))
    plain = geometry.self_intersection(*both)
    for middle in (np.zeros(3), shift):
        radii = np.linalg.norm(plain.places - middle, axis=1)
        assert np.allclose(radii, 0.04, rtol=0.02, atol=0)
    assert (plain.faces[:, 0] < 1280).all() and (plain.faces[:, 1] >= 1280).all()
    turn = Rotation.from_rotvec([1.0, 2.0, 3.0]).as_matrix()
    scaled = geometry.self_intersection(unit * (both.vertices @ turn.T + [1, 2, 3]), both.faces)
    assert np.array_equal(scaled.faces, plain.faces) and plain.count > 50


TORN = Mesh(SPHERE.vertices[SPHERE.faces].reshape(-1, 3), np.arange(3840).reshape(-1, 3))
PLATES = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0.2, 0.2, -1], [0.2, 0.2, 1], [0.2, 0.2, 0]])
FAN = np.array([[0, 0, 0], [2, -1, 0], [2, 1, 0], [2, 0, -1], [2, 0, 1], [-2, 0, -1], [-2, 0, 1.0]])


# A ball whose top comes out at the back.
TOP = SPHERE.vertices[:, 2:] > 0.03
DENTED = moved(SPHERE, np.where(TOP, [0.0, 0.0, -0.09], 0.0))
# A fan that folds over itself within its plane.
TURN = np.arange(16)[:, None] * np.pi / 8
RIM = np.concatenate([np.cos(TURN), np.sin(TURN), 0.0 * TURN], axis=1)
FOOT, TIP = [[np.cos(np.pi / 8) * 1.001, 0.05, 0.0]], [[0.1, 0.0, 1.0]]
FOLDED = Mesh(np.concatenate([FOOT, RIM, TIP]), geometry.join_rings(np.array([16])))


@pytest.mark.parametrize(("mesh", "crosses"), [
    (SPHERE, False),
    (TORUS, False),
    (Mesh((TORUS.vertices + 0.3).astype(np.float32), TORUS.faces), False),
    (BOX, False),
    (TORN, False),  # vertices in one place are one
    (FOLDED, False),
    (Mesh(PLATES, np.array([[0, 1, 2], [3, 4, 5]])), False),  # a face without area
    (Mesh(FAN, np.array([[0, 1, 2], [0, 3, 4]])), True),  # beyond their common vertex
    (Mesh(FAN, np.array([[0, 1, 2], [0, 5, 6]])), False),
    *((joined(BOX, moved(BOX, by)), False) for by in ([1, 0, 0], [1, 1, 0], [0.3, 0.2, 1])),
    (joined(BOX, moved(BOX, [0.25, 0.25, -1.0], [0.5, 0.5, 3.0])), True),
    (DENTED, True),
])  # fmt: skip
def test_touching_faces_do_not_cross(mesh, crosses):
    assert (geometry.self_intersection(*mesh).count > 0) == crosses


TRIANGLE = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])


@pytest.mark.parametrize(
    "examine", [geometry.triangle_corners, geometry.solidity, geometry.self_intersection]
)
@pytest.mark.parametrize(("vertices", "faces", "words"), [
    (TRIANGLE[:, :2], [[0, 1, 2]], r"vertices must have shape \(any, 3\), got \(3, 2\)"),
    (TRIANGLE * np.nan, [[0, 1, 2]], "vertices must be finite"),
    (TRIANGLE, np.empty((0, 3), int), "at least one row, got int64 of shape"),
    (TRIANGLE, [0, 1, 2], "faces must be integers of shape"),
    (TRIANGLE, [[0, 1, 2, 0]], "faces must be integers of shape"),
    (TRIANGLE, [[0.0, 1.0, 2.0]], "faces must be integers of shape .* got float64"),
    (TRIANGLE, [[0, 1, 3]], "faces must name vertices from 0 to 2, got 3"),
    (TRIANGLE, [[0, -1, 2]], "faces must name vertices from 0 to 2, got -1"),
])  # fmt: skip
def test_bad_meshes_are_refused(examine, vertices, faces, words):
    with pytest.raises(ValueError, match=words):
        examine(vertices, faces)


@pytest.mark.parametrize(("sizes", "words"), [
    ([], "sizes must be at least one ring of 3 points"),
    ([8, 2], "sizes must be at least one ring of 3 points"),
    ([8, 6], "sizes of neighbours must be equal, half or twice, got 8 and 6"),
    ([8, 32], "sizes of neighbours must be equal, half or twice"),
])  # fmt: skip
def test_rings_that_do_not_fit_are_refused(sizes, words):
    with pytest.raises(ValueError, match=words):
        geometry.join_rings(np.array(sizes))
