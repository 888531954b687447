import math

import numpy as np
import pytest

from palpate.core.touch.forms import (
    curvature_along,
    graph_errors,
    graph_shape_operator,
    principal_curvatures,
)
from tests.core.touch.parametric import shape_operator


def on_an_ellipsoid(a, b, c, u, v):
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


def test_a_sphere_bends_by_one_over_its_radius_everywhere_outwards():
    for u in (-1.2, 0.0, 0.7):
        derivatives = on_an_ellipsoid(2.0, 2.0, 2.0, u, 0.4)
        shape = shape_operator(*derivatives)
        assert principal_curvatures(shape)[:2] == pytest.approx((0.5, 0.5))
        for turn in np.linspace(0, math.pi, 5):
            along = math.cos(turn) * shape.tangents[0] + math.sin(turn) * shape.tangents[1]
            assert curvature_along(shape, along) == pytest.approx(0.5)


def test_gaussian_and_mean_curvature_of_an_ellipsoid_are_those_of_the_book():
    a, b, c = 0.03, 0.05, 0.02
    for u, v in np.random.default_rng(0).uniform(-1.3, 1.3, (20, 2)):
        derivatives = on_an_ellipsoid(a, b, c, u, v)
        x, y, z = a * math.cos(u) * math.cos(v), b * math.cos(u) * math.sin(v), c * math.sin(u)
        h = math.sqrt(x**2 / a**4 + y**2 / b**4 + z**2 / c**4)
        gauss = 1.0 / (a * b * c * h * h) ** 2
        mean = (a**2 + b**2 + c**2 - x**2 - y**2 - z**2) / (2 * (a * b * c) ** 2 * h**3)
        k1, k2, *_ = principal_curvatures(shape_operator(*derivatives))
        assert k1 * k2 == pytest.approx(gauss, rel=1e-11)
        assert 0.5 * (k1 + k2) == pytest.approx(mean, rel=1e-11)


def test_the_principal_curvatures_are_the_extremes_of_the_normal_curvature():
    derivatives = on_an_ellipsoid(3.0, 1.0, 2.0, 0.5, 0.6)
    by_u, by_v, by_uu, by_uv, by_vv, outward = derivatives
    shape = shape_operator(*derivatives)
    k1, k2, direction, umbilic = principal_curvatures(shape)
    turns = np.linspace(0, math.pi, 100001)
    # The quotient of the second form and the first: (3.15), its sign turned.
    normal = outward / np.linalg.norm(outward)
    steps = [(math.cos(t), math.sin(t)) for t in turns[::100]]
    found = [
        -float(normal @ (du * du * by_uu + 2 * du * dv * by_uv + dv * dv * by_vv))
        / float(np.sum((du * by_u + dv * by_v) ** 2))
        for du, dv in steps
    ]
    assert max(found) == pytest.approx(k1, rel=1e-5)
    assert min(found) == pytest.approx(k2, rel=1e-5)
    assert not umbilic
    assert curvature_along(shape, direction) == pytest.approx(k1, rel=1e-12)
    across = np.cross(direction, shape.normal)
    assert curvature_along(shape, across) == pytest.approx(k2, rel=1e-12)
    assert np.linalg.norm(direction) == pytest.approx(1.0, rel=1e-15)
    assert float(direction @ shape.normal) == pytest.approx(0.0, abs=1e-15)


def test_parametric_and_graph_agree():
    rng = np.random.default_rng(1)
    for _ in range(50):
        p, q, r, s, t = rng.normal(size=5)
        graph = graph_shape_operator((p, q), (r, s, t))
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
        assert np.allclose(
            principal_curvatures(graph)[:2],
            principal_curvatures(surface)[:2],
            rtol=1e-11,
            atol=1e-12,
        )
        way = rng.normal(size=3)
        along = curvature_along(surface, way)
        assert curvature_along(graph, way) == pytest.approx(along, rel=1e-10, abs=1e-12)
        assert np.allclose(graph.tangents @ graph.tangents.T, np.eye(2), atol=1e-15)
        assert np.allclose(graph.tangents @ graph.normal, 0.0, atol=1e-15)


