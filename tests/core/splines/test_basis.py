from __future__ import annotations

import numpy as np
import pytest

from palpate.core.splines.basis import (
    clamped_knots,
    clamped_matrix,
    clamped_slopes,
    greville,
    periodic_matrix,
)

EVERYWHERE = np.concatenate([[0.0, 1.0, 1e-300, 1 - 1e-16], np.random.default_rng(0).random(200)])


@pytest.mark.parametrize("count", [4, 5, 9, 32])
def test_the_clamped_basis_sums_to_one_everywhere_and_is_never_negative(count: int) -> None:
    basis = clamped_matrix(EVERYWHERE, count).toarray()
    assert basis.shape == (len(EVERYWHERE), count)
    assert np.allclose(basis.sum(axis=1), 1.0, atol=1e-15)
    assert (basis >= 0.0).all()


def test_the_ends_belong_to_the_first_and_the_last_coefficient() -> None:
    ends = clamped_matrix(np.array([0.0, 1.0]), 7).toarray()
    assert np.array_equal(ends, np.eye(7)[[0, 6]])


def test_places_outside_are_taken_to_the_nearest_end() -> None:
    outside = np.array([-0.1, -1e-16, 1 + 1e-16, 7.0])
    assert np.array_equal(
        clamped_matrix(outside, 6).toarray(), clamped_matrix(np.array([0, 0, 1, 1.0]), 6).toarray()
    )


@pytest.mark.parametrize(("count", "degree"), [(4, 3), (9, 3), (32, 3), (5, 2), (3, 1)])
def test_greville_abscissae_reproduce_the_identity(count: int, degree: int) -> None:
    basis = clamped_matrix(EVERYWHERE, count, degree)
    assert np.allclose(basis @ greville(count, degree), EVERYWHERE, rtol=0, atol=1e-15)


def test_greville_abscissae_rise_from_0_to_1() -> None:
    places = greville(9)
    assert places[0] == 0.0
    assert places[-1] == 1.0
    assert (np.diff(places) > 0.0).all()


@pytest.mark.parametrize("count", [4, 6, 11])
def test_slopes_are_those_of_the_basis(count: int) -> None:
    x = np.random.default_rng(1).uniform(0.01, 0.99, 50)
    step = 1e-6
    ahead, back = clamped_matrix(x + step, count), clamped_matrix(x - step, count)
    differences = (ahead - back).toarray() / (2 * step)
    # A knot between the two places costs a jump of the third derivative times step^2.
    assert np.allclose(clamped_slopes(x, count), differences, rtol=0, atol=1e-8)
    assert np.allclose(clamped_slopes(x, count) @ greville(count), 1.0, atol=1e-13)


def test_slopes_exist_at_both_ends() -> None:
    ends = clamped_slopes(np.array([0.0, 1.0]), 6)
    assert np.allclose(ends @ greville(6), 1.0, atol=1e-13)


def test_knots_are_clamped_and_even() -> None:
    assert clamped_knots(6).tolist() == pytest.approx([0, 0, 0, 0, 1 / 3, 2 / 3, 1, 1, 1, 1])


@pytest.mark.parametrize(("count", "degree"), [(3, 3), (0, 3), (2, 2)])
def test_too_few_coefficients_are_refused(count: int, degree: int) -> None:
    words = f"count must be larger than the degree {degree}, got {count}"
    with pytest.raises(ValueError, match=words):
        clamped_knots(count, degree)


@pytest.mark.parametrize("count", [4, 5, 48])
def test_the_periodic_basis_sums_to_one_all_around(count: int) -> None:
    turns = np.concatenate([EVERYWHERE, -EVERYWHERE, 5 * EVERYWHERE])
    basis = periodic_matrix(turns, count)
    assert basis.shape == (len(turns), count)
    assert (np.diff(basis.indptr) == 4).all()
    assert np.allclose(basis.toarray().sum(axis=1), 1.0, atol=1e-14)


def test_a_whole_turn_changes_nothing() -> None:
    turns = np.array([-0.3, 0.0, -1e-17, 0.25, 0.999])
    here = periodic_matrix(turns, 12).toarray()
    assert np.allclose(periodic_matrix(turns + 1.0, 12).toarray(), here, atol=1e-14)


def test_the_periodic_basis_has_no_seam() -> None:
    coefficients = np.random.default_rng(2).normal(size=11)
    step = 1e-3

    def around(turns: np.ndarray) -> np.ndarray:
        return np.asarray(periodic_matrix(turns, 11) @ coefficients)

    # Value, slope and second derivative are continuous: what remains are third differences,
    # no larger at the seam than at any other knot.
    offsets = step * np.array([-1.5, -0.5, 0.5, 1.5])
    jumps = [abs(np.diff(around(knot + offsets), 3)[0]) for knot in np.arange(11) / 11]
    third = 11**3 * 8 * np.abs(coefficients).max()
    assert max(jumps) < third * step**3
    assert jumps[0] < third * step**3


def test_shifting_the_coefficients_turns_the_curve() -> None:
    coefficients = np.random.default_rng(2).normal(size=9)
    turns = np.linspace(0.0, 1.0, 40)
    moved = periodic_matrix(turns + 1 / 9, 9) @ np.roll(coefficients, 1)
    assert np.allclose(moved, periodic_matrix(turns, 9) @ coefficients, atol=1e-13)


def test_a_circle_of_too_few_coefficients_is_refused() -> None:
    with pytest.raises(ValueError, match="count must be larger than the degree 3, got 3"):
        periodic_matrix(np.zeros(1), 3)
