from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from palpate.core.shapes.protocol import Mesh
from palpate.core.splines.bases import clamped_basis
from palpate.core.splines.lattices import (
    Lattice,
    LatticeLayer,
    box_lattice,
    deformed_normals,
    folded_share,
    layered_lattice,
    pull_points,
)
from palpate.core.splines.spline_volumes import Parallelepiped, SplineVolume, mean_determinant

LOW, EXTENT, COUNTS = np.array([-0.1, 0.2, 0.3]), np.array([0.5, 0.25, 2.0]), (6, 4, 5)
EDGES = np.array([[0.5, 0.1, 0.0], [-0.1, 0.25, 0.0], [0.3, 0.0, 2.0]])
RNG = np.random.default_rng(1)
NOISE = RNG.normal(size=(*COUNTS, 3))
WEIGHTS = RNG.uniform(0.5, 2.0, COUNTS)


def places(count):
    return np.asarray(LOW + EXTENT * np.random.default_rng(0).random((count, 3)))


def undeformed():
    return box_lattice(LOW, EXTENT, COUNTS)


def bent():
    return undeformed().with_control(undeformed().control + 0.05 * EXTENT * NOISE)


def skewed():
    """Weighted, over a parallelepiped."""
    bases = clamped_basis(6), clamped_basis(4), clamped_basis(5, 2)
    frame = Parallelepiped(LOW, EDGES)
    control = frame.greville_control(bases)
    return Lattice(SplineVolume(control + 0.02 * NOISE, bases, WEIGHTS), frame)


def wedge():
    """Over an undeformed lattice that is no parallelepiped, and folds nowhere."""
    before = undeformed().control.copy()
    before[..., 0] *= 1.0 + 0.3 * before[..., 2]
    volume = SplineVolume(before, undeformed().volume.bases)
    return Lattice(bent().volume, volume)


def test_an_undeformed_lattice_moves_nothing():
    points = places(200)
    assert np.allclose(undeformed().deform(points), points, rtol=0, atol=2e-15)
    assert np.allclose(undeformed().jacobian_determinant(points), 1.0, rtol=0, atol=2e-14)


@pytest.mark.parametrize(("counts", "degree"), [((2, 2, 2), 1), ((3, 4, 6), 2), ((5, 5, 5), 4)])
def test_an_undeformed_lattice_of_any_degree_moves_nothing(counts, degree):
    points = places(50)
    moved = box_lattice(LOW, EXTENT, counts, degree).deform(points)
    assert np.allclose(moved, points, rtol=0, atol=2e-15)


def test_the_control_points_run_along_s_t_u():
    control = undeformed().control
    assert control.shape == (*COUNTS, 3)
    assert control[0, 0, 0] == pytest.approx(LOW)
    assert control[-1, 0, 0] == pytest.approx(LOW + EXTENT * [1, 0, 0])
    assert control[0, -1, 0] == pytest.approx(LOW + EXTENT * [0, 1, 0])
    assert control[0, 0, -1] == pytest.approx(LOW + EXTENT * [0, 0, 1])


def test_affine_motions_of_the_control_points_are_reproduced():
    matrix = np.array([[1.2, 0.3, 0.0], [-0.1, 0.8, 0.2], [0.4, 0.0, 1.1]])
    shift = np.array([1.0, -2.0, 0.5])
    lattice = undeformed().with_control(undeformed().control @ matrix.T + shift, WEIGHTS)
    plain, points = undeformed().with_control(lattice.control), places(100)
    assert np.allclose(plain.deform(points), points @ matrix.T + shift, rtol=0, atol=1e-14)
    volume = np.linalg.det(matrix)
    assert np.allclose(plain.jacobian_determinant(points), volume, rtol=1e-12)


@given(st.sampled_from([1e-6, 1e-3, 1e3, 1e6]), st.integers(0, 5))
@settings(derandomize=True, deadline=None, max_examples=20)
def test_the_deformation_is_the_same_in_any_unit(scale: float, seed: int) -> None:
    control = bent().control + 0.01 * np.random.default_rng(seed).normal(size=(*COUNTS, 3))
    here = undeformed().with_control(control)
    there = box_lattice(scale * LOW, scale * EXTENT, COUNTS).with_control(scale * control)
    points = places(10)
    moved = there.deform(scale * points)
    assert np.allclose(moved, scale * here.deform(points), rtol=0, atol=1e-14 * scale)


