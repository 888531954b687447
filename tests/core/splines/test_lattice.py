from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from palpate.core.arrays import Floats
from palpate.core.shapes.protocol import Mesh
from palpate.core.shapes.superquadric import Superquadric
from palpate.core.splines.basis import clamped_basis
from palpate.core.splines.determinant import mean_determinant
from palpate.core.splines.frame import Frame
from palpate.core.splines.lattice import Lattice, box_lattice
from palpate.core.splines.volume import Volume

LOW, EXTENT, COUNTS = np.array([-0.1, 0.2, 0.3]), np.array([0.5, 0.25, 2.0]), (6, 4, 5)
EDGES = np.array([[0.5, 0.1, 0.0], [-0.1, 0.25, 0.0], [0.3, 0.0, 2.0]])
RNG = np.random.default_rng(1)
NOISE = RNG.normal(size=(*COUNTS, 3))
WEIGHTS = RNG.uniform(0.5, 2.0, COUNTS)


def places(count: int) -> Floats:
    return np.asarray(LOW + EXTENT * np.random.default_rng(0).random((count, 3)))


def undeformed() -> Lattice:
    return box_lattice(LOW, EXTENT, COUNTS)


def bent() -> Lattice:
    return undeformed().with_control(undeformed().control + 0.05 * EXTENT * NOISE)


def skewed() -> Lattice:
    """Weighted, over a parallelepiped."""
    bases = clamped_basis(6), clamped_basis(4), clamped_basis(5, 2)
    frame = Frame(LOW, EDGES)
    control = frame.greville_control(bases)
    return Lattice(Volume(control + 0.02 * NOISE, bases, WEIGHTS), frame)


def wedge() -> Lattice:
    """Over an undeformed lattice that is no parallelepiped, and folds nowhere."""
    before = undeformed().control.copy()
    before[..., 0] *= 1.0 + 0.3 * before[..., 2]
    volume = Volume(before, undeformed().volume.bases)
    return Lattice(bent().volume, volume)


def test_an_undeformed_lattice_moves_nothing() -> None:
    points = places(200)
    assert np.allclose(undeformed().deform(points), points, rtol=0, atol=2e-15)
    assert np.allclose(undeformed().jacobian_determinant(points), 1.0, rtol=0, atol=2e-14)


@pytest.mark.parametrize(("counts", "degree"), [((2, 2, 2), 1), ((3, 4, 6), 2), ((5, 5, 5), 4)])
def test_an_undeformed_lattice_of_any_degree_moves_nothing(
    counts: tuple[int, int, int], degree: int
) -> None:
    points = places(50)
    moved = box_lattice(LOW, EXTENT, counts, degree).deform(points)
    assert np.allclose(moved, points, rtol=0, atol=2e-15)


def test_the_control_points_run_along_s_t_u() -> None:
    control = undeformed().control
    assert control.shape == (*COUNTS, 3)
    assert control[0, 0, 0] == pytest.approx(LOW)
    assert control[-1, 0, 0] == pytest.approx(LOW + EXTENT * [1, 0, 0])
    assert control[0, -1, 0] == pytest.approx(LOW + EXTENT * [0, 1, 0])
    assert control[0, 0, -1] == pytest.approx(LOW + EXTENT * [0, 0, 1])


def test_affine_motions_of_the_control_points_are_reproduced() -> None:
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


def test_mirrored_control_points_mirror_the_deformation() -> None:
    mirror = np.array([-1.0, 1.0, 1.0])
    there = box_lattice(LOW * mirror - [EXTENT[0], 0, 0], EXTENT, COUNTS)
    there = there.with_control(bent().control[::-1] * mirror)
    points = places(50)
    assert np.allclose(there.deform(points * mirror), bent().deform(points) * mirror, atol=1e-14)


@pytest.mark.parametrize("make", [bent, skewed, wedge])
def test_the_jacobian_is_that_of_finite_differences(make: Callable[[], Lattice]) -> None:
    lattice, step = make(), 1e-6
    inside = np.random.default_rng(3).uniform(0.05, 0.9, (40, 3))
    before = lattice.undeformed
    points = before.points(inside) if isinstance(before, Frame) else before.at(inside)
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


def test_the_change_of_volume_on_a_grid_is_that_at_its_points() -> None:
    axes = np.array([0.0, 0.4, 1.0]), np.array([0.2, 0.9]), np.array([0.5])
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    for lattice in (bent(), skewed()):
        assert isinstance(lattice.undeformed, Frame)
        wanted = lattice.jacobian_determinant(lattice.undeformed.points(grid))
        found = lattice.change_on_grid(*axes)
        assert found.shape == (3, 2, 1)
        assert np.allclose(found.ravel(), wanted, rtol=1e-11)


def test_the_unit_of_change_is_the_undeformed_volume() -> None:
    before = wedge().undeformed
    assert isinstance(before, Volume)
    assert mean_determinant(before) == pytest.approx(EXTENT.prod() * 1.39, rel=1e-3)  # 1 + .3 z
    still = Lattice(before, before)
    assert mean_determinant(still.relative) == pytest.approx(1.0)
    assert mean_determinant(undeformed().relative) == pytest.approx(1.0)
    wider = Lattice(Volume(2.0 * before.control, before.bases, before.weights), before)
    assert mean_determinant(wider.relative) == pytest.approx(8.0)


