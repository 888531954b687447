"""Laws of B-spline bases: values, knots, tensor products, interpolation, refinement."""

import itertools
import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy.interpolate import BSpline

from palpate.core.arrays import Floats
from palpate.core.splines import (
    Basis,
    PeriodicBasis,
    averaged_knots,
    clamped_basis,
    evaluate_grid,
    evaluate_scattered,
    insert_knots,
    interpolate_grid,
    periodic_knots,
    wound_basis,
)

EVERYWHERE = np.concatenate([[0.0, 1.0, 1e-300, 1 - 1e-16], np.random.default_rng(0).random(200)])


def uniform_basis(count: int, degree: int = 3) -> Basis:
    """Even knots that continue beyond both ends of [0, 1]."""
    return Basis(np.arange(-degree, count + 1) / (count - degree), degree)


SHAPES = {
    "double": Basis(np.array([0, 0, 0, 0, 0.2, 0.35, 0.35, 0.7, 1, 1, 1, 1]), 3),
    "broken": Basis(np.array([0, 0, 0, 0, 0.5, 0.5, 0.5, 0.5, 1, 1, 1, 1]), 3),
    "uniform": uniform_basis(9, 2),
    "linear": Basis(np.array([-1, -0.5, 0.1, 0.4, 0.9, 2, 2.5]), 1),
    "quintic": clamped_basis(12, 5),
    "bernstein": clamped_basis(5, 4),
}


@pytest.mark.parametrize("basis", SHAPES.values(), ids=SHAPES)
def test_values_and_all_derivatives_equal_scipys(basis: Basis):
    low, high = basis.domain
    x = np.concatenate([low + (high - low) * EVERYWHERE, basis.breaks()])
    theirs = BSpline(basis.knots, np.eye(basis.count), basis.degree)
    for order in range(basis.degree + 2):
        wanted = theirs(x, nu=order) if order <= basis.degree else np.zeros((len(x), basis.count))
        limit = 1e-13 * np.abs(wanted).max()
        result = basis.matrix(x, order)
        assert np.allclose(result.toarray(), wanted, rtol=1e-13, atol=limit)
        many = basis.matrix(np.tile(x, 3), order)
        assert np.array_equal(many.toarray(), np.tile(result.toarray(), (3, 1)))


def test_places_within_rounding_of_domain_are_clipped():
    basis = clamped_basis(6)
    beyond = np.array([-1e-16, 1.0 + 2.3e-16])
    assert np.array_equal(basis.matrix(beyond).toarray(), np.eye(6)[[0, -1]])
    large = Basis(1e9 * basis.knots, 3)
    assert large.matrix(np.array([1e9 + 1e-6])).toarray()[0, -1] == 1.0
    for wrong in (large, Basis(1e9 * (basis.knots - 1.0), 3)):
        with pytest.raises(ValueError, match=r"the domain from .* got 1 outside, the worst 1e\+09"):
            wrong.matrix(np.array([1e9 + 1.0]))


@pytest.mark.parametrize(("count", "degree"), [(4, 3), (5, 3), (11, 3), (48, 3), (2, 1), (7, 5)])
def test_periodic_basis_is_the_wrapped_cardinal_spline(count: int, degree: int):
    turns = np.concatenate([by * EVERYWHERE[4:30] for by in (1, -1, 5)])
    basis, cardinal = PeriodicBasis(count, degree), BSpline.basis_element(np.arange(degree + 2))
    wraps = np.arange(-8, 9)[:, None, None]
    place = count * (turns[:, None] + wraps) - np.arange(count) + degree
    inside = (place > 0.0) & (place < degree + 1)
    for order in range(degree + 1):
        values = np.where(inside, cardinal(np.where(inside, place, 0.5), nu=order), 0.0)
        wanted = float(count) ** order * values.sum(axis=0)
        result = basis.matrix(turns, order)
        assert np.allclose(result.toarray(), wanted, rtol=0, atol=1e-11 * count**order)
        assert (np.diff(result.indptr) == degree + 1).all()
    # Each function is symmetric about its Greville abscissa.
    places = basis.greville()
    left, right = (basis.matrix(places + by).diagonal() for by in (-0.07, 0.07))
    assert np.allclose(left, right, rtol=0, atol=1e-13)
    assert np.diff(places) == pytest.approx(np.full(count - 1, 1 / count), abs=1e-15)


