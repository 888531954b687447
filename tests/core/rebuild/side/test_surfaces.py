from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from palpate.core.arrays import Floats
from palpate.core.rebuild.side.lofting import fit_contour_loft
from palpate.core.rebuild.side.surfaces import (
    MOST_SITES,
    AxialParameter,
    ContourSurface,
    SidePatch,
    basis_along,
    reparametrisation_through,
)
from palpate.core.splines.bases import is_interpolable

TURNS = np.arange(40) / 40
RIM = np.stack([np.cos(2 * np.pi * TURNS), np.sin(2 * np.pi * TURNS)], axis=-1)


@pytest.fixture(scope="module")
def ball() -> ContourSurface:
    """Of radius 1 about (3, -2, 0), from its lower pole to the height 0.9."""
    heights = np.linspace(-0.9, 0.9, 19)
    grid = np.sqrt(1.0 - heights**2)[:, None, None] * RIM + np.array([3.0, -2.0])
    return fit_contour_loft(heights, grid, low=-1.0, high=1.0, pole=(True, False)).surface


def away(points: Floats) -> Floats:
    return np.linalg.norm(points - np.array([3.0, -2.0, 0.0]), axis=-1)


def test_places_lie_on_the_ball_from_its_pole_to_the_last_contour(ball):
    low, high = ball.along.domain
    points = ball.places(np.linspace(low, high, 100), np.linspace(0.0, 3.0, 100))
    assert np.abs(away(points) - 1.0).max() < 1e-4
    assert np.allclose(ball.reach, (-1.0, 0.9))
    assert np.allclose(points[0], [3.0, -2.0, -1.0], atol=1e-12)


def test_heights_and_turns_are_broadcast(ball):
    heights = np.linspace(-0.8, 0.8, 5)
    grid = ball.at(heights[:, None], TURNS)
    assert grid.shape == (5, 40, 2)
    assert np.array_equal(ball.at(heights[2], TURNS[7]), grid[2, 7])
    parameters = ball.within(heights)
    assert np.allclose(ball.on_grid(parameters, TURNS), grid, atol=1e-14)
    points = ball.places(np.repeat(parameters, 40), np.tile(TURNS, 5))
    assert np.allclose(points[:, :2].reshape(5, 40, 2), grid, atol=1e-14)
    assert np.allclose(points[:, 2], np.repeat(heights, 40))


@pytest.mark.parametrize("by", [(1, 0), (0, 1), (1, 1), (0, 2)])
def test_derivatives_by_height_and_turn_are_those_of_differences(ball, by):
    heights, turns = np.meshgrid([-0.7, 0.1, 0.6], [0.03, 0.41], indexing="ij")
    step = 1e-5
    lower = (by[0], by[1] - 1) if by[1] else (0, 0)
    h, t = (0.0, step) if by[1] else (step, 0.0)
    forth, back = ball.at(heights + h, turns + t, lower), ball.at(heights - h, turns - t, lower)
    wanted = (forth - back) / (2 * step)
    assert np.allclose(ball.at(heights, turns, by), wanted, rtol=1e-6, atol=1e-5)


@pytest.mark.parametrize("by", [(1, 0), (0, 1), (2, 0), (1, 1), (0, 2)])
def test_derivatives_by_the_parameter_are_smooth_up_to_the_pole(ball, by):
    low, high = ball.along.domain
    parameters, turns = np.array([low, low + 0.1, high]), np.full(3, 0.2)
    found = ball.places(parameters, turns, by)
    assert np.isfinite(found).all()
    assert np.abs(found).max() < 50.0
    assert np.allclose(found[:, :2], ball.on_grid(parameters, turns[:1], by)[:, 0], atol=1e-13)


def test_beyond_its_reach_the_section_is_carried_on(ball):
    last = ball.at(0.9, TURNS)
    assert np.array_equal(ball.at(0.97, TURNS), last)
    assert np.array_equal(ball.at(0.97, TURNS, (1, 0)), np.zeros((40, 2)))