def test_mirrored_control_points_mirror_the_deformation():
    mirror = np.array([-1.0, 1.0, 1.0])
    there = box_lattice(LOW * mirror - [EXTENT[0], 0, 0], EXTENT, COUNTS)
    there = there.with_control(bent().control[::-1] * mirror)
    points = places(50)
    assert np.allclose(there.deform(points * mirror), bent().deform(points) * mirror, atol=1e-14)


@pytest.mark.parametrize("make", [bent, skewed, wedge])
def test_the_jacobian_is_that_of_finite_differences(make):
    lattice, step = make(), 1e-6
    inside = np.random.default_rng(3).uniform(0.05, 0.9, (40, 3))
    before = lattice.undeformed
    points = before.points(inside) if isinstance(before, Parallelepiped) else before.at(inside)
    columns = [
        (lattice.deform(points + step * axis) - lattice.deform(points - step * axis)) / (2 * step)
        for axis in np.eye(3)
    ]
    wanted = np.stack(columns, axis=-1)
    moved, slopes = lattice.deform_with_jacobian(points)
    assert np.allclose(slopes, wanted, rtol=0, atol=1e-5)
    assert np.allclose(lattice.jacobian(points), slopes, rtol=0, atol=0)
    assert np.allclose(moved, lattice.deform(points), rtol=0, atol=1e-15)
    determinant = lattice.jacobian_determinant(points)
    assert np.allclose(determinant, np.linalg.det(wanted), rtol=1e-4, atol=1e-5)
    assert np.ptp(determinant) > 0.05


def test_the_change_of_volume_on_a_grid_is_that_at_its_points():
    axes = np.array([0.0, 0.4, 1.0]), np.array([0.2, 0.9]), np.array([0.5])
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    for lattice in (bent(), skewed()):
        assert isinstance(lattice.undeformed, Parallelepiped)
        wanted = lattice.jacobian_determinant(lattice.undeformed.points(grid))
        found = lattice.change_on_grid(*axes)
        assert found.shape == (3, 2, 1)
        assert np.allclose(found.ravel(), wanted, rtol=1e-11)


def test_the_unit_of_change_is_the_undeformed_volume():
    before = wedge().undeformed
    assert isinstance(before, SplineVolume)
    assert mean_determinant(before) == pytest.approx(EXTENT.prod() * 1.39, rel=1e-3)  # 1 + .3 z
    still = Lattice(before, before)
    assert mean_determinant(still.relative) == pytest.approx(1.0)
    assert mean_determinant(undeformed().relative) == pytest.approx(1.0)
    wider = Lattice(SplineVolume(2.0 * before.control, before.bases, before.weights), before)
    assert mean_determinant(wider.relative) == pytest.approx(8.0)


def test_a_lattice_that_was_flat_changes_no_volume():
    plain = undeformed()
    flat = SplineVolume(plain.control * [1, 1, 0], plain.volume.bases)
    assert np.array_equal(
        Lattice(flat, flat).change_on_grid(*np.full((3, 2), 0.3)), np.zeros((2, 2, 2))
    )


def test_a_mirrored_lattice_is_a_fold_everywhere():
    lattice = undeformed().with_control(undeformed().control[:, ::-1])
    assert np.allclose(lattice.jacobian_determinant(places(20)), -1.0, rtol=0, atol=1e-12)


