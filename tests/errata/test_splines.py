"""Errata on splines, lattices and the inversion of points: chapters 1 to 5."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.interpolate import BSpline

from palpate.core.arrays import Floats
from palpate.core.splines import (
    Basis,
    Parallelepiped,
    SplineVolume,
    averaged_knots,
    box_lattice,
    clamped_basis,
    coons_patch,
    invert_points,
    upright_parallelepiped,
)
from palpate.core.splines.inversion import invert_general

RNG = np.random.default_rng(0)
PLACES = np.array([0.1, 0.3, 0.5, 0.9])
KNOTS = np.array([0, 0, 0, 0, 0.2, 0.35, 0.7, 1, 1, 1, 1])
ORDER, COUNTS = 4, (5, 5, 6)
UNDEFORMED = box_lattice(np.full(3, -1.0), np.full(3, 2.0), COUNTS).volume
NOISE = 0.1 * np.random.default_rng(0).normal(size=UNDEFORMED.control.shape)
DEFORMED = SplineVolume(UNDEFORMED.control + NOISE, UNDEFORMED.bases)


def test_the_printed_patch_has_a_corner_twice_and_no_boundary_curves():
    corners = np.random.default_rng(3).normal(size=(2, 2, 3))  # C(u, v) by u, then by v
    u, v = np.meshgrid(np.linspace(0, 1, 9), np.linspace(0, 1, 7))
    weights = np.stack([(1 - u) * (1 - v), (1 - u) * v, u * (1 - v), u * v])
    named = [[(0, 0), (0, 1), third, (1, 1)] for third in ((0, 1), (1, 0))]
    printed, right = (
        np.tensordot(weights, np.array([corners[one] for one in names]), (0, 0)) for names in named
    )
    assert printed[0, -1] == pytest.approx(corners[0, 1])  # where u is 1 and v is 0
    assert np.linalg.norm(printed[0, -1] - corners[1, 0]) > 1.0
    # Mended, it is still a bilinear surface: it leaves any boundary that is not straight.
    low = right[0] + np.sin(np.pi * u[0])[:, None] * [0.0, 0.0, 1.0]
    patch = coons_patch(low, right[-1], right[:, 0], right[:, -1])
    assert np.abs(right[0] - low).max() == pytest.approx(1.0)
    assert np.abs(patch[0] - low).max() < 1e-15 and np.abs(patch[-1] - right[-1]).max() < 1e-15


def half_open(i: int, order: int, t: float, x: Floats) -> float:
    """The recursion of section 2.4.2 as printed, 0 / 0 being 0."""
    if order == 1:
        return float(x[i] <= t < x[i + 1])
    total = 0.0
    if x[i + order - 1] > x[i]:
        total += (t - x[i]) * half_open(i, order - 1, t, x) / (x[i + order - 1] - x[i])
    if x[i + order] > x[i + 1]:
        total += (x[i + order] - t) * half_open(i + 1, order - 1, t, x) / (x[i + order] - x[i + 1])
    return total


def printed_sum(t: float, knots: Floats) -> float:
    return sum(half_open(i, 4, t, knots) for i in range(7))


def test_unclamped_knots_carry_a_basis_only_between_their_inner_ones():
    # Figure 2.7 (b): 11 even knots from 0 to 1 and 7 functions.
    knots = np.linspace(0, 1, 11)
    assert [printed_sum(t, knots) for t in (0.1, 0.5)] == pytest.approx([1 / 6, 1.0])
    assert Basis(knots, 3).domain == pytest.approx((0.3, 0.7))
    with pytest.raises(ValueError, match="must lie in the domain"):
        Basis(knots, 3).matrix(np.array([0.1]))
    assert BSpline(knots, np.ones(7), 3)(0.5) == pytest.approx(1.0)


def knot(i: int) -> float:
    """The knot x_i, counted from 1."""
    return float(KNOTS[i - 1]) if 1 <= i <= len(KNOTS) else math.nan


def share(value: float, span: float) -> float:
    return value / span if span != 0.0 else 0.0


def function(i: int, order: int, u: float) -> float:
    """N_{i, order} at u, counted from 1; 0 beyond the ends."""
    if not 1 <= i <= len(KNOTS) - order:
        return 0.0
    if order == 1:
        return float(knot(i) <= u < knot(i + 1))
    return float(BSpline(KNOTS, np.eye(len(KNOTS) - order)[i - 1], order - 1)(u))


def derivative(times: int, i: int, u: float, printed: bool) -> float:
    """(3.25), as printed or with the right indices."""
    k, c, (a, b) = ORDER, {(1, 1): 1.0}, (2, 1) if printed else (0, -1)
    first = (2, 1) if printed else (1, 0)
    for p in range(2, times + 2):
        c[p, 1] = share(c[p - 1, 1], knot(i + k - p + first[0]) - knot(i + first[1]))
        for j in range(2, p):
            span = knot(i + k + j - p + a) - knot(i + j + b)
            c[p, j] = share(c[p - 1, j] - c[p - 1, j - 1], span)
        c[p, p] = share(-c[p - 1, p - 1], knot(i + k) - knot(i + p - 1))
    terms = [c[times + 1, j] * function(i + j - 1, k - times, u) for j in range(1, times + 2)]
    return math.factorial(k - 1) / math.factorial(k - times - 1) * sum(terms)


def ours(times: int) -> Floats:
    return np.asarray(Basis(KNOTS, ORDER - 1).matrix(PLACES, times).toarray())


@pytest.mark.filterwarnings("ignore:invalid value")
def test_the_coefficients_of_a_derivative_have_other_indices():
    for times, wrong_by in ((1, 1.0), (2, 50.0), (3, 500.0)):
        errors = [
            np.nanmax(
                np.abs(
                    [[derivative(times, i, u, printed) for i in range(1, 8)] for u in PLACES]
                    - ours(times)
                )
            )
            for printed in (True, False)
        ]
        assert errors[0] > wrong_by and errors[1] < 1e-12 * 10**times


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
    assert errors[0] == pytest.approx(2.42, abs=0.01) and errors[1] < 1e-14


def test_the_second_recursion_divides_by_zero_at_the_highest_derivative():
    times = ORDER - 1  # which the text allows
    with pytest.raises(ZeroDivisionError):
        (ORDER - 1) / (ORDER - times - 1)
    wanted = BSpline(KNOTS, np.eye(7), 3).derivative(3)(PLACES)
    assert np.allclose(ours(3), wanted, rtol=1e-12, atol=1e-10)


def test_the_sum_of_the_single_index_has_as_many_terms_as_control_points():
    shares = UNDEFORMED.shares(RNG.random((20, 3))).toarray()
    assert shares.shape[1] == np.prod(COUNTS)  # M of (4.3); its second sum stops at N
    assert np.allclose(shares.sum(axis=1), 1.0, atol=1e-14)
    assert np.abs(shares[:, : COUNTS[2]].sum(axis=1) - 1.0).max() > 0.9


def test_the_matrix_of_newtons_method_holds_products_of_slopes():
    target, at = np.array([0.1, 0.2, -0.1]), np.array([0.4, 0.55, 0.6])

    def gradient(parameters: Floats) -> Floats:
        place, slopes = DEFORMED.first(parameters[None])
        return np.asarray(slopes[0].T @ (place[0] - target))

    place, slopes, bends = DEFORMED.second(at[None])
    off = place[0] - target
    right = slopes[0].T @ slopes[0] + np.einsum("i,ijk->jk", off, bends[0])
    for axis, step in enumerate(1e-5 * np.eye(3)):
        change = (gradient(at + step) - gradient(at - step)) / 2e-5
        assert np.allclose(right[:, axis], change, rtol=1e-6, atol=1e-6)
    # Of the product in the second row, (4.9) prints one factor: a vector beside numbers.
    assert (slopes[0][:, 1] + off @ bends[0][:, 1, 0]).shape == (3,) != right[1, 0].shape


def test_the_equations_of_right_angles_square_the_condition_and_have_false_roots():
    flat = SplineVolume(UNDEFORMED.control * [1.0, 1.0, 1e-6], UNDEFORMED.bases)
    slopes = flat.first(np.full((1, 3), 0.4))[1][0]
    assert np.linalg.cond(slopes.T @ slopes) > 1e5 * np.linalg.cond(slopes)
    # Outside, the nearest face point is at right angles, but no answer.
    outside = invert_points(UNDEFORMED, np.array([[0.3, 0.2, 1.5]]))
    assert not outside.converged[0] and outside.residual[0] == pytest.approx(0.5)


def test_the_cosine_is_nothing_over_nothing_where_the_point_is_met():
    slope, off = np.array([1.0, 0.0, 0.0]), np.zeros(3)
    with np.errstate(invalid="ignore"):
        assert np.isnan(abs(slope @ off) / (np.linalg.norm(slope) * np.linalg.norm(off)))
    found = invert_points(UNDEFORMED, UNDEFORMED.at(np.full((1, 3), 0.3)))
    assert found.converged[0] and found.steps[0] == 0


def test_tolerances_in_metres_depend_on_the_unit():
    # (4.14) and (4.16) with the program's 1e-6, at a lattice of a nanometre and of a gigametre.
    points, steps = DEFORMED.at(np.random.default_rng(1).uniform(0.1, 0.9, (30, 3))), []
    for scale in (2.0**-30, 1.0, 2.0**30):
        scaled = SplineVolume(scale * DEFORMED.control, DEFORMED.bases)
        found = invert_general(scaled, scale * points)
        off = np.linalg.norm(scaled.at(np.full((1, 3), 0.5)) - scale * points, axis=1)
        assert (off <= 1e-6).all() == (scale < 1e-6)  # passes at once if all is that small
        assert found.converged.all()
        steps.append(found.steps)
    assert np.array_equal(steps[0], steps[1]) and np.array_equal(steps[1], steps[2])


def test_points_that_are_all_equal_have_no_centripetal_parameters():
    with np.errstate(invalid="ignore"):
        assert np.isnan(np.sqrt(np.zeros(5)) / np.sqrt(np.zeros(5)).sum()).all()  # a pole's row


def test_inner_knots_average_as_many_parameters_as_the_degree():
    count, sites = 9, np.linspace(0, 1, 9)

    def knots(first: int | None) -> Floats:
        inner = [
            sum(sites[at + i - 1] for i in range(first or at, ORDER)) / (ORDER - 1)
            for at in range(1, count - ORDER + 1)
        ]
        return np.array([0.0] * ORDER + inner + [1.0] * ORDER)

    printed = knots(None)  # the sum of (4.19) begins at i = l
    assert printed[4:9] == pytest.approx([0.25, 0.2917, 0.2083, 0.0, 0.0], abs=1e-4)
    assert (np.sort(printed)[:6] == 0.0).all()  # six equal knots of order 4
    assert np.allclose(averaged_knots(sites), knots(1))
    system = Basis(averaged_knots(sites), 3).matrix(sites).toarray()
    assert np.linalg.cond(system) == pytest.approx(4.1, abs=0.1)


def test_no_spline_is_needed_for_what_is_known_in_closed_form():
    points, basis = RNG.uniform(-1, 1, (1000, 3)), clamped_basis(15)
    found = invert_points(UNDEFORMED, points)
    assert found.residual.max() < 1e-15
    assert np.allclose(found.parameters, 0.5 * (points + 1.0), rtol=0, atol=1e-15)
    # Section 4.3 interpolates such parameters over a grid, and clips what overshoots.
    corner = np.interp(
        basis.greville(), np.linspace(0, 1, 15), np.clip(np.linspace(-2, 2, 15), 0, 1)
    )
    values = np.linalg.solve(basis.matrix(basis.greville()).toarray(), corner)
    assert (basis.matrix(np.linspace(0, 1, 400)) @ values).max() > 1.001


INSIDE = RNG.uniform(-1, 1, (2000, 3)) * [3, 2, 1] + 5.0
HALF = np.array([3.0, 2.0, 1.0])
PRINTED, RIGHT = (
    upright_parallelepiped(5.0 - k * HALF, 2.0 * HALF).local(INSIDE) for k in (2, 1)
)  # step 2 of section 5.4
EDGES, ALONG = np.diag([4.0, 2.0, 1.0]), np.array([[2.0, 0.0, 0.0]])
BERNSTEIN = clamped_basis(6, 5).matrix(np.linspace(0, 1, 7)).toarray()
CLAMPED = clamped_basis(7)
TURNED = np.array([-1.0, 1.0])
MARGIN = upright_parallelepiped(np.full(3, -1.2), np.full(3, 2.4))
FIGURES = {
    # computed, stated, and the largest difference
    "test_lattice_coordinates_are_in_edges_not_in_unit_vectors": [
        (ALONG[0] @ EDGES[0] / np.linalg.norm(EDGES[0]), 2.0, 0.0),
        (Parallelepiped(np.zeros(3), EDGES).local(ALONG)[0, 0], 0.5, 0.0),
    ],
    "test_a_bernstein_curve_of_degree_n_has_one_vertex_more": [
        (clamped_basis(6, 5).count, 6, 0.0),
        (BERNSTEIN.sum(axis=1), np.ones(7), 1e-15),
        (BERNSTEIN[-1, :5].sum(), 0.0, 0.0),  # the first n at the end
    ],
    "test_the_recursion_leaves_nothing_at_the_last_knot": [
        ([printed_sum(t, CLAMPED.knots) for t in (0.4, 1.0)], [1.0, 0.0], 1e-15),
        (CLAMPED.matrix(np.array([1.0])).sum(), 1.0, 0.0),
    ],
    "test_the_printed_knots_do_not_end_at_one": [
        # (2.21) for n + 1 = 7 vertices and order k = 4, over n - k + 2 = 4
        (np.array([0, 0, 0, 0, 1, 2, 3, 4, 4, 4, 4]) / 4, CLAMPED.knots, 1e-15)
    ],
    "test_inner_slicing_planes_are_not_those_that_include_the_ends": [
        # step 4a has count + 1 intervals; the program has planes at both ends
        (np.abs(np.linspace(-1, 1, 29)[1:-1] - np.linspace(-1, 1, 27)).max(), 2 / 28, 1e-15)
    ],
    "test_a_lattice_about_a_centroid_begins_half_its_size_before_it": [
        ((PRINTED > 1.0).any(axis=1).mean() > 0.8, True, 0.0),
        (((RIGHT >= 0.0) & (RIGHT <= 1.0)).all(), True, 0.0),
    ],
    "test_points_are_scaled_by_the_lattice_and_not_by_the_shape": [
        # (5.1) divides by the size of the shape; a lattice with a margin is larger
        ((2.0 / 2.0 * (TURNED + 1.2) - 1.0).max(), 1.2, 1e-12),
        (2.0 * MARGIN.local(np.tile(TURNED[:, None], 3))[:, 0] - 1.0, TURNED / 1.2, 1e-12),
    ],
}


@pytest.mark.parametrize("name", FIGURES)
def test_figures(name):
    for computed, stated, tolerance in FIGURES[name]:
        assert computed == pytest.approx(stated, abs=tolerance, rel=0.0)
