from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from palpate.core.shapes.bound import ONE, Bound

coefficients = st.lists(st.floats(-5, 5), min_size=1, max_size=4)
T = np.linspace(-1.0, 1.0, 201)


def bound_of(polynomial: np.polynomial.Polynomial) -> Bound:
    values = [float(np.abs(polynomial.deriv(n)(T)).max()) for n in (1, 2)]
    return Bound(float(np.abs(polynomial(T)).max()), *values)


@given(coefficients, coefficients, st.floats(-3, 3))
def test_products_sums_and_multiples_stay_within_their_bounds(
    first: list[float], second: list[float], factor: float
) -> None:
    f, g = np.polynomial.Polynomial(first), np.polynomial.Polynomial(second)
    for made, bound in (
        (f * g, bound_of(f).times(bound_of(g))),
        (f + g, bound_of(f).plus(bound_of(g))),
        (factor * f, bound_of(f).scaled(factor)),
    ):
        for have, most in zip(bound_of(made), bound, strict=True):
            assert have <= most * (1 + 1e-12) + 1e-12


def test_one_times_anything_is_that() -> None:
    some = Bound(2.0, 3.0, 4.0)
    assert ONE.times(some) == some
