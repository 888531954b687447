import numpy as np
import pytest

from palpate.core.geometry.meshes import is_closed, is_inside_out, solidity
from palpate.core.shapes.protocol import Mesh
from palpate.core.shapes.superquadrics import Superquadric, regular_points
from palpate.core.shapes.tessellations import bracketed_roots, icosphere, isosurface


@pytest.mark.parametrize("level", [0, 1, 2, 3, 5])
def test_each_level_splits_every_face_in_four(level):
    directions, faces = icosphere(level)
    assert directions.shape == (10 * 4**level + 2, 3)
    assert faces.shape == (20 * 4**level, 3)
    assert np.allclose(np.linalg.norm(directions, axis=1), 1.0, atol=1e-15)


@pytest.mark.parametrize("level", [0, 1, 3])
def test_it_is_closed_and_every_face_looks_outwards(level, is_closed):
    directions, faces = icosphere(level)
    assert is_closed(Mesh(directions, faces))
    a, b, c = directions[faces].transpose(1, 0, 2)
    assert (np.einsum("ni,ni->n", np.cross(b - a, c - a), a + b + c) > 0).all()


def test_its_faces_are_nearly_even():
    directions, faces = icosphere(4)
    a, b, c = directions[faces].transpose(1, 0, 2)
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    assert area.max() / area.min() < 2.0  # 20 for rings of latitude


def test_it_is_the_same_object_each_time_and_cannot_be_written():
    directions, faces = icosphere(1)
    assert icosphere(1)[0] is directions
    with pytest.raises(ValueError, match="read-only"):
        directions[0, 0] = 2.0
    with pytest.raises(ValueError, match="read-only"):
        faces[0, 0] = 2


@pytest.mark.parametrize("level", [-1, 9])
def test_levels_out_of_range_are_refused(level):
    with pytest.raises(ValueError, match=f"level must be between 0 and 8, got {level}"):
        icosphere(level)


BOX = np.array([[-1.0, -1, -1], [1, 1, 1]])


def balls(*middles, radius=1.0):
    def inside_out(points, directions):
        away = points - np.array(middles)[:, None]
        nearest = (away**2).sum(axis=2).argmin(axis=0)
        one = away[nearest, np.arange(len(points))]
        return (one**2).sum(axis=1) - radius**2, 2 * (one * directions).sum(axis=1)

    return inside_out


def ring(points, directions):
    x, y, z = points.T
    round_, away = np.hypot(x, y), np.stack([x, y, z])
    value = (round_ - 0.7) ** 2 + z * z - 0.2**2
    by = 2 * (away - 0.7 * np.stack([x, y, 0 * z]) / np.maximum(round_, 1e-9))
    return value, (by * directions.T).sum(axis=0)


def test_a_balls_vertices_lie_on_it_and_the_error_falls_fourfold_with_each_level(
    signed_volume, is_closed
):
    errors, faces = [], []
    for level in (4, 5, 6):
        mesh = isosurface(balls([0.0, 0, 0]), BOX, level)
        assert is_closed(mesh)
        assert np.abs(np.linalg.norm(mesh.vertices, axis=1) - 1).max() < 1e-11
        errors.append(4 / 3 * np.pi - signed_volume(mesh))
        faces.append(len(mesh.faces))
    assert np.diff(np.log2(errors)) == pytest.approx([-2, -2], abs=0.2)
    assert np.diff(np.log2(faces)) == pytest.approx([2, 2], abs=0.2)


def test_two_parts_and_a_hole_are_meshed_as_such():
    two = isosurface(balls([-0.5, 0, 0], [0.5, 0, 0], radius=0.4), BOX, 5)
    assert solidity(*two).components == 2
    torus = isosurface(ring, BOX * [[1, 1, 0.25]], 5)
    assert (solidity(*torus).components, solidity(*torus).genus) == (1, 1)
    for mesh in (two, torus):
        assert is_closed(mesh.faces)
        assert not is_inside_out(*mesh)


def test_every_face_looks_outwards():
    vertices, faces = isosurface(balls([0.0, 0, 0]), BOX, 4)
    a, b, c = vertices[faces].transpose(1, 0, 2)
    assert ((np.cross(b - a, c - a) * (a + b + c)).sum(axis=1) >= -1e-12).all()


