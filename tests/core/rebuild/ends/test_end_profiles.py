from __future__ import annotations

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.rebuild.ends.end_profiles import (
    Conic,
    Flat,
    Superellipse,
    conic,
    flared,
    flat,
    superellipse,
    trend_of,
)

DEPTHS = np.linspace(-0.9, 0.9, 19)
WAY = np.linspace(0.0, 1.0, 9)


def beyond(way: Floats) -> Floats:
    return np.asarray(DEPTHS[-1] + way * (1.0 - DEPTHS[-1]))


@pytest.mark.parametrize("half", [1.0, 3.0])
def test_a_conic_goes_on_exactly_as_an_ellipsoid_does(half: float) -> None:
    def radius(z: Floats) -> Floats:
        return np.asarray(half * np.sqrt(1.0 - z**2))

    profile = conic(DEPTHS, radius(DEPTHS), 1.0)

    expected = radius(beyond(WAY)) / radius(DEPTHS[-1:])
    np.testing.assert_allclose(profile.shares(WAY), expected, atol=1e-7)


def test_a_conic_goes_on_exactly_as_a_paraboloid_does() -> None:
    profile = conic(DEPTHS, np.sqrt(2.0 - 2.0 * DEPTHS), 1.0)

    assert profile == Conic(pytest.approx(-0.5))
    np.testing.assert_allclose(profile.shares(WAY), np.sqrt(1.0 - WAY), atol=1e-7)


def test_a_conic_of_a_cone_is_a_straight_line_to_its_tip() -> None:
    assert conic(DEPTHS, 1.0 - DEPTHS, 1.0) == Flat(-1.0)


def test_a_wall_goes_on_as_that_of_a_frustum_does() -> None:
    profile = flat(DEPTHS, 2.0 - 0.5 * DEPTHS, 1.0)

    assert profile == Flat(pytest.approx(-0.05 / 1.55, rel=1e-9))


def test_a_wall_flares_by_no_more_than_half_and_never_passes_the_axis() -> None:
    assert flat(DEPTHS, 1.0 + 50.0 * (DEPTHS + 0.9) ** 8, 3.0) == Flat(0.5)
    assert flat(DEPTHS, 1.0 - DEPTHS, 5.0) == Flat(-1.0)


@pytest.mark.parametrize(("p", "q"), [(2.0, 2.0), (8.0, 4.0), (16.0, 16.0)])
def test_a_shoulder_is_found_again(p: float, q: float) -> None:
    depths = np.linspace(0.1, 0.97, 10)
    truth = Superellipse(0.0, p, q)
    begin = (depths - depths[0]) / (1.0 - depths[0])

    found = superellipse(depths, 0.7 * truth.shares(begin), 1.0)

    assert found == Superellipse(pytest.approx(begin[-1]), pytest.approx(p), pytest.approx(q))


@pytest.mark.parametrize("profile", [Flat(-0.3), Conic(-0.3), Superellipse(0.4, 5.0, 3.0)])
def test_every_profile_begins_with_the_last_radius(
    profile: Flat | Conic | Superellipse,
) -> None:
    assert profile.shares(np.zeros(1)) == pytest.approx(1.0)


@pytest.mark.parametrize("profile", [Conic(0.0), Conic(-0.9), Superellipse(0.4, 5.0, 1.5)])
def test_a_round_profile_ends_in_a_point(profile: Conic | Superellipse) -> None:
    assert profile.shares(np.ones(1)) == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize(
    ("count", "at_end"), [(1, 1.0), (2, 1.0 - 0.19 * 1.5), (3, 1.0 - 0.27 * 1.5 - 0.08 * 2.25)]
)
def test_a_trend_is_of_the_degree_that_the_contours_can_tell(count: int, at_end: float) -> None:
    # Through 1.22, 1.19, 1: the second difference is -0.16, the slope at the end -0.27.
    radii = np.sqrt(np.array([1.22, 1.19, 1.0]))

    trend = trend_of(np.array([-2.0, -1.0, 0.0])[-count:], radii[-count:])

    assert trend.at(1.5) == pytest.approx(at_end)


@pytest.mark.parametrize("trend", [-0.5, 0.0, 0.4])
def test_a_shoulder_on_a_wall_that_leans_is_found(trend: float) -> None:
    truth = Superellipse(0.0, 4.0, 2.0, trend)
    depths = np.linspace(0.3, 0.9, 14)
    zeta = (depths - 0.3) / 0.7
    radii = 3.0 * truth.shares(zeta)
    found = flared(depths, radii, 1.0)
    assert isinstance(found, Superellipse)
    assert (found.p, found.q) == pytest.approx((4.0, 2.0))
    assert found.trend == pytest.approx(trend, abs=1e-9)
    expected = truth.shares(0.857142857 + (1.0 - 0.857142857) * WAY) / truth.shares(zeta[-1:])
    np.testing.assert_allclose(found.shares(WAY), expected, atol=1e-6)


@pytest.mark.parametrize("height", [0.003, 0.006])
def test_a_frustum_of_some_millimetres_is_followed_to_its_end(height: float) -> None:
    depths = np.linspace(0.0, 0.9 * height, 14)
    radii = 0.02 - 0.5 * depths
    for family in (flat, flared):
        shares = family(depths, radii, height).shares(WAY)
        expected = (radii[-1] - 0.5 * WAY * 0.1 * height) / radii[-1]
        np.testing.assert_allclose(shares[:-1], expected[:-1], atol=2e-3)
