"""Errata of chapters 1 and 2: poses, superquadrics, deformations, least squares, R-functions."""

from __future__ import annotations

import math
from collections import Counter

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.least_squares import levenberg_marquardt
from palpate.core.poses import Pose
from palpate.core.shapes import (
    Bend,
    GeneralisedCylinder,
    Hyperquadric,
    SuperellipseSection,
    Superquadric,
    Taper,
    inside_outside,
    regular_points,
    trigonometric_points,
)
from palpate.core.shapes.boolean_solids import conjunction, conjunction_slopes

RNG = np.random.default_rng(0)
PHI, PSI, ALPHA = 0.7, 0.4, 0.3


def about(axis: str, angle: float) -> Floats:
    c, s = math.cos(angle), math.sin(angle)
    rows = {"x": [[1, 0, 0], [0, c, -s], [0, s, c]], "y": [[c, 0, s], [0, 1, 0], [-s, 0, c]]}
    return np.array(rows.get(axis, [[c, -s, 0], [s, c, 0], [0, 0, 1]]), float)


def printed_rotation(corner: float) -> Floats:
    """(1.6) with what stands in the third row, first column."""
    c, s = math.cos, math.sin
    first = [c(PHI) * c(PSI), -s(PHI), c(PHI) * s(PSI)]
    return np.array([first, [s(PHI) * c(PSI), c(PHI), s(PHI) * s(PSI)], [corner, 0.0, c(PSI)]])


def angle_between(one: Floats, other: Floats) -> float:
    return float(np.arccos(np.clip(0.5 * (np.trace(one.T @ other) - 1.0), -1.0, 1.0)))


def test_the_printed_matrix_is_no_rotation():
    printed, right = printed_rotation(-math.sin(PHI)), printed_rotation(-math.sin(PSI))
    assert np.linalg.det(printed) == pytest.approx(1.099, abs=5e-4)
    assert np.abs(printed.T @ printed - np.eye(3)).max() == pytest.approx(0.263, abs=5e-4)
    assert np.allclose(
        Pose.from_array(Pose(np.zeros(3), right).array).axes, right, rtol=0, atol=1e-15
    )


def test_the_matrix_turns_about_y_first():
    right = printed_rotation(-math.sin(PSI))
    assert np.allclose(right, about("z", PHI) @ about("y", PSI), rtol=0, atol=1e-15)
    assert angle_between(right, about("y", PSI) @ about("z", PHI)) > 0.25


def test_two_angles_cannot_express_every_rotation():
    # (1.6) has a 0 in its third row: no body turned about x has one.
    turned, turns = about("x", 0.5), np.linspace(-math.pi, math.pi, 61)
    ours = Pose.from_array(np.array([0, 0, 0, math.sin(0.25), 0, 0, math.cos(0.25)])).axes
    assert np.allclose(ours, turned, atol=1e-15) and turned[2, 1] == pytest.approx(math.sin(0.5))
    pairs = [about("z", phi) @ about("y", psi) for phi in turns for psi in turns]
    assert min(angle_between(one, turned) for one in pairs) > 0.45


def test_a_linear_cylinder_has_an_apex_where_its_scale_vanishes():
    section, heights = SuperellipseSection(np.ones(2), 1.0), np.array([-0.06, 0.06])
    assert 0.5 * heights[0] + 0.02 < 0.0  # (1.4): the radius A z + B below z = -B / A
    with pytest.raises(ValueError, match="scale"):
        GeneralisedCylinder(section, heights, 0.5 * heights + 0.02)
    heights[0] = -0.04
    assert GeneralisedCylinder(section, heights, 0.5 * heights + 0.02).bounds()[0, 2] == -0.04


ETA, OMEGA = RNG.uniform(-1.5, 1.5, 1000), RNG.uniform(-np.pi, np.pi, 1000)
SIZE, EXPONENTS = np.array([1.0, 2.0, 3.0]), np.array([0.4, 1.3])
SHAPE = Superquadric(SIZE, EXPONENTS)
ANGLED = trigonometric_points(SHAPE, ETA, OMEGA).points
UNIT = np.ones(3)


