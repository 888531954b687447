from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from palpate.core.shapes.piecewise import natural_spline, periodic_spline, straight_pieces

KNOTS = np.array([0.0, 0.02, 0.05, 0.06, 0.1])
VALUES = np.array([1.0, 1.3, 0.5, 0.6, 0.2])


def test_the_natural_spline_is_the_one_of_the_textbooks() -> None:
    ours, theirs = natural_spline(KNOTS, VALUES), CubicSpline(KNOTS, VALUES, bc_type="natural")
    places = np.linspace(0.0, 0.1, 101)
    for order, found in enumerate(ours.at(places, ours.piece(places))):
        assert np.allclose(found, theirs(places, order), rtol=1e-9, atol=1e-9)


def test_the_periodic_spline_is_the_one_of_the_textbooks() -> None:
    for count in (3, 4, 9):
        values = np.random.default_rng(count).uniform(0.5, 1.5, count)
        knots = np.linspace(0.0, 2 * np.pi, count + 1)
        ours = periodic_spline(knots, values)
        theirs = CubicSpline(knots, np.append(values, values[0]), bc_type="periodic")
        places = np.linspace(0.0, 2 * np.pi, 101)[:-1]
        for order, found in enumerate(ours.at(places, ours.piece(places))):
            assert np.allclose(found, theirs(places, order), rtol=1e-9, atol=1e-9)


def test_straight_pieces_go_from_value_to_value() -> None:
    curve = straight_pieces(KNOTS, VALUES)
    places = np.linspace(-0.01, 0.1, 56)
    value, slope, bend = curve.at(places, curve.piece(places))
    inner = places >= 0.0
    assert np.allclose(value[inner], np.interp(places[inner], KNOTS, VALUES))
    assert slope[0] == pytest.approx(15.0)  # carried on before the first knot
    assert (bend == 0.0).all()


@pytest.mark.parametrize("make", [natural_spline, straight_pieces])
def test_the_range_holds_all_values_and_is_met(make: type) -> None:
    rng = np.random.default_rng(8)
    for _ in range(20):
        knots = np.cumsum(rng.uniform(0.1, 1.0, 6))
        curve = make(knots, rng.normal(size=6))
        places = np.linspace(knots[0], knots[-1], 4001)
        seen = curve.at(places, curve.piece(places))[0]
        low, high = curve.value_range()
        assert low <= seen.min() <= low + 2e-3
        assert high - 2e-3 <= seen.max() <= high


def test_extremes_of_parabolas_and_of_a_level_line_are_found() -> None:
    hill = natural_spline(np.array([0.0, 1.0, 2.0]), np.array([0.0, 1.0, 0.0]))
    assert np.isclose(hill.value_range()[1], 1.0)
    level = straight_pieces(np.array([0.0, 1.0]), np.array([2.0, 2.0]))
    assert level.value_range() == (2.0, 2.0)
    assert len(level.extremes()[0]) == 0
