from __future__ import annotations

import math

import numpy as np
import pytest

from palpate.core.splines.bases import Basis, clamped_basis, uniform_knots
from palpate.core.splines.spline_volumes import (
    Bases,
    Parallelepiped,
    SplineVolume,
    upright_parallelepiped,
)

RNG = np.random.default_rng(7)
BASES: Bases = (clamped_basis(6), clamped_basis(3, 2), Basis(uniform_knots(5, 2), 2))
CONTROL = RNG.normal(size=(6, 3, 5, 3))
WEIGHTS = RNG.uniform(0.3, 3.0, (6, 3, 5))
AT = np.concatenate([RNG.random((40, 3)), [[0, 0, 0], [1, 1, 1], [0, 1, 0.5]]])
VOLUMES = [SplineVolume(CONTROL, BASES), SplineVolume(CONTROL, BASES, WEIGHTS)]
KINDS = ["polynomial", "rational"]


@pytest.mark.parametrize("volume", VOLUMES, ids=KINDS)
def test_points_are_means_of_the_control_points_by_their_shares(volume):
    shares = volume.shares(AT)
    assert np.allclose(shares.sum(axis=1), 1.0, rtol=0, atol=1e-14)
    assert (shares.data >= 0.0).all()
    assert np.allclose(volume.at(AT), shares @ CONTROL.reshape(-1, 3), rtol=0, atol=1e-14)


@pytest.mark.parametrize("volume", VOLUMES, ids=KINDS)
def test_slopes_and_second_derivatives_are_difference_quotients(volume):
    at, step = RNG.uniform(0.01, 0.99, (30, 3)), 1e-6
    points, slopes, bends = volume.second(at)
    assert np.allclose(points, volume.at(at), rtol=0, atol=1e-14)
    assert np.allclose(volume.first(at)[1], slopes, rtol=0, atol=1e-12)
    for axis, way in enumerate(np.eye(3)):
        (high, high_slopes), (low, low_slopes) = (
            volume.first(at + k * step * way) for k in (1, -1)
        )
        assert np.allclose(slopes[:, :, axis], (high - low) / (2 * step), rtol=0, atol=1e-6)
        quotient = (high_slopes - low_slopes) / (2 * step)
        assert np.allclose(bends[:, :, :, axis], quotient, rtol=0, atol=1e-4)


@pytest.mark.parametrize("volume", VOLUMES, ids=KINDS)
def test_a_grid_holds_the_points_of_its_places(volume):
    axes = np.linspace(0, 1, 4), np.linspace(0, 1, 3), np.linspace(0, 1, 5)
    places = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    wanted = volume.at(places.reshape(-1, 3)).reshape(places.shape)
    assert np.allclose(volume.grid(*axes), wanted, rtol=0, atol=1e-14)


def test_weights_that_are_all_alike_change_nothing():
    alike = SplineVolume(CONTROL, BASES, np.full((6, 3, 5), 7.0))
    assert np.allclose(alike.at(AT), VOLUMES[0].at(AT), rtol=0, atol=1e-14)


def test_a_heavy_control_point_draws_its_surroundings():
    heavy = np.ones((6, 3, 5))
    heavy[2, 1, 2] = 1e6
    at = np.array([[0.3, 0.5, 0.5]])
    drawn = SplineVolume(CONTROL, BASES, heavy).at(at)[0]
    assert np.linalg.norm(drawn - CONTROL[2, 1, 2]) < 1e-4


