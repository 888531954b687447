import math

import numpy as np
import pytest

from palpate.core.least_squares import levenberg_marquardt
from palpate.core.shapes.boolean_solids import conjunction, conjunction_slopes
from palpate.core.shapes.hyperquadrics import Hyperquadric

X = np.linspace(0.0, 2.0, 9)
TRUE = np.array([1.5, 0.7])


def model(parameters, scales):
    """Residuals (9,) and Jacobian (9, 2) of a decay, its parameters given in other units."""
    a, b = parameters * scales
    fading = np.exp(-b * X)
    residuals = a * fading - TRUE[0] * np.exp(-TRUE[1] * X)
    return residuals, np.column_stack([fading, -a * X * fading]) * scales


def test_the_jacobian_has_a_row_for_each_residual():
    start = np.array([1.0, 0.2])
    residuals, jacobian = model(start, np.ones(2))
    gradient = 2.0 * jacobian.T @ residuals
    step = 1e-6
    for axis in range(2):
        ahead, back = (start + sign * step * np.eye(2)[axis] for sign in (1, -1))
        change = sum(model(ahead, np.ones(2))[0] ** 2) - sum(model(back, np.ones(2))[0] ** 2)
        assert gradient[axis] == pytest.approx(change / (2 * step), rel=1e-6)
    # (2.11) ends its first column with f_n and its last with f_m: n rows do not fit m residuals.
    with pytest.raises(ValueError, match="mismatch"):
        jacobian[:2].T @ residuals


def test_a_step_comes_from_all_residuals_and_not_from_one():
    start = np.array([1.0, 0.2])
    residuals, jacobian = model(start, np.ones(2))
    curve = jacobian.T @ jacobian
    right = start - np.linalg.solve(curve, jacobian.T @ residuals)
    one = start - np.linalg.solve(curve, (jacobian * residuals[0]).sum(axis=0))  # (2.16) with f_i
    before, after, printed = (
        np.linalg.norm(model(at, np.ones(2))[0]) for at in (start, right, one)
    )
    assert after < 0.5 * before
    assert printed > before


def test_damping_all_columns_alike_depends_on_their_units():
    start = np.array([1.0, 0.2])
    steps = []
    for scales in (np.ones(2), np.array([1.0, 2.0**-10])):
        residuals, jacobian = model(start / scales, scales)
        damped = jacobian.T @ jacobian + 0.1 * np.eye(2)
        steps.append(-scales * np.linalg.solve(damped, jacobian.T @ residuals))
    assert np.abs(steps[0] - steps[1]).max() > 0.1
    ends = []
    for scales in (np.ones(2), np.array([1.0, 2.0**-10])):

        def problem(at, which, scales=scales):
            found = [model(one, scales) for one in at]
            return np.array([r for r, _ in found]), np.array([j for _, j in found])

        bounds = np.full(2, -np.inf), np.full(2, np.inf)
        ends.append(levenberg_marquardt(problem, start[None] / scales, *bounds))
    assert ends[0].steps[0] == ends[1].steps[0]
    assert np.allclose(ends[0].parameters, ends[1].parameters * [1.0, 2.0**-10], rtol=1e-12)
    assert np.allclose(ends[0].parameters, TRUE, rtol=1e-8)


def box_terms(exponents):
    planes = np.column_stack([np.eye(3), np.zeros(3)])
    return Hyperquadric(planes, exponents)


def test_the_strip_of_a_term_lies_between_one_and_minus_one():
    # The text closes each strip of (2.29) with "H = 1 and H".
    flat = box_terms(np.full(3, 40.0)).bounds()
    assert np.allclose(flat, [[-1, -1, -1], [1, 1, 1]], atol=1e-2)


def test_terms_that_do_not_span_space_leave_it_unbounded():
    planes = np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [1.0, 1.0, 0.0, 0.0]])
    far = np.array([0.0, 0.0, 1e9, 1.0])
    assert (np.abs(planes @ far) ** 2).sum() == 0.0  # inside, by (2.28)
    with pytest.raises(ValueError, match="unbounded"):
        Hyperquadric(planes, np.full(3, 2.0))