def test_faces_edges_and_corners_deform_as_the_inside_next_to_them_does():
    lattice = bent()
    ends = np.stack(np.meshgrid(*[[0.0, 0.5, 1.0]] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    inside = np.clip(ends, 1e-9, 1 - 1e-9)
    here, there = (lattice.deform(LOW + EXTENT * at) for at in (ends, inside))
    assert np.allclose(here, there, rtol=0, atol=1e-8)
    corners = lattice.deform(LOW + EXTENT * np.array([[0, 0, 0], [1, 1, 1], [1, 0, 0]]))
    wanted = lattice.control[[0, -1, -1], [0, -1, 0], [0, -1, 0]]
    assert np.allclose(corners, wanted, rtol=0, atol=1e-15)


def test_points_outside_by_rounding_are_on_the_face():
    far = box_lattice(LOW + 1e4, EXTENT, COUNTS)
    beyond = np.array([np.nextafter(far.control[-1, -1, -1], np.inf)])
    assert np.array_equal(far.local(beyond), [[1.0, 1.0, 1.0]])


def test_points_outside_are_refused_with_their_number_and_the_worst():
    points = np.concatenate([places(3), LOW + EXTENT * np.array([[1.5, 0.5, 0.5], [0.5, -1, 0]])])
    words = r"points must lie in the lattice, got 2 of 5 outside, the worst \(0.15, -0.05, 0.3\)"
    with pytest.raises(ValueError, match=words + " m by 1 of an edge"):
        bent().deform(points)
    with pytest.raises(
        ValueError, match=r"got 1 of 1 outside, the worst \(3, 0.3, 0.5\) m by 2.\d+ m"
    ):
        wedge().deform(np.array([[3.0, 0.3, 0.5]]))
    with pytest.raises(ValueError, match="points must be finite"):
        bent().deform(np.full((1, 3), math.nan))
    with pytest.raises(ValueError, match=r"points must have shape \(any, 3\)"):
        bent().deform(np.zeros(3))


def test_even_control_points_move_nothing_once_parameters_are_inverted():
    bases, frame = undeformed().volume.bases, Parallelepiped(LOW, EDGES)
    even = SplineVolume(frame.even_control(COUNTS), bases)
    points = frame.points(np.random.default_rng(4).random((60, 3)))
    assert np.allclose(Lattice(even, even).deform(points), points, rtol=0, atol=1e-12)
    moved = Lattice(even, frame).deform(points)  # as if they were at the Greville abscissae
    assert np.abs(moved - points).max() > 0.01


def test_a_deformed_lattice_over_another_one_takes_its_parameters():
    lattice, at = wedge(), np.random.default_rng(5).random((40, 3))
    assert isinstance(lattice.undeformed, SplineVolume)
    points = lattice.undeformed.at(at)
    assert np.allclose(lattice.local(points), at, rtol=0, atol=1e-9)
    assert np.allclose(lattice.deform(points), bent().volume.at(at), rtol=0, atol=1e-9)


@pytest.mark.parametrize("make", [bent, skewed, wedge])
def test_normals_are_those_of_the_deformed_surface(make):
    lattice, step = make(), 1e-6
    at = np.random.default_rng(6).uniform(0.1, 0.9, (30, 3))
    before = lattice.undeformed
    points = before.points(at) if isinstance(before, Parallelepiped) else before.at(at)
    normals = np.random.default_rng(7).normal(size=(30, 3))
    first = np.cross(normals, [1.0, 2.0, 3.0])
    second = np.cross(normals, first)
    one, other = (
        lattice.deform(points + step * way) - lattice.deform(points - step * way)
        for way in (first, second)
    )
    wanted = np.cross(one, other)
    wanted /= np.linalg.norm(wanted, axis=1, keepdims=True)
    found = lattice.deform_normals(points, normals)
    assert np.allclose(found, wanted, rtol=0, atol=1e-4)


def test_normals_are_finite_where_the_lattice_is_flat():
    control = undeformed().control * [1.0, 1.0, 0.0]
    found = undeformed().with_control(control).deform_normals(places(9), np.eye(3)[[0, 1, 2] * 3])
    assert np.allclose(np.linalg.norm(found, axis=1), 1.0)


@pytest.mark.parametrize(
    ("normals", "words"),
    [
        (np.zeros((1, 3)), "normals must have a direction, got zero"),
        (np.zeros((2, 3)), r"normals must have shape \(1, 3\)"),
        (np.full((1, 3), math.inf), "normals must be finite"),
    ],
)
def test_normals_that_are_none_are_refused(normals, words):
    with pytest.raises(ValueError, match=words):
        bent().deform_normals(places(1), normals)


def test_a_deformed_mesh_keeps_its_outside(ball, is_closed, signed_volume):
    box = np.array([[-0.03, -0.03, -0.03], [0.03, 0.03, 0.03]])
    plain, mesh = box_lattice(box[0], box[1] - box[0], (4, 4, 4)), ball.mesh(3)
    for control in (plain.control * [2, 1, 1], plain.control * [-2, 1, 1]):
        found = Mesh(*plain.with_control(control).deform_mesh(*mesh))
        assert is_closed(found)
        assert signed_volume(found) == pytest.approx(2 * signed_volume(mesh))


def test_moved_control_points_must_be_as_many_as_before():
    with pytest.raises(ValueError, match=r"control must have shape \(6, 4, 5, 3\)"):
        undeformed().with_control(np.zeros((4, 4, 4, 3)))


def test_weights_stay_unless_others_are_given():
    weighted = skewed()
    again = weighted.with_control(weighted.control).volume.weights
    assert again is not None
    assert np.array_equal(again, WEIGHTS / WEIGHTS.max())
    other = weighted.with_control(weighted.control, np.ones(COUNTS)).volume.weights
    assert other is not None
    assert np.array_equal(other, np.ones(COUNTS))


def test_a_box_that_is_none_is_refused():
    with pytest.raises(ValueError, match="extent must be positive"):
        box_lattice(LOW, np.array([1.0, 0.0, 1.0]), COUNTS)
    with pytest.raises(ValueError, match="count must be larger than the degree 3, got 3"):
        box_lattice(LOW, EXTENT, (6, 3, 5))


SURFACE_RNG = np.random.default_rng(2)


def test_normals_stay_at_right_angles_to_the_surface_and_outside():
    slopes = SURFACE_RNG.normal(size=(100, 3, 3))
    normals = SURFACE_RNG.normal(size=(100, 3))
    found = deformed_normals(slopes, normals)
    tangents = np.cross(normals, SURFACE_RNG.normal(size=(100, 3)))
    moved = (slopes @ tangents[:, :, None])[:, :, 0]
    assert np.allclose(np.einsum("ni,ni->n", found, moved), 0.0, rtol=0, atol=1e-12)
    assert np.allclose(np.linalg.norm(found, axis=1), 1.0, rtol=0, atol=1e-14)
    outwards = np.einsum("ni,nij,nj->n", found, slopes, normals)
    assert (outwards > 0.0).all()  # also where the derivative mirrors


def test_normals_are_the_same_in_any_unit():
    slopes, normals = SURFACE_RNG.normal(size=(20, 3, 3)), SURFACE_RNG.normal(size=(20, 3))
    plain = deformed_normals(slopes, normals)
    for scale in (1e-150, 1e100):
        assert np.allclose(deformed_normals(scale * slopes, normals), plain, rtol=0, atol=1e-13)


def test_normals_are_unit_where_everything_is_squeezed_onto_a_plane_a_line_or_a_point():
    flat, line, point = np.diag([1.0, 1.0, 0.0]), np.diag([1.0, 0.0, 0.0]), np.zeros((3, 3))
    for squeezed in (flat, line, point):
        normals = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.6, 0.0, 0.8]])
        found = deformed_normals(np.broadcast_to(squeezed, (3, 3, 3)), normals)
        assert np.allclose(np.linalg.norm(found, axis=1), 1.0, rtol=0, atol=1e-14)
    found = deformed_normals(flat[None], np.array([[0.6, 0.0, 0.8]]))
    assert np.allclose(found, [[0.0, 0.0, 1.0]], rtol=0, atol=1e-8)


