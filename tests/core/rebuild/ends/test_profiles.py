from __future__ import annotations

from itertools import product

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.rebuild.ends.closing import choose_profile
from palpate.core.rebuild.ends.profiles import (
    Conic,
    Flat,
    Rounded,
    Superellipse,
    conic,
    flared,
    flat,
    profile_curves,
    rounded,
    shoulder,
    superellipse,
    trend_of,
)

PROFILES = [
    Conic(0.0),
    Conic(-0.5),
    Conic(-0.99),
    Superellipse(0.3, 2.0, 2.0),
    Superellipse(0.1, 1.0, 1.0),
    Superellipse(0.6, 30.0, 12.0),
    Superellipse(0.4, 5.0, 1.5),
    Superellipse(0.4, 5.0, 2.5, 0.6),
    Superellipse(0.8, 3.0, 4.0, -0.3),
    Flat(0.2),
    Flat(-1.0),
]
WAY = np.linspace(0.0, 1.0, 33)


@pytest.mark.parametrize("profile", PROFILES)
def test_curves_run_from_the_rim_to_the_middle_without_a_gap(profile):
    curves = profile_curves(profile, 1.0)
    ends = np.array([curve.at(np.array([0.0, 1.0])) for curve in curves])
    np.testing.assert_allclose(ends[0, 0], [0.0, 1.0], atol=1e-12)
    np.testing.assert_allclose(ends[-1, 1], [1.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(ends[1:, 0], ends[:-1, 1], atol=1e-12)


@pytest.mark.parametrize("profile", PROFILES)
def test_curves_tell_the_radius_that_the_profile_tells(profile):
    height, radius = profile_curves(profile, 1.0)[0].at(WAY[:-1]).T
    wide = radius > 0.3  # nearer to the middle a square end's height has no digits left
    np.testing.assert_allclose(profile.shares(height)[wide], radius[wide], atol=1e-9)


@pytest.mark.parametrize("profile", PROFILES)
def test_derivatives_are_those_of_central_differences_and_finite_at_both_ends(profile):
    way, step = np.linspace(0.01, 0.97, 25), 1e-5
    for curve, by in product(profile_curves(profile, 1.0), (1, 2)):
        told = curve.at(way, by)
        seen = (curve.at(way + step, by - 1) - curve.at(way - step, by - 1)) / (2.0 * step)
        scale = max(float(np.abs(told).max()), 1.0)
        np.testing.assert_allclose(told, seen, atol=1e-6 * scale)
        assert np.isfinite(curve.at(np.array([0.0, 1.0]), by)).all()


def test_without_a_gap_there_is_only_a_disc():
    (disc,) = profile_curves(Flat(0.0), 0.0)
    np.testing.assert_array_equal(disc.at(np.array([0.0, 0.5, 1.0])), [[0, 1], [0, 0.5], [0, 0]])


def test_a_flat_end_has_a_wall_and_a_disc():
    wall, disc = profile_curves(Flat(-0.2), 1.0)
    np.testing.assert_allclose(wall.at(np.array([1.0])), [[1.0, 0.8]])
    np.testing.assert_allclose(disc.at(np.array([0.5])), [[1.0, 0.4]])


DEPTHS = np.linspace(-0.9, 0.9, 19)
NINTHS = np.linspace(0.0, 1.0, 9)


def beyond(way: Floats) -> Floats:
    return np.asarray(DEPTHS[-1] + way * (1.0 - DEPTHS[-1]))


@pytest.mark.parametrize("half", [1.0, 3.0])
def test_a_conic_goes_on_exactly_as_an_ellipsoid_does(half):
    def radius(z: Floats) -> Floats:
        return np.asarray(half * np.sqrt(1.0 - z**2))

    profile = conic(DEPTHS, radius(DEPTHS), 1.0)
    expected = radius(beyond(NINTHS)) / radius(DEPTHS[-1:])
    np.testing.assert_allclose(profile.shares(NINTHS), expected, atol=1e-7)


def test_a_conic_goes_on_exactly_as_a_paraboloid_does():
    profile = conic(DEPTHS, np.sqrt(2.0 - 2.0 * DEPTHS), 1.0)
    assert profile == Conic(pytest.approx(-0.5))
    np.testing.assert_allclose(profile.shares(NINTHS), np.sqrt(1.0 - NINTHS), atol=1e-7)


def test_a_conic_of_a_cone_is_a_straight_line_to_its_tip():
    assert conic(DEPTHS, 1.0 - DEPTHS, 1.0) == Flat(-1.0)


def test_a_wall_goes_on_as_that_of_a_frustum_does():
    profile = flat(DEPTHS, 2.0 - 0.5 * DEPTHS, 1.0)
    assert profile == Flat(pytest.approx(-0.05 / 1.55, rel=1e-9))


def test_a_wall_flares_by_no_more_than_half_and_never_passes_the_axis():
    assert flat(DEPTHS, 1.0 + 50.0 * (DEPTHS + 0.9) ** 8, 3.0) == Flat(0.5)
    assert flat(DEPTHS, 1.0 - DEPTHS, 5.0) == Flat(-1.0)


@pytest.mark.parametrize(("p", "q"), [(2.0, 2.0), (8.0, 4.0), (16.0, 16.0)])
def test_a_shoulder_is_found_again(p, q):
    depths = np.linspace(0.1, 0.97, 10)
    truth = Superellipse(0.0, p, q)
    begin = (depths - depths[0]) / (1.0 - depths[0])
    found = superellipse(depths, 0.7 * truth.shares(begin), 1.0)
    assert found == Superellipse(pytest.approx(begin[-1]), pytest.approx(p), pytest.approx(q))


@pytest.mark.parametrize("profile", [Flat(-0.3), Conic(-0.3), Superellipse(0.4, 5.0, 3.0)])
def test_every_profile_begins_with_the_last_radius(profile):
    assert profile.shares(np.zeros(1)) == pytest.approx(1.0)


@pytest.mark.parametrize("profile", [Conic(0.0), Conic(-0.9), Superellipse(0.4, 5.0, 1.5)])
def test_a_round_profile_ends_in_a_point(profile):
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
def test_a_shoulder_on_a_wall_that_leans_is_found(trend):
    truth = Superellipse(0.0, 4.0, 2.0, trend)
    depths = np.linspace(0.3, 0.9, 14)
    zeta = (depths - 0.3) / 0.7
    radii = 3.0 * truth.shares(zeta)
    found = flared(depths, radii, 1.0)
    assert isinstance(found, Superellipse)
    assert (found.p, found.q) == pytest.approx((4.0, 2.0))
    assert found.trend == pytest.approx(trend, abs=1e-9)
    expected = truth.shares(0.857142857 + (1.0 - 0.857142857) * NINTHS) / truth.shares(zeta[-1:])
    np.testing.assert_allclose(found.shares(NINTHS), expected, atol=1e-6)


@pytest.mark.parametrize("height", [0.003, 0.006])
def test_a_frustum_of_some_millimetres_is_followed_to_its_end(height):
    depths = np.linspace(0.0, 0.9 * height, 14)
    radii = 0.02 - 0.5 * depths
    for family in (flat, flared):
        shares = family(depths, radii, height).shares(NINTHS)
        expected = (radii[-1] - 0.5 * NINTHS * 0.1 * height) / radii[-1]
        np.testing.assert_allclose(shares[:-1], expected[:-1], atol=2e-3)


END, RADIUS, GAP = 0.09, 0.03, 1.2e-3
ROWS = np.linspace(END - GAP - 13e-3, END - GAP, 14)


def filleted(depths: Floats, arc: float, lean: float = 0.0) -> Floats:
    """Radii of a wall that leans, rounded off by an arc."""
    inside = np.clip(1.0 - (END - depths) / arc, 0.0, 1.0)
    return RADIUS + lean * (depths - END) - arc * (1.0 - np.sqrt(1.0 - inside**2))


@pytest.mark.parametrize("lean", [0.0, -0.3, 0.2])
@pytest.mark.parametrize("arc", [2e-3, 4e-3, 8e-3])
def test_an_edge_that_was_rounded_by_an_arc_is_found_again(arc, lean):
    found = rounded(ROWS, filleted(ROWS, arc, lean), END)
    assert found is not None
    assert found.arc * GAP == pytest.approx(arc, rel=0.03)
    beyond = np.linspace(END - GAP, END, 20)
    shares = found.shares((beyond - ROWS[-1]) / GAP)
    last = filleted(ROWS[-1:], arc, lean)[0]
    assert np.abs(last * shares - filleted(beyond, arc, lean)).max() < 0.02 * arc


def test_its_curve_is_the_profile_and_its_derivatives_are_those_of_the_curve():
    profile = Rounded(3.0, 0.13, (1.04, 0.02, 0.001))
    arc, disc = profile_curves(profile, 1.0)
    way = np.linspace(0.0, 1.0, 41)
    points = arc.at(way)
    np.testing.assert_allclose(profile.shares(points[:, 0]), points[:, 1], atol=1e-12)
    assert points[0] == pytest.approx([0.0, float(profile.shares(np.zeros(1))[0])], abs=1e-12)
    assert points[-1] == pytest.approx(disc.at(np.zeros(1))[0], abs=1e-12)
    assert disc.at(np.ones(1))[0] == pytest.approx([1.0, 0.0])
    step = 1e-5
    middle = way[1:-1]
    for by in (1, 2):
        above, below = arc.at(middle + step, by - 1), arc.at(middle - step, by - 1)
        np.testing.assert_allclose(arc.at(middle, by), (above - below) / (2 * step), atol=1e-8)


def test_a_rounded_edge_is_told_from_a_superellipse_by_the_rows_before_it():
    made = choose_profile(ROWS, filleted(ROWS, 4e-3), END, 0.0, dense=True)
    assert made[0] == "rounded"
    zeta = np.clip((ROWS - 0.045) / 0.045, 0.0, 1.0)
    grown = choose_profile(ROWS, RADIUS * shoulder(zeta, 10.0, 10.0), END, 0.0, dense=True)
    assert grown[0] == "flared"
    assert isinstance(grown[1], Superellipse)


@pytest.mark.parametrize("noise", [0.0, 5e-6])
def test_a_shoulder_takes_the_place_of_a_sharp_edge_that_misses_the_rows(noise):
    zeta = np.linspace(0.78, 0.93, 14)
    radii = 0.02 * shoulder(zeta, 16.0, 8.0) * (1.0 + 0.1 * zeta)
    radii += np.random.default_rng(0).normal(0.0, noise, 14)
    assert choose_profile(0.1 * zeta, radii, 0.1, noise, dense=True)[0] == "flared"


@pytest.mark.parametrize("noise", [0.0, 1e-5])
@pytest.mark.parametrize("lean", [0.0, -0.2])
def test_a_sharp_edge_stays_sharp(noise, lean):
    wall = RADIUS + lean * (ROWS - END)
    wall += noise * np.sin(np.arange(14) / 3.0)  # rows of a smooth skin err together
    assert choose_profile(ROWS, wall, END, noise, dense=True)[0] == "flat"


def test_a_ball_ends_as_a_ball():
    ball = np.sqrt(0.045**2 - (ROWS - 0.045) ** 2)
    assert choose_profile(ROWS, ball, END, 0.0, dense=True)[0] == "conic"


def test_what_leaves_no_disc_is_no_rounded_edge():
    narrow = filleted(ROWS, 8e-3) - 0.0225
    assert narrow.min() > 0.0
    assert rounded(ROWS, narrow, END) is None


def test_an_edge_sharper_than_what_was_seen_is_none_either():
    wall = np.full(len(ROWS), RADIUS)
    assert rounded(ROWS, wall, END) is None