def test_a_lattice_that_was_flat_changes_no_volume() -> None:
    plain = undeformed()
    flat = Volume(plain.control * [1, 1, 0], plain.volume.bases)
    assert np.array_equal(
        Lattice(flat, flat).change_on_grid(*np.full((3, 2), 0.3)), np.zeros((2, 2, 2))
    )


def test_a_mirrored_lattice_is_a_fold_everywhere() -> None:
    lattice = undeformed().with_control(undeformed().control[:, ::-1])
    assert np.allclose(lattice.jacobian_determinant(places(20)), -1.0, rtol=0, atol=1e-12)


def test_faces_edges_and_corners_deform_as_the_inside_next_to_them_does() -> None:
    lattice = bent()
    ends = np.stack(np.meshgrid(*[[0.0, 0.5, 1.0]] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    inside = np.clip(ends, 1e-9, 1 - 1e-9)
    here, there = (lattice.deform(LOW + EXTENT * at) for at in (ends, inside))
    assert np.allclose(here, there, rtol=0, atol=1e-8)
    corners = lattice.deform(LOW + EXTENT * np.array([[0, 0, 0], [1, 1, 1], [1, 0, 0]]))
    wanted = lattice.control[[0, -1, -1], [0, -1, 0], [0, -1, 0]]
    assert np.allclose(corners, wanted, rtol=0, atol=1e-15)


def test_points_outside_by_rounding_are_on_the_face() -> None:
    far = box_lattice(LOW + 1e4, EXTENT, COUNTS)
    beyond = np.array([np.nextafter(far.control[-1, -1, -1], np.inf)])
    assert np.array_equal(far.local(beyond), [[1.0, 1.0, 1.0]])


def test_points_outside_are_refused_with_their_number_and_the_worst() -> None:
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


def test_even_control_points_move_nothing_once_parameters_are_inverted() -> None:
    bases, frame = undeformed().volume.bases, Frame(LOW, EDGES)
    even = Volume(frame.even_control(COUNTS), bases)
    points = frame.points(np.random.default_rng(4).random((60, 3)))
    assert np.allclose(Lattice(even, even).deform(points), points, rtol=0, atol=1e-12)
    moved = Lattice(even, frame).deform(points)  # as if they were at the Greville abscissae
    assert np.abs(moved - points).max() > 0.01


def test_a_deformed_lattice_over_another_one_takes_its_parameters() -> None:
    lattice, at = wedge(), np.random.default_rng(5).random((40, 3))
    assert isinstance(lattice.undeformed, Volume)
    points = lattice.undeformed.at(at)
    assert np.allclose(lattice.local(points), at, rtol=0, atol=1e-9)
    assert np.allclose(lattice.deform(points), bent().volume.at(at), rtol=0, atol=1e-9)


@pytest.mark.parametrize("make", [bent, skewed, wedge])
def test_normals_are_those_of_the_deformed_surface(make: Callable[[], Lattice]) -> None:
    lattice, step = make(), 1e-6
    at = np.random.default_rng(6).uniform(0.1, 0.9, (30, 3))
    before = lattice.undeformed
    points = before.points(at) if isinstance(before, Frame) else before.at(at)
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


def test_normals_are_finite_where_the_lattice_is_flat() -> None:
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
def test_normals_that_are_none_are_refused(normals: Floats, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        bent().deform_normals(places(1), normals)


def test_a_deformed_mesh_keeps_its_outside(
    ball: Superquadric,
    is_closed: Callable[[Mesh], bool],
    signed_volume: Callable[[Mesh], float],
) -> None:
    box = np.array([[-0.03, -0.03, -0.03], [0.03, 0.03, 0.03]])
    plain, mesh = box_lattice(box[0], box[1] - box[0], (4, 4, 4)), ball.mesh(3)
    for control in (plain.control * [2, 1, 1], plain.control * [-2, 1, 1]):
        found = Mesh(*plain.with_control(control).deform_mesh(*mesh))
        assert is_closed(found)
        assert signed_volume(found) == pytest.approx(2 * signed_volume(mesh))


def test_moved_control_points_must_be_as_many_as_before() -> None:
    with pytest.raises(ValueError, match=r"control must have shape \(6, 4, 5, 3\)"):
        undeformed().with_control(np.zeros((4, 4, 4, 3)))


def test_weights_stay_unless_others_are_given() -> None:
    weighted = skewed()
    again = weighted.with_control(weighted.control).volume.weights
    assert again is not None
    assert np.array_equal(again, WEIGHTS / WEIGHTS.max())
    other = weighted.with_control(weighted.control, np.ones(COUNTS)).volume.weights
    assert other is not None
    assert np.array_equal(other, np.ones(COUNTS))


def test_a_box_that_is_none_is_refused() -> None:
    with pytest.raises(ValueError, match="extent must be positive"):
        box_lattice(LOW, np.array([1.0, 0.0, 1.0]), COUNTS)
    with pytest.raises(ValueError, match="count must be larger than the degree 3, got 3"):
        box_lattice(LOW, EXTENT, (6, 3, 5))