def test_at_an_umbilic_the_curvatures_are_equal_to_1e_14_and_no_direction_is_claimed():
    rng = np.random.default_rng(2)
    for _ in range(2000):
        u, v = rng.uniform(-1.4, 1.4, 2)
        radius = 10.0 ** rng.uniform(-3, 3)
        k1, k2, direction, umbilic = principal_curvatures(
            shape_operator(*on_an_ellipsoid(radius, radius, radius, u, v))
        )
        assert (k1 - k2) * radius < 1e-13 / math.cos(u) ** 2
        assert np.isfinite(direction).all()
        p, q = rng.normal(size=2)
        w = math.sqrt(1 + p * p + q * q)
        # The graph of a ball of radius 1 where its slopes are p and q.
        seconds = (w * (1 + p * p), w * p * q, w * (1 + q * q))
        k1, k2, direction, umbilic = principal_curvatures(graph_shape_operator((p, q), seconds))
        assert k1 == pytest.approx(1.0, abs=1e-14)
        assert k1 - k2 < 1e-14
        assert umbilic


def test_a_plane_is_flat_exactly_and_its_direction_is_not_claimed():
    for slopes in ((0.0, 0.0), (0.3, -0.7), (1e6, 0.0)):
        shape = graph_shape_operator(slopes, (0.0, 0.0, 0.0))
        k1, k2, direction, umbilic = principal_curvatures(shape)
        assert (k1, k2) == (0.0, 0.0)
        assert umbilic
        assert np.linalg.norm(direction) == pytest.approx(1.0)
        assert curvature_along(shape, direction) == 0.0


def test_a_saddle_keeps_its_signs_with_a_mean_of_zero():
    k1, k2, direction, umbilic = principal_curvatures(
        graph_shape_operator((0.0, 0.0), (-30.0, 0.0, 30.0))
    )
    assert (k1, k2) == (30.0, -30.0)
    assert k1 * k2 < 0.0
    assert np.allclose(np.abs(direction), [0.0, 1.0, 0.0])
    assert not umbilic


@pytest.mark.parametrize("steep", [1e3, 1e6, 1e12, 1e160])
def test_a_vertical_wall_is_finite_and_bends_as_it_should(steep):
    # A cylinder of radius 2 about the z axis, seen almost along it: x along the slope.
    wall = shape_operator(
        np.array([1.0 / steep, 0.0, 1.0]) * steep,
        np.array([0.0, 1.0, 0.0]),
        np.zeros(3),
        np.zeros(3),
        np.array([-0.5, 0.0, 0.0]),
        np.array([1.0, 0.0, 0.0]),
    )
    k1, k2, *_ = principal_curvatures(wall)
    assert k1 == pytest.approx(0.5, rel=2.0 / steep)
    assert k2 == pytest.approx(0.0, abs=1e-12)
    for slopes in ((steep, 0.0), (0.0, -steep), (steep, steep)):
        shape = graph_shape_operator(slopes, (1.0, 2.0, 3.0))
        assert np.isfinite([*principal_curvatures(shape)[:2], *shape.normal]).all()
        assert np.linalg.norm(shape.normal) == pytest.approx(1.0)


def test_which_way_is_outwards_decides_the_sign():
    *derivatives, outward = on_an_ellipsoid(2.0, 2.0, 2.0, 0.3, 0.3)
    by_u, by_v, by_uu, by_uv, by_vv = derivatives
    inside_out = shape_operator(by_u, by_v, by_uu, by_uv, by_vv, -outward)
    assert principal_curvatures(inside_out)[:2] == pytest.approx((-0.5, -0.5))
    assert principal_curvatures(shape_operator(by_v, by_u, by_vv, by_uv, by_uu, outward))[
        :2
    ] == pytest.approx((0.5, 0.5))


