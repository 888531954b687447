from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from palpate.core.shapes.r_functions import (
    complement,
    conjunction,
    conjunction_slopes,
    difference,
    difference_slopes,
    disjunction,
    disjunction_slopes,
)

OMEGAS = [1.0, 0.5, 0.0, -0.5, -1.0 + 1e-12]
VALUES = st.one_of(
    st.floats(-10.0, 10.0),
    st.floats(-1e200, 1e200),
    st.sampled_from([0.0, 1e8, -1e8, 1e-8, -1e-8, 1.0, -1.0, 1.0 + 1e-12]),
)


def exact(f1: float, f2: float, omega: float, sign: int) -> Any:
    with mpmath.workdps(900):
        a, b, w = mpmath.mpf(f1), mpmath.mpf(f2), mpmath.mpf(omega)
        root = mpmath.sqrt(a * a + b * b - 2 * w * a * b)
        return (a + b + sign * root) / (1 + w)


def close(found: Any, wanted: Any) -> bool:
    if abs(wanted) < 1e-300:
        return abs(float(found)) < 1e-299
    return bool(abs(mpmath.mpf(float(found)) / wanted - 1) < 2e-15)


@settings(derandomize=True, deadline=None, max_examples=50)
@given(VALUES, VALUES, st.sampled_from(OMEGAS))
def test_values_are_those_of_the_definition_to_the_last_digits(
    f1: float, f2: float, omega: float
) -> None:
    assert close(conjunction(f1, f2, omega), exact(f1, f2, omega, -1))
    assert close(disjunction(f1, f2, omega), exact(f1, f2, omega, 1))


@settings(derandomize=True, deadline=None, max_examples=50)
@given(VALUES, VALUES, st.sampled_from(OMEGAS), st.integers(0, 2))
def test_the_signs_are_those_of_the_boolean_operations(
    f1: float, f2: float, omega: float, smoothness: int
) -> None:
    both = conjunction(f1, f2, omega, smoothness=smoothness)
    either = disjunction(f1, f2, omega, smoothness=smoothness)
    assert np.isfinite([both, either]).all()
    assert (both > 0.0) == (f1 > 0.0 and f2 > 0.0)
    assert (both < 0.0) == (f1 < 0.0 or f2 < 0.0)
    assert (either > 0.0) == (f1 > 0.0 or f2 > 0.0)
    assert (either < 0.0) == (f1 < 0.0 and f2 < 0.0)


@settings(derandomize=True, deadline=None, max_examples=50)
@given(VALUES, VALUES, st.sampled_from(OMEGAS))
def test_the_laws_of_de_morgan_hold_to_the_bit(f1: float, f2: float, omega: float) -> None:
    assert conjunction(f1, f2, omega) == complement(
        disjunction(complement(f1), complement(f2), omega)
    )
    assert difference(f1, f2, omega) == conjunction(f1, complement(f2), omega)
    assert conjunction(f1, f2, omega) == conjunction(f2, f1, omega)


def test_with_omega_1_they_are_minimum_and_maximum() -> None:
    f1, f2 = np.random.default_rng(0).normal(size=(2, 1000))
    assert np.allclose(conjunction(f1, f2, 1.0), np.minimum(f1, f2), rtol=1e-14, atol=0)
    assert np.allclose(disjunction(f1, f2, 1.0), np.maximum(f1, f2), rtol=1e-14, atol=0)


@pytest.mark.parametrize("omega", OMEGAS[:-1])
@pytest.mark.parametrize("smoothness", [0, 1, 2])
@pytest.mark.parametrize(
    ("function", "slopes"),
    [
        (conjunction, conjunction_slopes),
        (disjunction, disjunction_slopes),
        (difference, difference_slopes),
    ],
)
def test_slopes_are_those_of_the_values(
    function: Callable[..., Any], slopes: Callable[..., Any], omega: float, smoothness: int
) -> None:
    rng = np.random.default_rng(1)
    f1, f2 = rng.uniform(0.2, 2.0, (2, 500)) * rng.choice([-1.0, 1.0], (2, 500))
    # With omega 1 there is an edge where the two are equal, or opposite in the difference.
    keep = np.abs(np.abs(f1) - np.abs(f2)) > 1e-3
    f1, f2, step = f1[keep], f2[keep], 1e-5
    one, two = slopes(f1, f2, omega, smoothness=smoothness)

    def value(a: Any, b: Any) -> Any:
        return function(a, b, omega, smoothness=smoothness)

    central = (value(f1 + step, f2) - value(f1 - step, f2)) / (2 * step)
    assert np.allclose(one, central, rtol=1e-5, atol=1e-7)
    central = (value(f1, f2 + step) - value(f1, f2 - step)) / (2 * step)
    assert np.allclose(two, central, rtol=1e-5, atol=1e-7)


