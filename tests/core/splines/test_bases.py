from __future__ import annotations

import itertools
import math
from math import comb

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy.interpolate import BSpline

from palpate.core.splines.bases import (
    Basis,
    PeriodicBasis,
    averaged_knots,
    check_knots,
    clamped_basis,
    clamped_knots,
    evaluate_grid,
    evaluate_scattered,
    insert_knots,
    interpolate_grid,
    is_interpolable,
    periodic_knots,
    uniform_knots,
)

EVERYWHERE = np.concatenate([[0.0, 1.0, 1e-300, 1 - 1e-16], np.random.default_rng(0).random(200)])
SHAPES = [
    Basis(np.array([0, 0, 0, 0, 0.2, 0.35, 0.35, 0.7, 1, 1, 1, 1]), 3),
    Basis(np.array([0, 0, 0, 0, 0.5, 0.5, 0.5, 0.5, 1, 1, 1, 1]), 3),
    Basis(uniform_knots(9, 2), 2),
    Basis(np.array([-1, -0.5, 0.1, 0.4, 0.9, 2, 2.5]), 1),
    clamped_basis(12, 5),
    clamped_basis(5, 4),
]
NAMES = ["double", "broken", "uniform", "linear", "quintic", "bernstein"]


def within(basis):
    low, high = basis.domain
    inner = basis.knots[(basis.knots >= low) & (basis.knots <= high)]
    return np.concatenate([low + (high - low) * EVERYWHERE, inner])


def slow(basis, i, degree, x):
    """Cox's and de Boor's recursion, with 0/0 as 0 and the last piece closed."""
    knots, (_, high) = basis.knots, basis.domain
    if degree == 0:
        closed = x == high and knots[i] < high == knots[i + 1]
        return float(knots[i] <= x < knots[i + 1] or closed)
    total = 0.0
    if knots[i + degree] > knots[i]:
        share = (x - knots[i]) / (knots[i + degree] - knots[i])
        total += share * slow(basis, i, degree - 1, x)
    if knots[i + degree + 1] > knots[i + 1]:
        share = (knots[i + degree + 1] - x) / (knots[i + degree + 1] - knots[i + 1])
        total += share * slow(basis, i + 1, degree - 1, x)
    return total


@pytest.mark.parametrize("basis", SHAPES, ids=NAMES)
def test_the_functions_are_those_of_the_recursion_written_out(basis):
    x = within(basis)[::9]
    wanted = [[slow(basis, i, basis.degree, at) for i in range(basis.count)] for at in x]
    assert np.allclose(basis.matrix(x).toarray(), wanted, rtol=0, atol=1e-15)


@pytest.mark.parametrize("basis", SHAPES, ids=NAMES)
def test_values_and_all_derivatives_are_scipys(basis):
    x, theirs = within(basis), BSpline(basis.knots, np.eye(basis.count), basis.degree)
    for order in range(basis.degree + 1):
        wanted = theirs(x, nu=order)
        found = basis.matrix(x, order).toarray()
        assert np.allclose(found, wanted, rtol=1e-13, atol=1e-13 * np.abs(wanted).max())


@pytest.mark.parametrize("basis", SHAPES, ids=NAMES)
def test_the_functions_sum_to_one_everywhere_and_are_never_negative(basis):
    values = basis.matrix(within(basis)).toarray()
    assert np.allclose(values.sum(axis=1), 1.0, rtol=0, atol=1e-15)
    assert (values >= 0.0).all()


@pytest.mark.parametrize("basis", SHAPES, ids=NAMES)
def test_greville_abscissae_reproduce_the_identity(basis):
    x = within(basis)
    assert np.allclose(basis.matrix(x) @ basis.greville(), x, rtol=0, atol=2e-15)
    assert np.allclose(basis.matrix(x, 1) @ basis.greville(), 1.0, rtol=0, atol=1e-13)


@given(
    st.integers(1, 5),
    st.lists(st.floats(0.01, 0.99), max_size=8),
    st.floats(0.0, 1.0),
    st.sampled_from([2.0**-30, 2.0**30]),
)
@settings(derandomize=True, deadline=None, max_examples=50)
def test_any_knots_in_any_unit_give_a_partition_of_unity(
    degree: int, inner: list[float], at: float, scale: float
) -> None:
    ends = [0.0] * (degree + 1), [1.0] * (degree + 1)
    knots = np.array([*ends[0], *sorted(set(inner)), *ends[1]])
    here = Basis(knots, degree).matrix(np.array([at])).toarray()
    scaled = Basis(scale * knots, degree).matrix(np.array([scale * at])).toarray()
    assert here.sum() == pytest.approx(1.0, abs=1e-14)
    assert np.array_equal(scaled, here)


