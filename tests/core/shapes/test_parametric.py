from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.shapes.parametric import SurfacePoints, grid_of_angles, regular, trigonometric
from palpate.core.shapes.superquadric import Superquadric

Way = Callable[[Superquadric, Floats, Floats], SurfacePoints]
SIZE = np.array([0.03, 0.02, 0.04])
PAIRS = [[0.02, 0.02], [0.15, 0.15], [1.0, 1.0], [0.4, 1.6], [2.0, 2.0]]


@pytest.mark.parametrize("way", [trigonometric, regular])
@pytest.mark.parametrize("exponents", PAIRS)
def test_points_lie_on_the_surface_and_normals_are_those_of_the_gauge(
    way: Way, exponents: list[float]
) -> None:
    shape = Superquadric(SIZE, np.array(exponents))
    points, normals = way(shape, *grid_of_angles(31, 40))
    assert np.abs(shape.gauge(points) - 1.0).max() < 1e-14
    assert np.allclose(np.linalg.norm(normals, axis=1), 1.0, atol=1e-15)
    inner = np.abs(points / SIZE).min(axis=1) > 1e-3  # off the creases
    assert np.abs(normals[inner] - shape.normals(points[inner])).max() < 1e-9


@pytest.mark.parametrize("way", [trigonometric, regular])
@pytest.mark.parametrize("exponents", PAIRS)
def test_poles_and_seam_have_their_points_and_normals(way: Way, exponents: list[float]) -> None:
    shape = Superquadric(SIZE, np.array(exponents))
    eta = np.array([0.5, -0.5, 0.0, 0.0]) * math.pi
    points, normals = way(shape, eta, np.array([0.3, 0.3, -math.pi, 0.5 * math.pi]))
    wanted = np.array([[0, 0, 1], [0, 0, -1], [-1, 0, 0], [0, 1, 0]])
    assert np.array_equal(points[2:], wanted[2:] * SIZE)
    assert np.allclose(points[:2], wanted[:2] * SIZE, atol=1e-16)
    assert np.isfinite(normals).all()
    assert (np.einsum("ni,ni->n", normals, wanted) > 0.2).all()


def test_every_power_keeps_its_sign() -> None:
    eta, omega = grid_of_angles(20, 40)
    points = trigonometric(Superquadric(SIZE, np.array([0.3, 0.7])), eta, omega).points
    wanted = np.column_stack([np.cos(omega), np.sin(omega), np.sin(eta)])
    clear = (np.abs(wanted) > 1e-9).all(axis=1) & (np.abs(eta) < 1.5)
    assert (np.sign(points) == np.sign(wanted))[clear].all()
    assert clear.sum() > 500


def test_the_seam_is_there_once() -> None:
    eta, omega = grid_of_angles(3, 8)
    assert omega[:8] == pytest.approx(-math.pi + math.pi / 4 * np.arange(8))
    equator = regular(Superquadric(SIZE, np.ones(2)), eta, omega).points[8:16]
    assert len(np.unique(equator.round(12), axis=0)) == 8


def test_regular_points_are_far_more_evenly_spaced_on_a_box() -> None:
    shape = Superquadric(np.ones(3), np.full(2, 0.1))
    omega = grid_of_angles(2, 80).omega[:80]
    unevenness = {}
    for way in (trigonometric, regular):
        ring = way(shape, np.zeros(80), omega).points
        gaps = np.linalg.norm(np.roll(ring, -1, axis=0) - ring, axis=1)
        unevenness[way] = gaps.max() / gaps.min()
    assert unevenness[regular] < 2.0
    assert unevenness[trigonometric] > 50.0


@pytest.mark.parametrize(("rows", "columns"), [(1, 8), (3, 2)])
def test_a_grid_that_is_too_small_is_refused(rows: int, columns: int) -> None:
    words = rf"at least 2 rows and 3 columns, got {rows} and {columns}"
    with pytest.raises(ValueError, match=words):
        grid_of_angles(rows, columns)


def test_angles_that_do_not_match_are_refused() -> None:
    shape = Superquadric(SIZE, np.ones(2))
    with pytest.raises(ValueError, match=r"omega must have shape \(2\), got \(3,\)"):
        regular(shape, np.zeros(2), np.zeros(3))
    with pytest.raises(ValueError, match="eta must be finite"):
        trigonometric(shape, np.array([math.inf]), np.zeros(1))
