from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import CubicSpline

from palpate.core.shapes.sections import (
    Section,
    SplineSection,
    SuperellipseSection,
    natural_spline,
    periodic_spline,
    straight_pieces,
)

SECTIONS: list[Section] = [
    SplineSection(np.full(5, 0.03)),
    SplineSection(np.array([0.03, 0.02, 0.03, 0.02])),
    SplineSection(np.array([0.03, 0.022, 0.035, 0.021, 0.027, 0.031])),
    SuperellipseSection(np.array([0.03, 0.02]), 0.1),
    SuperellipseSection(np.array([0.02, 0.03]), 1.0),
    SuperellipseSection(np.array([0.03, 0.02]), 1.7),
]
every = pytest.mark.parametrize("section", SECTIONS)


@every
def test_the_gauge_is_1_on_the_outline_and_grows_evenly(section: Section) -> None:
    points = section.outline(64)
    for share in (0.3, 1.0, 2.0):
        gauge = section.gauge_along(*(share * points.T), np.ones(64), np.ones(64))[0]
        assert np.allclose(gauge, share, rtol=0, atol=1e-14)
    turn = np.arctan2(points[:, 1], points[:, 0])
    assert (np.diff(turn[turn > -1e-12]) > 0).all()


@every
def test_slopes_are_derivatives(section: Section) -> None:
    rng = np.random.default_rng(1)
    (x, y), (dx, dy) = rng.uniform(-0.04, 0.04, (2, 300)), rng.normal(size=(2, 300))
    step = 1e-8
    there, back = (section.gauge_along(x + s * dx, y + s * dy, dx, dy)[0] for s in (step, -step))
    slope = section.gauge_along(x, y, dx, dy)[1]
    assert np.quantile(np.abs(slope - (there - back) / (2 * step)), 0.95) < 1e-4
    assert np.isfinite(section.gauge_along(*np.zeros((2, 1)), *np.ones((2, 1)))).all()


@every
def test_the_bounds_hold_all_around(section: Section) -> None:
    traits, azimuth = section.traits, np.linspace(0, 2 * math.pi, 20001)
    x, y = np.cos(azimuth), np.sin(azimuth)
    gauge, bend_way = section.gauge_along(x, y, -y, x)
    step = azimuth[1]
    assert traits.radius[0] <= (1 / gauge).min() * (1 + 1e-12)
    assert (1 / gauge).max() * (1 - 1e-12) <= traits.radius[1]
    bends = gauge + np.gradient(np.gradient(gauge, step), step)
    inner = bends[3:-3]
    assert inner.min() >= -traits.hollow - 1e-3 * traits.steepest
    assert inner.max() <= traits.bulge + 1e-2 * traits.steepest
    assert np.hypot(gauge, bend_way).max() <= traits.steepest * (1 + 1e-9)


def test_convex_sections_are_known_to_be_convex() -> None:
    assert [section.traits.hollow == 0.0 for section in SECTIONS] == [
        True, False, False, True, True, True,
    ]  # fmt: skip


@given(radii=st.lists(st.floats(0.5, 1.5), min_size=3, max_size=8))
@settings(derandomize=True, deadline=None, max_examples=30)
def test_no_chord_shows_a_section_hollower_than_it_says(radii: list[float]) -> None:
    section = SplineSection(np.array(radii))
    start = np.linspace(0, 2 * math.pi, 40)
    x, y = 0.7 * np.cos(start), 0.7 * np.sin(start)
    dx, dy = 0.3 * np.cos(2 * start + 1), 0.3 * np.sin(2 * start + 1)
    gauge, slope = section.gauge_along(x, y, dx, dy)
    after = section.gauge_along(x + dx, y + dy, dx, dy)[0]
    near = np.hypot(x, y) - 0.3
    across = np.abs(x * dy - y * dx)
    assert (after >= gauge + slope - 0.5 * section.traits.hollow * across**2 / near**3 - 1e-9).all()


@pytest.mark.parametrize(
    ("radii", "sentence"),
    [
        ([0.03, 0.03], "radii must be 3 to 64, got 2"),
        ([0.03] * 65, "radii must be 3 to 64, got 65"),
        ([0.03, 0.0, 0.03], "radii must be positive"),
        ([1e-320] * 3, "radii must be positive, 1e-09 m or more"),
        ([0.03, math.inf, 0.03], "radii must be finite"),
        ([1.0, 1.0, 0.001, 0.001, 0.001, 1.0], "the curve through them reaches the axis"),
    ],
)
def test_radii_that_make_no_section_are_refused(radii: list[float], sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence):
        SplineSection(np.array(radii))


@pytest.mark.parametrize(
    ("size", "exponent", "sentence"),
    [
        ([0.03, 0.0], 1.0, "size must be positive"),
        ([0.03, 1e-320], 1.0, "size must be positive, 1e-09 m or more"),
        ([0.03], 1.0, r"size must have shape \(2\)"),
        ([0.03, 0.02], 2.5, "exponent must lie between 0.02 and 2.0, got 2.5"),
        ([0.03, 0.02], math.nan, "exponent must lie between"),
    ],
)
def test_superellipses_that_are_none_are_refused(
    size: list[float], exponent: float, sentence: str
) -> None:
    with pytest.raises(ValueError, match=sentence):
        SuperellipseSection(np.array(size), exponent)


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