def test_what_is_no_surface_is_refused():
    zero, x = np.zeros(3), np.array([1.0, 0.0, 0.0])
    with pytest.raises(ValueError, match="parallel"):
        shape_operator(x, 3.0 * x, zero, zero, zero, x)
    with pytest.raises(ValueError, match="must be finite and not zero"):
        shape_operator(x, zero, zero, zero, zero, x)


def test_a_direction_along_the_normal_has_no_curvature():
    shape = graph_shape_operator((0.3, -0.2), (1.0, 0.5, 2.0))
    assert curvature_along(shape, shape.normal) == 0.0
    assert curvature_along(shape, np.zeros(3)) == 0.0


DIRECTION = np.array([0.3, 0.9, 0.1])
DEVIATION = 1e-3


def scatter(derivatives, factor, draws=4000):
    """Root mean square change of normal, k1, k2 and the curvature along a direction."""
    rng = np.random.default_rng(0)

    def known(five):
        p, q, r, s, t = five.tolist()
        shape = graph_shape_operator((p, q), (r, s, t))
        k1, k2, *_ = principal_curvatures(shape)
        return shape.normal, [k1, k2, curvature_along(shape, DIRECTION)]

    normal, numbers = known(derivatives)
    found = []
    for _ in range(draws):
        other, changed = known(derivatives + DEVIATION * factor @ rng.normal(size=factor.shape[1]))
        found.append(
            [np.arcsin(np.linalg.norm(np.cross(normal, other))), *(np.array(changed) - numbers)]
        )
    return np.asarray(np.sqrt(np.mean(np.square(found), axis=0)))


def promised(derivatives, factor):
    p, q, r, s, t = derivatives.tolist()
    shape = graph_shape_operator((p, q), (r, s, t))
    errors = graph_errors(derivatives, factor, DEVIATION, shape, DIRECTION)
    return np.array([errors.normal, *errors.principal, errors.across])


@pytest.mark.parametrize("seed", range(6))
def test_errors_are_the_scatter_under_noise_however_the_surface_leans(seed):
    rng = np.random.default_rng(seed)
    derivatives = rng.normal(size=5)
    factor = rng.normal(size=(5, 7))
    assert np.allclose(scatter(derivatives, factor), promised(derivatives, factor), rtol=0.06)


def test_near_an_umbilic_the_errors_are_neither_nothing_nor_without_bound():
    factor = np.eye(5)
    for apart in (0.0, 0.1, 0.5, 1.0, 2.0, 5.0, 50.0):
        derivatives = np.array([0.0, 0.0, 1.0 + apart * DEVIATION, 0.0, 1.0])
        ratio = promised(derivatives, factor) / scatter(derivatives, factor)
        assert ratio.min() > 0.85
        assert (
            ratio.max() < 1.35
        )  # on the safe side where their difference is as large as its error


def test_a_pad_that_is_turned_makes_no_difference():
    rng = np.random.default_rng(3)
    p, q, r, s, t = rng.normal(size=5)
    before = promised(np.array([p, q, r, s, t]), np.diag([1.0, 1.0, 1.0, 0.5**0.5, 1.0]))
    turned = np.array([q, -p, t, -s, r])  # by a right angle
    after = graph_errors(
        turned,
        np.diag([1.0, 1.0, 1.0, 0.5**0.5, 1.0]),
        DEVIATION,
        graph_shape_operator((q, -p), (t, -s, r)),
        np.array([DIRECTION[1], -DIRECTION[0], DIRECTION[2]]),
    )
    assert np.allclose(before, [after.normal, *after.principal, after.across], rtol=1e-12)


def test_without_noise_there_is_no_error():
    derivatives = np.array([0.1, 0.2, 3.0, 0.5, 2.0])
    shape = graph_shape_operator((0.1, 0.2), (3.0, 0.5, 2.0))
    errors = graph_errors(derivatives, np.eye(5), 0.0, shape, DIRECTION)
    assert errors.normal == errors.across == 0.0
    assert errors.principal == (0.0, 0.0)
    assert (errors.parts == 0.0).all()
