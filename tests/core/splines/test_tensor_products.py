from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from palpate.core.arrays import Floats
from palpate.core.splines.bases import (
    Basis,
    averaged_knots,
    bernstein_basis,
    clamped_basis,
    uniform_knots,
)
from palpate.core.splines.tensor_products import (
    BLOCK,
    evaluate_grid,
    evaluate_scattered,
    insert_knots,
    interpolate_grid,
    is_interpolable,
)

BASES = (clamped_basis(6), bernstein_basis(2), clamped_basis(5, 2))
RNG = np.random.default_rng(3)


def de_casteljau(control: Floats, at: Floats) -> Floats:
    """Points of a Bézier curve, surface or solid: Fung, 1999, (2.20), without its binomials."""
    points = np.broadcast_to(control, (len(at), *control.shape))
    for x in at.T:
        share = x.reshape(-1, *(1,) * (points.ndim - 2))
        for _ in range(points.shape[1] - 1):
            points = (1.0 - share[:, None]) * points[:, :-1] + share[:, None] * points[:, 1:]
        points = points[:, 0]
    return np.array(points)


def dense(bases: tuple[Basis, ...], control: Floats, at: Floats, order: tuple[int, ...]) -> Floats:
    """Every function times every coefficient."""
    rows = [b.matrix(x, k).toarray() for b, x, k in zip(bases, at.T, order, strict=True)]
    letters = "abc"[: len(bases)]
    inputs = ",".join(f"n{letter}" for letter in letters)
    return np.asarray(np.einsum(f"{letters}x,{inputs}->nx", control, *rows))


@pytest.mark.parametrize("axes", [1, 2, 3])
def test_scattered_places_take_all_coefficients_that_reach_them(axes: int) -> None:
    bases = BASES[:axes]
    control = RNG.normal(size=(*(basis.count for basis in bases), 4))
    at = np.concatenate([RNG.random((30, axes)), np.zeros((1, axes)), np.ones((1, axes))])
    orders = list(itertools.product((0, 1, 2), repeat=axes))
    found = evaluate_scattered(bases, control, at, orders)
    for order, values in zip(orders, found, strict=True):
        wanted = dense(bases, control, at, order)
        assert np.allclose(values, wanted, rtol=0, atol=1e-12 * max(np.abs(wanted).max(), 1.0))


@pytest.mark.parametrize("order", [(0, 0, 0), (1, 0, 2), (0, 1, 0)])
def test_a_grid_is_evaluated_as_its_places_are(order: tuple[int, ...]) -> None:
    control = RNG.normal(size=(6, 3, 5, 3))
    axes = [RNG.random(4), RNG.random(2), np.array([0.0, 0.3, 1.0])]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    wanted = evaluate_scattered(BASES, control, grid.reshape(-1, 3), [order])[0].reshape(4, 2, 3, 3)
    assert np.allclose(evaluate_grid(BASES, control, axes, order), wanted, rtol=0, atol=1e-12)


