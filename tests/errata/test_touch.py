"""Errata of chapter 3: filters, curvature, and the step from contour to contour."""

from __future__ import annotations

import math

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.splines import Basis
from palpate.core.touch import (
    adaptive_wiener,
    median_filter,
    median_then_wiener,
    neighbourhoods,
    principal_curvatures,
    wiener_then_median,
)
from tests.core.touch.parametric import normal_curvature, shape_operator

X, Y, Z = np.eye(3)
NONE = np.zeros(3)
SIGNAL, NOISE, WINDOW = 4.0, 1.0, 9
AROUND = NOISE / WINDOW / (SIGNAL + NOISE)  # the kernel of (3.7) beside the middle
MIDDLE = (SIGNAL + NOISE / WINDOW) / (SIGNAL + NOISE)


def sphere(u: float = 0.3, v: float = 0.9) -> tuple[Floats, ...]:
    """Derivatives by azimuth and latitude on a ball of radius 2, and the outward normal."""
    (cu, su), (cv, sv) = (math.cos(u), math.sin(u)), (math.cos(v), math.sin(v))
    out = np.array([cu * cv, su * cv, sv])
    by_u, by_v = np.array([-su * cv, cu * cv, 0.0]), np.array([-cu * sv, -su * sv, cv])
    by_uu, by_uv = np.array([-cu * cv, -su * cv, 0.0]), np.array([su * sv, -cu * sv, 0.0])
    return 2 * by_u, 2 * by_v, 2 * by_uu, 2 * by_uv, -2 * out, out


def printed_forms() -> tuple[float, ...]:
    """E, F, G, L, M, N of (3.10) and (3.14) on the ball, with the normal of (3.11)."""
    by_u, by_v, *bends, _ = sphere()
    n = np.cross(by_u, by_v)
    n /= np.linalg.norm(n)
    return (by_u @ by_u, by_u @ by_v, by_v @ by_v, *(float(n @ bend) for bend in bends))


E, F, G, L, M, N = printed_forms()
BALL = shape_operator(*sphere())
FOUND = principal_curvatures(BALL)


def test_the_gain_of_the_wiener_filter_is_of_variances():
    assert math.sqrt(SIGNAL) / (math.sqrt(SIGNAL) + math.sqrt(NOISE)) == pytest.approx(2 / 3)
    by_kernel = (MIDDLE - 1 / WINDOW) / (1 - 1 / WINDOW)  # what (3.7) does to the middle
    image = np.zeros((3, 3))
    image[1, 1], mean, variance = 1.0, 1 / 9, 8 / 81
    found = (adaptive_wiener(image, 0.2 * variance)[1, 1] - mean) / (1.0 - mean)
    assert by_kernel == pytest.approx(0.8) and found == pytest.approx(0.8)


def test_a_constant_window_is_nothing_over_nothing():
    with np.errstate(invalid="ignore"):
        assert np.isnan(np.float64(0.0) / (np.float64(0.0) + 0.0))
    for variance in (0.0, 1e-30):
        assert np.array_equal(adaptive_wiener(np.full((4, 4), 2.0), variance), np.full((4, 4), 2.0))


def test_what_is_called_a_power_spectrum_is_a_variance_with_the_noise_in_it():
    rng = np.random.default_rng(0)
    noisy = 1e8 + rng.normal(size=9)
    one_pass, two_passes = (noisy**2).mean() - noisy.mean() ** 2, noisy.var()
    assert abs(one_pass - two_passes) > 0.5
    image = 1e8 + rng.normal(size=(40, 40))
    smoothed = adaptive_wiener(image, 1.0)
    # All of it is noise: little of the variance may be left. Borders are mirrored.
    assert smoothed.var() < 0.35 * image.var() and smoothed.shape == image.shape


def test_the_median_comes_before_the_wiener_filter_where_there_are_impulses():
    def noise(frame: Floats) -> float:
        """What a filter that knows no noise takes: the mean of the local variances."""
        return float(neighbourhoods(frame).var(axis=-1).mean())

    x = np.linspace(-1, 1, 16)
    clean = 1.0 - 0.3 * (x[:, None] ** 2 + x**2)
    rng, errors = np.random.default_rng(1), []
    for _ in range(20):
        frame = clean + 0.01 * rng.normal(size=clean.shape)
        frame[rng.random(clean.shape) < 0.08] = 0.0
        wiener_first = wiener_then_median(frame, noise(frame))
        median_first = median_then_wiener(frame, noise(median_filter(frame)))
        errors.append(
            [np.sqrt(np.mean((one - clean) ** 2)) for one in (wiener_first, median_first)]
        )
    assert np.divide(*np.mean(errors, axis=0)) > 1.4