def printed_function(points: Floats, size: Floats, exponents: Floats) -> Floats:
    """(2.6) with absolute values."""
    e1, e2 = exponents
    x, y, z = np.abs(points / size).T
    return ((x ** (2 / e2) + y ** (2 / e2)) ** (e2 / e1) + z ** (2 / e1)) ** e1


def test_powers_of_negative_numbers_need_a_sign():
    with np.errstate(invalid="ignore"):
        assert np.isnan(np.cos(OMEGA) ** EXPONENTS[1]).mean() == pytest.approx(0.52, abs=0.005)
    assert np.allclose(SHAPE.gauge(ANGLED), 1.0, rtol=0, atol=1e-14)


def test_the_angles_are_parameters_and_not_those_of_the_point():
    latitude = np.arctan2(ANGLED[:, 2], np.hypot(ANGLED[:, 0], ANGLED[:, 1]))
    assert np.degrees(np.abs(latitude - ETA).max()) > 30.0


def test_both_ends_of_the_azimuth_are_one_seam():
    ends = trigonometric_points(SHAPE, np.full(2, 0.3), np.array([-np.pi, np.pi])).points
    assert np.allclose(ends[0], ends[1], rtol=0, atol=1e-12)


def test_the_inside_out_function_is_negative_inside():
    # (2.3) prints "= 0, > 0, < 0" beside one "inside the solid".
    points = np.array([[0.5, 0.5, 0.5], [2.0, 2.0, 2.0]])
    printed = printed_function(points, UNIT, EXPONENTS) - 1.0
    for values in (printed, inside_outside(points, EXPONENTS).value):
        assert values[0] < 0.0 < values[1]


def test_the_regular_parameters_are_only_more_even():
    box, ratios = Superquadric(UNIT, np.array([0.1, 0.1])), []
    for sample in (regular_points, trigonometric_points):
        places = sample(box, np.zeros(41), np.linspace(0, np.pi / 2, 41)).points
        steps = np.linalg.norm(np.diff(places, axis=0), axis=1)
        ratios.append(steps.max() / steps.min())
    assert ratios[0] == pytest.approx(1.64, abs=0.005) and ratios[1] > 100.0


def test_the_regular_azimuth_is_not_that_of_the_point_unless_the_section_is_round():
    x, y, _ = regular_points(SHAPE, ETA, OMEGA).points.T
    off = np.abs(np.angle(np.exp(1j * (np.arctan2(y, x) - OMEGA))))
    assert np.degrees(off.max()) == pytest.approx(19.5, abs=0.05)
    scaled = np.angle(np.exp(1j * (np.arctan2(y / SIZE[1], x / SIZE[0]) - OMEGA)))
    assert np.allclose(scaled, 0.0, atol=1e-14)


def test_curves_of_equal_latitude_are_plane_only_if_the_section_is_an_ellipse():
    omega, eta = np.linspace(-np.pi, np.pi, 181), np.full(181, np.arctan(0.6))
    solids = [Superquadric(UNIT, np.array(e)) for e in ((0.15, 0.15), (0.2, 1.0), (1.0, 1.0))]
    spread = [np.ptp(regular_points(one, eta, omega).points[:, 2]) for one in solids]
    assert spread[0] > 0.15 and max(spread[1:]) < 1e-15


def test_the_function_with_its_outer_power_is_of_second_degree():
    points = RNG.normal(size=(200, 3))
    once, twice = (printed_function(k * points, SIZE, EXPONENTS) for k in (1, 2))
    assert np.allclose(twice / once, 4.0, rtol=1e-13)
    # So the distance to the surface along the radius is |x| (1 - F^(-1/2)), at any exponents.
    gauges = [SHAPE.gauge(points * (once**p)[:, None]) for p in (-0.5, -EXPONENTS[0] / 2)]
    assert np.allclose(gauges[0], 1.0, rtol=0, atol=1e-13) and np.ptp(gauges[1]) > 0.5


def test_the_function_overflows_where_its_root_does_not():
    points, exponents = np.array([[1e9, 0.0, 0.0], [1e-9, 0.0, 0.0]]), np.array([0.05, 0.05])
    with np.errstate(over="ignore"):
        assert printed_function(points, UNIT, exponents).tolist() == [np.inf, 0.0]
    ours = inside_outside(points, exponents).value
    assert np.allclose(ours, 2 * np.log([1e9, 1e-9]), rtol=1e-14)


