from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from palpate.core.splines.basis import Basis, bernstein_basis, clamped_basis
from palpate.core.splines.knots import uniform_knots
from palpate.core.splines.monotone import invert_rising

EPSILON = np.finfo(float).eps


@given(
    st.integers(1, 5),
    st.lists(st.floats(1e-6, 1.0), min_size=6, max_size=12),
    st.sampled_from([1e-9, 1.0, 1e9]),
)
@settings(derandomize=True, deadline=None, max_examples=50)
def test_a_rising_spline_takes_its_values_where_they_are_found(
    degree: int, rises: list[float], scale: float
) -> None:
    coefficients = scale * np.cumsum([0.0, *rises])
    basis = clamped_basis(len(coefficients), degree)
    at = np.concatenate([np.random.default_rng(0).random(50), [0.0, 1.0], np.unique(basis.knots)])
    values = basis.matrix(at) @ coefficients
    found = invert_rising(basis, coefficients, values)
    off = np.abs(basis.matrix(found.parameters) @ coefficients - values)
    assert off.max() <= 16 * EPSILON * np.ptp(coefficients)
    assert found.residual.max() <= 8 * EPSILON * np.ptp(coefficients)


def test_roots_are_found_in_few_steps_and_stay() -> None:
    basis = clamped_basis(27)
    coefficients = np.linspace(-1.0, 1.0, 27)
    values = np.random.default_rng(1).uniform(-1, 1, 10_000)
    found = invert_rising(basis, coefficients, values)
    assert found.steps.max() <= 6
    assert found.residual.max() <= 4 * EPSILON * 2.0


def test_an_identity_needs_no_step() -> None:
    basis = clamped_basis(9)
    values = np.random.default_rng(2).random(100)
    found = invert_rising(basis, basis.greville(), values)
    assert np.allclose(found.parameters, values, rtol=0, atol=4 * EPSILON)
    assert found.steps.max() <= 1


def test_a_spline_that_stands_still_somewhere_is_inverted_there_too() -> None:
    # Its slope is nearly 3 x^2: Newton's method alone creeps to a root near 0.
    rising = np.array([0, 1e-12, 2e-12, 1.0])
    found = invert_rising(bernstein_basis(3), rising, np.array([0, 1e-9, 1.0]))
    assert found.parameters[[0, 2]].tolist() == [0.0, 1.0]
    assert found.parameters[1] == pytest.approx(1e-3, rel=1e-5)


def test_values_beyond_the_ends_are_answered_with_the_ends() -> None:
    found = invert_rising(clamped_basis(6), np.arange(6.0), np.array([-1.0, 7.0]))
    assert found.parameters.tolist() == [0.0, 1.0]
    assert found.residual.tolist() == [1.0, 2.0]


def test_unclamped_ends_are_where_the_spline_ends_not_its_coefficients() -> None:
    basis = Basis(uniform_knots(7), 3)
    values = basis.matrix(np.linspace(0, 1, 20)) @ np.arange(7.0)
    found = invert_rising(basis, np.arange(7.0), values)
    assert np.allclose(found.parameters, np.linspace(0, 1, 20), rtol=0, atol=1e-14)


@pytest.mark.parametrize(
    ("coefficients", "words"),
    [
        ([0, 1, 2, 2], "coefficients must rise"),
        ([0, 1, 2], r"coefficients must have shape \(4\)"),
        ([0, 1, 2, np.inf], "coefficients must be finite"),
    ],
)
def test_coefficients_that_do_not_rise_are_refused(coefficients: list[float], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        invert_rising(clamped_basis(4), np.array(coefficients, float), np.zeros(1))


def test_values_that_are_no_numbers_are_refused() -> None:
    with pytest.raises(ValueError, match="values must be numbers, got 1 nan"):
        invert_rising(clamped_basis(6), np.arange(6.0), np.array([1.0, np.nan]))