def test_a_rational_quadratic_makes_an_exact_quarter_of_a_cylinder():
    arc = np.array([[1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    control = np.zeros((2, 3, 2, 3))
    control[0, :, :, :2], control[1, :, :, :2] = arc[:, None], 2.0 * arc[:, None]
    control[:, :, 1, 2] = 1.0
    weights = np.broadcast_to(np.array([1.0, math.sqrt(0.5), 1.0])[None, :, None], (2, 3, 2))
    bases = clamped_basis(2, 1), clamped_basis(3, 2), clamped_basis(2, 1)
    points = SplineVolume(control, bases, weights).at(AT)
    assert np.allclose(np.hypot(points[:, 0], points[:, 1]), 1.0 + AT[:, 0], rtol=0, atol=1e-14)


def test_an_affine_image_of_the_control_points_is_one_of_all_points():
    matrix, shift = RNG.normal(size=(3, 3)), RNG.normal(size=3)
    for volume in VOLUMES:
        image = SplineVolume(CONTROL @ matrix + shift, BASES, volume.weights)
        assert np.allclose(image.at(AT), volume.at(AT) @ matrix + shift, rtol=0, atol=1e-13)


@pytest.mark.parametrize(
    ("control", "bases", "weights", "words"),
    [
        (CONTROL[:5], BASES, None, r"control must have shape \(6, 3, 5, 3\), got \(5, 3, 5, 3\)"),
        (CONTROL * math.nan, BASES, None, "control must be finite"),
        (CONTROL, BASES, WEIGHTS[:, :, :4], r"weights must have shape \(6, 3, 5\)"),
        (CONTROL, BASES, WEIGHTS * math.inf, "weights must be finite"),
        (
            CONTROL,
            (Basis(2.0 * clamped_basis(6).knots, 3), *BASES[1:]),
            None,
            r"basis along s must span 0 to 1, got \(0.0, 2.0\)",
        ),
    ],
)
def test_what_is_no_volume_is_refused(control, bases, weights, words):
    with pytest.raises(ValueError, match=words):
        SplineVolume(control, bases, weights)


def test_a_volume_has_three_bases():
    with pytest.raises(ValueError, match="bases must be three, for s, t and u, got 2"):
        SplineVolume(CONTROL[:, :, 0], BASES[:2])  # type: ignore[arg-type]


def test_no_points_have_no_shares():
    assert VOLUMES[1].shares(np.zeros((0, 3))).shape == (0, 90)


def test_parameters_outside_are_refused():
    outside = np.array([[0.5, 0.5, 1.1]])
    for ask in (VOLUMES[0].at, VOLUMES[0].first, VOLUMES[0].second, VOLUMES[0].shares):
        with pytest.raises(ValueError, match="x must lie in the domain from 0 to 1"):
            ask(outside)
        with pytest.raises(ValueError, match=r"must have shape \(any, 3\), got \(1, 2\)"):
            ask(outside[:, :2])


def test_a_volume_keeps_arrays_that_nobody_can_write():
    for array in (VOLUMES[1].control, VOLUMES[1].weights, VOLUMES[1].spline):
        assert array is not None
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1.0


EDGES = np.array([[0.5, 0.1, 0.0], [-0.1, 0.25, 0.0], [0.3, 0.0, 2.0]])
CORNER = np.array([-0.1, 0.2, 0.3])


def test_the_corners_have_parameters_0_and_1():
    frame = Parallelepiped(CORNER, EDGES)
    assert np.allclose(frame.local(CORNER[None]), 0.0, rtol=0, atol=0)
    assert np.allclose(frame.local(CORNER + EDGES), np.eye(3), rtol=0, atol=1e-15)


def test_parameters_and_points_are_each_others_inverse(rotations):
    rng = np.random.default_rng(0)
    for rotation in rotations(5):
        frame = Parallelepiped(CORNER, EDGES @ rotation)
        points = rng.normal(size=(50, 3))
        assert np.allclose(frame.points(frame.local(points)), points, rtol=0, atol=1e-14)


def test_the_volume_is_signed():
    assert Parallelepiped(CORNER, EDGES).volume == pytest.approx(np.linalg.det(EDGES))
    assert Parallelepiped(CORNER, EDGES[::-1]).volume < 0.0
    assert upright_parallelepiped(CORNER, np.array([1.0, 2.0, 3.0])).volume == pytest.approx(6.0)


def test_even_control_points_divide_the_edges_alike():
    control = Parallelepiped(CORNER, EDGES).even_control((3, 2, 5))
    assert control.shape == (3, 2, 5, 3)
    assert np.allclose(control[1, 1, 3], CORNER + EDGES.T @ [0.5, 1.0, 0.75])


def test_control_points_at_greville_abscissae_begin_and_end_at_the_corners():
    bases = clamped_basis(6), clamped_basis(4), clamped_basis(5)
    control = Parallelepiped(CORNER, EDGES).greville_control(bases)
    assert control.shape == (6, 4, 5, 3)
    assert np.allclose(control[-1, 0, 0], CORNER + EDGES[0])
    assert np.allclose(control[0, -1, 0], CORNER + EDGES[1])
    assert np.allclose(control[0, 0, -1], CORNER + EDGES[2])


def test_for_bernstein_polynomials_even_steps_are_the_greville_abscissae():
    frame = Parallelepiped(CORNER, EDGES)
    bases = clamped_basis(4, 3), clamped_basis(3, 2), clamped_basis(5, 4)
    assert np.allclose(frame.greville_control(bases), frame.even_control((4, 3, 5)), atol=1e-15)


def test_a_frame_keeps_arrays_that_nobody_can_write():
    edges = EDGES.copy()
    frame = Parallelepiped(CORNER, edges)
    edges[0, 0] = 9.0
    assert frame.edges[0, 0] == 0.5
    with pytest.raises(ValueError, match="read-only"):
        frame.inverse[0, 0] = 1.0


@pytest.mark.parametrize("size", [1e-200, 1e-9, 1e9, 1e150])
def test_no_size_is_too_small_or_too_large(size):
    frame = Parallelepiped(size * CORNER, size * EDGES)
    assert np.allclose(frame.local(size * (CORNER + EDGES)), np.eye(3), rtol=0, atol=1e-14)


@pytest.mark.parametrize(
    ("corner", "edges", "words"),
    [
        (CORNER[:2], EDGES, r"corner must have shape \(3\)"),
        (CORNER, EDGES[:2], r"edges must have shape \(3, 3\)"),
        (CORNER * math.inf, EDGES, "corner must be finite"),
        (CORNER, EDGES * math.nan, "edges must be finite"),
        (CORNER, EDGES * [[1], [0], [1]], r"edges must have a length, got \[\[0.5"),
        (CORNER, EDGES[[0, 1, 0]], "edges must not lie in a plane"),
    ],
)
def test_what_is_no_parallelepiped_is_refused(corner, edges, words):
    with pytest.raises(ValueError, match=words):
        Parallelepiped(corner, edges)


@pytest.mark.parametrize(
    ("low", "extent", "words"),
    [
        (CORNER, [1.0, 0.0, 1.0], r"extent must be positive, got \[1.0, 0.0, 1.0\] m"),
        (CORNER, [1.0, -1.0, 1.0], "extent must be positive"),
        ([0.0, math.inf, 0.0], [1.0, 1.0, 1.0], "low must be finite"),
    ],
)
def test_what_is_no_upright_box_is_refused(low, extent, words):
    with pytest.raises(ValueError, match=words):
        upright_parallelepiped(np.array(low), np.array(extent))


def test_fewer_than_two_control_points_along_an_edge_are_refused():
    with pytest.raises(ValueError, match=r"counts must be at least 2 along each edge, got \(2, 1"):
        Parallelepiped(CORNER, EDGES).even_control((2, 1, 2))
