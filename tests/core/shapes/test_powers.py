from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from palpate.core.shapes.powers import (
    LARGEST,
    line_above,
    line_below,
    power_slopes,
    powers,
    range_of_powers,
    range_of_slopes,
)

few = settings(derandomize=True, deadline=None, max_examples=50)
case = given(
    h=st.one_of(st.just(0.0), st.floats(-2.0, 2.0)),
    rate=st.floats(-50.0, 50.0),
    exponent=st.sampled_from([0.1, 0.5, 0.9, 1.0, 1.5, 2.0, 8.0, 40.0]),
    length=st.floats(1e-3, 0.1),
)
ALONG = np.linspace(0.0, 1.0, 501)


def seen(h: float, rate: float, exponent: float, length: float) -> np.ndarray:
    found: np.ndarray = np.abs(h + rate * length * ALONG) ** exponent
    return found


@case
@few
def test_lines_stay_below_and_above(h: float, rate: float, exponent: float, length: float) -> None:
    one = np.array([[h]]), np.array([[rate]]), np.array([[exponent]]), np.array([length])
    values = seen(h, rate, exponent, length)
    room = 1e-12 * (1 + values.max())
    low, high = line_below(*one), line_above(*one)
    way = length * ALONG
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