def test_the_ratio_of_steps_is_infinite_across_the_contour():
    with np.errstate(invalid="ignore", over="ignore"):
        h = np.float64(1e200)
        assert np.isnan((L + 2 * M * h + N * h * h) / (E + 2 * F * h + G * h * h))
    assert normal_curvature(BALL, sphere()[1]) == pytest.approx(0.5)


def test_the_second_parameter_runs_across_the_contour_only_if_they_are_orthogonal():
    # A cylinder along z of radius 1; u along a helix, v around: F is not 0.
    by_u, by_v = Y + Z, Y
    shape = shape_operator(by_u, by_v, -X, -X, -X, X)
    e, f = float(by_u @ by_u), float(by_u @ by_v)
    assert normal_curvature(shape, by_v) == pytest.approx(1.0)  # N / G
    assert normal_curvature(shape, by_u - e / f * by_v) == pytest.approx(0.5)  # orthogonal to u


def test_the_equation_of_the_principal_directions_vanishes_at_an_umbilic():
    assert np.abs([F * N - M * G, E * N - L * G, E * M - L * F]).max() < 1e-15
    assert FOUND.umbilic and FOUND[:2] == pytest.approx((0.5, 0.5), rel=1e-14)


def test_the_equation_of_the_principal_directions_loses_a_root():
    # F N = M G: one principal direction is u = const, h infinite.
    (e, f, g), (ll, m, n) = (2.0, 0.0, 1.0), (0.5, 0.0, -0.4)
    assert f * n - m * g == 0.0
    assert len(np.roots([f * n - m * g, e * n - ll * g, e * m - ll * f])) == 1
    shape = shape_operator(np.sqrt(e) * X, Y, -ll * Z, m * Z, -n * Z, Z)
    assert normal_curvature(shape, Y) == pytest.approx(-0.4)


def test_the_discriminant_at_an_umbilic_is_negative_by_rounding():
    rng = np.random.default_rng(0)
    a = rng.normal(size=(20000, 2, 2))
    first = a @ a.transpose(0, 2, 1) + 0.1 * np.eye(2)
    second = 0.7 * (1 + 1e-16 * rng.normal(size=(20000, 1, 1))) * first
    (e, f, g), (ll, m, n) = (
        (form[:, 0, 0], form[:, 0, 1], form[:, 1, 1]) for form in (first, second)
    )
    qa, qb, qc = e * g - f * f, e * n + ll * g - 2 * m * f, ll * n - m * m
    spread = qb * qb - 4 * qa * qc
    printed = (qb + np.sqrt(np.maximum(spread, 0.0))) / (2 * qa)
    assert (spread < 0.0).mean() > 0.2 and np.abs(printed - 0.7).max() > 1e-8
    for row in range(50):
        factor = np.linalg.cholesky(first[row])
        tangents = [np.array([*line, 0.0]) for line in factor]
        inwards = [np.array([0.0, 0.0, -part]) for part in (ll[row], m[row], n[row])]
        found = principal_curvatures(shape_operator(*tangents, *inwards, Z))
        assert found[:2] == pytest.approx((0.7, 0.7), rel=2e-14)


PLANE, CYLINDER = (principal_curvatures(shape_operator(X, Y, b, NONE, NONE, Z)) for b in (NONE, -Z))
SCALES = np.array([1.0, 10.0, 1000.0])  # one shape in three units


def test_the_logarithmic_and_the_inverse_template_need_their_constants():
    def logarithmic(x: float, a: float, b: float, c: float) -> float:
        return a / math.log(b * x + c)

    with pytest.raises(ZeroDivisionError):
        logarithmic(0.0, 1.0, 0.3, 1.0)
    assert logarithmic(0.0, math.log(1.5), 0.3, 1.5) == 1.0 > logarithmic(1.0, 0.4, 0.3, 1.5)
    assert [1.0 / (0.5 * 0.0 + b) ** 2 for b in (2.0, 1.0)] == [0.25, 1.0]  # starts at 1 only if
    with np.errstate(invalid="ignore"):  # b is 1
        assert np.isnan(1.0 / np.float64(0.5 * -3.0 + 1.0) ** 0.5)  # a concave place


