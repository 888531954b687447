from __future__ import annotations

import math

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.splines.lattice import Lattice, undeformed_control

LOW, EXTENT, COUNTS = np.array([-0.1, 0.2, 0.3]), np.array([0.5, 0.25, 2.0]), (6, 4, 5)


def places(count: int) -> Floats:
    return np.asarray(LOW + EXTENT * np.random.default_rng(0).random((count, 3)))


def undeformed() -> Lattice:
    return Lattice(undeformed_control(LOW, EXTENT, COUNTS), LOW, EXTENT)


def bent() -> Lattice:
    control = undeformed_control(LOW, EXTENT, COUNTS)
    noise = np.random.default_rng(1).normal(size=control.shape)
    return Lattice(control + 0.05 * EXTENT * noise, LOW, EXTENT)


def test_an_undeformed_lattice_moves_nothing() -> None:
    points = places(200)
    assert np.allclose(undeformed().deform(points), points, rtol=0, atol=2e-15)
    assert np.allclose(undeformed().jacobian_determinant(points), 1.0, rtol=0, atol=2e-14)


def test_the_control_points_have_the_counts_asked_for_along_z_x_y() -> None:
    control = undeformed_control(LOW, EXTENT, COUNTS)
    assert control.shape == (*COUNTS, 3)
    assert control[0, 0, 0] == pytest.approx(LOW)
    assert control[-1, 0, 0] == pytest.approx(LOW + EXTENT * [0, 0, 1])
    assert control[0, -1, 0] == pytest.approx(LOW + EXTENT * [1, 0, 0])
    assert control[0, 0, -1] == pytest.approx(LOW + EXTENT * [0, 1, 0])


def test_affine_motions_of_the_control_points_are_reproduced() -> None:
    matrix = np.array([[1.2, 0.3, 0.0], [-0.1, 0.8, 0.2], [0.4, 0.0, 1.1]])
    shift = np.array([1.0, -2.0, 0.5])
    control = undeformed().control @ matrix.T + shift
    lattice, points = Lattice(control, LOW, EXTENT), places(100)
    assert np.allclose(lattice.deform(points), points @ matrix.T + shift, rtol=0, atol=1e-14)
    volume = np.linalg.det(matrix)
    assert np.allclose(lattice.jacobian_determinant(points), volume, rtol=1e-12)


def test_the_change_of_volume_is_that_of_finite_differences() -> None:
    lattice, points = bent(), places(60)
    points = np.clip(points, LOW + 0.01 * EXTENT, LOW + 0.99 * EXTENT)
    step = 1e-6
    columns = [
        (lattice.deform(points + step * axis) - lattice.deform(points - step * axis)) / (2 * step)
        for axis in np.eye(3)
    ]
    wanted = np.linalg.det(np.stack(columns, axis=-1))
    assert np.allclose(lattice.jacobian_determinant(points), wanted, rtol=1e-6, atol=1e-7)
    assert np.ptp(wanted) > 0.1


def test_a_mirrored_lattice_is_a_fold_everywhere() -> None:
    control = undeformed().control[:, ::-1]
    determinant = Lattice(control, LOW, EXTENT).jacobian_determinant(places(20))
    assert np.allclose(determinant, -1.0, atol=1e-12)


def test_points_outside_move_as_the_nearest_face_does() -> None:
    lattice = bent()
    points = LOW + EXTENT * np.array([[1.5, 0.5, 0.5], [0.5, -1.0, 2.0]])
    nearest = LOW + EXTENT * np.array([[1.0, 0.5, 0.5], [0.5, 0.0, 1.0]])
    assert np.allclose(lattice.deform(points), lattice.deform(nearest), rtol=0, atol=1e-15)


def test_corners_go_where_their_control_points_are() -> None:
    lattice = bent()
    corners = LOW + EXTENT * np.array([[0, 0, 0], [1, 1, 1], [1, 0, 0]])
    wanted = lattice.control[[0, -1, 0], [0, -1, -1], [0, -1, 0]]
    assert np.allclose(lattice.deform(corners), wanted, atol=1e-15)


@pytest.mark.parametrize(
    ("control", "low", "extent", "words"),
    [
        (np.zeros((3, 4, 4, 3)), LOW, EXTENT, r"4 points along each axis, got \(3, 4, 4\)"),
        (np.zeros((4, 4, 3, 3)), LOW, EXTENT, r"4 points along each axis, got \(4, 4, 3\)"),
        (np.zeros((4, 4, 4, 2)), LOW, EXTENT, r"control must have shape \(any, any, any, 3\)"),
        (np.full((4, 4, 4, 3), math.nan), LOW, EXTENT, "control must be finite"),
        (np.zeros((4, 4, 4, 3)), LOW, [1.0, 0.0, 1.0], r"extent must be positive, got \[1.0, 0.0"),
        (np.zeros((4, 4, 4, 3)), LOW, [1.0, -1.0, 1.0], "extent must be positive"),
        (np.zeros((4, 4, 4, 3)), [0.0, math.inf, 0.0], EXTENT, "low must be finite"),
    ],
)
def test_what_is_no_lattice_is_refused(
    control: Floats, low: Floats, extent: Floats, words: str
) -> None:
    with pytest.raises(ValueError, match=words):
        Lattice(control, np.array(low), np.array(extent))