def test_three_terms_are_a_superquadric_only_if_its_exponents_are_equal():
    points = np.random.default_rng(0).uniform(0.2, 1.0, (100, 3))

    def superquadric(e1, e2):
        level = points[:, 0] ** (2 / e2) + points[:, 1] ** (2 / e2)
        return np.asarray(level ** (e2 / e1) + points[:, 2] ** (2 / e1))

    def terms(e1, e2):
        return np.asarray((points ** np.array([2 / e2, 2 / e2, 2 / e1])).sum(axis=1))

    assert np.allclose(superquadric(0.5, 0.5), terms(0.5, 0.5), rtol=1e-14)
    assert np.abs(superquadric(0.5, 1.0) - terms(0.5, 1.0)).max() > 0.5


def test_an_exponent_of_one_is_convex_and_one_below_it_has_an_infinite_slope():
    rng = np.random.default_rng(0)
    first, second = rng.uniform(-1, 1, (2, 2000, 3))
    values = {g: [(np.abs(p) ** g).sum(axis=1) for p in (first, second, 0.5 * (first + second))]
              for g in (1.0, 0.8)}  # fmt: skip
    for exponent, convex in ((1.0, True), (0.8, False)):
        a, b, middle = values[exponent]
        assert bool((middle <= 0.5 * (a + b) + 1e-15).all()) == convex
    slopes = 0.8 * np.array([1e-3, 1e-9, 1e-15]) ** -0.2
    assert slopes[-1] > 100.0 * slopes[0]
    octahedron = box_terms(np.ones(3))
    value, slope = octahedron.inside_out(np.zeros((1, 3)), np.array([[1.0, 0.0, 0.0]]))
    assert np.isfinite([*value, *slope]).all()


def test_the_intersection_is_of_both_functions():
    # (2.35) and (2.37) print "f2 and f2" on the left.
    assert conjunction(0.3, 0.5) == pytest.approx(0.8 - math.hypot(0.3, 0.5))
    assert conjunction(0.5, 0.5) != pytest.approx(0.8 - math.hypot(0.3, 0.5))


def test_an_omega_that_knows_the_sign_breaks_de_morgan():
    # What the misprinted condition of (2.33), omega(-f1, f2) = omega(f1, f2), is there for.
    def omega(f1, f2):
        return 0.5 if f1 * f2 > 0 else -0.5

    def union(f1, f2, w):
        return (f1 + f2 + math.sqrt(f1 * f1 + f2 * f2 - 2 * w * f1 * f2)) / (1 + w)

    taken = union(0.3, -0.5, omega(0.3, -0.5))
    assert union(0.3, -0.5, omega(-0.3, -0.5)) != pytest.approx(taken)


def test_the_printed_intersection_cancels():
    printed = 1e8 + 1e-8 - math.sqrt(1e16 + 1e-16)
    assert printed == pytest.approx(1.49e-8, rel=1e-2)
    assert conjunction(1e8, 1e-8) == pytest.approx(1e-8, rel=1e-15)


def test_the_printed_intersection_is_wrong_as_omega_nears_minus_one():
    w = -1.0 + 1e-12
    printed = (0.8 - math.sqrt(0.09 + 0.25 - 2 * w * 0.15)) / (1 + w)
    assert printed == pytest.approx(0.1876, abs=2e-4)
    assert abs(printed - 0.1875) > 1e-5
    assert conjunction(0.3, 0.5, w) == pytest.approx(0.1875, rel=1e-11)


def test_the_printed_intersection_overflows():
    with np.errstate(over="ignore", invalid="ignore"):
        big = np.float64(1e200)
        assert not np.isfinite(big + big - np.sqrt(big**2 + big**2))
    assert conjunction(1e200, 1e200) == pytest.approx((2 - math.sqrt(2)) * 1e200)


def test_the_printed_slopes_are_nothing_over_nothing_where_both_vanish():
    with np.errstate(invalid="ignore"):
        assert np.isnan(1.0 - np.float64(0.0) / np.float64(0.0))
    assert conjunction_slopes(0.0, 0.0) == (1.0, 1.0)


def test_a_polynomial_in_space_has_more_coefficients():
    for degree in (1, 2, 4):
        terms = sum(
            a + b + c <= degree
            for a in range(degree + 1)
            for b in range(degree + 1)
            for c in range(degree + 1)
        )
        assert terms == math.comb(degree + 3, 3) > degree + 1