def test_distances_to_knots_are_an_ill_conditioned_basis():
    x, conditions = np.linspace(0, 1, 400), []
    for segments in (5, 40):
        knots = np.linspace(0, 1, segments + 1)
        distances = np.abs(x[:, None] - knots)  # (3.29)
        hats = Basis(np.concatenate([[0.0], knots, [1.0]]), 1).matrix(x).toarray()
        conditions.append([np.linalg.cond(distances), np.linalg.cond(hats)])
    assert conditions[0][0] > 30 and conditions[1][0] > 1500
    assert max(conditions[0][1], conditions[1][1]) < 2.5
    # (3.33) forms the normal equations, which square it.
    squared = np.linalg.cond(distances.T @ distances)
    assert squared == pytest.approx(conditions[1][0] ** 2, rel=1e-3)


KAPPA, CHANGE = np.meshgrid(np.linspace(0.1, 2, 5), np.linspace(0.1, 3, 6))


def rank(steps: Floats) -> int:
    return int(np.linalg.matrix_rank(steps, tol=1e-6))


FIGURES = {
    # computed, stated, and the largest difference
    "test_the_kernel_holds_for_all_neighbours_but_the_middle": [
        (MIDDLE + 4 * AROUND, 0.911, 1e-3),  # n1 and n2 both not 0
        (MIDDLE + 8 * AROUND, 1.0, 1e-15),  # (n1, n2) not (0, 0)
    ],
    "test_a_convex_surface_has_negative_curvature_by_the_outward_normal": [
        (N / G, -0.5, 1e-12),
        (np.exp(-10.0 * N / G), 148.4, 0.1),  # (3.1): a step over the object
        (normal_curvature(BALL, sphere()[1]), 0.5, 1e-12),
    ],
    "test_the_mean_curvature_lacks_a_half": [
        ((E * N + L * G - 2 * M * F) / (E * G - F * F), -1.0, 1e-12),
        (0.5 * (FOUND.k1 + FOUND.k2), 0.5, 1e-12),
    ],
    "test_a_point_without_any_curvature_is_not_parabolic": [
        # A zero Gaussian curvature, the text's test, is that of both.
        (PLANE.k1 * PLANE.k2, CYLINDER.k1 * CYLINDER.k2, 0.0),
        ([PLANE.k1 + PLANE.k2, CYLINDER.k1 + CYLINDER.k2], [0.0, 1.0], 0.0),
    ],
    "test_the_step_depends_on_the_unit_of_length": [
        (np.exp(-2.0 / SCALES), [0.135, 0.819, 0.998], 1e-3),  # exp(-a kappa) of (3.1)
        (np.exp(-2.0 / SCALES * SCALES), np.full(3, math.exp(-2.0)), 1e-15),
    ],
    "test_a_falling_curvature_makes_the_step_larger_than_any": [
        (math.exp(-10.0 * -0.5), 148.4, 0.1),  # (3.28) with a change that has a sign
        (math.exp(-10.0 * abs(-0.5)), 0.0067, 1e-4),
    ],
    "test_the_smallest_step_is_never_reached": [
        # (3.35) sets mu to s_min, which s reaches where a template is 0: nowhere.
        (0.18 * np.exp(-0.1 * 0.0) + 0.02, 0.2, 1e-15),
        ((0.18 * np.exp(-0.1 * np.linspace(0, 50, 200)) + 0.02 > 0.02).all(), True, 0.0),
    ],
    "test_of_three_steps_that_are_called_separable_one_is": [
        (rank(np.exp(0.5 * KAPPA + 0.2 * CHANGE)), 1, 0.0),
        (rank(1.0 / (0.5 * KAPPA + 0.2 * CHANGE) ** 2) > 1, True, 0.0),
        (rank(1.0 / np.log(2.0 + 0.5 * KAPPA + 0.2 * CHANGE)) > 1, True, 0.0),
        # And without its minus signs the first grows with the curvature.
        ((np.diff(np.exp(0.5 * KAPPA + 0.2 * CHANGE), axis=1) > 0.0).all(), True, 0.0),
        (rank(np.exp(-0.5 * KAPPA) * np.exp(-0.2 * CHANGE)), 1, 0.0),
    ],
}


@pytest.mark.parametrize("name", FIGURES)
def test_figures(name):
    for computed, stated, tolerance in FIGURES[name]:
        assert computed == pytest.approx(stated, abs=tolerance, rel=0.0)