@given(st.integers(1, 5), st.integers(1, 6), st.floats(0.0, 1.0))
@settings(derandomize=True, deadline=None, max_examples=50)
def test_mirrored_knots_give_mirrored_functions(degree: int, more: int, at: float) -> None:
    knots = clamped_basis(degree + more, degree).knots ** 2
    mirrored = Basis(1.0 - knots[::-1], degree)
    here = Basis(knots, degree).matrix(np.array([at])).toarray()[0]
    there = mirrored.matrix(np.array([1.0 - at])).toarray()[0]
    assert np.allclose(there[::-1], here, rtol=0, atol=1e-12)


@pytest.mark.parametrize("order", [1, 2, 3])
def test_derivatives_are_difference_quotients_of_the_order_below(order):
    basis, step = clamped_basis(9, 4), 1e-6
    x = np.random.default_rng(1).uniform(0.01, 0.99, 50)
    ahead, back = basis.matrix(x + step, order - 1), basis.matrix(x - step, order - 1)
    quotient = (ahead - back).toarray() / (2 * step)
    size = np.abs(quotient).max()
    assert np.allclose(basis.matrix(x, order).toarray(), quotient, rtol=0, atol=1e-5 * size)


@pytest.mark.parametrize("degree", [1, 3, 6])
def test_the__is_bernsteins(degree):
    x = EVERYWHERE[:, None]
    i = np.arange(degree + 1)
    binomials = np.array([comb(degree, k) for k in i])
    wanted = binomials * x**i * (1.0 - x) ** (degree - i)
    found = clamped_basis(degree + 1, degree).matrix(EVERYWHERE).toarray()
    assert np.allclose(found, wanted, rtol=0, atol=1e-14)


def test_only_as_many_functions_as_the_degree_and_one_are_given_at_a_place():
    basis = clamped_basis(9, 3)
    local = basis.nonzero(np.array([0.0, 0.5, 1.0]), 1)
    assert local.first.tolist() == [0, 3, 5]
    assert local.values.shape == (2, 3, 4)
    assert local.columns()[1].tolist() == [3, 4, 5, 6]


@pytest.mark.parametrize(
    ("x", "words"),
    [
        (np.array([0.5, math.nan]), "x must be finite"),
        (np.array([[0.5]]), r"x must have shape \(any\)"),
        (
            np.array([-0.2, 0.5, 1.1]),
            "x must lie in the domain from 0 to 1, got 2 outside, .* -0.2",
        ),
    ],
)
def test_places_that_are_none_are_refused(x, words):
    with pytest.raises(ValueError, match=words):
        clamped_basis(5).matrix(x)


def test_a_negative_derivative_is_refused():
    with pytest.raises(ValueError, match="derivatives must be 0 or more, got -1"):
        clamped_basis(5).nonzero(np.array([0.5]), -1)
    with pytest.raises(ValueError, match="derivatives must be 0 or more, got -1"):
        PeriodicBasis(5).matrix(np.array([0.5]), -1)


def test_knots_that_are_none_are_refused():
    with pytest.raises(ValueError, match="knots must not fall"):
        Basis(np.array([0, 1, 0.5, 2.0]), 1)


@pytest.mark.parametrize(("count", "degree"), [(4, 3), (5, 3), (48, 3), (2, 1), (7, 5)])
def test_the_periodic_basis_sums_to_one_all_around(count, degree):
    turns = np.concatenate([EVERYWHERE, -EVERYWHERE, 5 * EVERYWHERE])
    basis = PeriodicBasis(count, degree).matrix(turns)
    assert basis.shape == (len(turns), count)
    assert (np.diff(basis.indptr) == degree + 1).all()
    assert np.allclose(basis.toarray().sum(axis=1), 1.0, rtol=0, atol=1e-14)


def test_a_whole_turn_changes_nothing():
    turns = np.array([-0.3, 0.0, -1e-17, 0.25, 0.999])
    here = PeriodicBasis(12).matrix(turns).toarray()
    assert np.allclose(PeriodicBasis(12).matrix(turns + 1.0).toarray(), here, atol=1e-14)


