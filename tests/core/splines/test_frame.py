from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.splines.basis import bernstein_basis, clamped_basis
from palpate.core.splines.frame import Frame, upright_frame

EDGES = np.array([[0.5, 0.1, 0.0], [-0.1, 0.25, 0.0], [0.3, 0.0, 2.0]])
CORNER = np.array([-0.1, 0.2, 0.3])


def test_the_corners_have_parameters_0_and_1() -> None:
    frame = Frame(CORNER, EDGES)
    assert np.allclose(frame.local(CORNER[None]), 0.0, rtol=0, atol=0)
    assert np.allclose(frame.local(CORNER + EDGES), np.eye(3), rtol=0, atol=1e-15)


def test_parameters_and_points_are_each_others_inverse(
    rotations: Callable[[int], Floats],
) -> None:
    rng = np.random.default_rng(0)
    for rotation in rotations(5):
        frame = Frame(CORNER, EDGES @ rotation)
        points = rng.normal(size=(50, 3))
        assert np.allclose(frame.points(frame.local(points)), points, rtol=0, atol=1e-14)


def test_the_volume_is_signed() -> None:
    assert Frame(CORNER, EDGES).volume == pytest.approx(np.linalg.det(EDGES))
    assert Frame(CORNER, EDGES[::-1]).volume < 0.0
    assert upright_frame(CORNER, np.array([1.0, 2.0, 3.0])).volume == pytest.approx(6.0)


def test_even_control_points_divide_the_edges_alike() -> None:
    control = Frame(CORNER, EDGES).even_control((3, 2, 5))
    assert control.shape == (3, 2, 5, 3)
    assert np.allclose(control[1, 1, 3], CORNER + EDGES.T @ [0.5, 1.0, 0.75])


def test_control_points_at_greville_abscissae_begin_and_end_at_the_corners() -> None:
    bases = clamped_basis(6), clamped_basis(4), clamped_basis(5)
    control = Frame(CORNER, EDGES).greville_control(bases)
    assert control.shape == (6, 4, 5, 3)
    assert np.allclose(control[-1, 0, 0], CORNER + EDGES[0])
    assert np.allclose(control[0, -1, 0], CORNER + EDGES[1])
    assert np.allclose(control[0, 0, -1], CORNER + EDGES[2])


def test_for_bernstein_polynomials_even_steps_are_the_greville_abscissae() -> None:
    frame = Frame(CORNER, EDGES)
    bases = bernstein_basis(3), bernstein_basis(2), bernstein_basis(4)
    assert np.allclose(frame.greville_control(bases), frame.even_control((4, 3, 5)), atol=1e-15)


def test_a_frame_keeps_arrays_that_nobody_can_write() -> None:
    edges = EDGES.copy()
    frame = Frame(CORNER, edges)
    edges[0, 0] = 9.0
    assert frame.edges[0, 0] == 0.5
    with pytest.raises(ValueError, match="read-only"):
        frame.inverse[0, 0] = 1.0


@pytest.mark.parametrize("size", [1e-200, 1e-9, 1e9, 1e150])
def test_no_size_is_too_small_or_too_large(size: float) -> None:
    frame = Frame(size * CORNER, size * EDGES)
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
def test_what_is_no_parallelepiped_is_refused(corner: Floats, edges: Floats, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        Frame(corner, edges)


@pytest.mark.parametrize(
    ("low", "extent", "words"),
    [
        (CORNER, [1.0, 0.0, 1.0], r"extent must be positive, got \[1.0, 0.0, 1.0\] m"),
        (CORNER, [1.0, -1.0, 1.0], "extent must be positive"),
        ([0.0, math.inf, 0.0], [1.0, 1.0, 1.0], "low must be finite"),
    ],
)
def test_what_is_no_upright_box_is_refused(low: Floats, extent: Floats, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        upright_frame(np.array(low), np.array(extent))


def test_fewer_than_two_control_points_along_an_edge_are_refused() -> None:
    with pytest.raises(ValueError, match=r"counts must be at least 2 along each edge, got \(2, 1"):
        Frame(CORNER, EDGES).even_control((2, 1, 2))
