from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from palpate.core.splines.knots import (
    averaged_knots,
    check_knots,
    clamped_knots,
    greville,
    periodic_knots,
    uniform_knots,
)


def test_clamped_knots_are_even_between_repeated_ends() -> None:
    assert clamped_knots(6).tolist() == pytest.approx([0, 0, 0, 0, 1 / 3, 2 / 3, 1, 1, 1, 1])
    assert clamped_knots(4).tolist() == [0, 0, 0, 0, 1, 1, 1, 1]  # Bernstein polynomials


def test_uniform_knots_run_on_in_even_steps_beyond_the_domain() -> None:
    knots = uniform_knots(7, 3)
    assert len(knots) == 7 + 3 + 1
    assert np.allclose(np.diff(knots), 0.25, rtol=0, atol=1e-15)
    assert (knots[3], knots[7]) == (0.0, 1.0)


def test_periodic_knots_hold_one_turn_and_what_comes_again() -> None:
    knots = periodic_knots(5, 2)
    assert len(knots) == 5 + 2 * 2 + 1
    assert np.allclose(knots * 5, np.arange(-2, 8), rtol=0, atol=1e-15)


def test_averaged_knots_are_means_of_as_many_sites_as_the_degree() -> None:
    sites = np.array([0.0, 1.0, 3.0, 4.0, 8.0, 10.0])
    assert averaged_knots(sites, 3)[3:-3].tolist() == pytest.approx([0, 8 / 3, 5, 10])
    assert averaged_knots(sites, 5).tolist() == [0.0] * 6 + [10.0] * 6


def test_greville_abscissae_are_means_of_as_many_knots_as_the_degree() -> None:
    knots = np.array([0, 0, 0, 1, 4, 4, 4.0])
    assert greville(knots, 2).tolist() == [0.0, 0.5, 2.5, 4.0]


@given(
    st.integers(1, 6),
    st.lists(st.floats(0.0, 1.0), min_size=0, max_size=12),
)
@settings(derandomize=True, deadline=None, max_examples=50)
def test_greville_abscissae_never_fall_and_end_where_clamped_knots_do(
    degree: int, inner: list[float]
) -> None:
    knots = np.array([0.0] * (degree + 1) + sorted(set(inner)) + [1.0] * (degree + 1))
    if not knots[degree + 1] > 0.0 or not knots[-degree - 2] < 1.0:
        return  # an end would occur too often
    places = greville(knots, degree)
    assert len(places) == len(knots) - degree - 1
    assert (np.diff(places) >= 0.0).all()
    assert (places[0], places[-1]) == (0.0, 1.0)


def test_a_checked_knot_vector_is_a_copy_that_nobody_can_write() -> None:
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
def test_what_is_no_knot_vector_is_refused(knots: list[float], degree: int, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        check_knots(np.array(knots, float), degree)


@pytest.mark.parametrize("make", [clamped_knots, uniform_knots, periodic_knots])
def test_too_few_coefficients_are_refused(make: type) -> None:
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
def test_sites_that_allow_no_knots_are_refused(sites: list[float], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        averaged_knots(np.array(sites))


def test_averages_of_no_sites_are_refused() -> None:
    with pytest.raises(ValueError, match="degree must be at least 1, got 0"):
        averaged_knots(np.arange(5.0), 0)
