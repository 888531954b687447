import numpy as np
import pytest

from palpate.core.geometry.meshes import (
    are_outside,
    areas_and_normals,
    close_rings,
    corner_normals,
    facet_sag,
    is_closed,
    is_inside_out,
    join_rings,
    solidity,
    triangle_corners,
)
from palpate.core.geometry.nearest import nearest_points, nearest_search
from palpate.core.shapes.protocol import Mesh
from palpate.core.shapes.tessellations import icosphere


def joined(*meshes):
    """All meshes as one, no vertex shared."""
    starts = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
    return Mesh(
        np.concatenate([mesh.vertices for mesh in meshes]),
        np.concatenate([mesh.faces + start for mesh, start in zip(meshes, starts, strict=False)]),
    )


def test_a_cube_is_a_solid_of_unit_volume(box):
    assert solidity(*box) == (True, 1, 0, pytest.approx(1.0, rel=1e-12))


def test_a_torus_has_one_handle_and_the_volume_of_pappus(torus):
    found = solidity(*torus)
    assert found[:3] == (True, 1, 1)
    section = 20 / 2 * np.sin(2 * np.pi / 20)  # of the polygon, for a circle of radius 1
    assert found.volume == pytest.approx(2 * np.pi * 3 * section, rel=0.01)


def test_handles_and_pieces_add_up(torus, box):
    far = Mesh(torus.vertices + 10.0, torus.faces)
    found = solidity(*joined(torus, far, box))
    assert found[:3] == (True, 3, 2)


def test_two_cubes_that_touch_in_a_vertex_are_two_spheres(box):
    # The far corner of one is vertex 0 of the other.
    second = np.where(box.faces == 0, 6, box.faces + 8)
    vertices = np.concatenate([box.vertices, box.vertices + 1.0])
    found = solidity(vertices, np.concatenate([box.faces, second]))
    assert found == (True, 2, 0, pytest.approx(2.0))


def test_turned_inside_out_the_volume_is_negative(box):
    found = solidity(box.vertices, box.faces[:, ::-1])
    assert found == (True, 1, 0, pytest.approx(-1.0))


def test_far_from_the_origin_the_volume_stays(box):
    assert solidity(box.vertices + 1e6, box.faces).volume == pytest.approx(1.0, rel=1e-9)


def test_vertices_that_no_face_names_are_ignored(box):
    vertices = np.concatenate([box.vertices, [[9.0, 9.0, 9.0]]])
    assert solidity(vertices, box.faces)[:3] == (True, 1, 0)


def test_a_missing_face_opens_the_surface(box):
    assert solidity(box.vertices, box.faces[1:])[:3] == (False, 1, None)


def test_a_face_turned_the_wrong_way_is_not_watertight(box):
    faces = box.faces.copy()
    faces[3] = faces[3, ::-1]
    assert not solidity(box.vertices, faces).watertight


def test_a_face_given_twice_is_not_watertight(box):
    assert not solidity(box.vertices, np.concatenate([box.faces, box.faces[:1]])).watertight


def test_two_solids_that_share_an_edge_are_not_watertight(box):
    # Edge 2-6 of one becomes edge 0-4 of the other: four faces at one edge.
    second = box.faces + 8
    second[box.faces == 0], second[box.faces == 4] = 2, 6
    vertices = np.concatenate([box.vertices, box.vertices + np.array([1.0, 1.0, 0.0])])
    assert not solidity(vertices, np.concatenate([box.faces, second])).watertight


def test_a_face_with_a_doubled_corner_is_not_watertight():
    assert not solidity(np.eye(3), [[0, 1, 1], [1, 0, 0]]).watertight


def test_the_order_of_faces_does_not_matter(torus):
    shuffled = np.random.default_rng(0).permutation(torus.faces)
    assert solidity(torus.vertices, shuffled)[:3] == (True, 1, 1)


def test_a_ball_is_closed_until_a_face_is_taken_away_doubled_or_turned():
    _, faces = icosphere(2)
    assert is_closed(faces)
    assert is_closed(faces[:, ::-1])
    assert is_closed(np.random.default_rng(0).permutation(faces))
    assert not is_closed(faces[1:])
    assert not is_closed(np.concatenate([faces, faces[:1]]))
    turned = faces.copy()
    turned[7] = turned[7, ::-1]
    assert not is_closed(turned)
    assert not is_closed(faces[:0])