@pytest.mark.parametrize("order", [0, 1, 2])
def test_the_periodic_basis_has_no_seam(order):
    coefficients, step = np.random.default_rng(2).normal(size=11), 1e-9
    for knot in (0.0, 3 / 11):
        ends = PeriodicBasis(11).matrix(np.array([knot - step, knot + step]), order)
        jump = abs(np.diff(ends @ coefficients)[0])
        assert jump < 3 * step * 11 ** (order + 1) * 8 * np.abs(coefficients).max()


def test_shifting_the_coefficients_turns_the_curve():
    coefficients = np.random.default_rng(2).normal(size=9)
    turns, basis = np.linspace(0.0, 1.0, 40), PeriodicBasis(9)
    moved = basis.matrix(turns + 1 / 9) @ np.roll(coefficients, 1)
    assert np.allclose(moved, basis.matrix(turns) @ coefficients, atol=1e-13)


@pytest.mark.parametrize("degree", [2, 3])
def test_periodic_coefficients_stand_where_their_functions_are_symmetric(degree):
    basis = PeriodicBasis(8, degree)
    places = basis.greville()
    left, right = basis.matrix(places - 0.07), basis.matrix(places + 0.07)
    assert np.allclose(left.diagonal(), right.diagonal(), atol=1e-14)
    assert np.allclose(np.diff(places), 1 / 8, atol=1e-15)


def test_a_circle_of_too_few_coefficients_is_refused():
    with pytest.raises(ValueError, match="count must be larger than the degree 3, got 3"):
        PeriodicBasis(3)


def test_clamped_knots_are_even_between_repeated_ends():
    assert clamped_knots(6).tolist() == pytest.approx([0, 0, 0, 0, 1 / 3, 2 / 3, 1, 1, 1, 1])
    assert clamped_knots(4).tolist() == [0, 0, 0, 0, 1, 1, 1, 1]  # Bernstein polynomials


def test_uniform_knots_run_on_in_even_steps_beyond_the_domain():
    knots = uniform_knots(7, 3)
    assert len(knots) == 7 + 3 + 1
    assert np.allclose(np.diff(knots), 0.25, rtol=0, atol=1e-15)
    assert (knots[3], knots[7]) == (0.0, 1.0)


def test_periodic_knots_hold_one_turn_and_what_comes_again():
    knots = periodic_knots(5, 2)
    assert len(knots) == 5 + 2 * 2 + 1
    assert np.allclose(knots * 5, np.arange(-2, 8), rtol=0, atol=1e-15)


def test_averaged_knots_are_means_of_as_many_sites_as_the_degree():
    sites = np.array([0.0, 1.0, 3.0, 4.0, 8.0, 10.0])
    assert averaged_knots(sites, 3)[3:-3].tolist() == pytest.approx([0, 8 / 3, 5, 10])
    assert averaged_knots(sites, 5).tolist() == [0.0] * 6 + [10.0] * 6


def test_greville_abscissae_are_means_of_as_many_knots_as_the_degree():
    knots = np.array([0, 0, 0, 1, 4, 4, 4.0])
    assert Basis(knots, 2).greville().tolist() == [0.0, 0.5, 2.5, 4.0]


@given(st.integers(1, 6), st.lists(st.floats(0.0, 1.0), min_size=0, max_size=12))
@settings(derandomize=True, deadline=None, max_examples=50)
def test_greville_abscissae_never_fall_and_end_where_clamped_knots_do(
    degree: int, inner: list[float]
) -> None:
    knots = np.array([0.0] * (degree + 1) + sorted(set(inner)) + [1.0] * (degree + 1))
    if not knots[degree + 1] > 0.0 or not knots[-degree - 2] < 1.0:
        return  # an end would occur too often
    places = Basis(knots, degree).greville()
    assert len(places) == len(knots) - degree - 1
    assert (np.diff(places) >= 0.0).all()
    assert (places[0], places[-1]) == (0.0, 1.0)


def test_a_checked_knot_vector_is_a_copy_that_nobody_can_write():
    given_knots = clamped_knots(5)
    checked = check_knots(given_knots, 3)
    given_knots[4] = 7.0
    assert checked[4] == 0.5
    with pytest.raises(ValueError, match="read-only"):
        checked[0] = 1.0


