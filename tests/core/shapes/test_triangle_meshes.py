"""Triangle meshes: both ray tracers, inside and outside, thin walls, tessellations."""

from collections.abc import Iterator
from importlib.util import find_spec

import numpy as np
import pytest
import trimesh

from palpate.core.arrays import Floats
from palpate.core.geometry import areas_and_normals, is_closed, solidity
from palpate.core.shapes import INSIDE, MISS, Superquadric, TriangleShape, grid_surface, isosurface
from tests.core.shapes.definitions import DOWN, block, boolean, without

NO_EMBREE = find_spec("embreex") is None
BACKENDS = [False, pytest.param(True, marks=pytest.mark.skipif(NO_EMBREE, reason="no Embree here"))]
backends = pytest.mark.parametrize("embree", BACKENDS)
BALL = Superquadric(np.full(3, 0.03), np.ones(2))
UP = np.array([0.0, 0.0, 1.0])


def bundles(count: int) -> Iterator[tuple[Floats, Floats]]:
    """Rays through a box of 0.06 m about the origin, from all sides."""
    rng = np.random.default_rng(7)
    for towards in rng.normal(size=(count, 3)):
        direction = towards / np.linalg.norm(towards)
        yield rng.uniform(-0.06, 0.06, (64, 3)) - 0.15 * direction, direction


@backends
def test_first_hits_lie_on_facets_within_sag(embree):
    vertices, faces = BALL.mesh(4)
    facets = TriangleShape(vertices, faces, embree)
    # The farthest that a point of a face lies below the sphere.
    sag = 0.03 - np.linalg.norm(vertices[faces].mean(axis=1), axis=1).min()
    for origins, direction in bundles(4):
        hits = facets.first_hits(origins, direction)
        met = np.isfinite(hits.ranges)
        assert np.array_equal(met, hits.faces >= 0) and met.sum() > 5
        assert np.array_equal(facets.cast(origins, direction, 0.4), hits.ranges)
        place = origins[met] + hits.ranges[met, None] * direction
        a, b, c = vertices[faces[hits.faces[met]]].transpose(1, 0, 2)
        second, third = hits.weights[met].T[:, :, None]
        on_face = a + second * (b - a) + third * (c - a)
        assert np.allclose(on_face, place, rtol=0, atol=1e-6)  # weights of single precision
        normal = areas_and_normals(vertices[faces[hits.faces[met]]])[1]
        assert np.abs(np.einsum("ni,ni->n", place - a, normal)).max() < 1e-13  # ranges of double
        assert (normal @ direction < 0).all()
        depth = 0.03 - np.linalg.norm(place, axis=1)
        assert (depth > -1e-12).all() and (depth < sag + 1e-12).all()
        exact = BALL.cast(origins, direction, 0.4)
        assert np.isfinite(exact[met]).all()  # the facets lie within the ball
        assert (met == np.isfinite(exact)).mean() > 0.95


@backends
def test_rays_have_reach_and_detect_inside_start(embree):
    mesh = BALL.mesh(3)
    facets = TriangleShape(*mesh, embree)
    origin = np.array([[0.0, 0.0, -0.1]])
    assert facets.cast(origin, UP, 0.0699)[0] == MISS
    assert facets.cast(origin, UP, 0.0701)[0] == pytest.approx(0.07, abs=1e-13)
    assert facets.cast(origin, DOWN, 1.0)[0] == MISS
    assert facets.cast(origin + [0.05, 0, 0], UP, 1.0)[0] == MISS
    inside = np.array([[0.0, 0.0, 0.0], [0.01, 0.0, -0.01]])
    assert (facets.cast(inside, np.array([0.6, 0.0, 0.8]), 1e-6) == INSIDE).all()
    assert facets.bounds().tolist() == [mesh.vertices.min(axis=0).tolist(), [0.03] * 3]
    assert facets.mesh(0) == facets.mesh(5) == mesh
    cube = TriangleShape(*block([0, 0, 0], [1, 1, 1]).solid.mesh(0), embree)
    origins = np.array([[0.5, 0.25, -2.0], [1.25, 0.5, -2.0], [0.25, 0.5, 0.5], [0.5, 0.5, 3.0]])
    result = cube.cast(origins, UP, 5.0)  # sides are seen edge-on
    assert result[0] == pytest.approx(2.0) and result[1:].tolist() == [MISS, INSIDE, MISS]