def test_many_places_are_taken_in_blocks_and_keep_their_order() -> None:
    control = RNG.normal(size=(6, 1))
    at = RNG.random((BLOCK // 4 + 3, 1))
    found = evaluate_scattered(BASES[:1], control, at, [(0,)])[0]
    assert np.allclose(found[-5:], BASES[0].matrix(at[-5:, 0]) @ control, rtol=0, atol=1e-14)
    assert np.allclose(found[:5], BASES[0].matrix(at[:5, 0]) @ control, rtol=0, atol=1e-14)


def test_no_places_are_no_values() -> None:
    assert evaluate_scattered(
        BASES, np.zeros((6, 3, 5, 3)), np.zeros((0, 3)), [(0, 0, 0)]
    ).shape == (1, 0, 3)


@pytest.mark.parametrize("degrees", [(4,), (3, 2), (2, 3, 5)])
def test_bezier_solids_are_those_of_de_casteljau(degrees: tuple[int, ...]) -> None:
    control = RNG.normal(size=(*(degree + 1 for degree in degrees), 3))
    at = np.concatenate([RNG.random((40, len(degrees))), np.ones((1, len(degrees)))])
    bases = tuple(bernstein_basis(degree) for degree in degrees)
    found = evaluate_scattered(bases, control, at, [(0,) * len(degrees)])[0]
    assert np.allclose(found, de_casteljau(control, at), rtol=0, atol=1e-14)


def test_places_outside_are_refused() -> None:
    with pytest.raises(ValueError, match="x must lie in the domain"):
        evaluate_scattered(BASES, np.zeros((6, 3, 5, 3)), np.array([[0.5, 1.5, 0.5]]), [(0, 0, 0)])
    with pytest.raises(ValueError, match="x must lie in the domain"):
        evaluate_grid(BASES[:1], np.zeros((6, 3)), [np.array([-0.5])])


def test_coefficients_and_places_that_do_not_fit_the_bases_are_refused() -> None:
    control = np.zeros((6, 3, 5, 3))
    words = r"control must have shape \(6, 3, 5, any\), got \(5, 3, 6, 3\)"
    with pytest.raises(ValueError, match=words):
        evaluate_scattered(BASES, control.swapaxes(0, 2), np.zeros((1, 3)), [(0, 0, 0)])
    with pytest.raises(ValueError, match=words):
        evaluate_grid(BASES, control.swapaxes(0, 2), [np.zeros(1)] * 3)
    with pytest.raises(ValueError, match=r"at must have shape \(any, 3\)"):
        evaluate_scattered(BASES, control, np.zeros((1, 2)), [(0, 0, 0)])


def test_coefficients_orders_and_axes_that_are_none_are_refused() -> None:
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
def test_curves_surfaces_and_solids_go_through_their_values(axes: int) -> None:
    sites = [np.sort(COLLOCATION_RNG.random(n)) for n in (7, 5, 6)[:axes]]
    bases = [Basis(averaged_knots(places, 3), 3) for places in sites]
    values = COLLOCATION_RNG.normal(size=(*(len(places) for places in sites), 2))
    found = interpolate_grid(bases, sites, values)
    assert np.allclose(evaluate_grid(bases, found.control, sites), values, rtol=0, atol=1e-10)
    assert found.condition >= 1.0


def test_a_polynomial_of_the_degree_is_found_again() -> None:
    basis = clamped_basis(9, 3)
    sites = basis.greville()
    found = interpolate_grid([basis], [sites], (sites**3 - sites)[:, None])
    x = np.linspace(0.0, 1.0, 50)
    assert np.allclose(basis.matrix(x) @ found.control, (x**3 - x)[:, None], rtol=0, atol=1e-14)


def test_the_condition_is_that_of_the_whole_system() -> None:
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
def test_sites_that_determine_no_spline_are_refused(sites: list[float]) -> None:
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
def test_values_that_do_not_fit_are_refused(values: Floats, words: str) -> None:
    basis = clamped_basis(6)
    with pytest.raises(ValueError, match=words):
        interpolate_grid([basis], [basis.greville()], values)


def test_sites_outside_are_refused() -> None:
    with pytest.raises(ValueError, match="x must lie in the domain"):
        is_interpolable(clamped_basis(4), np.array([0.0, 0.3, 0.6, 1.2]))
    with pytest.raises(ValueError, match="sites must be finite"):
        is_interpolable(clamped_basis(4), np.array([0.0, 0.3, 0.6, math.inf]))


def test_axes_without_sites_are_refused() -> None:
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


def test_any_axis_can_be_refined() -> None:
    bases = [clamped_basis(5), clamped_basis(4)]
    control = np.random.default_rng(0).normal(size=(5, 4, 3))
    finer, moved = insert_knots(bases[1], control, np.array([0.5, 0.5, 0.5]), axis=1)
    axes = [np.linspace(0, 1, 7), np.linspace(0, 1, 9)]
    assert moved.shape == (5, 7, 3)
    found = evaluate_grid([bases[0], finer], moved, axes)
    assert np.allclose(found, evaluate_grid(bases, control, axes), rtol=0, atol=1e-14)


def test_a_knot_as_often_as_the_degree_makes_a_control_point_a_point() -> None:
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
def test_knots_that_cannot_be_inserted_are_refused(new: list[float], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        insert_knots(clamped_basis(6), np.zeros((6, 1)), np.array(new))


def test_coefficients_of_another_basis_are_refused() -> None:
    with pytest.raises(ValueError, match="control must have 6 coefficients, got 5"):
        insert_knots(clamped_basis(6), np.zeros((5, 1)), np.array([0.5]))


def test_coefficients_that_are_not_finite_are_refused() -> None:
    with pytest.raises(ValueError, match="control must be finite"):
        insert_knots(clamped_basis(6), np.full((6, 1), np.nan), np.array([0.5]))