@settings(derandomize=True, deadline=None, max_examples=50)
@given(VALUES, VALUES, st.sampled_from(OMEGAS))
def test_a_small_slope_keeps_its_digits(f1: float, f2: float, omega: float) -> None:
    with mpmath.workdps(900):
        a, b, w = mpmath.mpf(f1), mpmath.mpf(f2), mpmath.mpf(omega)
        root = mpmath.sqrt(a * a + b * b - 2 * w * a * b)
        if root == 0:
            return
        wanted = (1 - (a - w * b) / root) / (1 + w)
    found = conjunction_slopes(f1, f2, omega)[0]
    assert abs(float(found) - wanted) <= 4e-15 * abs(wanted) + 1e-300


def test_where_both_vanish_the_slopes_are_the_middle_of_those_around() -> None:
    turn = 2 * np.pi * np.arange(400) / 400
    for omega in (-0.5, 0.0, 0.7, 1.0):
        around = conjunction_slopes(np.cos(turn), np.sin(turn), omega)
        for part, found in zip(around, conjunction_slopes(0.0, 0.0, omega), strict=True):
            assert found == pytest.approx(0.5 * (part.min() + part.max()), rel=1e-3)
    assert conjunction_slopes(0.0, 0.0, smoothness=1) == (0.0, 0.0)


def test_the_smooth_forms_multiply_by_a_power_of_both() -> None:
    f1, f2 = np.random.default_rng(2).normal(size=(2, 100))
    for k in (1, 2, 3):
        times = (f1**2 + f2**2) ** (k / 2)
        assert np.allclose(conjunction(f1, f2, smoothness=k), conjunction(f1, f2) * times)
        assert np.allclose(disjunction(f1, f2, smoothness=k), disjunction(f1, f2) * times)


def test_a_value_that_leaves_the_range_of_floats_keeps_its_sign() -> None:
    assert conjunction(1e200, 1e200, smoothness=1) == np.finfo(float).max
    assert conjunction(-1e200, 1e200, smoothness=1) == -np.finfo(float).max
    assert 0.0 < conjunction(1e-200, 1e-200, smoothness=1) < 1e-300


@pytest.mark.parametrize("smoothness", [2, 50])
def test_where_one_value_is_none_and_the_other_huge_there_is_no_nan(smoothness: int) -> None:
    assert conjunction(0.0, 1e200, smoothness=smoothness) == 0.0
    assert disjunction(0.0, -1e200, smoothness=smoothness) == 0.0


def test_arrays_broadcast() -> None:
    column, row = np.arange(3.0)[:, None], np.arange(4.0)
    assert conjunction(column, row).shape == (3, 4)
    assert all(part.shape == (3, 4) for part in conjunction_slopes(column, row))


@pytest.mark.parametrize("omega", [-1.0, 1.0 + 1e-12, math.nan])
def test_an_omega_out_of_range_is_refused(omega: float) -> None:
    with pytest.raises(ValueError, match=f"omega must be above -1 and at most 1, got {omega}"):
        conjunction(1.0, 1.0, omega)


def test_a_negative_smoothness_is_refused() -> None:
    with pytest.raises(ValueError, match="smoothness must be 0 or more, got -1"):
        disjunction(1.0, 1.0, smoothness=-1)


@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_values_that_are_not_finite_are_refused(value: float) -> None:
    with pytest.raises(ValueError, match="f2 must be finite"):
        disjunction(1.0, [1.0, value])
    with pytest.raises(ValueError, match="f must be finite"):
        complement(value)


def test_a_large_and_a_small_value_an_omega_near_its_end_huge_values_and_none_keep_all_digits() -> (
    None
):
    # As printed, the difference of two numbers near 1e8 leaves 1.49e-8.
    assert conjunction(1e8, 1e-8) == pytest.approx(1e-8, rel=1e-15)
    assert disjunction(-1e8, -1e-8) == pytest.approx(-1e-8, rel=1e-15)
    # As omega nears -1 the conjunction nears f1 f2 / (f1 + f2), 0 over 0 as printed.
    assert conjunction(0.3, 0.5, -1.0 + 1e-12) == pytest.approx(0.15 / 0.8, rel=1e-11)
    assert conjunction(1e200, 1e200) == pytest.approx((2 - math.sqrt(2)) * 1e200, rel=1e-15)
    assert conjunction(0.0, 0.0) == 0.0 == disjunction(0.0, 0.0)
    for omega in (-1.0 + 1e-12, 0.0, 1.0):
        for pair in ((0.0, 0.0), (1e200, 1e-200), (1e8, -1e-8), (3e-310, 3e-310)):
            slopes = [*conjunction_slopes(*pair, omega), *disjunction_slopes(*pair, omega)]
            assert np.isfinite(slopes).all()