def test_two_balls_are_closed_and_a_fin_is_not():
    _, faces = icosphere(1)
    assert is_closed(np.concatenate([faces, faces + 42]))
    a, b = faces[0, :2]
    assert not is_closed(np.concatenate([faces, [[a, b, 42]]]).astype(np.int32))


def test_turned_faces_are_seen_wherever_the_mesh_is_and_even_with_a_hole():
    directions, faces = icosphere(2)
    for place in ([0.0, 0.0, 0.0], [50.0, -20.0, 9.0]):
        for some in (faces, faces[40:]):
            assert not is_inside_out(directions + place, some)
            assert is_inside_out(directions + place, some[:, ::-1])


TRIANGLE = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])


def test_a_cube_has_six_unit_sides_whose_normals_point_outwards(box):
    corners = triangle_corners(box.vertices, box.faces)
    areas, normals = areas_and_normals(corners)
    np.testing.assert_array_equal(areas, 0.5)
    outwards = corners.mean(axis=1) - 0.5
    assert np.einsum("ij,ij->i", normals, outwards) == pytest.approx(0.5)


def test_a_triangle_without_area_has_no_normal():
    flat = np.array([[[0.0, 0, 0], [1, 0, 0], [2, 0, 0]]])
    areas, normals = areas_and_normals(flat)
    assert areas.tolist() == [0.0]
    assert normals.tolist() == [[0.0, 0.0, 0.0]]


@pytest.mark.parametrize(
    ("vertices", "faces", "words"),
    [
        (TRIANGLE[:, :2], [[0, 1, 2]], r"vertices must have shape \(any, 3\), got \(3, 2\)"),
        (TRIANGLE * np.nan, [[0, 1, 2]], "vertices must be finite"),
        (TRIANGLE, np.empty((0, 3), int), "at least one row, got int64 of shape"),
        (TRIANGLE, [0, 1, 2], "faces must be integers of shape"),
        (TRIANGLE, [[0, 1, 2, 0]], "faces must be integers of shape"),
        (TRIANGLE, [[0.0, 1.0, 2.0]], "faces must be integers of shape .* got float64"),
        (TRIANGLE, [[0, 1, 3]], "faces must name vertices from 0 to 2, got 3"),
        (TRIANGLE, [[0, -1, 2]], "faces must name vertices from 0 to 2, got -1"),
    ],
)
def test_what_is_no_mesh_is_refused(vertices, faces, words):
    with pytest.raises(ValueError, match=words):
        triangle_corners(vertices, faces)  # type: ignore[arg-type]


def stack(count, size):
    """Rings of an upright cylinder of radius 1 and height 2, closed."""
    turn = 2 * np.pi * np.arange(size) / size
    rim = np.column_stack([np.cos(turn), np.sin(turn)])
    rings = np.stack([np.column_stack([rim, np.full(size, z)]) for z in np.linspace(-1, 1, count)])
    return Mesh(*close_rings(np.array([0, 0, -1.0]), rings, np.array([0, 0, 1.0])))


@pytest.mark.parametrize("count", [2, 3, 20])
@pytest.mark.parametrize("size", [3, 4, 50])
def test_rings_become_a_closed_surface_without_handles(count, size, is_closed):
    mesh = stack(count, size)
    assert mesh.vertices.shape == (count * size + 2, 3)
    assert mesh.faces.shape == (2 * count * size, 3)
    assert mesh.faces.dtype == np.int32
    assert is_closed(mesh)


def test_faces_look_outwards(signed_volume):
    polygon = 0.5 * 50 * np.sin(2 * np.pi / 50)
    assert signed_volume(stack(5, 50)) == pytest.approx(2 * polygon)
    mesh = stack(5, 50)
    a, b, c = mesh.vertices[mesh.faces].transpose(1, 0, 2)
    assert (np.einsum("ni,ni->n", np.cross(b - a, c - a), a + b + c) > 0).all()


def test_a_single_ring_is_a_closed_disc(is_closed):
    assert is_closed(stack(1, 8))


