from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from palpate.core.arrays import Floats
from palpate.core.explore.planners.hats import (
    even_curve_knots,
    fit_falling,
    free_knots,
    hat_matrix,
    polyline_of,
)
from palpate.core.explore.planners.templates import TEMPLATES, Template

PLACES = np.linspace(0.0, 10.0, 200)


def worst(values: Floats, knots: Floats) -> float:
    line = fit_falling(PLACES, values, knots)
    return float(np.abs(np.interp(PLACES, line.knots, line.values) - values).max())


def test_case_68_knots_that_coincide_leave_the_fit_well_conditioned() -> None:
    even = np.linspace(0.0, 10.0, 6)
    near = even.copy()
    near[2] = near[1] + 1e-6

    assert np.linalg.cond(np.abs(PLACES[:, None] - near)) > 1e6  # the basis of (3.29)
    for knots in (even, near):
        assert np.linalg.cond(hat_matrix(PLACES, knots)) < 3.0


def test_hats_span_what_the_thesis_writes_with_absolute_values() -> None:
    knots = np.array([0.0, 1.0, 2.5, 7.0, 10.0])
    theirs = np.abs(PLACES[:, None] - knots) @ np.array([0.3, -1.0, 0.2, 0.7, 0.1])
    at_knots = np.abs(knots[:, None] - knots) @ np.array([0.3, -1.0, 0.2, 0.7, 0.1])

    np.testing.assert_allclose(hat_matrix(PLACES, knots) @ at_knots, theirs, atol=1e-13)


@pytest.mark.parametrize("template", TEMPLATES)
def test_knots_of_even_curve_beat_even_knots(template: Template) -> None:
    values = TEMPLATES[template](PLACES, 2.0)
    even = worst(values, np.linspace(0.0, 10.0, 6))

    assert worst(values, even_curve_knots(PLACES, values, 5)) < 0.4 * even


def test_free_knots_are_no_worse_in_the_least_squares_and_stay_in_order() -> None:
    values = np.exp(-0.5 * PLACES)
    start = fit_falling(PLACES, values, even_curve_knots(PLACES, values, 5))
    line = free_knots(PLACES, values, 5)

    def squares(knots: Floats, heights: Floats) -> float:
        return float(((np.interp(PLACES, knots, heights) - values) ** 2).sum())

    assert squares(line.knots, line.values) <= squares(start.knots, start.values)
    assert (np.diff(line.knots) > 0.0).all()
    assert line.knots[[0, -1]].tolist() == [0.0, 10.0]


@settings(derandomize=True, deadline=None, max_examples=20)
@given(
    power=st.floats(0.2, 5.0),
    segments=st.integers(1, 12),
    template=st.sampled_from(sorted(TEMPLATES)),
)
def test_a_polyline_of_a_template_falls_and_stays_between_0_and_1(
    power: float, segments: int, template: Template
) -> None:
    line = polyline_of(lambda x: TEMPLATES[template](x, power), 40.0, segments)

    assert (np.diff(line.values) <= 1e-12).all()
    assert 0.0 <= line.at(1e9) <= line.at(0.0) <= 1.02


def test_knots_that_do_not_increase_are_refused() -> None:
    with pytest.raises(ValueError, match="knots must be at least 2 and increase"):
        hat_matrix(PLACES, np.array([0.0, 1.0, 1.0, 2.0]))


def test_functions_that_cannot_be_fitted_are_refused() -> None:
    with pytest.raises(ValueError, match="segments must be at least 1, got 0"):
        even_curve_knots(PLACES, PLACES, 0)
    with pytest.raises(ValueError, match="places must be at least 3 and increase"):
        free_knots(PLACES[::-1], PLACES, 3)
    with pytest.raises(ValueError, match="values must have shape"):
        free_knots(PLACES, PLACES[:5], 3)
