import numpy as np
import pytest

from palpate.core.touch.filters import (
    adaptive_wiener,
    median_filter,
    median_then_wiener,
    neighbourhoods,
    wiener_then_median,
)
from palpate.core.touch.forms import curvature_along, principal_curvatures
from tests.core.touch.parametric import shape_operator

RADIUS = 2.0
U, V = 0.3, 0.9


def sphere():
    """Derivatives by azimuth and latitude on a sphere, and the outward normal."""
    c, s = np.cos, np.sin
    by_u = RADIUS * np.array([-s(U) * c(V), c(U) * c(V), 0.0])
    by_v = RADIUS * np.array([-c(U) * s(V), -s(U) * s(V), c(V)])
    by_uu = RADIUS * np.array([-c(U) * c(V), -s(U) * c(V), 0.0])
    by_uv = RADIUS * np.array([s(U) * s(V), -c(U) * s(V), 0.0])
    out = np.array([c(U) * c(V), s(U) * c(V), s(V)])
    return by_u, by_v, by_uu, by_uv, -RADIUS * out, out


def printed_forms():
    """E, F, G, L, M, N of (3.10) and (3.14), with the normal as it comes from (3.11)."""
    by_u, by_v, by_uu, by_uv, by_vv, _ = sphere()
    n = np.cross(by_u, by_v)
    n /= np.linalg.norm(n)
    first = by_u @ by_u, by_u @ by_v, by_v @ by_v
    return (*map(float, first), float(n @ by_uu), float(n @ by_uv), float(n @ by_vv))


def test_the_gain_of_the_wiener_filter_is_of_variances():
    signal, noise, window = 4.0, 1.0, 9
    printed = np.sqrt(signal) / (np.sqrt(signal) + np.sqrt(noise))
    centre = (signal + noise / window) / (signal + noise)
    by_kernel = (centre - 1 / window) / (1 - 1 / window)  # what (3.7) does to the middle
    assert printed == pytest.approx(0.667, abs=1e-3)
    assert by_kernel == pytest.approx(0.8)
    image = np.zeros((3, 3))
    image[1, 1] = 1.0
    mean, variance = 1 / 9, 8 / 81
    found = adaptive_wiener(image, 0.2 * variance)[1, 1]
    assert (found - mean) / (1.0 - mean) == pytest.approx(0.8)


def test_the_kernel_holds_for_all_neighbours_but_the_middle():
    signal, noise, window = 4.0, 1.0, 9
    middle = (signal + noise / window) / (signal + noise)
    around = noise / window / (signal + noise)
    assert middle + 4 * around == pytest.approx(0.911, abs=1e-3)  # n1 and n2 both not 0
    assert middle + 8 * around == pytest.approx(1.0)  # (n1, n2) not (0, 0)


def test_a_constant_window_is_nothing_over_nothing():
    with np.errstate(invalid="ignore"):
        assert np.isnan(np.float64(0.0) / (np.float64(0.0) + 0.0))
    assert np.array_equal(adaptive_wiener(np.full((4, 4), 2.0), 0.0), np.full((4, 4), 2.0))
    assert np.array_equal(adaptive_wiener(np.full((4, 4), 2.0), 1e-30), np.full((4, 4), 2.0))


def test_what_is_called_a_power_spectrum_is_a_variance_with_the_noise_in_it():
    rng = np.random.default_rng(0)
    noisy = 1e8 + rng.normal(size=9)
    two_passes = ((noisy - noisy.mean()) ** 2).mean()
    one_pass = (noisy**2).mean() - noisy.mean() ** 2
    assert abs(one_pass - two_passes) > 0.5
    image = 1e8 + rng.normal(size=(40, 40))
    smoothed = adaptive_wiener(image, 1.0)
    # All of it is noise: little of the variance may be left.
    assert smoothed.var() < 0.35 * image.var()
    assert smoothed.shape == image.shape  # the borders, of which nothing is said, are mirrored


def test_the_median_comes_before_the_wiener_filter_where_there_are_impulses():
    def noise(frame):
        """What a filter that knows no noise takes: the mean of the local variances."""
        return float(neighbourhoods(frame).var(axis=-1).mean())

    x = np.linspace(-1, 1, 16)
    clean = 1.0 - 0.3 * (x[:, None] ** 2 + x**2)
    rng, errors = np.random.default_rng(1), []
    for _ in range(20):
        frame = clean + 0.01 * rng.normal(size=clean.shape)
        frame[rng.random(clean.shape) < 0.08] = 0.0
        ways = (
            wiener_then_median(frame, noise(frame)),
            median_then_wiener(frame, noise(median_filter(frame))),
        )
        errors.append([np.sqrt(((way - clean) ** 2).mean()) for way in ways])
    wiener_first, median_first = np.mean(errors, axis=0)
    assert wiener_first > 1.4 * median_first


