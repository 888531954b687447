from __future__ import annotations

import math

import numpy as np
import pytest

from palpate.core.shapes.r_functions import (
    conjunction,
    conjunction_slopes,
    disjunction,
    disjunction_slopes,
)


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