def test_the_residual_is_no_distance():
    # (2.10): the root of the volume times F - 1, for points at the same distance from two balls.
    radii, round_ = np.array([0.01, 0.1]), np.ones(2)
    near = [np.array([[r + 0.005, 0, 0]]) for r in radii]
    pairs = list(zip(near, radii, strict=True))
    residuals = [r**1.5 * (printed_function(p, np.full(3, r), round_)[0] - 1.0) for p, r in pairs]
    assert residuals[0] / residuals[1] == pytest.approx(0.386, abs=0.005)
    far = printed_function(np.array([[10.0, 0, 0], [100.0, 0, 0]]), UNIT, round_) - 1.0
    assert far[1] / far[0] == pytest.approx(101.0, abs=0.01)
    ours = [(Superquadric(np.full(3, r), round_).gauge(p)[0] - 1.0) * r for p, r in pairs]
    assert np.allclose(ours, 0.005, rtol=1e-12)


POINTS = np.random.default_rng(0).uniform(-1, 1, (500, 3))


def printed_bend(points: Floats, k: float, angle: Floats, inwards: Floats) -> Floats:
    """(2.8) and (2.9) with an angle and a coordinate r."""
    radius = 1.0 / k - np.cos(angle) * (1.0 / k - inwards)
    x = points[:, 0] + np.cos(ALPHA) * (radius - inwards)
    y = points[:, 1] + np.sin(ALPHA) * (radius - inwards)
    return np.column_stack([x, y, np.sin(angle) * (1.0 / k - inwards)])


def test_the_inverse_of_a_taper_is_singular_where_a_section_vanishes():
    with np.errstate(divide="ignore"):
        assert np.isinf(np.float64(1.0) / (-1.0 / 1.0 * 1.0 + 1.0))
    with pytest.raises(ValueError, match="taper must lie between -1 and 1"):
        Taper(-1.0, 0.0, 1.0)
    taper = Taper(-0.999, 0.5, 1.0)
    assert np.allclose(taper.inverse(taper(POINTS)), POINTS, rtol=0, atol=1e-12)


def test_the_angle_of_a_bend_is_height_times_curvature():
    height, k = np.linspace(-1, 1, 2001), 0.5
    axis = np.column_stack([np.zeros((2001, 2)), height])
    both = printed_bend(axis, k, height / k, np.zeros(2001)), Bend(k, ALPHA)(axis)
    lengths = [np.linalg.norm(np.diff(bent, axis=0), axis=1).sum() for bent in both]
    assert lengths == pytest.approx([8.0, 2.0], rel=1e-5)


def test_the_arc_tangent_of_y_over_x_turns_half_of_the_points_round():
    x, y = -0.5, 0.2
    printed = np.cos(ALPHA - np.arctan(y / x)) * np.hypot(x, y)
    right = x * np.cos(ALPHA) + y * np.sin(ALPHA)
    assert (printed, right) == pytest.approx((0.4186, -0.4186), abs=5e-5)
    found = Bend(1e-3, ALPHA).unbend(np.array([x, y]) @ Bend(1.0, ALPHA).towards, np.zeros(1))
    assert found.inwards == pytest.approx(right, rel=1e-12)


def test_one_over_the_curvature_loses_all_digits_as_it_vanishes():
    inwards = POINTS[:, :2] @ [np.cos(ALPHA), np.sin(ALPHA)]
    for k, low, high in ((1e-9, 1e-8, 1e-6), (1e-16, 0.5, np.inf)):
        printed = printed_bend(POINTS, k, k * POINTS[:, 2], inwards)
        assert low < np.abs(printed - Bend(k, ALPHA)(POINTS)).max() < high
    for k in (0.0, 1e-300, 1e-16, 1e-9, 1e-3, 0.6, -0.6):
        bend = Bend(k, ALPHA)
        assert np.allclose(bend.inverse(bend(POINTS)), POINTS, rtol=0, atol=2e-15)


