from __future__ import annotations

import math

import mpmath
import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from palpate.core.shapes.superquadrics import inside_outside

EPS = float(np.finfo(float).eps)


def exact(points, exponents):
    """The logarithm of F in 50 digits, rounded, and by how much what is given misses it."""

    def one(point):
        x, y, z = (abs(mpmath.mpf(float(value))) for value in point)
        across = x ** (2 / e2) + y ** (2 / e2)
        return e1 * mpmath.log(across ** (e2 / e1) + z ** (2 / e1))

    with mpmath.workdps(50):
        e1, e2 = (mpmath.mpf(float(e)) for e in exponents)
        wanted = [one(point) for point in points]
        value = inside_outside(points, exponents).value
        errors = [float(abs(mpmath.mpf(float(v)) - w)) for v, w in zip(value, wanted, strict=True)]
    return np.array([float(w) for w in wanted]), np.array(errors)


def test_log_f_has_all_its_digits_for_points_near_and_far():
    rng = np.random.default_rng(0)
    for _ in range(25):
        exponents = np.exp(rng.uniform(math.log(0.05), math.log(2.0), 2))
        points = np.exp(rng.uniform(math.log(0.01), math.log(100.0), (30, 3)))
        points[:10] = 1.0 + 1e-6 * rng.normal(size=(10, 3))  # near a corner of the box
        points[10:15] = points[10:15, :1]  # on a diagonal
        assert exact(points, exponents)[1].max() <= 16 * EPS


def test_log_f_has_its_digits_for_points_next_to_the_axes_and_very_far():
    rng = np.random.default_rng(1)
    for _ in range(25):
        exponents = np.exp(rng.uniform(math.log(0.01), math.log(2.0), 2))
        points = 10.0 ** rng.uniform(-200, 5, (20, 3))
        value, error = exact(points, exponents)
        assert (error <= (4 + 2 * np.abs(value)) * EPS).all()


def test_the_surface_of_a_ball_has_log_f_0():
    directions = np.random.default_rng(2).normal(size=(100, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    assert np.abs(inside_outside(directions, [1.0, 1.0]).value).max() <= 4 * EPS


@settings(max_examples=50, deadline=None, derandomize=True)
@given(
    e1=st.floats(0.1, 2.0),
    e2=st.floats(0.1, 2.0),
    point=st.tuples(*[st.floats(0.05, 5.0)] * 3),
    factor=st.floats(1e-3, 1e3),
)
def test_f_is_homogeneous_of_degree_2(
    e1: float, e2: float, point: tuple[float, float, float], factor: float
) -> None:
    near = inside_outside([point], [e1, e2])
    far = inside_outside(factor * np.array([point]), [e1, e2])
    assert far.value[0] == pytest.approx(near.value[0] + 2 * math.log(factor), abs=1e-14)
    assert near.by_log[0].sum() == pytest.approx(2.0, abs=1e-14)
    assert far.by_log[0] == pytest.approx(near.by_log[0], abs=1e-12)


@pytest.mark.parametrize("exponents", [[0.1, 0.1], [1.0, 1.0], [0.3, 1.7], [2.0, 2.0]])
def test_the_derivatives_are_those_of_differences(exponents):
    points = np.random.default_rng(3).uniform(0.2, 2.0, (60, 3)) * [1, -1, 1]
    found, step = inside_outside(points, exponents), 1e-6
    for axis in range(3):
        ahead, back = points.copy(), points.copy()
        ahead[:, axis] += step
        back[:, axis] -= step
        slope = inside_outside(ahead, exponents).value - inside_outside(back, exponents).value
        assert np.allclose(found.by_place[:, axis], slope / (2 * step), atol=1e-7)
        assert np.allclose(found.by_log[:, axis], found.by_place[:, axis] * points[:, axis])
    for which in range(2):
        shift = step * np.eye(2)[which]
        pair = np.array(exponents) - shift
        ahead = inside_outside(points, np.minimum(pair + 2 * shift, 2.0)).value
        back = inside_outside(points, pair).value
        wide = np.minimum(pair[which] + 2 * step, 2.0) - pair[which]
        assert np.allclose(found.by_exponents[:, which], (ahead - back) / wide, atol=1e-5)


@pytest.mark.parametrize("exponents", [[0.0, 1.0], [1.0, 2.1], [-1.0, 1.0]])
def test_exponents_out_of_range_are_refused(exponents):
    with pytest.raises(ValueError, match=r"exponents must be above 0 and up to 2, got \["):
        inside_outside(np.ones((1, 3)), exponents)


def test_points_that_are_none_are_refused():
    with pytest.raises(ValueError, match="scaled must be finite"):
        inside_outside([[0.0, math.nan, 1.0]], [1.0, 1.0])
    with pytest.raises(ValueError, match=r"scaled must have shape \(any, 3\)"):
        inside_outside([1.0, 2.0, 3.0], [1.0, 1.0])
    with pytest.raises(ValueError, match=r"exponents must have shape \(2\)"):
        inside_outside(np.ones((1, 3)), [1.0])