@pytest.mark.parametrize("scale", [1e-110, 1e-60, 1.0, 1e110])
def test_a_mirrored_mesh_is_turned_round_in_any_unit(scale):
    vertices = scale * np.vstack([np.zeros(3), np.eye(3)])
    faces = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]], np.int32)
    plain = box_lattice(np.zeros(3), np.full(3, scale), (4, 4, 4))
    mirrored = plain.with_control(plain.control * [1, 1, -1])
    assert np.array_equal(plain.deform_mesh(vertices, faces)[1], faces)
    assert np.array_equal(mirrored.deform_mesh(vertices, faces)[1], faces[:, ::-1])
    assert mirrored.deform_mesh(np.zeros((0, 3)), np.zeros((0, 3), np.int32))[1].shape == (0, 3)


def test_triangles_of_vertices_that_are_not_there_are_refused():
    plain = box_lattice(np.zeros(3), np.ones(3), (4, 4, 4))
    for number in (3, -1):
        with pytest.raises(ValueError, match=f"faces must name the 3 vertices, got {number}"):
            plain.deform_mesh(np.eye(3), np.array([[0, 1, number]], np.int32))
    with pytest.raises(ValueError, match=r"faces must have shape \(any, 3\), got \(1, 4\)"):
        plain.deform_mesh(np.eye(3), np.array([[0, 1, 2, 0]], np.int32))


