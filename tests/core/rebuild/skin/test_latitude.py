from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from palpate.core.rebuild.skin.latitude import MOST_SITES, Latitude, basis_along
from palpate.core.splines.collocation import interpolable

KINDS = list(itertools.product((False, True), repeat=2))


@pytest.mark.parametrize("kind", KINDS)
def test_heights_and_latitudes_are_inverse(kind: tuple[bool, bool]) -> None:
    latitude = Latitude(-2.0, 5.0, kind)
    heights = np.linspace(-2.0, 5.0, 201)
    latitudes = latitude.of(heights)
    assert (np.diff(latitudes) > 0.0).all()
    assert np.allclose(latitude.height(latitudes), heights, rtol=0, atol=1e-14)


@pytest.mark.parametrize("kind", KINDS)
def test_the_height_stands_still_at_round_ends_alone(kind: tuple[bool, bool]) -> None:
    latitude = Latitude(1.0, 3.0, kind)
    slopes = latitude.height(latitude.of(np.array([1.0, 3.0])), 1)
    assert (np.abs(slopes) < 1e-15).tolist() == list(kind)


@pytest.mark.parametrize("kind", KINDS)
def test_derivatives_of_the_height_are_those_of_differences(kind: tuple[bool, bool]) -> None:
    latitude = Latitude(-1.0, 0.5, kind)
    places = latitude.of(np.linspace(-0.9, 0.4, 7))
    step = 1e-4
    below, here, above = (latitude.height(places + way * step) for way in (-1, 0, 1))
    assert np.allclose(latitude.height(places, 1), (above - below) / (2 * step), atol=1e-6)
    assert np.allclose(latitude.height(places, 2), (above - 2 * here + below) / step**2, atol=1e-5)


def test_the_radius_of_a_ball_is_a_cosine_of_its_latitude_up_to_the_pole() -> None:
    gap = np.array([1e-15, 1e-12, 1e-6, 0.1])
    latitude = Latitude(-1.0, 1.0, (True, True))
    heights = 1.0 - gap
    exact = np.sqrt((1.0 - heights) * (1.0 + heights))
    assert np.allclose(np.cos(latitude.of(heights)), exact, rtol=1e-8, atol=0.0)


def test_heights_beyond_an_end_are_taken_to_it() -> None:
    for kind in KINDS:
        latitude = Latitude(0.0, 1.0, kind)
        assert (
            latitude.of(np.array([-3.0, 4.0])).tolist() == latitude.of(np.array([0, 1.0])).tolist()
        )


def test_the_unit_of_the_heights_does_not_matter() -> None:
    heights = np.linspace(0.0, 1.0, 9)
    for kind in KINDS:
        usual = Latitude(0.0, 1.0, kind).of(heights)
        for unit in (1e-9, 1e9):
            assert np.allclose(Latitude(0.0, unit, kind).of(unit * heights), usual, rtol=1e-14)


@pytest.mark.parametrize(("sites", "degree"), [(2, 1), (3, 2), (4, 3), (5, 3), (40, 3)])
def test_the_degree_is_lower_where_there_are_few_sites(sites: int, degree: int) -> None:
    places = np.linspace(-1.0, 1.0, sites) ** 3
    basis = basis_along(places, (-2.0, 2.0))
    assert (basis.degree, basis.count) == (degree, sites)
    assert basis.domain == (places[0], places[-1])


def test_a_single_site_has_a_line_between_the_ends() -> None:
    basis = basis_along(np.array([0.3]), (-1.0, 1.0))
    assert (basis.degree, basis.count, basis.domain) == (1, 2, (-1.0, 1.0))


def test_very_many_sites_share_intervals() -> None:
    basis = basis_along(np.linspace(0.0, 1.0, 1000), (0.0, 1.0))
    assert basis.count == MOST_SITES
    assert basis.domain == (0.0, 1.0)


@settings(derandomize=True, deadline=None, max_examples=40)
@given(st.lists(st.floats(1e-4, 1.0), min_size=1, max_size=30))
def test_values_at_any_rising_sites_can_be_interpolated(steps: list[float]) -> None:
    sites = np.cumsum([0.0, *steps])
    assert interpolable(basis_along(sites, (0.0, 1.0)), sites)