def test_a_side_patch_runs_from_0_to_1(ball):
    side = SidePatch(ball)
    ends = side.at(np.array([0.0, 1.0]), np.array([0.3, 0.3]))
    assert np.allclose(ends[:, 2], [-1.0, 0.9])
    v, turns, step = np.array([0.2, 0.7]), np.array([0.1, 0.9]), 1e-5
    for order in (0, 1):
        wanted = (side.at(v + step, turns, (order, 0)) - side.at(v - step, turns, (order, 0))) / (
            2 * step
        )
        assert np.allclose(side.at(v, turns, (order + 1, 0)), wanted, rtol=1e-5, atol=1e-5)


def test_derivatives_that_are_not_offered_and_bad_numbers_are_refused(ball):
    with pytest.raises(ValueError, match="by must be 0 or 1 in the height, got 2"):
        ball.at(0.0, 0.0, (2, 0))
    with pytest.raises(ValueError, match="heights must be finite"):
        ball.at(np.nan, 0.0)
    with pytest.raises(ValueError, match="turns must be finite"):
        ball.at(0.0, np.inf)
    with pytest.raises(ValueError, match="x must lie in the domain"):
        ball.places(np.array([99.0]), np.zeros(1))


KINDS = list(itertools.product((False, True), repeat=2))


@pytest.mark.parametrize("kind", KINDS)
def test_heights_and_parameters_are_inverse(kind):
    axis = AxialParameter(-2.0, 5.0, kind)
    heights = np.linspace(-2.0, 5.0, 201)
    parameters = axis.of(heights)
    assert (np.diff(parameters) > 0.0).all()
    assert np.allclose(axis.height(parameters), heights, rtol=0, atol=1e-14)


@pytest.mark.parametrize("kind", KINDS)
def test_the_height_stands_still_at_round_ends_alone(kind):
    axis = AxialParameter(1.0, 3.0, kind)
    slopes = axis.height(axis.of(np.array([1.0, 3.0])), 1)
    assert (np.abs(slopes) < 1e-15).tolist() == list(kind)


@pytest.mark.parametrize("kind", KINDS)
def test_derivatives_of_the_height_are_those_of_differences(kind):
    axis = AxialParameter(-1.0, 0.5, kind)
    places = axis.of(np.linspace(-0.9, 0.4, 7))
    step = 1e-4
    below, here, above = (axis.height(places + way * step) for way in (-1, 0, 1))
    assert np.allclose(axis.height(places, 1), (above - below) / (2 * step), atol=1e-6)
    assert np.allclose(axis.height(places, 2), (above - 2 * here + below) / step**2, atol=1e-5)


def test_the_radius_of_a_ball_is_a_cosine_of_its_latitude_up_to_the_pole():
    gap = np.array([1e-15, 1e-12, 1e-6, 0.1])
    axis = AxialParameter(-1.0, 1.0, (True, True))
    heights = 1.0 - gap
    exact = np.sqrt((1.0 - heights) * (1.0 + heights))
    assert np.allclose(np.cos(axis.of(heights)), exact, rtol=1e-8, atol=0.0)


def test_heights_beyond_an_end_are_taken_to_it():
    for kind in KINDS:
        axis = AxialParameter(0.0, 1.0, kind)
        assert axis.of(np.array([-3.0, 4.0])).tolist() == axis.of(np.array([0, 1.0])).tolist()


def test_the_unit_of_the_heights_does_not_matter():
    heights = np.linspace(0.0, 1.0, 9)
    for kind in KINDS:
        usual = AxialParameter(0.0, 1.0, kind).of(heights)
        for unit in (1e-9, 1e9):
            assert np.allclose(
                AxialParameter(0.0, unit, kind).of(unit * heights), usual, rtol=1e-14
            )


@pytest.mark.parametrize(("sites", "degree"), [(2, 1), (3, 2), (4, 3), (5, 3), (40, 3)])
def test_the_degree_is_lower_where_there_are_few_sites(sites, degree):
    places = np.linspace(-1.0, 1.0, sites) ** 3
    basis = basis_along(places, (-2.0, 2.0))
    assert (basis.degree, basis.count) == (degree, sites)
    assert basis.domain == (places[0], places[-1])