@backends
def test_no_ray_slips_between_two_triangles(embree):
    vertices, faces = BALL.mesh(2)
    facets = TriangleShape(vertices, faces, embree)
    a, b, c = vertices[faces].transpose(1, 0, 2)
    targets = np.concatenate([vertices, (a + b) / 2, (a + b + c) / 3])
    for direction in (UP, np.array([0.36, 0.48, 0.8])):
        in_view = targets[np.linalg.norm(np.cross(targets, direction), axis=1) < 0.027]
        assert np.isfinite(facets.cast(in_view - 0.1 * direction, direction, 0.3)).all()


@backends
def test_closed_meshes_have_an_inside_and_open_ones_an_outer_side(embree):
    vertices, faces = BALL.mesh(3)
    origin, outside = np.zeros((1, 3)), np.array([[0.0, 0.0, -0.1], [0.0, 0.0, 0.1]])
    whole, holed = (TriangleShape(vertices, some, embree) for some in (faces, faces[1:]))
    assert whole.closed and not holed.closed
    assert holed.cast(origin, UP, 1.0)[0] == MISS  # it has no inside
    assert holed.cast(outside, UP, 1.0).tolist() == [whole.cast(outside, UP, 1.0)[0], MISS]
    for shift in (0.0, 5.0):
        for some in (faces, faces[9:]):
            right = TriangleShape(vertices + shift, some, embree)
            turned = TriangleShape(vertices + shift, some[:, ::-1], embree)
            assert (right.flipped, turned.flipped) == (False, True)
            assert np.array_equal(turned.mesh(0).faces, some)
            origins = vertices[:200] * [1, 1, 0] + [shift, shift, shift + 0.1]
            first, second = (shape.cast(origins, DOWN, 1.0) for shape in (right, turned))
            met = np.isfinite(first)
            assert np.array_equal(met, np.isfinite(second)) and met.sum() > 100
            assert np.allclose(first[met], second[met], rtol=0, atol=1e-9)


@backends
def test_ray_passes_back_faces_until_a_front_face_or_gives_up(embree):
    triangle = np.array([[-1.0, -1.0, 0.0], [0.0, 1.0, 0.0], [1.0, -1.0, 0.0]])
    for sheets, turned in ((4, 0), (4, 1), (9, 4), (200, 100)):
        heights = np.linspace(0.0, 0.1 * sheets - 0.1, sheets)
        faces = np.arange(3 * sheets, dtype=np.int32).reshape(-1, 3)
        faces[turned] = faces[turned, ::-1]
        corners = np.concatenate([triangle + [0.0, 0.0, height] for height in heights])
        wall = TriangleShape(corners, faces, embree)
        direction = UP if wall.flipped else DOWN  # sees backs
        start = np.array([[0.0, -0.2, -1.0 if direction is UP else heights[-1] + 1.0]])
        hits = wall.first_hits(start, direction)
        steps = turned if direction is UP else sheets - 1 - turned
        expected = (1.0 + 0.1 * steps, turned) if steps < 64 else (MISS, -1)
        assert (pytest.approx(hits.ranges[0], abs=1e-6), hits.faces[0]) == expected


WALL = 5e-4
OUTER, INNER = block([0, 0, 0], [0.06, 0.06, 0.04]), block([WALL] * 3, [0.06 - WALL] * 2 + [0.05])
SLIT = block([0.028, -0.01, 0.01], [0.032, 0.07, 0.05])


@backends
def test_thin_walls_and_openings_are_met_as_by_exact_casts(embree):
    exact = [boolean(without(OUTER, taken)).solid for taken in (INNER, SLIT)]
    facets = [TriangleShape(*solid.mesh(0), embree) for solid in exact]
    for solid, other in zip(exact, facets, strict=True):
        for origins, direction in bundles(6):
            origins = origins + [0.03, 0.03, 0.02]
            wanted, result = (shape.cast(origins, direction, 0.4) for shape in (solid, other))
            met = np.isfinite(wanted)
            assert np.array_equal(result[~met], wanted[~met])
            assert np.allclose(result[met], wanted[met], rtol=0, atol=1e-12)


