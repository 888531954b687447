"""Shape operators of graphs, and the principal curvatures of any."""

from __future__ import annotations

import math

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.touch import graph_shape_operator, principal_curvatures
from tests.core.touch.parametric import shape_operator


def on_an_ellipsoid(a: float, b: float, c: float, u: float, v: float) -> tuple[Floats, ...]:
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


@pytest.mark.parametrize("axes", [(2.0, 2.0, 2.0), (0.03, 0.05, 0.02), (3.0, 1.0, 2.0)])
def test_an_ellipsoid_has_the_curvatures_of_the_textbook(axes):
    a, b, c = axes
    for u, v in np.random.default_rng(0).uniform(-1.3, 1.3, (20, 2)):
        derivatives = on_an_ellipsoid(a, b, c, u, v)
        x, y, z = a * math.cos(u) * math.cos(v), b * math.cos(u) * math.sin(v), c * math.sin(u)
        h = math.sqrt(x**2 / a**4 + y**2 / b**4 + z**2 / c**4)
        gauss = 1.0 / (a * b * c * h * h) ** 2
        mean = (a**2 + b**2 + c**2 - x**2 - y**2 - z**2) / (2 * (a * b * c) ** 2 * h**3)
        k1, k2, *_ = principal_curvatures(shape_operator(*derivatives))
        assert k1 >= k2 and k1 * k2 == pytest.approx(gauss, rel=1e-11)
        assert 0.5 * (k1 + k2) == pytest.approx(mean, rel=1e-11)
        hollow = principal_curvatures(shape_operator(*derivatives[:5], -derivatives[5]))
        assert hollow[:2] == pytest.approx((-k2, -k1))


def test_at_an_umbilic_the_curvatures_are_equal_to_rounding():
    rng = np.random.default_rng(2)
    for p, q in rng.normal(size=(500, 2)).tolist():
        w = math.sqrt(1 + p * p + q * q)
        # The graph of a ball of radius 1 where its slopes are p and q.
        seconds = (w * (1 + p * p), w * p * q, w * (1 + q * q))
        k1, k2, direction, umbilic = principal_curvatures(graph_shape_operator((p, q), seconds))
        assert k1 == pytest.approx(1.0, abs=1e-14) and 0.0 <= k1 - k2 < 1e-14
        assert umbilic and np.linalg.norm(direction) == pytest.approx(1.0)


@pytest.mark.parametrize("steep", [1e3, 1e6, 1e12, 1e160])
def test_a_wall_along_the_viewing_direction_is_finite(steep):
    # A cylinder of radius 2 about the z axis, seen almost along it.
    around = math.hypot(1.0, 1.0 / steep)  # z = steep (x - y^2 / 4) up to second order
    wall = graph_shape_operator((steep, 0.0), (0.0, 0.0, -0.5 * steep))
    k1, k2, *_ = principal_curvatures(wall)
    assert (k1, k2) == pytest.approx((0.0, -0.5 / around), abs=1e-12)
    for slopes in ((steep, 0.0), (0.0, -steep), (steep, steep)):
        shape = graph_shape_operator(slopes, (1.0, 2.0, 3.0))
        assert np.isfinite([*principal_curvatures(shape)[:2], *shape.normal]).all()
        assert np.linalg.norm(shape.normal) == pytest.approx(1.0)