def test_a_convex_surface_has_negative_curvature_by_the_outward_normal():
    *_, g, _, _, n = printed_forms()
    assert n / g == pytest.approx(-0.5)
    assert np.exp(-10.0 * n / g) == pytest.approx(148.4, abs=0.1)  # (3.1): a step over the object
    assert curvature_along(shape_operator(*sphere()), sphere()[1]) == pytest.approx(0.5)


def test_the_ratio_of_steps_is_infinite_across_the_contour():
    e, f, g, ll, m, n = printed_forms()
    with np.errstate(invalid="ignore", over="ignore"):
        h = np.float64(1e200)
        assert np.isnan((ll + 2 * m * h + n * h * h) / (e + 2 * f * h + g * h * h))
    assert np.isfinite(curvature_along(shape_operator(*sphere()), sphere()[1]))


def test_the_second_parameter_runs_across_the_contour_only_if_they_are_orthogonal():
    # A cylinder along z of radius 1; u along a helix, v around: F is not 0.
    by_u, by_v = np.array([0.0, 1.0, 1.0]), np.array([0.0, 1.0, 0.0])
    bend = np.array([-1.0, 0.0, 0.0])
    outward = np.array([1.0, 0.0, 0.0])
    shape = shape_operator(by_u, by_v, bend, bend, bend, outward)
    e, f = float(by_u @ by_u), float(by_u @ by_v)
    assert curvature_along(shape, by_v) == pytest.approx(1.0)  # N / G
    assert curvature_along(shape, by_u - e / f * by_v) == pytest.approx(0.5)  # orthogonal to u


def test_the_equation_of_the_principal_directions_vanishes_at_an_umbilic():
    e, f, g, ll, m, n = printed_forms()
    coefficients = np.array([f * n - m * g, e * n - ll * g, e * m - ll * f])
    assert np.abs(coefficients).max() < 1e-15
    found = principal_curvatures(shape_operator(*sphere()))
    assert found.umbilic
    assert (found.k1, found.k2) == pytest.approx((0.5, 0.5), rel=1e-14)


def test_the_equation_of_the_principal_directions_loses_a_root():
    # F N = M G: one principal direction is u = const, h infinite.
    (e, f, g), (ll, m, n) = (2.0, 0.0, 1.0), (0.5, 0.0, -0.4)
    assert f * n - m * g == 0.0
    assert len(np.roots([f * n - m * g, e * n - ll * g, e * m - ll * f])) == 1
    x, y, z = np.eye(3)
    shape = shape_operator(np.sqrt(e) * x, y, -ll * z, m * z, -n * z, z)
    assert curvature_along(shape, y) == pytest.approx(-0.4)


def test_the_discriminant_at_an_umbilic_is_negative_by_rounding():
    rng = np.random.default_rng(0)
    a = rng.normal(size=(20000, 2, 2))
    first = a @ a.transpose(0, 2, 1) + 0.1 * np.eye(2)
    second = 0.7 * (1 + 1e-16 * rng.normal(size=(20000, 1, 1))) * first
    e, f, g = first[:, 0, 0], first[:, 0, 1], first[:, 1, 1]
    ll, m, n = second[:, 0, 0], second[:, 0, 1], second[:, 1, 1]
    qa, qb, qc = e * g - f * f, e * n + ll * g - 2 * m * f, ll * n - m * m
    spread = qb * qb - 4 * qa * qc
    assert (spread < 0.0).mean() > 0.2
    printed = (qb + np.sqrt(np.maximum(spread, 0.0))) / (2 * qa)
    assert np.abs(printed - 0.7).max() > 1e-8
    for row in range(50):
        factor = np.linalg.cholesky(first[row])
        by_u, by_v = (np.array([*factor[i], 0.0]) for i in (0, 1))
        inwards = [np.array([0.0, 0.0, -part]) for part in (ll[row], m[row], n[row])]
        found = principal_curvatures(
            shape_operator(by_u, by_v, *inwards, np.array([0.0, 0.0, 1.0]))
        )
        assert (found.k1, found.k2) == pytest.approx((0.7, 0.7), rel=2e-14)


def test_the_mean_curvature_lacks_a_half():
    e, f, g, ll, m, n = printed_forms()
    printed = (e * n + ll * g - 2 * m * f) / (e * g - f * f)
    assert printed == pytest.approx(-1.0)
    found = principal_curvatures(shape_operator(*sphere()))
    assert 0.5 * (found.k1 + found.k2) == pytest.approx(0.5)


def test_a_point_without_any_curvature_is_not_parabolic():
    x, y, z = np.eye(3)
    none = np.zeros(3)
    plane, cylinder = (
        principal_curvatures(shape_operator(x, y, bend, none, none, z)) for bend in (none, -z)
    )
    # A zero Gaussian curvature, the text's test, is that of both.
    assert plane.k1 * plane.k2 == cylinder.k1 * cylinder.k2 == 0.0
    assert (plane.k1 + plane.k2, cylinder.k1 + cylinder.k2) == (0.0, 1.0)