def test_knots_follow_their_definitions():
    assert clamped_basis(6).knots == pytest.approx([0, 0, 0, 0, 1 / 3, 2 / 3, 1, 1, 1, 1])
    assert clamped_basis(4).knots.tolist() == [0, 0, 0, 0, 1, 1, 1, 1]
    assert periodic_knots(5, 2) * 5 == pytest.approx(np.arange(-2, 8), abs=1e-15)
    assert np.array_equal(wound_basis(5, 2).knots, periodic_knots(5, 2))
    assert wound_basis(5, 2).domain == (0.0, 1.0)
    # Inner knots are means of `degree` sites, Greville abscissae of `degree` knots.
    sites = np.array([0.0, 1.0, 3.0, 4.0, 8.0, 10.0])
    assert averaged_knots(sites, 3)[3:-3] == pytest.approx([0, 8 / 3, 5, 10])
    assert averaged_knots(sites, 5).tolist() == [0.0] * 6 + [10.0] * 6
    basis = Basis(np.array([0, 0, 0, 1, 4, 4, 4.0]), 2)
    assert basis.greville().tolist() == [0.0, 0.5, 2.5, 4.0]
    assert (basis.count, basis.domain, basis.breaks().tolist()) == (4, (0.0, 4.0), [0, 1, 4])


BASES = (clamped_basis(6), clamped_basis(3, 2), clamped_basis(5, 2))
CONTROL = np.random.default_rng(3).normal(size=(6, 3, 5, 4))


@pytest.mark.parametrize("axes", [1, 2, 3])
def test_tensor_products_are_sums_over_all_functions_and_interpolate(axes: int):
    bases, rng = BASES[:axes], np.random.default_rng(axes)
    control = CONTROL[(..., *(0,) * (3 - axes), slice(None))]
    sides = [np.append(rng.random(3 + axis), [0.0, 1.0]) for axis in range(axes)]
    at = np.stack(np.meshgrid(*sides, indexing="ij"), axis=-1).reshape(-1, axes)
    orders = list(itertools.product((0, 1, 2), repeat=axes))
    scattered = evaluate_scattered(bases, control, at, orders)
    for order, values in zip(orders, scattered, strict=True):
        wanted = control
        for axis, (basis, x, nu) in enumerate(zip(bases, sides, order, strict=True)):
            rows = basis.matrix(x, nu).toarray()
            wanted = np.moveaxis(np.tensordot(rows, wanted, (1, axis)), 0, axis)
        limit = 1e-12 * max(np.abs(wanted).max(), 1.0)
        assert np.allclose(values.reshape(wanted.shape), wanted, rtol=0, atol=limit)
        gridded = evaluate_grid(bases, control, sides, order)
        assert np.allclose(gridded, wanted, rtol=0, atol=limit)
    values = evaluate_grid(bases, control, sides)
    assert np.array_equal(values, evaluate_grid(bases, control, sides, (0,) * axes))
    assert evaluate_scattered(bases, control, at[:0], orders).shape == (3**axes, 0, 4)
    # Interpolants take their values.
    sites = [np.sort(rng.random(n)) for n in (7, 5, 6)[:axes]]
    bases = tuple(Basis(averaged_knots(places, 3), 3) for places in sites)
    values = rng.normal(size=(*(len(places) for places in sites), 2))
    result = interpolate_grid(bases, sites, values)
    assert evaluate_grid(bases, result.control, sites) == pytest.approx(values, abs=1e-10)
    matrices = [b.matrix(x).toarray() for b, x in zip(bases, sites, strict=True)]
    condition = np.prod([np.linalg.cond(matrix) for matrix in matrices])
    assert result.condition == pytest.approx(condition)


@given(st.integers(1, 5), st.lists(st.floats(0.001, 0.999), max_size=6), st.booleans())
@settings(derandomize=True, deadline=None, max_examples=40)
def test_inserting_knots_changes_no_point(degree: int, new: list[float], clamped: bool):
    basis = (clamped_basis if clamped else uniform_basis)(degree + 4, degree)
    control = np.random.default_rng(degree).normal(size=(basis.count, 2))
    finer, moved = insert_knots(basis, control, np.unique(new))
    x = np.linspace(0.0, 1.0, 40)
    assert finer.count == basis.count + len(np.unique(new))
    assert np.allclose(finer.matrix(x) @ moved, basis.matrix(x) @ control, rtol=0, atol=1e-13)


def test_any_axis_can_be_refined_up_to_the_degree():
    bases, control = [clamped_basis(5), clamped_basis(4)], CONTROL[:5, :, :4, 0].swapaxes(1, 2)
    finer, moved = insert_knots(bases[1], control, np.array([0.5, 0.5, 0.5]), axis=1)
    axes = [np.linspace(0, 1, 7), np.linspace(0, 1, 9)]
    result = evaluate_grid([bases[0], finer], moved, axes)
    assert np.allclose(result, evaluate_grid(bases, control, axes), rtol=0, atol=1e-14)
    # At a knot as often as the degree a coefficient is the value.
    assert result[:, 4] == pytest.approx(bases[0].matrix(axes[0]) @ moved[:, 3], abs=1e-15)


def scattered(control: Floats = CONTROL, at: Floats | None = None, order=(0, 0, 0)) -> Floats:
    return evaluate_scattered(BASES, control, np.full((1, 3), 0.5) if at is None else at, [order])