@pytest.mark.parametrize(
    "sizes", [[3], [8, 8], [4, 8, 16, 16, 8, 4], [16, 8], [8, 16], [12, 6, 3, 6, 12]]
)
def test_rings_are_joined_without_holes_and_face_outwards(sizes):
    rings = []
    for height, size in enumerate(sizes, 1):
        angle = 2 * np.pi * np.arange(size) / size
        rings.append(np.column_stack([np.cos(angle), np.sin(angle), np.full(size, height)]))
    top = [0.0, 0.0, len(sizes) + 1.0]
    found = solidity(np.concatenate([[[0.0, 0.0, 0.0]], *rings, [top]]), join_rings(sizes))
    assert found[:3] == (True, 1, 0)
    assert found.volume > 0.0


@pytest.mark.parametrize(
    ("sizes", "words"),
    [
        ([], "sizes must be at least one ring of 3 points"),
        ([8, 2], "sizes must be at least one ring of 3 points"),
        ([8, 6], "sizes of neighbours must be equal, half or twice, got 8 and 6"),
        ([8, 32], "sizes of neighbours must be equal, half or twice"),
    ],
)
def test_rings_that_do_not_fit_each_other_are_refused(sizes, words):
    with pytest.raises(ValueError, match=words):
        join_rings(sizes)


def found(mesh, points):
    nearest = nearest_points(nearest_search(mesh.vertices[mesh.faces]), points)
    return are_outside(mesh.vertices, mesh.faces, points, nearest)


def test_points_about_a_box_are_outside_whatever_part_is_nearest(box):
    points = np.random.default_rng(0).uniform(-1.0, 2.0, size=(5000, 3))
    expected = ((points < 0.0) | (points > 1.0)).any(axis=1)
    np.testing.assert_array_equal(found(box, points), expected)


@pytest.mark.parametrize("corner", [[0, 0, 0], [1, 1, 1], [1, 0, 1]])
def test_straight_out_of_a_corner_is_outside(box, corner):
    away = np.asarray(corner) - 0.5
    assert found(box, np.array([corner + 1e-6 * away])).all()
    assert not found(box, np.array([corner - 1e-6 * away])).any()


def test_the_hole_of_a_torus_is_outside(torus):
    assert found(torus, np.zeros((1, 3))).all()
    assert not found(torus, np.array([[3.0, 0.0, 0.0]])).any()


def test_beside_a_thin_blade_the_vertex_is_judged_by_the_angles_of_its_faces():
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


def cylinder(count):
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
def test_the_sag_of_a_sphere_is_its_mean_distance_from_the_facets(level):
    directions, faces = icosphere(level)
    corners = directions[faces]
    shares = np.random.default_rng(0).dirichlet([1, 1, 1], 200)
    off = 1.0 - np.linalg.norm(np.einsum("bi,fij->fbj", shares, corners), axis=2)
    mean = np.average(off.mean(axis=1), weights=areas_and_normals(corners)[0])
    assert facet_sag(0.05 * directions, faces) == pytest.approx(0.05 * mean, rel=0.05)


def test_a_box_has_no_sag(box):
    assert facet_sag(box.vertices, box.faces) == pytest.approx(0.0, abs=1e-15)


def test_the_sharp_rim_of_a_cylinder_does_not_hide_the_sag_of_its_side():
    vertices, faces = cylinder(48)
    # A chord of angle 2 pi / 48 leaves its circle by two thirds of the sagitta on average.
    side = 2.0 / 3.0 * (1.0 - np.cos(np.pi / 48))
    share = 4.0 * np.pi / (4.0 * np.pi + 2.0 * np.pi)  # of the side in the area
    assert facet_sag(vertices, faces) == pytest.approx(side * share, rel=0.05)


def test_normals_are_shared_across_blunt_edges_alone(box):
    apart = corner_normals(box.vertices, box.faces, np.radians(30))
    shared = corner_normals(box.vertices, box.faces, np.pi)
    flat = areas_and_normals(box.vertices[box.faces])[1]
    np.testing.assert_allclose(apart, np.repeat(flat[:, None], 3, axis=1), atol=1e-15)
    outwards = (box.vertices - 0.5) / np.sqrt(0.75)
    np.testing.assert_allclose(shared, outwards[box.faces], atol=1e-12)


def test_a_single_face_has_its_own_normal():
    found = corner_normals(np.eye(3), np.array([[0, 1, 2]], np.int32), np.pi)
    np.testing.assert_allclose(found, np.full((1, 3, 3), np.sqrt(1 / 3)))
