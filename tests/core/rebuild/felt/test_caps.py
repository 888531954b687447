from __future__ import annotations

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.rebuild.felt.caps import (
    EXPONENTS,
    LEAST_SITES,
    MOST_SITES,
    RINGS,
    Profile,
    cap_rings,
    fit_profile,
    shares_of,
    thin_out,
)

NONE = np.zeros((0, 3))
BALL = Profile(begin=0.0, end=0.03, p=2.0, q=2.0, trend=0.0, misfit=0.0)
TURN = 2 * np.pi * np.arange(80) / 80


def ring(radius: float, height: float, middle: tuple[float, float] = (0.0, 0.0)) -> Floats:
    away = radius * np.column_stack([np.cos(TURN), np.sin(TURN)])
    return np.column_stack([away + middle, np.full(len(TURN), height)])


@pytest.mark.parametrize("p", [1.2, 2.0, 5.0, 20.0])
@pytest.mark.parametrize("q", [1.2, 2.0, 5.0, 20.0])
def test_a_superellipse_is_followed_to_its_end(p: float, q: float) -> None:
    heights = np.linspace(0.0, 0.8, 40)
    profile = fit_profile(heights, 3.0 * (1 - heights**p) ** (1 / q), 1.0)
    assert profile.misfit < 4e-3
    beyond = np.array([0.85, 0.9, 0.95])
    rim = 3.0 * (1 - 0.8**p) ** (1 / q)
    shares = 3.0 * (1 - beyond**p) ** (1 / q) / rim
    assert np.allclose(profile.heights(0.8, shares), beyond, rtol=0, atol=0.02)


def test_a_ball_and_a_cone_are_among_what_is_tried() -> None:
    heights = np.linspace(0.0, 0.8, 40)
    ball = fit_profile(heights, np.sqrt(1 - heights**2), 1.0)
    assert (ball.p, ball.q) == pytest.approx((2.0, 2.0))
    cone = fit_profile(heights, 1 - heights, 1.0)
    assert cone.misfit < 1e-12
    assert np.allclose(cone.heights(0.8, np.array([1.0, 0.5])), [0.8, 0.9], rtol=0, atol=1e-9)


def test_exponents_among_those_tried_are_found_exactly() -> None:
    heights = np.linspace(0.2, 0.9, 40)
    for p, q in ((EXPONENTS[3], EXPONENTS[5]), (EXPONENTS[8], EXPONENTS[2])):
        zeta = (heights - 0.2) / 0.8
        profile = fit_profile(heights, 0.7 * (1 - zeta**p) ** (1 / q), 1.0)
        assert (profile.p, profile.q) == (p, q)
        assert profile.misfit < 1e-12


def test_a_profile_may_run_downwards_and_in_any_unit() -> None:
    heights = np.linspace(0.0, 0.8, 40)
    radii = (1 - heights**2.5) ** (1 / 1.7)
    up = fit_profile(heights, radii, 1.0)
    down = fit_profile(-1e-3 * heights, 1e-3 * radii, -1e-3)
    assert (up.p, up.q) == (down.p, down.q)
    assert down.misfit == pytest.approx(1e-3 * up.misfit, rel=1e-6)
    shares = np.array([1.0, 0.5, 0.0])
    assert np.allclose(down.heights(-0.8e-3, shares), -1e-3 * up.heights(0.8, shares))


@pytest.mark.parametrize("rim", [0.0, 0.01, 0.029])
def test_heights_run_from_the_rim_to_the_end(rim: float) -> None:
    heights = BALL.heights(rim, np.linspace(1.0, 0.0, 50))
    assert heights[0] == pytest.approx(rim)
    assert heights[-1] == pytest.approx(0.03)
    assert (np.diff(heights) >= 0.0).all()


@pytest.mark.parametrize("height", [0.005, 0.02, 0.029])
def test_the_cap_of_a_ball_is_the_ball(height: float) -> None:
    rim = ring(np.sqrt(0.03**2 - height**2), height)
    rings = cap_rings(BALL, np.zeros(2), rim, NONE)
    assert rings.shape == (RINGS, 80, 3)
    assert np.allclose(np.linalg.norm(rings, axis=2), 0.03, rtol=1e-12)
    assert np.ptp(rings[-1], axis=0).max() == 0.0
    assert np.allclose(rings[-1, 0], [0.0, 0.0, 0.03], atol=1e-15)