@pytest.mark.parametrize(
    ("knots", "degree", "words"),
    [
        ([0, 1, 2, 3], 0, "degree must be at least 1, got 0"),
        ([0, 0, math.nan, 1, 1], 1, "knots must be finite"),
        ([[0, 0, 1, 1]], 1, r"knots must have shape \(any\)"),
        ([0, 0, 1, 1], 2, "knots must be at least 6 for degree 2, got 4"),
        ([0, 0, 2, 1, 3, 3], 1, "knots must not fall, got 1 after 2"),
        ([0, 0, 1, 1, 1, 2, 2], 1, "knots may repeat 2 times at degree 1, got 1 3 times"),
        ([0, 1, 1, 2], 1, "knots leave no domain: it begins and ends at 1"),
    ],
)
def test_what_is_no_knot_vector_is_refused(knots, degree, words):
    with pytest.raises(ValueError, match=words):
        check_knots(np.array(knots, float), degree)


@pytest.mark.parametrize("make", [clamped_knots, uniform_knots, periodic_knots])
def test_too_few_coefficients_are_refused(make):
    with pytest.raises(ValueError, match="count must be larger than the degree 3, got 3"):
        make(3, 3)
    with pytest.raises(ValueError, match="degree must be at least 1, got 0"):
        make(3, 0)


@pytest.mark.parametrize(
    ("sites", "words"),
    [
        ([0, 0.5, 1], "sites must be more than the degree 3, got 3"),
        ([0, 0.2, 0.2, 0.6, 1], "sites must increase"),
        ([0, 0.2, math.inf, 0.6, 1], "sites must be finite"),
    ],
)
def test_sites_that_allow_no_knots_are_refused(sites, words):
    with pytest.raises(ValueError, match=words):
        averaged_knots(np.array(sites))


def test_averages_of_no_sites_are_refused():
    with pytest.raises(ValueError, match="degree must be at least 1, got 0"):
        averaged_knots(np.arange(5.0), 0)


BASES = (clamped_basis(6), clamped_basis(3, 2), clamped_basis(5, 2))
RNG = np.random.default_rng(3)


def de_casteljau(control, at):
    """Points of a Bézier curve, surface or solid: Fung, 1999, (2.20), without its binomials."""
    points = np.broadcast_to(control, (len(at), *control.shape))
    for x in at.T:
        share = x.reshape(-1, *(1,) * (points.ndim - 2))
        for _ in range(points.shape[1] - 1):
            points = (1.0 - share[:, None]) * points[:, :-1] + share[:, None] * points[:, 1:]
        points = points[:, 0]
    return np.array(points)


def dense(bases, control, at, order):
    """Every function times every coefficient."""
    rows = [b.matrix(x, k).toarray() for b, x, k in zip(bases, at.T, order, strict=True)]
    letters = "abc"[: len(bases)]
    inputs = ",".join(f"n{letter}" for letter in letters)
    return np.asarray(np.einsum(f"{letters}x,{inputs}->nx", control, *rows))


@pytest.mark.parametrize("axes", [1, 2, 3])
def test_scattered_places_take_all_coefficients_that_reach_them(axes):
    bases = BASES[:axes]
    control = RNG.normal(size=(*(basis.count for basis in bases), 4))
    at = np.concatenate([RNG.random((30, axes)), np.zeros((1, axes)), np.ones((1, axes))])
    orders = list(itertools.product((0, 1, 2), repeat=axes))
    found = evaluate_scattered(bases, control, at, orders)
    for order, values in zip(orders, found, strict=True):
        wanted = dense(bases, control, at, order)
        assert np.allclose(values, wanted, rtol=0, atol=1e-12 * max(np.abs(wanted).max(), 1.0))


@pytest.mark.parametrize("order", [(0, 0, 0), (1, 0, 2), (0, 1, 0)])
def test_a_grid_is_evaluated_as_its_places_are(order):
    control = RNG.normal(size=(6, 3, 5, 3))
    axes = [RNG.random(4), RNG.random(2), np.array([0.0, 0.3, 1.0])]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    wanted = evaluate_scattered(BASES, control, grid.reshape(-1, 3), [order])[0].reshape(4, 2, 3, 3)
    assert np.allclose(evaluate_grid(BASES, control, axes, order), wanted, rtol=0, atol=1e-12)


def test_no_places_are_no_values():
    assert evaluate_scattered(
        BASES, np.zeros((6, 3, 5, 3)), np.zeros((0, 3)), [(0, 0, 0)]
    ).shape == (1, 0, 3)


@pytest.mark.parametrize("degrees", [(4,), (3, 2), (2, 3, 5)])
def test_bezier_solids_are_those_of_de_casteljau(degrees):
    control = RNG.normal(size=(*(degree + 1 for degree in degrees), 3))
    at = np.concatenate([RNG.random((40, len(degrees))), np.ones((1, len(degrees)))])
    bases = tuple(clamped_basis(degree + 1, degree) for degree in degrees)
    found = evaluate_scattered(bases, control, at, [(0,) * len(degrees)])[0]
    assert np.allclose(found, de_casteljau(control, at), rtol=0, atol=1e-14)