BOX = np.array([[-0.03, -0.02, -0.05], [0.03, 0.02, 0.07]])
POINTS = BOX[0] + (BOX[1] - BOX[0]) * np.random.default_rng(0).random((50, 3))


def test_layers_that_are_left_alone_move_nothing():
    lattice = layered_lattice(BOX, [LatticeLayer()] * 5)
    assert lattice.control.shape == (4, 4, 5, 3)
    assert np.allclose(lattice.deform(POINTS), POINTS, rtol=0, atol=1e-16)
    assert folded_share(lattice) == 0.0


def test_layers_that_are_all_alike_scale_turn_then_shift():
    moved = layered_lattice(BOX, [LatticeLayer(1.5, math.pi / 2, (0.01, 0.02))] * 4).deform(POINTS)
    x, y, z = POINTS.T
    wanted = np.column_stack([-1.5 * y + 0.01, 1.5 * x + 0.02, z])
    assert np.allclose(moved, wanted, rtol=0, atol=1e-16)


def test_layers_are_taken_from_the_bottom_to_the_top():
    lattice = layered_lattice(
        BOX, [LatticeLayer(), LatticeLayer(), LatticeLayer(), LatticeLayer(2.0)]
    )
    bottom, top = lattice.deform(np.array([BOX[0], BOX[1]]))
    assert bottom == pytest.approx(BOX[0])
    assert top == pytest.approx([0.06, 0.04, 0.07])


def test_a_fold_is_seen_and_its_share_told():
    turned = [LatticeLayer(), LatticeLayer(turn=3.0), LatticeLayer(turn=-3.0), LatticeLayer()]
    assert 0.0 < folded_share(layered_lattice(BOX, turned)) < 1.0
    lattice = layered_lattice(BOX, [LatticeLayer()] * 4)
    mirrored = lattice.with_control(lattice.control[:, :, ::-1])
    assert folded_share(mirrored) == 1.0
    assert folded_share(layered_lattice(BOX, [LatticeLayer(0.05)] * 4)) == 1.0


PULLED_COUNTS = (5, 4, 6)
PULLED_RNG = np.random.default_rng(0)
PULLED_WEIGHTS = PULLED_RNG.uniform(0.3, 3.0, PULLED_COUNTS)


def plain():
    return box_lattice(np.array([-1.0, 2.0, 0.0]), np.array([2.0, 1.0, 3.0]), PULLED_COUNTS)


def weighted():
    lattice = plain()
    return lattice.with_control(
        lattice.control + 0.02 * PULLED_RNG.normal(size=(*PULLED_COUNTS, 3)), PULLED_WEIGHTS
    )


def pulled_places(count):
    return np.asarray(
        [-1.0, 2.0, 0.0] + [2.0, 1.0, 3.0] * np.random.default_rng(1).random((count, 3))
    )


@pytest.mark.parametrize("make", [plain, weighted])
@pytest.mark.parametrize("count", [1, 2, 12])
def test_points_go_to_their_targets(make, count):
    points = pulled_places(count)
    targets = points + 0.1 * PULLED_RNG.normal(size=(count, 3))
    pulled = pull_points(make(), points, targets)
    assert np.allclose(pulled.lattice.deform(points), targets, rtol=0, atol=1e-10)
    assert pulled.residual.max() < 1e-10
    assert pulled.rank == count
    assert pulled.condition >= 1.0