def on_grid(control: Floats = CONTROL, axes: int = 3, order=None) -> Floats:
    return evaluate_grid(BASES, control, [np.full(1, 0.5)] * axes, order)


def interpolated(sites: list[float], values: Floats | None = None, axes: int = 1) -> object:
    values = np.zeros((len(sites), 1)) if values is None else values
    return interpolate_grid([clamped_basis(6)] * axes, [np.array(sites)], values)


def inserted(new: list[float], count: int = 6, value: float = 0.0) -> object:
    return insert_knots(clamped_basis(6), np.full((count, 1), value), np.array(new))


SIX = clamped_basis(6).greville().tolist()
HOLED = np.where(np.arange(4) == 0, np.nan, CONTROL)


@pytest.mark.parametrize(("call", "words"), [
    (lambda: Basis(np.arange(4.0), 0), "degree must be at least 1, got 0"),
    (lambda: Basis(np.array([0, 0, math.nan, 1, 1]), 1), "knots must be finite"),
    (lambda: Basis(np.array([[0, 0, 1, 1.0]]), 1), r"knots must have shape \(any\)"),
    (lambda: Basis(np.array([0, 0, 1, 1.0]), 2), "knots must be at least 6 for degree 2, got 4"),
    (lambda: Basis(np.array([0, 0, 2, 1, 3, 3.0]), 1), "knots must not fall, got 1 after 2"),
    (lambda: Basis(np.array([0, 0, 1, 1, 1, 2, 2.0]), 1), "2 times at degree 1, got 1 3 times"),
    (lambda: Basis(np.array([0, 1, 1, 2.0]), 1), "no domain: it begins and ends at 1"),
    (lambda: clamped_basis(5).matrix(np.array([0.5, math.nan])), "x must be finite"),
    (lambda: clamped_basis(5).matrix(np.array([[0.5]])), r"x must have shape \(any\)"),
    (lambda: clamped_basis(5).matrix(np.array([-0.2, 0.5, 1.1])), "got 2 outside, the worst -0.2"),
    (lambda: clamped_basis(5).nonzero(np.array([0.5]), -1), "derivatives must be 0 or more, got"),
    (lambda: PeriodicBasis(5).matrix(np.array([0.5]), -1), "derivatives must be 0 or more, got -1"),
    (lambda: PeriodicBasis(5).matrix(np.array([math.inf])), "x must be finite"),
    (lambda: PeriodicBasis(3), "count must be larger than the degree 3, got 3"),
    (lambda: clamped_basis(3), "count must be larger than the degree 3, got 3"),
    (lambda: periodic_knots(3, 0), "degree must be at least 1, got 0"),
    (lambda: averaged_knots(np.array([0, 0.5, 1])), "sites must be more than the degree 3, got 3"),
    (lambda: averaged_knots(np.array([0, 0.2, 0.2, 0.6, 1])), "sites must increase"),
    (lambda: averaged_knots(np.array([0, 0.2, math.inf, 1])), "sites must be finite"),
    (lambda: averaged_knots(np.arange(5.0), 0), "degree must be at least 1, got 0"),
    (lambda: scattered(CONTROL.swapaxes(0, 2)), r"control must have shape \(6, 3, 5, any\), got"),
    (lambda: scattered(HOLED), "control must be finite"),
    (lambda: scattered(at=np.zeros((1, 2))), r"at must have shape \(any, 3\)"),
    (lambda: scattered(order=(0, -1, 0)), "orders must be 0 or more for each of 3 axes, got"),
    (lambda: on_grid(axes=2), "axes must be 3, one for each basis, got 2"),
    (lambda: on_grid(order=(0, 0)), "orders must be 0 or more for each of 3 axes, got"),
    (lambda: interpolated([0, 0.2, 0.4, 0.6, 1]), "sites of axis 0 must be 6, increase, and lie"),
    (lambda: interpolated([0, 0.1, 0.2, 0.25, 0.3, 0.32]), "sites of axis 0 must be 6"),
    (lambda: interpolated([*SIX[:5], math.inf]), "sites must be finite"),
    (lambda: interpolated(SIX, np.zeros((5, 1))), r"values must have shape \(6, any\)"),
    (lambda: interpolated(SIX, np.full((6, 1), math.nan)), "values must be finite"),
    (lambda: interpolated(SIX, axes=2), "sites must be given for 2 axes, got 1"),
    (lambda: inserted([1.5]), "x must lie in the domain"),
    (lambda: inserted([math.nan]), "new must be finite"),
    (lambda: inserted([0.5] * 5), "knots may repeat 4 times at degree 3"),
    (lambda: inserted([0.5], count=5), "control must have 6 coefficients, got 5"),
    (lambda: inserted([0.5], value=math.nan), "control must be finite"),
])  # fmt: skip
def test_bad_input_is_refused(call: Callable[[], object], words: str):
    with pytest.raises(ValueError, match=words):
        call()