def test_a_surface_through_the_grids_own_nodes_is_closed(is_closed):
    def box(points, directions):
        axis = np.abs(points).argmax(axis=1)
        rows = np.arange(len(points))
        value = np.abs(points).max(axis=1) - 0.5
        return value, np.sign(points[rows, axis]) * directions[rows, axis]

    # Without the uneven margins half of all nodes would lie in its faces.
    for stretch in (1.0, 1.0 / (1 + 0.0231 + 0.0257)):
        assert is_closed(isosurface(box, BOX * stretch, 3))


EXPONENTS = [[0.1, 0.1], [1.0, 1.0], [2.0, 2.0], [0.1, 1.0], [1.0, 0.1], [2.0, 0.1]]


def smallest_angles(corners):
    """Of triangles (m, 3, 3), in degrees."""
    found = []
    for i in range(3):
        one, other = (corners[:, (i + k) % 3] - corners[:, i] for k in (1, 2))
        sine = np.linalg.norm(np.cross(one, other), axis=1)
        found.append(np.degrees(np.arctan2(sine, np.einsum("mi,mi->m", one, other))))
    return np.asarray(np.min(found, axis=0))


def rings(shape, rows, columns):
    """Triangles between rings of latitude, those without an area at the poles left out."""
    eta, omega = np.linspace(-0.5, 0.5, rows) * np.pi, 2 * np.pi * np.arange(columns) / columns
    points = regular_points(shape, np.repeat(eta, columns), np.tile(omega, rows)).points
    here = np.arange((rows - 1) * columns)
    beside = here // columns * columns + (here % columns + 1) % columns
    lower = np.column_stack([here, beside, beside + columns])[columns:]
    upper = np.column_stack([here, beside + columns, here + columns])[:-columns]
    return np.asarray(points[np.concatenate([lower, upper])])


@pytest.mark.parametrize("exponents", EXPONENTS)
def test_no_facet_of_a_solid_of_equal_semi_axes_is_a_sliver(exponents):
    shape = Superquadric(np.ones(3), np.array(exponents))
    for level in (3, 4):
        mesh = shape.mesh(level)
        assert smallest_angles(mesh.vertices[mesh.faces]).min() > 30.0
    assert smallest_angles(rings(shape, 37, 72)).min() < 5.0


@pytest.mark.parametrize("size", [[1.0, 1.0, 0.05], [0.05, 0.05, 1.0]])
@pytest.mark.parametrize("exponents", EXPONENTS)
def test_a_flat_or_slender_solid_has_no_sharper_facets_than_its_shape_makes(size, exponents):
    shape = Superquadric(np.array(size), np.array(exponents))
    mesh = shape.mesh(4)
    sharpest = smallest_angles(mesh.vertices[mesh.faces]).min()
    # An equilateral triangle, squeezed to a twentieth, has an angle of 2.5 degrees.
    assert sharpest > 2.2
    assert sharpest > smallest_angles(rings(shape, 37, 72)).min()


def test_roots_are_found_whichever_side_is_outside():
    wanted = np.array([0.1, 0.5, 0.9, 1.0, 0.0])

    def cubic(t):
        return (t - wanted) * (1 + t * t), 1 + t * t + 2 * t * (t - wanted)

    found = bracketed_roots(cubic, np.ones(5) * 1.1, np.zeros(5), 1e-14)
    assert np.allclose(found, wanted, rtol=0, atol=1e-13)

    def fall(t):
        value, slope = cubic(t)
        return -value, -slope

    found = bracketed_roots(fall, -0.1 * np.ones(5), np.full(5, 1.2), 1e-14)
    assert np.allclose(found, wanted, rtol=0, atol=1e-13)


def test_kinks_and_wrong_slopes_only_cost_steps():
    def step(t):
        return np.where(t > 0.3, 1.0, -1.0), np.zeros_like(t)

    assert abs(bracketed_roots(step, np.ones(1), np.zeros(1), 1e-13)[0] - 0.3) < 1e-12

    def misled(t):
        return np.cbrt(t - 0.7), np.full_like(t, -3.0)

    assert abs(bracketed_roots(misled, np.ones(1), np.zeros(1), 1e-13)[0] - 0.7) < 1e-12


def test_what_is_exactly_met_is_kept():
    def half(t):
        return t - 0.5, np.ones_like(t)

    assert bracketed_roots(half, np.ones(1), np.zeros(1), 1e-13)[0] == 0.5
