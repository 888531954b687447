"""Inputs at which splines and lattices are known to break."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.core.splines.basis import Basis, clamped_basis
from palpate.core.splines.frame import Frame
from palpate.core.splines.knots import averaged_knots
from palpate.core.splines.volume import Volume


def test_the_functions_sum_to_one_at_the_last_knot() -> None:
    for degree in (1, 2, 3, 5):
        basis = clamped_basis(degree + 4, degree)
        ends = basis.matrix(np.array([0.0, 1.0])).toarray()
        assert np.array_equal(ends, np.eye(degree + 4)[[0, -1]])
        slopes = basis.matrix(np.array([1.0]), 1) @ basis.greville()
        assert slopes[0] == pytest.approx(1.0, abs=1e-14)


def test_a_place_outside_by_rounding_is_the_end_and_by_more_is_refused() -> None:
    basis = clamped_basis(6)
    just_outside = np.array([-1e-16, 1.0 + 2.3e-16])
    assert np.array_equal(basis.matrix(just_outside).toarray(), np.eye(6)[[0, -1]])
    for outside in (-0.1, 1.1, -1e-9):
        with pytest.raises(ValueError, match="x must lie in the domain from 0 to 1, got 1 outside"):
            basis.matrix(np.array([0.5, outside]))
    large = Basis(1e9 * basis.knots, 3)
    assert large.matrix(np.array([1e9 + 1e-6])).toarray()[0, -1] == 1.0
    with pytest.raises(ValueError, match="x must lie in the domain"):
        large.matrix(np.array([1e9 + 1.0]))


def test_at_a_knot_of_full_multiplicity_the_right_limit_is_taken_without_a_nan() -> None:
    basis = Basis(np.array([0, 0, 0, 0, 0.5, 0.5, 0.5, 0.5, 1, 1, 1, 1]), 3)
    for order in range(4):
        here, right = basis.matrix(np.array([0.5, 0.5 + 1e-13]), order).toarray()
        assert np.isfinite(here).all()
        assert np.allclose(here, right, rtol=1e-11, atol=1e-9)
    here, left = basis.matrix(np.array([0.5, 0.5 - 1e-13])).toarray()
    assert np.argmax(here) == 4
    assert np.argmax(left) == 3  # the curve jumps there


def test_the_highest_derivative_is_piecewise_constant_and_those_above_are_0() -> None:
    basis = clamped_basis(7, 3)
    x = np.array([0.01, 0.1, 0.2, 0.26, 0.49, 0.99, 1.0])
    third = basis.matrix(x, 3).toarray()
    assert np.isfinite(third).all()
    assert np.allclose(third[0], third[1], rtol=1e-12)
    assert np.allclose(third[3], third[4], rtol=1e-12)
    assert np.allclose(third[5], third[6], rtol=1e-12)
    assert np.abs(third[2] - third[3]).max() > 1.0
    for order in (4, 5, 9):
        assert not basis.matrix(x, order).toarray().any()


def test_averaged_knots_rise_and_their_system_has_a_condition_of_4() -> None:
    sites = np.linspace(0.0, 1.0, 9)
    basis = Basis(averaged_knots(sites, 3), 3)
    assert (np.diff(basis.knots) >= 0.0).all()
    assert np.linalg.cond(basis.matrix(sites).toarray()) == pytest.approx(4.1, abs=0.05)


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_lattice_without_length_along_an_edge_is_refused(axis: int) -> None:
    edges = np.eye(3)
    edges[axis] = 0.0
    with pytest.raises(ValueError, match="edges must have a length"):
        Frame(np.zeros(3), edges)


@pytest.mark.parametrize(("weight", "words"), [(0.0, "got 0"), (-1.0, "got -1")])
def test_weights_that_are_zero_or_negative_are_refused(weight: float, words: str) -> None:
    bases = clamped_basis(4), clamped_basis(4), clamped_basis(4)
    weights = np.ones((4, 4, 4))
    weights[1, 2, 3] = weight
    with pytest.raises(ValueError, match=f"weights must be positive, {words}"):
        Volume(np.zeros((4, 4, 4, 3)), bases, weights)
