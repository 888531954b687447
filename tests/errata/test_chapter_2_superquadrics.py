import numpy as np
import pytest

from palpate.core.shapes.superquadrics import (
    Superquadric,
    inside_outside,
    regular_points,
    trigonometric_points,
)

RNG = np.random.default_rng(0)
ETA = RNG.uniform(-1.5, 1.5, 1000)
OMEGA = RNG.uniform(-np.pi, np.pi, 1000)
SIZE = np.array([1.0, 2.0, 3.0])
EXPONENTS = np.array([0.4, 1.3])
SHAPE = Superquadric(SIZE, EXPONENTS)


def printed_function(points, size, exponents):
    """(2.6) with absolute values."""
    e1, e2 = exponents
    x, y, z = np.abs(points / size).T
    level = (x ** (2 / e2) + y ** (2 / e2)) ** (e2 / e1)
    return np.asarray((level + z ** (2 / e1)) ** e1)


def test_powers_of_negative_numbers_need_a_sign():
    with np.errstate(invalid="ignore"):
        naive = np.cos(OMEGA) ** EXPONENTS[1]
    assert np.isnan(naive).mean() == pytest.approx(0.52, abs=0.005)
    points = trigonometric_points(SHAPE, ETA, OMEGA).points
    assert np.allclose(SHAPE.gauge(points), 1.0, rtol=0, atol=1e-14)


def test_the_angles_are_parameters_and_not_those_of_the_point():
    points = trigonometric_points(SHAPE, ETA, OMEGA).points
    latitude = np.arctan2(points[:, 2], np.hypot(points[:, 0], points[:, 1]))
    assert np.degrees(np.abs(latitude - ETA).max()) > 30.0


def test_both_ends_of_the_azimuth_are_one_seam():
    ends = trigonometric_points(SHAPE, np.full(2, 0.3), np.array([-np.pi, np.pi])).points
    assert np.allclose(ends[0], ends[1], rtol=0, atol=1e-12)


def test_the_inside_out_function_is_negative_inside():
    # (2.3) prints "= 0, > 0, < 0" beside one "inside the solid".
    points = np.array([[0.5, 0.5, 0.5], [2.0, 2.0, 2.0]])
    printed = printed_function(points, np.ones(3), EXPONENTS) - 1.0
    ours = inside_outside(points, EXPONENTS).value
    assert printed[0] < 0.0 < printed[1]
    assert ours[0] < 0.0 < ours[1]


def test_the_regular_parameters_are_only_more_even():
    box, omega = Superquadric(np.ones(3), np.array([0.1, 0.1])), np.linspace(0, np.pi / 2, 41)
    ratios = []
    for way in (regular_points, trigonometric_points):
        places = way(box, np.zeros(41), omega).points
        steps = np.linalg.norm(np.diff(places, axis=0), axis=1)
        ratios.append(steps.max() / steps.min())
    assert ratios[0] == pytest.approx(1.64, abs=0.005)
    assert ratios[1] > 100.0


def test_the_regular_azimuth_is_not_that_of_the_point_unless_the_section_is_round():
    points = regular_points(SHAPE, ETA, OMEGA).points
    azimuth = np.arctan2(points[:, 1], points[:, 0])
    off = np.abs(np.angle(np.exp(1j * (azimuth - OMEGA))))
    assert np.degrees(off.max()) == pytest.approx(19.5, abs=0.05)
    scaled = np.arctan2(points[:, 1] / SIZE[1], points[:, 0] / SIZE[0])
    assert np.allclose(np.angle(np.exp(1j * (scaled - OMEGA))), 0.0, atol=1e-14)


def test_curves_of_equal_latitude_are_plane_only_if_the_section_is_an_ellipse():
    omega, eta = np.linspace(-np.pi, np.pi, 181), np.full(181, np.arctan(0.6))
    spread = [
        np.ptp(regular_points(Superquadric(np.ones(3), np.array(e)), eta, omega).points[:, 2])
        for e in ((0.15, 0.15), (0.2, 1.0), (1.0, 1.0))
    ]
    assert spread[0] > 0.15
    assert max(spread[1:]) < 1e-15


def test_the_function_with_its_outer_power_is_of_second_degree():
    points = RNG.normal(size=(200, 3))
    once, twice = (printed_function(k * points, SIZE, EXPONENTS) for k in (1, 2))
    assert np.allclose(twice / once, 4.0, rtol=1e-13)
    # So the way to the surface along the radius is |x| (1 - F^(-1/2)), at any exponents.
    stretched = points * (printed_function(points, SIZE, EXPONENTS) ** -0.5)[:, None]
    assert np.allclose(SHAPE.gauge(stretched), 1.0, rtol=0, atol=1e-13)
    usual = points * (printed_function(points, SIZE, EXPONENTS) ** (-EXPONENTS[0] / 2))[:, None]
    assert np.abs(SHAPE.gauge(usual) - 1.0).max() > 0.5


def test_the_function_overflows_where_its_root_does_not():
    points, exponents = np.array([[1e9, 0.0, 0.0], [1e-9, 0.0, 0.0]]), np.array([0.05, 0.05])
    with np.errstate(over="ignore"):
        printed = printed_function(points, np.ones(3), exponents)
    assert printed.tolist() == [np.inf, 0.0]
    ours = inside_outside(points, exponents).value
    assert np.allclose(ours, 2 * np.log([1e9, 1e-9]), rtol=1e-14)


def test_the_residual_is_no_distance():
    # (2.10): the root of the volume times F - 1, for points at the same distance from two balls.
    radii = np.array([0.01, 0.1])
    residuals = np.array(
        [
            np.sqrt(r**3)
            * (printed_function(np.array([[r + 0.005, 0, 0]]), np.full(3, r), np.ones(2)) - 1.0)[0]
            for r in radii
        ]
    )
    assert residuals[0] / residuals[1] == pytest.approx(0.386, abs=0.005)
    far = printed_function(np.array([[10.0, 0, 0], [100.0, 0, 0]]), np.ones(3), np.ones(2)) - 1.0
    assert far[1] / far[0] == pytest.approx(101.0, abs=0.01)
    gauges = [
        Superquadric(np.full(3, r), np.ones(2)).gauge(np.array([[r + 0.005, 0, 0]]))[0]
        for r in radii
    ]
    assert np.allclose((np.array(gauges) - 1.0) * radii, 0.005, rtol=1e-12)
