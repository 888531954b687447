from __future__ import annotations

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.shapes.gauge import curve, gauge_of, norm

STEP = 1e-6
X, Y = np.random.default_rng(0).uniform(0.05, 1.0, (2, 300))


def exponent(e: float) -> Floats:
    return np.asarray(e)


@pytest.mark.parametrize("e", [0.02, 0.1, 0.7, 1.0, 1.6, 2.0])
def test_the_norm_of_exponent_e_is_the_root_of_a_sum_of_powers(e: float) -> None:
    power = np.longdouble(2) / np.longdouble(e)
    wanted = np.exp(np.logaddexp(power * np.log(X, dtype=np.longdouble), power * np.log(Y)) / power)
    assert np.allclose(norm(X, Y, exponent(e)).value, wanted.astype(float), rtol=1e-15)


@pytest.mark.parametrize("e", [0.1, 0.7, 1.0, 1.6])
def test_its_slopes_are_those_of_differences(e: float) -> None:
    at = norm(X, Y, exponent(e))

    def slope(dx: float, dy: float, de: float) -> Floats:
        ahead = norm(X + STEP * dx, Y + STEP * dy, exponent(e + STEP * de)).value
        back = norm(X - STEP * dx, Y - STEP * dy, exponent(e - STEP * de)).value
        return np.asarray((ahead - back) / (2 * STEP))

    assert np.allclose(at.by_x, slope(1, 0, 0), rtol=0, atol=1e-8)
    assert np.allclose(at.by_y, slope(0, 1, 0), rtol=0, atol=1e-8)
    assert np.allclose(at.by_exponent, slope(0, 0, 1), rtol=0, atol=1e-8)


@pytest.mark.parametrize("e", [0.1, 0.7, 1.0, 1.6])
def test_its_second_derivatives_are_those_of_differences_of_slopes(e: float) -> None:
    along_x, along_y = np.random.default_rng(1).normal(size=(2, 300))
    found = curve(norm(X, Y, exponent(e)), along_x, along_y, exponent(e))

    def slope(dx: float, dy: float, de: float) -> Floats:
        ahead = norm(X + STEP * dx, Y + STEP * dy, exponent(e + STEP * de))
        back = norm(X - STEP * dx, Y - STEP * dy, exponent(e - STEP * de))
        by_x, by_y = ahead.by_x - back.by_x, ahead.by_y - back.by_y
        return np.asarray((by_x * along_x + by_y * along_y) / (2 * STEP))

    clear = np.minimum(X, Y) > 2e-3 * np.maximum(X, Y)
    for mine, wanted in (
        (found.by_x, slope(1, 0, 0)),
        (found.by_y, slope(0, 1, 0)),
        (found.by_exponent, slope(0, 0, 1)),
    ):
        assert np.allclose(mine[clear], wanted[clear], rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize("e", [0.01, 0.5, 1.0, 1.5, 2.0])
def test_second_derivatives_on_a_crease_are_finite(e: float) -> None:
    x, y = np.array([0.0, 1.0, 0.0, 1e-200, 1.0]), np.array([1.0, 0.0, 0.0, 1.0, 1e-12])
    found = curve(norm(x, y, exponent(e)), np.ones(5), -np.ones(5), exponent(e))
    assert all(np.isfinite(part).all() for part in found)


def test_the_gradient_points_outwards_and_is_that_of_differences() -> None:
    points = np.random.default_rng(2).normal(size=(200, 3))
    for pair in ([0.1, 0.1], [1.0, 1.0], [0.4, 1.7], [2.0, 2.0]):
        exponents = np.array(pair)
        value, slope = gauge_of(points, exponents)
        for axis in range(3):
            step = STEP * np.eye(3)[axis]
            ahead, back = gauge_of(points + step, exponents)[0], gauge_of(points - step, exponents)
            wanted = (ahead - back[0]) / (2 * STEP)
            assert np.allclose(slope[:, axis], wanted, rtol=0, atol=1e-6)
        # Euler: the gauge is homogeneous.
        assert np.allclose(np.einsum("ni,ni->n", slope, points), value, rtol=1e-14)