def test_a_single_site_has_a_line_between_the_ends():
    basis = basis_along(np.array([0.3]), (-1.0, 1.0))
    assert (basis.degree, basis.count, basis.domain) == (1, 2, (-1.0, 1.0))


def test_very_many_sites_share_intervals():
    basis = basis_along(np.linspace(0.0, 1.0, 1000), (0.0, 1.0))
    assert basis.count == MOST_SITES
    assert basis.domain == (0.0, 1.0)


@settings(derandomize=True, deadline=None, max_examples=40)
@given(st.lists(st.floats(1e-4, 1.0), min_size=1, max_size=30))
def test_values_at_any_rising_sites_can_be_interpolated(steps):
    sites = np.cumsum([0.0, *steps])
    assert is_interpolable(basis_along(sites, (0.0, 1.0)), sites)


EVEN = np.array([0.0, 0.2, 0.21, 0.5, 0.9, 1.0])
LENGTHS = np.array([1.0, 4.0, 1.5, 2.0, 0.5])


def test_a_reparametrisation_passes_its_places_and_spans_what_the_values_do():
    mapping = reparametrisation_through(EVEN, LENGTHS)
    assert np.allclose(mapping.mapped, np.append(0.0, np.cumsum(LENGTHS)) / LENGTHS.sum())
    assert np.abs(mapping.of(EVEN) - mapping.mapped).max() < 1e-14
    assert np.abs(mapping.value(mapping.mapped) - EVEN).max() < 1e-14


@given(
    steps=st.lists(st.tuples(st.floats(1e-4, 1.0), st.floats(1e-4, 1.0)), min_size=1, max_size=9)
)
@settings(derandomize=True, deadline=None, max_examples=50)
def test_it_rises_and_is_undone_by_its_inverse(steps):
    rises, lengths = np.array(steps).T
    even = np.concatenate([[-1.0], -1.0 + np.cumsum(rises)])
    mapping = reparametrisation_through(even, lengths)
    places = np.linspace(mapping.mapped[0], mapping.mapped[-1], 301)
    values = mapping.value(places)
    assert (np.diff(values) > 0.0).all()
    assert np.abs(mapping.value(mapping.of(values)) - values).max() < 1e-10 * np.ptp(even)


def test_its_derivatives_are_those_of_its_values():
    mapping, step = reparametrisation_through(EVEN, LENGTHS), 1e-5
    places = np.linspace(0.01, 0.99, 200)
    places = places[np.abs(places[:, None] - mapping.mapped).min(axis=1) > 2 * step]
    for derivative in (0, 1):
        slope = mapping.value(places + step, derivative) - mapping.value(places - step, derivative)
        wanted = mapping.value(places, derivative + 1)
        assert np.abs(slope / (2 * step) - wanted).max() < 1e-5 * np.abs(wanted).max()


def test_steps_as_long_as_the_values_change_nothing():
    mapping = reparametrisation_through(EVEN, np.diff(EVEN))
    places = np.linspace(0.0, 1.0, 101)
    assert np.abs(mapping.value(places) - places).max() < 1e-14
    assert np.abs(mapping.value(places, 2)).max() < 1e-9


@pytest.mark.parametrize("ends", [(False, False), (True, False), (False, True), (True, True)])
def test_a_reparametrised_axis_knows_its_heights(ends):
    even = AxialParameter(-2.0, 3.0, ends)
    rows = even.of(np.array([-2.0, -1.0, 0.9, 1.0, 3.0]))
    mapped = AxialParameter(
        -2.0, 3.0, ends, reparametrisation_through(rows, np.array([1.0, 2.0, 3.0, 1.0]))
    )
    heights = np.linspace(-2.0, 3.0, 50)
    assert np.abs(mapped.height(mapped.of(heights)) - heights).max() < 1e-12
    places, step = mapped.of(np.linspace(-1.9, 2.9, 40)), 1e-6
    for derivative in (0, 1):
        slope = mapped.height(places + step, derivative) - mapped.height(places - step, derivative)
        wanted = mapped.height(places, derivative + 1)
        assert np.median(np.abs(slope / (2 * step) - wanted)) < 1e-5 * np.abs(wanted).max()
