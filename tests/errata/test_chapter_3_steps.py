import math

import numpy as np
import pytest
from scipy.interpolate import BSpline

from palpate.core.splines.bases import Basis

KNOTS = np.array([0, 0, 0, 0, 0.2, 0.35, 0.7, 1, 1, 1, 1])
ORDER = 4
PLACES = np.array([0.1, 0.3, 0.5, 0.9])


def knot(i):
    """The knot x_i, counted from 1."""
    return float(KNOTS[i - 1]) if 1 <= i <= len(KNOTS) else math.nan


def share(value, span):
    return value / span if span != 0.0 else 0.0


def function(i, order, u):
    """N_{i, order} at u, counted from 1; 0 beyond the ends."""
    if not 1 <= i <= len(KNOTS) - order:
        return 0.0
    if order == 1:
        return float(knot(i) <= u < knot(i + 1))
    one = BSpline(KNOTS, np.eye(len(KNOTS) - order)[i - 1], order - 1)
    return float(one(u))


def coefficients(times, i, printed):
    """The c of (3.25), as printed or with the right indices."""
    k, c = ORDER, {(1, 1): 1.0}
    off = (2, 1) if printed else (1, 0)
    for p in range(2, times + 2):
        c[p, 1] = share(c[p - 1, 1], knot(i + k - p + off[0]) - knot(i + off[1]))
        for j in range(2, p):
            span = (knot(i + k + j - p + 2) - knot(i + j + 1)) if printed else (
                knot(i + k + j - p) - knot(i + j - 1)
            )  # fmt: skip
            c[p, j] = share(c[p - 1, j] - c[p - 1, j - 1], span)
        c[p, p] = share(-c[p - 1, p - 1], knot(i + k) - knot(i + p - 1))
    return c


def derivative(times, i, u, printed):
    c = coefficients(times, i, printed)
    factor = math.factorial(ORDER - 1) / math.factorial(ORDER - times - 1)
    return factor * sum(
        c[times + 1, j] * function(i + j - 1, ORDER - times, u) for j in range(1, times + 2)
    )


def ours(times):
    return np.asarray(Basis(KNOTS, ORDER - 1).matrix(PLACES, times).toarray())


@pytest.mark.filterwarnings("ignore:invalid value")
def test_the_coefficients_of_a_derivative_have_other_indices():
    for times, wrong_by in ((1, 1.0), (2, 50.0), (3, 500.0)):
        errors = [
            np.nanmax(
                [
                    abs(derivative(times, i, u, printed) - ours(times)[row, i - 1])
                    for i in range(1, 8)
                    for row, u in enumerate(PLACES)
                ]
            )
            for printed in (True, False)
        ]
        assert errors[0] > wrong_by
        assert errors[1] < 1e-12 * 10**times


def test_the_recursion_of_a_derivative_has_other_denominators():
    p, errors = ORDER - 1, np.zeros(2)
    for i in range(2, 6):
        for row, u in enumerate(PLACES):
            one, two = function(i, p, u), function(i + 1, p, u)
            printed = share(one, knot(i + ORDER) - knot(i))
            printed -= share(two, knot(i + ORDER + 1) - knot(i + 1))
            right = share(one, knot(i + p) - knot(i)) - share(two, knot(i + ORDER) - knot(i + 1))
            found = ours(1)[row, i - 1]
            errors = np.maximum(errors, [abs(p * printed - found), abs(p * right - found)])
    assert errors[0] == pytest.approx(2.42, abs=0.01)
    assert errors[1] < 1e-14


def test_the_second_recursion_divides_by_zero_at_the_highest_derivative():
    times = ORDER - 1  # which the text allows
    with pytest.raises(ZeroDivisionError):
        (ORDER - 1) / (ORDER - times - 1)
    wanted = BSpline(KNOTS, np.eye(7), 3).derivative(3)(PLACES)
    assert np.allclose(ours(3), wanted, rtol=1e-12, atol=1e-10)


def test_the_step_depends_on_the_unit_of_length():
    # (3.1) and (3.2): exp(-a kappa), with kappa in 1 over length, of one shape in three units.
    height, kappa = np.array([1.0, 10.0, 1000.0]), 2.0 / np.array([1.0, 10.0, 1000.0])
    assert np.exp(-kappa) == pytest.approx([0.135, 0.819, 0.998], abs=1e-3)
    assert np.exp(-kappa * height) == pytest.approx(np.full(3, math.exp(-2.0)))


def test_a_falling_curvature_makes_the_step_larger_than_any():
    # (3.28) with s2 = exp(-a change): the change has a sign, and the template ends at 0.
    change, a = -0.5, 10.0
    assert math.exp(-a * change) > 148.0
    assert math.exp(-a * abs(change)) < 1.0


def test_the_logarithmic_and_the_inverse_template_need_their_constants():
    def logarithmic(x, a, b, c):
        return a / math.log(b * x + c)

    with pytest.raises(ZeroDivisionError):
        logarithmic(0.0, 1.0, 0.3, 1.0)
    assert logarithmic(0.0, math.log(1.5), 0.3, 1.5) == 1.0
    assert logarithmic(1.0, math.log(1.5), 0.3, 1.5) < 1.0
    assert 1.0 / (0.5 * 0.0 + 2.0) ** 2 == 0.25  # starts at 1 only if b is 1
    assert 1.0 / (0.5 * 0.0 + 1.0) ** 2 == 1.0
    with np.errstate(invalid="ignore"):
        assert np.isnan(1.0 / np.float64(0.5 * -3.0 + 1.0) ** 0.5)  # a concave place


def test_distances_to_knots_are_an_ill_conditioned_basis():
    x = np.linspace(0, 1, 400)
    conditions = []
    for segments in (5, 40):
        knots = np.linspace(0, 1, segments + 1)
        distances = np.abs(x[:, None] - knots)  # (3.29)
        hats = Basis(np.concatenate([[0.0], knots, [1.0]]), 1).matrix(x).toarray()
        conditions.append([np.linalg.cond(distances), np.linalg.cond(hats)])
    (first, first_hats), (last, last_hats) = conditions
    assert first > 30
    assert last > 1500
    assert max(first_hats, last_hats) < 2.5
    # (3.33) forms the normal equations, which square it.
    product = distances.T @ distances
    assert np.linalg.cond(product) == pytest.approx(last**2, rel=1e-3)


def test_the_smallest_step_is_never_reached():
    # (3.35) sets mu to s_min, which s reaches where a template is 0: nowhere.
    smallest, largest = 0.02, 0.2
    curvature = np.linspace(0, 50, 200)
    steps = (largest - smallest) * np.exp(-0.1 * curvature) + smallest
    assert steps[0] == pytest.approx(largest)
    assert (steps > smallest).all()