def test_a_flat_end_is_a_disc() -> None:
    edge = Profile(begin=0.0, end=0.03, p=90.0, q=90.0, trend=0.0, misfit=0.0)
    rings = cap_rings(edge, np.zeros(2), ring(0.02, 0.0299), NONE)
    assert np.ptp(rings[:, :, 2]) < 0.0002
    assert (np.diff(np.linalg.norm(rings[:, 0, :2], axis=1)) < 0.0).all()


def test_touches_that_agree_with_the_profile_change_nothing() -> None:
    rim = ring(np.sqrt(0.03**2 - 0.02**2), 0.02, (0.1, 0.2))
    sites = np.random.default_rng(0).uniform(-0.01, 0.01, (100, 2))
    heights = np.sqrt(0.03**2 - (sites**2).sum(axis=1))
    felt = np.column_stack([sites + np.array([0.1, 0.2]), heights])
    without = cap_rings(BALL, np.array([0.1, 0.2]), rim, NONE)
    assert np.allclose(cap_rings(BALL, np.array([0.1, 0.2]), rim, felt), without, atol=1e-5)


def test_touches_correct_the_profile_where_they_are() -> None:
    rim = ring(0.02, 0.02)
    along = np.linspace(-0.012, 0.012, 15)
    places = np.stack(np.meshgrid(along, along), axis=-1).reshape(-1, 2)

    def dent(where: Floats) -> Floats:
        return np.asarray(0.025 - 0.001 * np.cos(100 * where[..., 0]))

    felt = np.column_stack([places, dent(places)])
    rings = cap_rings(BALL, np.zeros(2), rim, felt)
    near = np.abs(rings[:, :, :2]).max(axis=-1) < 0.011
    assert np.abs(rings[..., 2] - dent(rings[..., :2]))[near].max() < 0.1e-3
    assert np.abs(rings[0, :, 2] - 0.02).max() < 0.5e-3  # and it still joins the rim


def test_a_few_touches_correct_nothing() -> None:
    rim = ring(0.02, 0.02)
    felt = np.tile([0.0, 0.0, 0.5], (LEAST_SITES - 1, 1))
    assert np.array_equal(
        cap_rings(BALL, np.zeros(2), rim, felt), cap_rings(BALL, np.zeros(2), rim, NONE)
    )


def test_touches_at_one_place_or_outside_the_rim_do_no_harm() -> None:
    rim = ring(0.02, 0.02)
    same = np.tile([0.001, 0.002, 0.025], (50, 1))
    outside = np.column_stack([np.linspace(0.03, 0.05, 50), np.zeros(50), np.full(50, 9.0)])
    for felt in (same, outside):
        assert np.isfinite(cap_rings(BALL, np.zeros(2), rim, felt)).all()
    assert np.allclose(
        cap_rings(BALL, np.zeros(2), rim, outside),
        cap_rings(BALL, np.zeros(2), rim, NONE),
        atol=1e-12,
    )


def test_shares_are_measured_on_each_azimuth() -> None:
    middle = np.array([0.5, -0.5])
    rim = np.column_stack([0.5 + 0.04 * np.cos(TURN), -0.5 + 0.02 * np.sin(TURN), 0 * TURN])
    inner = np.column_stack([middle + 0.25 * (rim[:, :2] - middle), 0 * TURN])
    assert np.allclose(shares_of(middle, rim, inner), 0.25, rtol=1e-12)
    assert np.allclose(shares_of(middle, np.roll(rim, 7, axis=0), inner), 0.25, rtol=1e-12)
    assert shares_of(middle, rim, rim + np.array([9, 9, 0])).max() == 1.0
    assert shares_of(middle, rim, np.array([[0.5, -0.5, 3.0]]))[0] == 0.0


@pytest.mark.parametrize("count", [0, 1, MOST_SITES, MOST_SITES + 1, 10_000])
def test_thinning_keeps_the_ends_and_the_order(count: int) -> None:
    points = np.arange(3.0 * count).reshape(count, 3)
    kept = thin_out(points)
    assert len(kept) == min(count, MOST_SITES)
    assert (np.diff(kept[:, 0]) > 0).all()
    if count:
        assert kept[0, 0] == points[0, 0]
        assert kept[-1, 0] == points[-1, 0]
