from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from palpate.core.arrays import Floats
from palpate.core.shapes.dent import Dent

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