def test_no_smaller_change_of_the_control_points_would_do():
    lattice, points = weighted(), pulled_places(5)
    targets = points + 0.1 * PULLED_RNG.normal(size=(5, 3))
    change = (pull_points(lattice, points, targets).lattice.control - lattice.control).reshape(
        -1, 3
    )
    shares = lattice.volume.shares(lattice.local(points)).toarray()
    wanted = np.linalg.pinv(shares) @ (targets - lattice.deform(points))
    assert np.allclose(change, wanted, rtol=0, atol=1e-12)


def test_only_control_points_that_reach_a_point_move():
    lattice = box_lattice(np.zeros(3), np.ones(3), (8, 4, 4))
    pulled = pull_points(lattice, np.array([[0.05, 0.5, 0.5]]), np.array([[0.05, 0.5, 0.6]]))
    moved = np.abs(pulled.lattice.control - lattice.control).max(axis=(1, 2, 3))
    assert (moved[:4] > 0.0).all()
    assert not moved[4:].any()


def test_a_point_pulled_two_ways_goes_between_them_and_that_is_reported():
    points = np.repeat(pulled_places(1), 2, axis=0)
    pulled = pull_points(plain(), points, points + [[0, 0, 0.2], [0, 0, -0.1]])
    assert pulled.rank == 1
    assert np.allclose(pulled.residual, 0.15, rtol=0, atol=1e-12)
    assert np.allclose(pulled.lattice.deform(points[:1]), points[:1] + [0, 0, 0.05], atol=1e-12)


def test_more_points_than_control_points_are_met_as_well_as_can_be():
    lattice, points = plain(), pulled_places(600)
    targets = points + 0.05 * np.sin(9 * points)
    pulled = pull_points(lattice, points, targets)
    assert pulled.rank <= lattice.control[..., 0].size
    assert pulled.residual.max() > 1e-6
    shares = lattice.volume.shares(lattice.local(points)).toarray()
    left = pulled.lattice.deform(points) - targets
    assert np.abs(shares.T @ left).max() < 1e-10  # nothing is left that control points could do


def test_targets_where_the_points_are_move_nothing():
    lattice, points = weighted(), pulled_places(4)
    pulled = pull_points(lattice, points, lattice.deform(points))
    assert np.allclose(pulled.lattice.control, lattice.control, rtol=0, atol=1e-14)


def test_no_points_move_nothing():
    lattice = plain()
    pulled = pull_points(lattice, np.zeros((0, 3)), np.zeros((0, 3)))
    assert pulled.lattice is lattice
    assert (pulled.rank, pulled.condition, len(pulled.residual)) == (0, 1.0, 0)


@pytest.mark.parametrize("scale", [1e-6, 1e6])
def test_the_pull_is_the_same_in_any_unit(scale):
    points = pulled_places(4)
    targets = points + 0.1 * PULLED_RNG.normal(size=(4, 3))
    low, extent = scale * np.array([-1.0, 2.0, 0.0]), scale * np.array([2.0, 1.0, 3.0])
    here = pull_points(plain(), points, targets)
    there = pull_points(box_lattice(low, extent, PULLED_COUNTS), scale * points, scale * targets)
    assert there.rank == here.rank
    assert np.allclose(there.lattice.control, scale * here.lattice.control, atol=1e-12 * scale)


@pytest.mark.parametrize(
    ("points", "targets", "words"),
    [
        (np.zeros((1, 2)), np.zeros((1, 3)), r"points must have shape \(any, 3\)"),
        (np.zeros((1, 3)), np.zeros((2, 3)), r"targets must have shape \(1, 3\)"),
        (np.zeros((1, 3)), np.full((1, 3), math.nan), "targets must be finite"),
        (np.zeros((1, 3)), np.zeros((1, 3)), "points must lie in the lattice"),
    ],
)
def test_points_and_targets_that_are_none_are_refused(points, targets, words):
    with pytest.raises(ValueError, match=words):
        pull_points(plain(), points, targets)