def test_superquadric_meshes_split_faces_in_four_and_have_no_slivers():
    unit = Superquadric(np.ones(3), np.ones(2))
    for level in (0, 1, 2, 3, 5):
        vertices, faces = unit.mesh(level)
        assert vertices.shape == (10 * 4**level + 2, 3) and faces.shape == (20 * 4**level, 3)
        assert np.allclose(np.linalg.norm(vertices, axis=1), 1.0, atol=1e-15)
        body = solidity(vertices, faces)
        assert body.watertight and body.genus == 0 and body.volume > 0.0
        areas, normals = areas_and_normals(vertices[faces])
        assert (np.einsum("ni,nji->n", normals, vertices[faces]) > 0).all()
        assert np.ptp(areas) < areas.min()
        with pytest.raises(ValueError, match="read-only"):
            faces[0, 0] = 2
    # An equilateral triangle, squeezed to a twentieth, has an angle of 2.5 degrees.
    for size, least in (([1.0, 1, 1], 30.0), ([1.0, 1, 0.05], 2.2), ([0.05, 0.05, 1], 2.2)):
        for pair in ([0.1, 0.1], [1.0, 1.0], [2.0, 2.0], [0.1, 1.0], [2.0, 0.1]):
            mesh = trimesh.Trimesh(*Superquadric(np.array(size), np.array(pair)).mesh(3))
            assert np.degrees(mesh.face_angles).min() > least


def ring(points: Floats, directions: Floats) -> tuple[Floats, Floats]:
    x, y, z = points.T
    round_ = np.hypot(x, y)
    slopes = points.T - 0.7 * np.stack([x, y, 0 * z]) / np.maximum(round_, 1e-9)
    return (round_ - 0.7) ** 2 + z * z - 0.04, 2 * (slopes * directions.T).sum(axis=0)


def cube(points: Floats, directions: Floats) -> tuple[Floats, Floats]:
    """Its slopes jump at edges and are wrong there: that may only cost steps."""
    axis, rows = np.abs(points).argmax(axis=1), np.arange(len(points))
    value = np.cbrt(np.abs(points).max(axis=1) - 0.5)
    return value, -3.0 * np.sign(points[rows, axis]) * directions[rows, axis]


AROUND = np.array([[-1.0, -1, -1], [1, 1, 1]])


def test_isosurfaces_are_closed_and_converge_with_resolution():
    def sphere(points: Floats, directions: Floats) -> tuple[Floats, Floats]:
        return (points**2).sum(axis=1) - 1.0, 2 * (points * directions).sum(axis=1)

    meshes = [isosurface(sphere, AROUND, level) for level in (4, 5)]
    for vertices, _ in meshes:
        assert np.abs(np.linalg.norm(vertices, axis=1) - 1).max() < 1e-11
    bodies = [solidity(*mesh) for mesh in meshes]
    assert all(body.watertight and body.genus == 0 for body in bodies)
    errors = [4 / 3 * np.pi - body.volume for body in bodies]
    assert errors[1] == pytest.approx(errors[0] / 4, rel=0.15)
    assert len(meshes[1].faces) == pytest.approx(4 * len(meshes[0].faces), rel=0.15)
    torus = solidity(*isosurface(ring, AROUND * [[1, 1, 0.25]], 5))
    assert (torus.watertight, torus.components, torus.genus) == (True, 1, 1)
    assert torus.volume == pytest.approx(2 * np.pi**2 * 0.7 * 0.04, rel=0.05)
    # Without uneven margins half of all nodes would lie in the faces of this box.
    for stretch in (1.0, 1.0 / (1 + 0.0231 + 0.0257)):
        vertices, triangles = isosurface(cube, AROUND * stretch, 3)
        assert solidity(vertices, triangles).watertight
        assert np.abs(np.abs(vertices).max(axis=1) - 0.5).max() < 1e-11


def test_grid_surfaces_are_closed_also_along_a_level_bottom():
    x, y, z = np.meshgrid(*[np.arange(24.0)] * 3, indexing="ij")
    values = np.sqrt((x - 11.3) ** 2 + (y - 11.6) ** 2 + (z - 12.2) ** 2) - 9.0
    ball = grid_surface(values)
    assert solidity(*ball).volume == pytest.approx(4 / 3 * np.pi * 9**3, rel=0.01)
    # A chord of a cell's diagonal has a sag of 3 / (8 * 9).
    assert np.abs(np.linalg.norm(ball.vertices - [11.3, 11.6, 12.2], axis=1) - 9).max() < 0.042
    cut = grid_surface(values[:, :, 8:], level_bottom=True)
    assert is_closed(cut.faces) and cut.vertices[:, 2].min() == 0.0
    below = np.pi * 4.8**2 * (3 * 9 - 4.8) / 3  # the cap that is cut off
    assert solidity(*cut).volume == pytest.approx(4 / 3 * np.pi * 9**3 - below, rel=0.01)
    assert grid_surface(np.ones((4, 4, 4))).faces.shape == (0, 3)