def test_places_outside_are_refused():
    with pytest.raises(ValueError, match="x must lie in the domain"):
        evaluate_scattered(BASES, np.zeros((6, 3, 5, 3)), np.array([[0.5, 1.5, 0.5]]), [(0, 0, 0)])
    with pytest.raises(ValueError, match="x must lie in the domain"):
        evaluate_grid(BASES[:1], np.zeros((6, 3)), [np.array([-0.5])])


def test_coefficients_and_places_that_do_not_fit_the_bases_are_refused():
    control = np.zeros((6, 3, 5, 3))
    words = r"control must have shape \(6, 3, 5, any\), got \(5, 3, 6, 3\)"
    with pytest.raises(ValueError, match=words):
        evaluate_scattered(BASES, control.swapaxes(0, 2), np.zeros((1, 3)), [(0, 0, 0)])
    with pytest.raises(ValueError, match=words):
        evaluate_grid(BASES, control.swapaxes(0, 2), [np.zeros(1)] * 3)
    with pytest.raises(ValueError, match=r"at must have shape \(any, 3\)"):
        evaluate_scattered(BASES, control, np.zeros((1, 2)), [(0, 0, 0)])


def test_coefficients_orders_and_axes_that_are_none_are_refused():
    control = np.zeros((6, 3, 5, 1))
    at, axes = np.full((1, 3), 0.5), [np.full(1, 0.5)] * 3
    for order in ((0, -1, 0), (0, 0)):
        with pytest.raises(ValueError, match="orders must be 0 or more for each of 3 axes, got"):
            evaluate_scattered(BASES, control, at, [(1, 1, 1), order])
        with pytest.raises(ValueError, match="orders must be 0 or more for each of 3 axes, got"):
            evaluate_grid(BASES, control, axes, order)
    with pytest.raises(ValueError, match="axes must be 3, one for each basis, got 2"):
        evaluate_grid(BASES, control, axes[:2])
    control[0, 0, 0, 0] = np.nan
    with pytest.raises(ValueError, match="control must be finite"):
        evaluate_scattered(BASES, control, at, [(0, 0, 0)])
    with pytest.raises(ValueError, match="control must be finite"):
        evaluate_grid(BASES, control, axes)


COLLOCATION_RNG = np.random.default_rng(5)


@pytest.mark.parametrize("axes", [1, 2, 3])
def test_curves_surfaces_and_solids_go_through_their_values(axes):
    sites = [np.sort(COLLOCATION_RNG.random(n)) for n in (7, 5, 6)[:axes]]
    bases = [Basis(averaged_knots(places, 3), 3) for places in sites]
    values = COLLOCATION_RNG.normal(size=(*(len(places) for places in sites), 2))
    found = interpolate_grid(bases, sites, values)
    assert np.allclose(evaluate_grid(bases, found.control, sites), values, rtol=0, atol=1e-10)
    assert found.condition >= 1.0


def test_a_polynomial_of_the_degree_is_found_again():
    basis = clamped_basis(9, 3)
    sites = basis.greville()
    found = interpolate_grid([basis], [sites], (sites**3 - sites)[:, None])
    x = np.linspace(0.0, 1.0, 50)
    assert np.allclose(basis.matrix(x) @ found.control, (x**3 - x)[:, None], rtol=0, atol=1e-14)


def test_the_condition_is_that_of_the_whole_system():
    bases = [clamped_basis(5), clamped_basis(6)]
    sites = [basis.greville() for basis in bases]
    whole = np.kron(*(b.matrix(x).toarray() for b, x in zip(bases, sites, strict=True)))
    found = interpolate_grid(bases, sites, np.zeros((5, 6, 1)))
    assert found.condition == pytest.approx(np.linalg.cond(whole))


@given(st.lists(st.floats(0.0, 1.0), min_size=6, max_size=6, unique=True))
@settings(derandomize=True, deadline=None, max_examples=50)
def test_what_counts_as_interpolable_is_what_has_a_solution(places: list[float]) -> None:
    basis, sites = clamped_basis(6), np.sort(places)
    if np.diff(sites).min() < 1e-3:
        return  # the system is regular, but only just
    regular = np.linalg.cond(basis.matrix(sites).toarray()) < 1e15
    assert is_interpolable(basis, sites) is bool(regular)


