from __future__ import annotations

import math

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.touch.forms import (
    angle_between,
    curvature_along,
    forms_of,
    gaussian_curvature,
    graph_shape,
    mean_curvature,
    normal_curvature,
    principal,
    shape_operator,
)

Derivatives = tuple[Floats, Floats, Floats, Floats, Floats, Floats]


def on_an_ellipsoid(a: float, b: float, c: float, u: float, v: float) -> Derivatives:
    """First and second derivatives by latitude u and azimuth v, and the outward normal."""
    cu, su, cv, sv = math.cos(u), math.sin(u), math.cos(v), math.sin(v)
    return (
        np.array([-a * su * cv, -b * su * sv, c * cu]),
        np.array([-a * cu * sv, b * cu * cv, 0.0]),
        np.array([-a * cu * cv, -b * cu * sv, -c * su]),
        np.array([a * su * sv, -b * su * cv, 0.0]),
        np.array([-a * cu * cv, -b * cu * sv, 0.0]),
        np.array([cu * cv / a, cu * sv / b, su / c]),
    )


def test_a_sphere_bends_by_one_over_its_radius_everywhere_outwards() -> None:
    for u in (-1.2, 0.0, 0.7):
        derivatives = on_an_ellipsoid(2.0, 2.0, 2.0, u, 0.4)
        forms = forms_of(*derivatives)
        assert gaussian_curvature(forms) == pytest.approx(0.25)
        assert mean_curvature(forms) == pytest.approx(0.5)  # (3.22) as printed gives 1
        for turn in np.linspace(0, math.pi, 5):
            assert normal_curvature(forms, math.cos(turn), math.sin(turn)) == pytest.approx(0.5)


def test_gaussian_and_mean_curvature_of_an_ellipsoid_are_those_of_the_book() -> None:
    a, b, c = 0.03, 0.05, 0.02
    for u, v in np.random.default_rng(0).uniform(-1.3, 1.3, (20, 2)):
        derivatives = on_an_ellipsoid(a, b, c, u, v)
        x, y, z = a * math.cos(u) * math.cos(v), b * math.cos(u) * math.sin(v), c * math.sin(u)
        h = math.sqrt(x**2 / a**4 + y**2 / b**4 + z**2 / c**4)
        gauss = 1.0 / (a * b * c * h * h) ** 2
        mean = (a**2 + b**2 + c**2 - x**2 - y**2 - z**2) / (2 * (a * b * c) ** 2 * h**3)
        forms = forms_of(*derivatives)
        assert gaussian_curvature(forms) == pytest.approx(gauss, rel=1e-11)
        assert mean_curvature(forms) == pytest.approx(mean, rel=1e-11)
        k1, k2, *_ = principal(shape_operator(*derivatives))
        assert k1 * k2 == pytest.approx(gauss, rel=1e-11)
        assert 0.5 * (k1 + k2) == pytest.approx(mean, rel=1e-11)


def test_the_principal_curvatures_are_the_extremes_of_the_normal_curvature() -> None:
    derivatives = on_an_ellipsoid(3.0, 1.0, 2.0, 0.5, 0.6)
    forms, shape = forms_of(*derivatives), shape_operator(*derivatives)
    k1, k2, direction, umbilic = principal(shape)
    turns = np.linspace(0, math.pi, 100001)
    found = [normal_curvature(forms, math.cos(t), math.sin(t)) for t in turns[::100]]
    assert max(found) == pytest.approx(k1, rel=1e-5)
    assert min(found) == pytest.approx(k2, rel=1e-5)
    assert not umbilic
    assert curvature_along(shape, direction) == pytest.approx(k1, rel=1e-12)
    across = np.cross(direction, shape.normal)
    assert curvature_along(shape, across) == pytest.approx(k2, rel=1e-12)
    assert np.linalg.norm(direction) == pytest.approx(1.0, rel=1e-15)
    assert float(direction @ shape.normal) == pytest.approx(0.0, abs=1e-15)


def test_parametric_and_graph_agree() -> None:
    rng = np.random.default_rng(1)
    for _ in range(50):
        p, q, r, s, t = rng.normal(size=5)
        graph = graph_shape((p, q), (r, s, t))
        flat = np.zeros(2)
        surface = shape_operator(
            np.array([1.0, 0.0, p]),
            np.array([0.0, 1.0, q]),
            np.array([*flat, r]),
            np.array([*flat, s]),
            np.array([*flat, t]),
            np.array([0.0, 0.0, -1.0]),
        )
        assert np.allclose(graph.normal, surface.normal, atol=1e-14)
        assert np.allclose(principal(graph)[:2], principal(surface)[:2], rtol=1e-11, atol=1e-12)
        way = rng.normal(size=3)
        along = curvature_along(surface, way)
        assert curvature_along(graph, way) == pytest.approx(along, rel=1e-10, abs=1e-12)
        assert np.allclose(graph.tangents @ graph.tangents.T, np.eye(2), atol=1e-15)
        assert np.allclose(graph.tangents @ graph.normal, 0.0, atol=1e-15)