def test_a_bend_is_undone_before_the_taper_that_came_first():
    taper, bend = Taper(0.5, -0.4, 1.0), Bend(0.4, ALPHA)
    moved = bend(taper(POINTS))
    assert np.allclose(taper.inverse(bend.inverse(moved)), POINTS, rtol=0, atol=1e-14)
    assert np.abs(bend.inverse(taper.inverse(moved)) - POINTS).max() > 0.2


X, TRUE, START = np.linspace(0.0, 2.0, 9), np.array([1.5, 0.7]), np.array([1.0, 0.2])
INFINITE = np.full(2, -np.inf), np.full(2, np.inf)


def model(parameters: Floats, scales: Floats) -> tuple[Floats, Floats]:
    """Residuals (9,) and Jacobian (9, 2) of a decay, its parameters given in other units."""
    a, b = parameters * scales
    fading = np.exp(-b * X)
    residuals = a * fading - TRUE[0] * np.exp(-TRUE[1] * X)
    return residuals, np.column_stack([fading, -a * X * fading]) * scales


def test_the_jacobian_has_a_row_for_each_residual():
    residuals, jacobian = model(START, np.ones(2))
    gradient, step = 2.0 * jacobian.T @ residuals, 1e-6 * np.eye(2)
    for axis in range(2):
        ahead, back = (
            sum(model(START + sign * step[axis], np.ones(2))[0] ** 2) for sign in (1, -1)
        )
        assert gradient[axis] == pytest.approx((ahead - back) / 2e-6, rel=1e-6)
    # (2.11) ends its first column with f_n and its last with f_m: n rows do not fit m residuals.
    with pytest.raises(ValueError, match="mismatch"):
        jacobian[:2].T @ residuals


def test_a_step_comes_from_all_residuals_and_not_from_one():
    residuals, jacobian = model(START, np.ones(2))
    rights = jacobian.T @ residuals, (jacobian * residuals[0]).sum(axis=0)  # (2.16) with f_i
    steps = [np.linalg.solve(jacobian.T @ jacobian, right) for right in rights]
    after, printed = (np.linalg.norm(model(START - step, np.ones(2))[0]) for step in steps)
    assert after < 0.5 * np.linalg.norm(residuals) < 0.5 * printed


def test_damping_all_columns_alike_depends_on_their_units():
    steps, ends = [], []
    for scales in (np.ones(2), np.array([1.0, 2.0**-10])):
        residuals, jacobian = model(START / scales, scales)
        damped = jacobian.T @ jacobian + 0.1 * np.eye(2)
        steps.append(-scales * np.linalg.solve(damped, jacobian.T @ residuals))

        def problem(at: Floats, which: object, scales: Floats = scales) -> tuple[Floats, Floats]:
            residuals, jacobians = zip(*(model(one, scales) for one in at), strict=True)
            return np.array(residuals), np.array(jacobians)

        ends.append(levenberg_marquardt(problem, START[None] / scales, *INFINITE))
    assert np.abs(steps[0] - steps[1]).max() > 0.1
    assert ends[0].steps[0] == ends[1].steps[0]
    assert np.allclose(ends[0].parameters, ends[1].parameters * [1.0, 2.0**-10], rtol=1e-12)
    assert np.allclose(ends[0].parameters, TRUE, rtol=1e-8)


def test_the_strip_of_a_term_lies_between_one_and_minus_one():
    # The text closes each strip of (2.29) with "H = 1 and H".
    flat = Hyperquadric(np.eye(3, 4), np.full(3, 40.0)).bounds()
    assert np.allclose(flat, [[-1, -1, -1], [1, 1, 1]], atol=1e-2)


def test_terms_that_do_not_span_space_leave_it_unbounded():
    planes = np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [1.0, 1.0, 0.0, 0.0]])
    assert (np.abs(planes @ [0.0, 0.0, 1e9, 1.0]) ** 2).sum() == 0.0  # inside, by (2.28)
    with pytest.raises(ValueError, match="unbounded"):
        Hyperquadric(planes, np.full(3, 2.0))