@pytest.mark.parametrize(
    "sites", [[0, 0.2, 0.4, 0.6, 1], [0, 0.2, 0.2, 0.4, 0.7, 1], [0, 0.1, 0.2, 0.25, 0.3, 0.32]]
)
def test_sites_that_determine_no_spline_are_refused(sites):
    assert not is_interpolable(clamped_basis(6), np.array(sites))
    with pytest.raises(ValueError, match="sites of axis 0 must be 6, increase, and lie"):
        interpolate_grid([clamped_basis(6)], [np.array(sites)], np.zeros((len(sites), 1)))


@pytest.mark.parametrize(
    ("values", "words"),
    [
        (np.zeros((5, 1)), r"values must have shape \(6, any\)"),
        (np.full((6, 1), math.nan), "values must be finite"),
    ],
)
def test_values_that_do_not_fit_are_refused(values, words):
    basis = clamped_basis(6)
    with pytest.raises(ValueError, match=words):
        interpolate_grid([basis], [basis.greville()], values)


def test_sites_outside_are_refused():
    with pytest.raises(ValueError, match="x must lie in the domain"):
        is_interpolable(clamped_basis(4), np.array([0.0, 0.3, 0.6, 1.2]))
    with pytest.raises(ValueError, match="sites must be finite"):
        is_interpolable(clamped_basis(4), np.array([0.0, 0.3, 0.6, math.inf]))


def test_axes_without_sites_are_refused():
    basis = clamped_basis(4)
    with pytest.raises(ValueError, match="sites must be given for 2 axes, got 1"):
        interpolate_grid([basis, basis], [basis.greville()], np.zeros((4, 1)))


@given(st.integers(1, 5), st.lists(st.floats(0.001, 0.999), max_size=6), st.booleans())
@settings(derandomize=True, deadline=None, max_examples=50)
def test_inserting_knots_changes_no_point(degree: int, new: list[float], clamped: bool) -> None:
    basis = clamped_basis(degree + 4, degree)
    if not clamped:
        basis = Basis(uniform_knots(degree + 4, degree), degree)
    control = np.random.default_rng(degree).normal(size=(basis.count, 2))
    finer, moved = insert_knots(basis, control, np.unique(new))
    x = np.linspace(0.0, 1.0, 40)
    assert finer.count == basis.count + len(np.unique(new))
    assert np.allclose(finer.matrix(x) @ moved, basis.matrix(x) @ control, rtol=0, atol=1e-13)


def test_any_axis_can_be_refined():
    bases = [clamped_basis(5), clamped_basis(4)]
    control = np.random.default_rng(0).normal(size=(5, 4, 3))
    finer, moved = insert_knots(bases[1], control, np.array([0.5, 0.5, 0.5]), axis=1)
    axes = [np.linspace(0, 1, 7), np.linspace(0, 1, 9)]
    assert moved.shape == (5, 7, 3)
    found = evaluate_grid([bases[0], finer], moved, axes)
    assert np.allclose(found, evaluate_grid(bases, control, axes), rtol=0, atol=1e-14)


def test_a_knot_as_often_as_the_degree_makes_a_control_point_a_point():
    basis, control = clamped_basis(6), np.random.default_rng(1).normal(size=(6, 2))
    finer, moved = insert_knots(basis, control, np.full(3, 0.4))
    assert np.allclose(finer.matrix(np.array([0.4])) @ moved, moved[4], rtol=0, atol=1e-15)


@pytest.mark.parametrize(
    ("new", "words"),
    [
        ([1.5], "x must lie in the domain"),
        ([np.nan], "new must be finite"),
        ([0.5] * 5, "knots may repeat 4 times at degree 3"),
        ([1.0], "knots may repeat 4 times at degree 3"),
    ],
)
def test_knots_that_cannot_be_inserted_are_refused(new, words):
    with pytest.raises(ValueError, match=words):
        insert_knots(clamped_basis(6), np.zeros((6, 1)), np.array(new))


def test_coefficients_of_another_basis_are_refused():
    with pytest.raises(ValueError, match="control must have 6 coefficients, got 5"):
        insert_knots(clamped_basis(6), np.zeros((5, 1)), np.array([0.5]))


def test_coefficients_that_are_not_finite_are_refused():
    with pytest.raises(ValueError, match="control must be finite"):
        insert_knots(clamped_basis(6), np.full((6, 1), np.nan), np.array([0.5]))