def test_at_an_umbilic_the_curvatures_are_equal_to_1e_14_and_no_direction_is_claimed() -> None:
    rng = np.random.default_rng(2)
    for _ in range(2000):
        u, v = rng.uniform(-1.4, 1.4, 2)
        radius = 10.0 ** rng.uniform(-3, 3)
        k1, k2, direction, umbilic = principal(
            shape_operator(*on_an_ellipsoid(radius, radius, radius, u, v))
        )
        assert (k1 - k2) * radius < 1e-13 / math.cos(u) ** 2
        assert np.isfinite(direction).all()
        p, q = rng.normal(size=2)
        w = math.sqrt(1 + p * p + q * q)
        # The graph of a ball of radius 1 where its slopes are p and q.
        seconds = (w * (1 + p * p), w * p * q, w * (1 + q * q))
        k1, k2, direction, umbilic = principal(graph_shape((p, q), seconds))
        assert k1 == pytest.approx(1.0, abs=1e-14)
        assert k1 - k2 < 1e-14
        assert umbilic


def test_a_plane_is_flat_exactly_and_its_direction_is_not_claimed() -> None:
    for slopes in ((0.0, 0.0), (0.3, -0.7), (1e6, 0.0)):
        shape = graph_shape(slopes, (0.0, 0.0, 0.0))
        k1, k2, direction, umbilic = principal(shape)
        assert (k1, k2) == (0.0, 0.0)
        assert umbilic
        assert np.linalg.norm(direction) == pytest.approx(1.0)
        assert curvature_along(shape, direction) == 0.0


def test_a_saddle_keeps_its_signs_with_a_mean_of_zero() -> None:
    k1, k2, direction, umbilic = principal(graph_shape((0.0, 0.0), (-30.0, 0.0, 30.0)))
    assert (k1, k2) == (30.0, -30.0)
    assert k1 * k2 < 0.0
    assert np.allclose(np.abs(direction), [0.0, 1.0, 0.0])
    assert not umbilic


@pytest.mark.parametrize("steep", [1e3, 1e6, 1e12, 1e160])
def test_a_vertical_wall_is_finite_and_bends_as_it_should(steep: float) -> None:
    # A cylinder of radius 2 about the z axis, seen almost along it: x along the slope.
    wall = shape_operator(
        np.array([1.0 / steep, 0.0, 1.0]) * steep,
        np.array([0.0, 1.0, 0.0]),
        np.zeros(3),
        np.zeros(3),
        np.array([-0.5, 0.0, 0.0]),
        np.array([1.0, 0.0, 0.0]),
    )
    k1, k2, *_ = principal(wall)
    assert k1 == pytest.approx(0.5, rel=2.0 / steep)
    assert k2 == pytest.approx(0.0, abs=1e-12)
    for slopes in ((steep, 0.0), (0.0, -steep), (steep, steep)):
        shape = graph_shape(slopes, (1.0, 2.0, 3.0))
        assert np.isfinite([*principal(shape)[:2], *shape.normal]).all()
        assert np.linalg.norm(shape.normal) == pytest.approx(1.0)


def test_the_curvature_across_a_contour_does_not_need_h() -> None:
    forms = forms_of(*on_an_ellipsoid(3.0, 1.0, 2.0, 0.5, 0.6))
    assert normal_curvature(forms, 0.0, 1.0) == forms.second[2] / forms.first[2]  # (3.16)
    assert normal_curvature(forms, 0.0, 1e-300) == normal_curvature(forms, 0.0, 1.0)
    assert normal_curvature(forms, -2.0, 6.0) == pytest.approx(normal_curvature(forms, 1.0, -3.0))
    with pytest.raises(ValueError, match=r"\(du, dv\) must not be zero"):
        normal_curvature(forms, 0.0, 0.0)


def test_which_way_is_outwards_decides_the_sign() -> None:
    *derivatives, outward = on_an_ellipsoid(2.0, 2.0, 2.0, 0.3, 0.3)
    by_u, by_v, by_uu, by_uv, by_vv = derivatives
    inside_out = shape_operator(by_u, by_v, by_uu, by_uv, by_vv, -outward)
    assert principal(inside_out)[:2] == pytest.approx((-0.5, -0.5))
    assert principal(shape_operator(by_v, by_u, by_vv, by_uv, by_uu, outward))[:2] == pytest.approx(
        (0.5, 0.5)
    )


def test_what_is_no_surface_is_refused() -> None:
    zero, x = np.zeros(3), np.array([1.0, 0.0, 0.0])
    with pytest.raises(ValueError, match="parallel"):
        shape_operator(x, 3.0 * x, zero, zero, zero, x)
    with pytest.raises(ValueError, match="must be finite and not zero"):
        forms_of(x, zero, zero, zero, zero, x)


def test_a_direction_along_the_normal_has_no_curvature() -> None:
    shape = graph_shape((0.3, -0.2), (1.0, 0.5, 2.0))
    assert curvature_along(shape, shape.normal) == 0.0
    assert curvature_along(shape, np.zeros(3)) == 0.0


@pytest.mark.parametrize("angle", [0.0, 1e-300, 1e-9, 1e-3, 1.0, math.pi - 1e-9, math.pi])
def test_an_angle_of_1e_9_survives(angle: float) -> None:
    one = np.array([0.0, 0.0, 5.0])
    other = np.array([3.0 * math.sin(angle), 0.0, 3.0 * math.cos(angle)])
    assert angle_between(one, other) == pytest.approx(angle, rel=1e-9, abs=1e-305)
