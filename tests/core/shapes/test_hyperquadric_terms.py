from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from palpate.core.arrays import Floats
from palpate.core.shapes.hyperquadric_terms import (
    LARGEST,
    Dent,
    line_above,
    line_below,
    power_slopes,
    powers,
    range_of_powers,
    range_of_slopes,
)

PLANES = np.array([[40.0, 0.0, 0.0, -1.0], [0.0, 30.0, 10.0, 0.5]])
ALONG = np.linspace(0.0, 1.0, 801)


def value(dent: Dent, h: Floats) -> Floats:
    found: Floats = dent.depth * np.exp(-(np.abs(h) ** dent.exponents[:, None]).sum(axis=0))
    return found


@given(
    depth=st.sampled_from([2.0, 0.5, -0.7]),
    exponents=st.tuples(*[st.sampled_from([0.3, 1.0, 1.5, 2.0, 3.0, 6.0])] * 2),
    h=st.tuples(*[st.floats(-2.0, 2.0)] * 2),
    rate=st.tuples(*[st.floats(-40.0, 40.0)] * 2),
    length=st.floats(1e-3, 0.1),
)
@settings(derandomize=True, deadline=None, max_examples=50)
def test_lines_and_the_dip_hold(
    depth: float, exponents: tuple[float], h: tuple[float], rate: tuple[float], length: float
) -> None:
    dent = Dent(depth, PLANES, np.array(exponents))
    here, rates, lengths = np.array(h)[:, None], np.array(rate)[:, None], np.array([length])
    way = length * ALONG
    values = value(dent, here + rates * way)
    low, high = dent.line_below(here, rates, lengths), dent.line_above(here, rates, lengths)
    assert (values >= values[0] - low.gap[0] + low.slope[0] * way - 1e-12).all()
    assert (values <= values[0] + high.gap[0] + high.slope[0] * way + 1e-12).all()
    bends = np.diff(values, 2) / (length / 800) ** 2
    assert bends.min() >= -dent.dip(rates) * (1 + 1e-6) - 1e-3


def test_the_slope_is_the_derivative() -> None:
    dent = Dent(-0.7, PLANES, np.array([2.0, 3.0]))
    h, rate = np.array([[0.4, -1.0], [0.3, 0.8]]), np.array([[5.0, -2.0], [1.0, 7.0]])
    numeric = (value(dent, h + 1e-6 * rate) - value(dent, h - 1e-6 * rate)) / 2e-6
    found = dent.along(h, rate)
    assert np.allclose(found[0], value(dent, h), rtol=1e-14)
    assert np.allclose(found[1], numeric, rtol=1e-8)


def test_the_dip_of_a_round_dent_is_exact_and_a_crease_has_none() -> None:
    rate = np.array([[3.0], [4.0]])
    assert Dent(0.5, PLANES, np.full(2, 2.0)).dip(rate) == pytest.approx(0.5 * 2 * 25)
    assert Dent(0.5, PLANES, np.array([2.0, 1.9])).dip(rate) == math.inf


@pytest.mark.parametrize(
    ("depth", "planes", "exponents", "sentence"),
    [
        (math.nan, PLANES, [2, 2], "depth must be finite, got nan"),
        (1.0, np.zeros((0, 4)), [], "planes must be at least one, got none"),
        (1.0, PLANES, [2], r"exponents must have shape \(2\)"),
        (1.0, PLANES, [2, 0.05], "exponents must lie between 0.1 and 100"),
        (1.0, PLANES, [2, 101], "exponents must lie between 0.1 and 100"),
        (1.0, np.full((2, 4), np.inf), [2, 2], "planes must be finite"),
        (1.0, PLANES * [[1], [0]], [2, 2], r"planes\[1\] must face somewhere: .* long, got 0"),
        (1.0, PLANES * [[1e-300], [1]], [2, 2], r"planes\[0\] must face somewhere"),
    ],
)
def test_what_cannot_be_is_refused(
    depth: float, planes: Floats, exponents: list[float], sentence: str
) -> None:
    with pytest.raises(ValueError, match=sentence):
        Dent(depth, planes, np.array(exponents))


few = settings(derandomize=True, deadline=None, max_examples=50)
case = given(
    h=st.one_of(st.just(0.0), st.floats(-2.0, 2.0)),
    rate=st.floats(-50.0, 50.0),
    exponent=st.sampled_from([0.1, 0.5, 0.9, 1.0, 1.5, 2.0, 8.0, 40.0]),
    length=st.floats(1e-3, 0.1),
)
ALONG_POWERS = np.linspace(0.0, 1.0, 501)


def seen(h: float, rate: float, exponent: float, length: float) -> np.ndarray:
    found: np.ndarray = np.abs(h + rate * length * ALONG_POWERS) ** exponent
    return found


@case
@few
def test_lines_stay_below_and_above(h: float, rate: float, exponent: float, length: float) -> None:
    one = np.array([[h]]), np.array([[rate]]), np.array([[exponent]]), np.array([length])
    values = seen(h, rate, exponent, length)
    room = 1e-12 * (1 + values.max())
    low, high = line_below(*one), line_above(*one)
    way = length * ALONG_POWERS
    assert (values >= values[0] - low.gap[0] + low.slope[0] * way - room).all()
    assert (values <= values[0] + high.gap[0] + high.slope[0] * way + room).all()


@case
@few
def test_ranges_hold_all_that_is_seen(
    h: float, rate: float, exponent: float, length: float
) -> None:
    one = np.array([[h]]), np.array([[rate]]), np.array([[exponent]]), np.array([length])
    values = seen(h, rate, exponent, length)
    least, most = range_of_powers(*one)[:, 0, 0]
    assert least <= values.min() * (1 + 1e-12)
    assert values.max() <= most * (1 + 1e-12)
    low, high = range_of_slopes(*one)[:, 0, 0]
    slopes = np.diff(values) / (length / 500)
    room = 1e-9 * (1 + np.abs(slopes).max())
    assert low - room <= slopes.min()
    assert slopes.max() <= high + room


def test_slopes_are_derivatives_and_finite_in_a_cusp() -> None:
    h, rate = np.array([[0.7, -0.3, 0.0, 1.2]]), np.full((1, 4), -3.0)
    for exponent in (0.5, 1.0, 3.0):
        g = np.array([[exponent]])
        numeric = (powers(h + 1e-6 * rate, g) - powers(h - 1e-6 * rate, g)) / 2e-6
        assert np.allclose(power_slopes(h, rate, g), numeric, rtol=1e-6, atol=1e-6)
    assert power_slopes(np.zeros((1, 1)), np.ones((1, 1)), np.array([[0.1]]))[0, 0] == 0.0


def test_no_power_overflows() -> None:
    huge, g = np.array([[1e300]]), np.array([[100.0]])
    assert powers(huge, g)[0, 0] == pytest.approx(LARGEST**100)
    assert np.isfinite(power_slopes(huge, np.array([[1.0]]), g)).all()


def test_a_line_from_a_cusp_upwards_has_a_gap_and_no_slope() -> None:
    line = line_above(np.zeros((1, 1)), np.ones((1, 1)), np.array([[0.5]]), np.array([0.04]))
    assert line.slope[0, 0] == 0.0
    assert line.gap[0, 0] == pytest.approx(0.2)
