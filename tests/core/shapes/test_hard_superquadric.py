"""Cases in which the formulas as they are printed fail."""

from __future__ import annotations

import math

import numpy as np
import pytest

from palpate.core.shapes.bend import Bend
from palpate.core.shapes.inside_outside import InsideOutside, inside_outside
from palpate.core.shapes.superquadric import Superquadric
from palpate.core.shapes.taper import Taper

PAIRS = [[0.01, 0.01], [0.05, 0.05], [0.1, 2.0], [1.0, 1.0], [2.0, 0.1], [2.0, 2.0]]
POINTS = np.random.default_rng(0).uniform(-1, 1, (500, 3))


def all_finite(found: InsideOutside) -> bool:
    return all(np.isfinite(part).all() for part in found)


@pytest.mark.parametrize("exponents", PAIRS)
def test_f_is_finite_and_the_same_in_all_octants(exponents: list[float]) -> None:
    wanted = inside_outside(np.abs(POINTS), exponents)
    for signs in np.array(np.meshgrid([1, -1], [1, -1], [1, -1])).reshape(3, 8).T:
        found = inside_outside(np.abs(POINTS) * signs, exponents)
        assert all_finite(found)
        assert np.array_equal(found.value, wanted.value)
        assert np.array_equal(found.by_place * signs, wanted.by_place)


@pytest.mark.parametrize("exponent", [0.01, 0.02, 0.05])
def test_30_sizes_away_along_an_axis_f_is_900_where_its_powers_overflow(exponent: float) -> None:
    found = inside_outside(30.0 * np.eye(3), [exponent, exponent])
    assert np.exp(found.value) == pytest.approx(900.0, rel=1e-14)
    assert 30.0 ** (2 / 0.01) > 1e295  # and its square is none


@pytest.mark.parametrize("exponents", PAIRS)
def test_at_the_centre_f_is_0_its_gradient_finite_and_the_distance_inwards(
    exponents: list[float],
) -> None:
    found = inside_outside(np.zeros((1, 3)), exponents)
    assert all_finite(found)
    assert np.exp(found.value[0]) == 0.0
    assert found.by_place.tolist() == [[0.0, 0.0, 0.0]]
    shape = Superquadric(np.array([0.3, 0.2, 0.1]), np.maximum(exponents, 0.02))
    # The radial distance |x| (1 - 1 / gauge) of points closer and closer to the centre.
    near = np.outer([1e-3, 1e-9, 1e-200], [1.0, 0.0, 0.0])
    radial = np.abs(near[:, 0]) - np.abs(near[:, 0]) / shape.gauge(near)
    assert radial == pytest.approx([-0.299, -0.3, -0.3], abs=1e-8)
    assert shape.normals(np.zeros((1, 3))).tolist() == [[0.0, 0.0, 1.0]]


@pytest.mark.parametrize("exponents", [[2.0, 2.0], [1.0, 2.0], [2.0, 1.0], [1.5, 1.5]])
def test_on_a_crease_the_gradient_is_finite_and_the_mean_of_both_sides(
    exponents: list[float],
) -> None:
    on = np.array([[0.0, 0.6, 0.4], [0.6, 0.0, 0.4], [0.6, 0.4, 0.0], [0.0, 0.0, 1.0]])
    found = inside_outside(on, exponents)
    assert all_finite(found)
    gauge = np.exp(0.5 * found.value)
    assert (np.abs(found.by_place) <= 2.0 / gauge[:, None] * (1 + 1e-15)).all()
    for row, axis in enumerate([0, 1, 2]):
        sides = [on[row] + way * 1e-9 * np.eye(3)[axis] for way in (1, -1)]
        mean = inside_outside(sides, exponents).by_place.mean(axis=0)
        assert found.by_place[row] == pytest.approx(mean, abs=1e-4)


@pytest.mark.parametrize("exponents", PAIRS)
def test_coordinates_that_underflow_when_squared_are_finite(exponents: list[float]) -> None:
    points = [[1e-200, 1, 1], [1, 1e-200, 1e-200], [1e-200] * 3, [1e5] * 3, [1e-300, 0, 1e5]]
    found = inside_outside(points, exponents)
    assert all_finite(found)
    assert found.value[2] == pytest.approx(found.value[3] - 2 * math.log(1e205), abs=1e-11)


def test_a_taper_to_a_tip_is_refused_and_one_nearly_to_a_tip_ends_in_a_point() -> None:
    with pytest.raises(ValueError, match="taper must lie between -1 and 1"):
        Taper(-1.0, 0.0, 0.5)
    nearly = Taper(-1.0 + 1e-12, -1.0 + 1e-12, 0.5)
    rim = np.array([[0.3, 0.2, 0.5], [-0.3, 0.2, 0.5]])
    assert np.abs(nearly(rim)[:, :2]).max() < 1e-12
    assert np.allclose(nearly.inverse(nearly(rim)), rim, rtol=1e-15, atol=0)


@pytest.mark.parametrize("curvature", [0.0, 1e-300, 1e-16, 1e-9])
def test_a_bend_of_next_to_nothing_is_no_division_by_it(curvature: float) -> None:
    bend, (x, y, z) = Bend(curvature), POINTS.T
    first_order = np.column_stack([x + 0.5 * curvature * z * z, y, z - curvature * x * z])
    assert np.abs(bend(POINTS) - first_order).max() < 1e-14
    assert np.abs(bend.inverse(bend(POINTS)) - POINTS).max() < 1e-14


def test_what_a_bend_would_fold_is_refused_and_every_place_was_bent_from_where_it_is_not() -> None:
    bend = Bend(2.0, 0.3)
    for folded in ([0.6, 0.2, 0.0], [0.0, 0.0, 1.6], [0.0, 0.0, -1.6]):
        with pytest.raises(ValueError, match="all that is bent must be nearer"):
            bend(np.array([folded]))
    anywhere = 3.0 * POINTS
    before = bend.inverse(anywhere)
    assert (2.0 * (before[:, :2] @ bend.towards) < 1.0).all()
    assert (2.0 * np.abs(before[:, 2]) < math.pi).all()
    assert np.abs(bend(before) - anywhere).max() < 1e-14


def test_a_bend_of_points_at_negative_x_has_their_sign() -> None:
    at = np.array([[-0.4, 0.1, 0.0]])
    assert Bend(0.5, 0.0)(at) == pytest.approx(at, abs=1e-16)
    printed = math.cos(0.0 - math.atan(0.1 / -0.4)) * math.hypot(0.4, 0.1)
    assert printed == pytest.approx(0.4)  # where -0.4 is right


def test_the_inverse_in_order_gives_the_points_back_and_out_of_order_does_not() -> None:
    bend, taper = Bend(0.6, 0.4), Taper(0.5, -0.4, 1.0)
    there = bend(taper(POINTS))
    assert np.abs(taper.inverse(bend.inverse(there)) - POINTS).max() < 1e-14
    assert np.abs(bend.inverse(taper.inverse(there)) - POINTS).max() > 0.3
