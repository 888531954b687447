from __future__ import annotations

import itertools

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.splines.basis import Basis, bernstein_basis, clamped_basis
from palpate.core.splines.de_casteljau import de_casteljau
from palpate.core.splines.tensor import BLOCK, evaluate, evaluate_grid

BASES = (clamped_basis(6), bernstein_basis(2), clamped_basis(5, 2))
RNG = np.random.default_rng(3)


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
    found = evaluate(bases, control, at, orders)
    for order, values in zip(orders, found, strict=True):
        wanted = dense(bases, control, at, order)
        assert np.allclose(values, wanted, rtol=0, atol=1e-12 * max(np.abs(wanted).max(), 1.0))


@pytest.mark.parametrize("order", [(0, 0, 0), (1, 0, 2), (0, 1, 0)])
def test_a_grid_is_evaluated_as_its_places_are(order: tuple[int, ...]) -> None:
    control = RNG.normal(size=(6, 3, 5, 3))
    axes = [RNG.random(4), RNG.random(2), np.array([0.0, 0.3, 1.0])]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    wanted = evaluate(BASES, control, grid.reshape(-1, 3), [order])[0].reshape(4, 2, 3, 3)
    assert np.allclose(evaluate_grid(BASES, control, axes, order), wanted, rtol=0, atol=1e-12)


def test_many_places_are_taken_in_blocks_and_keep_their_order() -> None:
    control = RNG.normal(size=(6, 1))
    at = RNG.random((BLOCK // 4 + 3, 1))
    found = evaluate(BASES[:1], control, at, [(0,)])[0]
    assert np.allclose(found[-5:], BASES[0].matrix(at[-5:, 0]) @ control, rtol=0, atol=1e-14)
    assert np.allclose(found[:5], BASES[0].matrix(at[:5, 0]) @ control, rtol=0, atol=1e-14)


def test_no_places_are_no_values() -> None:
    assert evaluate(BASES, np.zeros((6, 3, 5, 3)), np.zeros((0, 3)), [(0, 0, 0)]).shape == (1, 0, 3)


@pytest.mark.parametrize("degrees", [(4,), (3, 2), (2, 3, 5)])
def test_bezier_solids_are_those_of_de_casteljau(degrees: tuple[int, ...]) -> None:
    control = RNG.normal(size=(*(degree + 1 for degree in degrees), 3))
    at = np.concatenate([RNG.random((40, len(degrees))), np.ones((1, len(degrees)))])
    bases = tuple(bernstein_basis(degree) for degree in degrees)
    found = evaluate(bases, control, at, [(0,) * len(degrees)])[0]
    assert np.allclose(found, de_casteljau(control, at), rtol=0, atol=1e-14)


def test_places_outside_are_refused() -> None:
    with pytest.raises(ValueError, match="x must lie in the domain"):
        evaluate(BASES, np.zeros((6, 3, 5, 3)), np.array([[0.5, 1.5, 0.5]]), [(0, 0, 0)])
    with pytest.raises(ValueError, match="x must lie in the domain"):
        evaluate_grid(BASES[:1], np.zeros((6, 3)), [np.array([-0.5])])


def test_coefficients_and_places_that_do_not_fit_the_bases_are_refused() -> None:
    control = np.zeros((6, 3, 5, 3))
    words = r"control must have shape \(6, 3, 5, any\), got \(5, 3, 6, 3\)"
    with pytest.raises(ValueError, match=words):
        evaluate(BASES, control.swapaxes(0, 2), np.zeros((1, 3)), [(0, 0, 0)])
    with pytest.raises(ValueError, match=words):
        evaluate_grid(BASES, control.swapaxes(0, 2), [np.zeros(1)] * 3)
    with pytest.raises(ValueError, match=r"at must have shape \(any, 3\)"):
        evaluate(BASES, control, np.zeros((1, 2)), [(0, 0, 0)])


def test_coefficients_orders_and_axes_that_are_none_are_refused() -> None:
    control = np.zeros((6, 3, 5, 1))
    at, axes = np.full((1, 3), 0.5), [np.full(1, 0.5)] * 3
    for order in ((0, -1, 0), (0, 0)):
        with pytest.raises(ValueError, match="orders must be 0 or more for each of 3 axes, got"):
            evaluate(BASES, control, at, [(1, 1, 1), order])
        with pytest.raises(ValueError, match="orders must be 0 or more for each of 3 axes, got"):
            evaluate_grid(BASES, control, axes, order)
    with pytest.raises(ValueError, match="axes must be 3, one for each basis, got 2"):
        evaluate_grid(BASES, control, axes[:2])
    control[0, 0, 0, 0] = np.nan
    with pytest.raises(ValueError, match="control must be finite"):
        evaluate(BASES, control, at, [(0, 0, 0)])
    with pytest.raises(ValueError, match="control must be finite"):
        evaluate_grid(BASES, control, axes)
