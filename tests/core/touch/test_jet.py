from __future__ import annotations

import numpy as np
import pytest

from palpate.core.touch.jet import COUNTS, Jet, derivative_rows, monomials


def test_slopes_and_second_derivatives_are_those_of_the_height() -> None:
    jet = Jet(np.random.default_rng(0).normal(size=15), 0.5)
    x, y = np.random.default_rng(1).uniform(-0.4, 0.4, (2, 30))
    h = 1e-5
    ahead_x, back_x = jet.slopes(x + h, y), jet.slopes(x - h, y)
    ahead_y, back_y = jet.slopes(x, y + h), jet.slopes(x, y - h)
    slope_x, slope_y = jet.slopes(x, y)
    by_xx, by_xy, by_yy = jet.second_derivatives(x, y)
    assert np.allclose(slope_x, (jet.height(x + h, y) - jet.height(x - h, y)) / (2 * h), atol=1e-7)
    assert np.allclose(slope_y, (jet.height(x, y + h) - jet.height(x, y - h)) / (2 * h), atol=1e-7)
    assert np.allclose(by_xx, (ahead_x[0] - back_x[0]) / (2 * h), atol=1e-6)
    assert np.allclose(by_xy, (ahead_x[1] - back_x[1]) / (2 * h), atol=1e-6)
    assert np.allclose(by_xy, (ahead_y[0] - back_y[0]) / (2 * h), atol=1e-6)
    assert np.allclose(by_yy, (ahead_y[1] - back_y[1]) / (2 * h), atol=1e-6)


@pytest.mark.parametrize("degree", [1, 2, 3, 4])
def test_rows_and_monomials_say_what_the_jet_says(degree: int) -> None:
    jet = Jet(np.random.default_rng(2).normal(size=COUNTS[degree]), 1.0)
    at_x, at_y = np.array([0.3]), np.array([-0.7])
    found = derivative_rows(0.3, -0.7, degree) @ jet.coefficients
    wanted = [jet.height(at_x, at_y), *jet.slopes(at_x, at_y), *jet.second_derivatives(at_x, at_y)]
    assert jet.degree == degree
    assert np.allclose(found, np.concatenate(wanted), rtol=1e-13)
    assert np.allclose(monomials(at_x, at_y, degree) @ jet.coefficients, found[0], rtol=1e-13)