def test_three_terms_are_a_superquadric_only_if_its_exponents_are_equal():
    points = RNG.uniform(0.2, 1.0, (100, 3))
    for e2, alike in ((0.5, True), (1.0, False)):
        solid = printed_function(points, UNIT, np.array([0.5, e2])) ** 2.0
        terms = (points ** np.array([2 / e2, 2 / e2, 4.0])).sum(axis=1)
        assert (np.abs(solid - terms).max() < 1e-14) == alike
        assert alike or np.abs(solid - terms).max() > 0.5


def test_an_exponent_of_one_is_convex_and_one_below_it_has_an_infinite_slope():
    first, second = RNG.uniform(-1, 1, (2, 2000, 3))
    for exponent, convex in ((1.0, True), (0.8, False)):
        ends = [(np.abs(p) ** exponent).sum(axis=1) for p in (first, second)]
        middle = (np.abs(0.5 * (first + second)) ** exponent).sum(axis=1)
        assert bool((middle <= 0.5 * sum(ends) + 1e-15).all()) == convex
    assert (1e-15) ** -0.2 > 100.0 * (1e-3) ** -0.2  # its slope, but for a factor
    octahedron = Hyperquadric(np.eye(3, 4), np.ones(3))
    value, slope = octahedron.inside_out(np.zeros((1, 3)), np.array([[1.0, 0.0, 0.0]]))
    assert np.isfinite([*value, *slope]).all()


def printed_union(f1: float, f2: float, w: float) -> float:
    """(2.33)."""
    return (f1 + f2 + math.sqrt(f1 * f1 + f2 * f2 - 2 * w * f1 * f2)) / (1 + w)


def test_the_printed_intersection_overflows():
    with np.errstate(over="ignore", invalid="ignore"):
        big = np.float64(1e200)
        assert not np.isfinite(big + big - np.sqrt(big**2 + big**2))
    assert conjunction(1e200, 1e200) == pytest.approx((2 - math.sqrt(2)) * 1e200)


def test_the_printed_slopes_are_nothing_over_nothing_where_both_vanish():
    with np.errstate(invalid="ignore"):
        assert np.isnan(1.0 - np.float64(0.0) / np.float64(0.0))
    assert conjunction_slopes(0.0, 0.0) == (1.0, 1.0)


NEAR = -1.0 + 1e-12
LOST = (0.8 - math.sqrt(0.09 + 0.25 - 2 * NEAR * 0.15)) / (1 + NEAR)
FIGURES = {
    # computed, stated, and the largest relative difference
    "test_the_intersection_is_of_both_functions": [  # (2.35) and (2.37) print "f2 and f2"
        (conjunction(0.3, 0.5), 0.8 - math.hypot(0.3, 0.5), 1e-15),
        (conjunction(0.5, 0.5), 1.0 - math.hypot(0.5, 0.5), 1e-15),
    ],
    "test_an_omega_that_knows_the_sign_breaks_de_morgan": [
        # omega(-f1, f2) = omega(f1, f2) is what the misprinted condition of (2.33) is there for.
        (printed_union(0.3, -0.5, -0.5), 0.4717797887, 1e-9),
        (printed_union(0.3, -0.5, 0.5), 0.3333333333, 1e-9),
    ],
    "test_the_printed_intersection_cancels": [
        (1e8 + 1e-8 - math.sqrt(1e16 + 1e-16), 1.49e-8, 1e-2),
        (conjunction(1e8, 1e-8), 1e-8, 1e-15),
    ],
    "test_the_printed_intersection_is_wrong_as_omega_nears_minus_one": [
        (LOST, 0.1876, 1e-3),
        (abs(LOST / 0.1875 - 1.0) > 5e-5, True, 0.0),
        (conjunction(0.3, 0.5, NEAR), 0.1875, 1e-11),
    ],
    "test_a_polynomial_in_space_has_more_coefficients": [
        (Counter(int(sum(p) <= n) for p in np.ndindex(n + 1, n + 1, n + 1))[1], terms, 0.0)
        for n, terms in ((1, math.comb(4, 3)), (2, math.comb(5, 3)), (4, math.comb(7, 3)))
    ],
}


@pytest.mark.parametrize("name", FIGURES)
def test_figures(name):
    for computed, stated, tolerance in FIGURES[name]:
        assert computed == pytest.approx(stated, rel=tolerance)
