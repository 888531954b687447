from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from palpate.core.splines.basis import Basis, clamped_basis
from palpate.core.splines.insert_knots import insert_knots
from palpate.core.splines.knots import uniform_knots
from palpate.core.splines.tensor import evaluate_grid


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
