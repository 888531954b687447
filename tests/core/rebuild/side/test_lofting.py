from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from palpate.core.arrays import Bools, Floats
from palpate.core.rebuild.side.lofting import ContourLoft, fit_contour_loft, local_outliers

HEIGHT = 2.0
POLE = float(np.sqrt(1.04))


def angles(count: int) -> Floats:
    return 2 * np.pi * np.arange(count) / count


def wavy(heights: Floats, angle: Floats) -> Floats:
    """Radius of a lobed zig-zag that closes at the heights -POLE and POLE."""
    lobes = 1 + 0.12 * np.cos(3 * angle) + 0.08 * np.sin(2 * angle + 2 * heights)
    return np.asarray(np.sqrt(1.04 - heights**2) * (0.75 + 0.18 * np.sin(9 * heights)) * lobes)


def contours(heights: Floats, count: int, sigma: float = 0.0, seed: int = 0) -> Floats:
    angle = angles(count)
    radius = wavy(heights[:, None], angle)[..., None]
    grid = radius * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    return grid + sigma * np.random.default_rng(seed).normal(size=grid.shape)


def errors(loft: ContourLoft, reach: float = 1.0) -> Floats:
    """Normal distances over the height, to first order, on a grid."""
    heights = np.linspace(-reach, reach, 121)[:, None]
    places = loft.at(heights, (np.arange(120) + 0.3) / 120)
    angle = np.arctan2(places[..., 1], places[..., 0])
    radius, step = wavy(heights, angle), 1e-6
    inwards = np.clip(heights + np.array([-step, step])[:, None, None], -1.0, 1.0)
    up = np.diff(wavy(inwards, angle), axis=0)[0] / np.diff(inwards, axis=0)[0]
    around = (wavy(heights, angle + step) - wavy(heights, angle - step)) / (2 * step)
    slope = np.sqrt(1 + up**2 + (around / radius) ** 2)
    return np.asarray((np.hypot(places[..., 0], places[..., 1]) - radius) / slope / HEIGHT)


def rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def test_27_by_80_clean_contours_with_poles_are_followed_to_a_ten_thousandth():
    heights = np.linspace(-1.0, 1.0, 27)
    loft = fit_contour_loft(heights, contours(heights, 80), low=-POLE, high=POLE, pole=(True, True))
    assert rms(errors(loft)) < 1e-4
    assert loft.health.condition < 1e3
    ends = loft.at(np.array([-POLE, POLE])[:, None], np.arange(9) / 9)
    assert np.ptp(ends, axis=1).max() < 1e-12


def test_noise_of_half_a_percent_leaves_less_than_a_third_of_it():
    heights = np.linspace(-1.0, 1.0, 27)
    found = []
    for seed in range(3):
        grid = contours(heights, 80, 0.005 * HEIGHT, seed)
        loft = fit_contour_loft(heights, grid, low=-1.04, high=1.04)
        found.append(rms(errors(loft)))
        assert loft.health.sigma == pytest.approx(0.005 * HEIGHT, rel=0.05)
        assert loft.health.outlying == 0
    assert np.mean(found) < 1.5e-3


def test_a_missing_contour_costs_little():
    """A gap in the heights of 27 contours with noise of half a percent."""
    heights = np.delete(np.linspace(-1.0, 1.0, 27), 12)
    grid = contours(heights, 80, 0.005 * HEIGHT)
    loft = fit_contour_loft(heights, grid, low=-1.04, high=1.04)
    assert rms(errors(loft)) < 1.5e-3
    assert loft.uncertainty().resolution == pytest.approx(HEIGHT / 26)
    turns = np.arange(20) / 20
    gap, beside = np.array([-1.0 + 12 / 13]), np.array([-1.0 + 17.5 / 13])
    assert rms(loft.deviation(gap, turns)) > 1.5 * rms(loft.deviation(beside, turns))


def test_noise_of_1_5_percent_is_not_fitted():
    heights = np.linspace(-1.0, 1.0, 27)
    for seed in range(2):
        grid = contours(heights, 80, 0.015 * HEIGHT, seed)
        assert rms(errors(fit_contour_loft(heights, grid, low=-1.04, high=1.04))) < 4e-3


def test_a_top_contour_collapsed_to_a_point_closes_the_surface():
    heights = np.linspace(-1.0, 1.0, 27)
    grid = contours(heights, 40)
    grid[-1] = 0.0
    loft = fit_contour_loft(heights, grid, low=-1.04, high=1.0)
    assert np.abs(loft.at(1.0, np.arange(7) / 7)).max() < 1e-4
    for values in (errors(loft), loft.deviation(heights, np.arange(5) / 5), loft.uncertainty()):
        assert np.isfinite(values).all()


@pytest.mark.parametrize("pole", [(False, False), (True, False), (False, True), (True, True)])
@pytest.mark.parametrize("count", [1, 2, 3])
def test_one_two_and_three_contours_give_a_surface(count, pole):
    heights = np.linspace(-0.5, 0.4, count)
    grid = contours(heights, 24)
    loft = fit_contour_loft(heights, grid, low=-1.0, high=1.0, pole=pole)
    assert np.allclose(loft.at(heights[:, None], np.arange(24) / 24), grid, atol=1e-4)
    for end, closed in zip((-1.0, 1.0), pole, strict=True):
        width = float(np.ptp(loft.at(end, np.arange(8) / 8), axis=0).max())
        assert (width < 1e-12) is closed
    band = loft.deviation(np.linspace(-1.0, 1.0, 30), np.arange(9) / 9)
    assert np.isfinite(band).all()
    assert np.isfinite(loft.uncertainty()).all()


def test_one_contour_is_carried_on_as_a_prism():
    grid = contours(np.array([0.2]), 24)
    loft = fit_contour_loft([0.2], grid, low=-1.0, high=1.0)
    turns = np.arange(24) / 24
    assert np.allclose(loft.at(np.linspace(-1, 1, 9)[:, None], turns), grid, atol=1e-4)
    assert loft.uncertainty().resolution == pytest.approx(1.0)


def test_uneven_and_repeated_heights_are_taken_as_they_are():
    heights = np.sin(np.linspace(-0.5 * np.pi, 0.5 * np.pi, 27))
    again = np.concatenate([heights, heights[10:12], heights[5:6] + 1e-7])
    loft = fit_contour_loft(again, contours(again, 80), low=-POLE, high=POLE, pole=(True, True))
    assert loft.health.merged == 3
    assert rms(errors(loft)) < 3e-4
    twice = fit_contour_loft(
        heights, contours(heights, 80), low=-POLE, high=POLE, pole=(True, True)
    )
    assert np.allclose(errors(loft), errors(twice), atol=1e-6)


def test_very_close_heights_that_disagree_stay_finite():
    heights = np.concatenate([np.linspace(-1.0, 1.0, 14), [0.1, 0.1 + 1e-3]])
    grid = contours(heights, 40, 0.005 * HEIGHT)
    loft = fit_contour_loft(heights, grid, low=-1.04, high=1.04)
    assert loft.health.merged == 0
    assert np.abs(errors(loft)).max() < 0.02


@pytest.mark.parametrize("order", [slice(None, None, -1), np.array([3, 0, 5, 1, 4, 2, 6, 7])])
def test_the_order_of_the_contours_does_not_matter(order):
    heights = np.linspace(-1.0, 1.0, 8)
    grid = contours(heights, 24, 0.01)
    one = fit_contour_loft(heights, grid, low=-1.1, high=1.1)
    other = fit_contour_loft(heights[order], grid[order], low=-1.1, high=1.1)
    assert np.array_equal(one.surface.control, other.surface.control)


def test_95_percent_of_the_surface_lies_in_the_band_of_95_percent():
    for count, turns in ((24, 40), (27, 80)):
        heights, covered = np.linspace(-1.0, 1.0, count), []
        for seed in range(4):
            grid = contours(heights, turns, 0.01, seed)
            loft = fit_contour_loft(heights, grid, low=-1.04, high=1.04)
            band = loft.deviation(np.linspace(-1, 1, 121), (np.arange(120) + 0.3) / 120)
            off = np.abs(HEIGHT * errors(loft))
            covered.append(np.mean(off <= 1.96 * band))
            claimed = loft.uncertainty()
            assert rms(off) < claimed.rms
            assert off.max() < claimed.most
        assert 0.90 <= np.mean(covered) <= 0.99


@pytest.mark.parametrize("unit", [1e-6, 1e3])
def test_unit_and_place_do_not_matter(unit):
    heights, turns = np.linspace(-1.0, 1.0, 9), np.arange(7) / 7
    grid = contours(heights, 24, 0.01)
    usual = fit_contour_loft(heights, grid, low=-1.04, high=1.04)
    shift = np.array([30.0, -50.0])
    moved = fit_contour_loft(
        unit * (heights + 20.0), unit * (grid + shift), low=unit * 18.96, high=unit * 21.04
    )
    at = np.linspace(-1.0, 1.0, 30)
    wanted = unit * (usual.at(at[:, None], turns) + shift)
    assert np.allclose(moved.at(unit * (at + 20.0)[:, None], turns), wanted, rtol=1e-9)
    band = moved.deviation(unit * (at + 20.0), turns)
    assert np.allclose(band, unit * usual.deviation(at, turns), rtol=1e-6)


def test_the_band_is_along_the_normal():
    heights = np.linspace(-0.9, 0.9, 9)
    rim = np.stack([np.cos(angles(24)), np.sin(angles(24))], axis=-1)
    noise = 1e-3 * np.random.default_rng(0).normal(size=(9, 24, 1)) * rim
    for lean in (0.0, 3.0):
        cone = (4.0 + lean * heights)[:, None, None] * rim + noise
        loft = fit_contour_loft(heights, cone, low=-1.0, high=1.0)
        assert loft.health.sigma == pytest.approx(1e-3, rel=0.15)
        level = rms(loft.deviation(heights, np.arange(24) / 24))
        if lean == 0.0:
            upright = level
    assert level == pytest.approx(upright / np.hypot(1.0, 3.0), rel=0.2)


def test_a_known_noise_is_that_of_the_band():
    heights = np.linspace(-1.0, 1.0, 14)
    grid = contours(heights, 40, 0.01)
    bands = [
        rms(
            fit_contour_loft(heights, grid, low=-1.04, high=1.04, noise=noise).deviation(
                heights, [0.1]
            )
        )
        for noise in (0.01, 0.03)
    ]
    assert bands[1] > bands[0]


def test_all_points_in_one_place_give_a_line():
    loft = fit_contour_loft(np.arange(6.0), np.full((6, 12, 2), 2.0), low=-1.0, high=6.0)
    assert np.allclose(loft.at([0.5, 4.0], [0.1, 0.2]), 2.0)
    assert np.array_equal(loft.deviation([0.5], [0.0]), [[0.0]])
    assert loft.uncertainty()[:2] == (0.0, 0.0)


@settings(derandomize=True, deadline=None, max_examples=40)
@given(st.integers(1, 12), st.integers(4, 30), st.integers(0, 3), st.integers(0, 10**6))
def test_whatever_the_contours_are_the_surface_is_finite(count, turns, poles, seed):
    rng = np.random.default_rng(seed)
    heights, grid = rng.random(count), rng.normal(size=(count, turns, 2))
    pole = (bool(poles & 1), bool(poles & 2))
    loft = fit_contour_loft(heights, grid, low=-0.1, high=1.1, pole=pole)
    places = np.linspace(-0.1, 1.1, 25)
    assert np.isfinite(loft.at(places[:, None], np.arange(9) / 9)).all()
    assert np.isfinite(loft.deviation(places, np.arange(9) / 9)).all()
    assert np.isfinite(loft.uncertainty()).all()
    assert np.isfinite(loft.health.condition)


def test_a_contour_or_noise_that_cannot_be_is_refused():
    heights = np.linspace(-1.0, 1.0, 5)
    with pytest.raises(ValueError, match="heights must lie from low"):
        fit_contour_loft(heights, contours(heights, 12), low=-1.1, high=0.9)
    with pytest.raises(ValueError, match="noise must be 0 or more"):
        fit_contour_loft(heights, contours(heights, 12), low=-1.1, high=1.1, noise=-1.0)
    loft = fit_contour_loft(heights, contours(heights, 12), low=-1.1, high=1.1)
    with pytest.raises(ValueError, match="heights must be finite"):
        loft.deviation([np.nan], [0.0])


M, K = 27, 80
HEIGHTS = np.linspace(-1.0, 1.0, M)
ANGLE = 2 * np.pi * np.arange(K) / K
RIM = np.stack([np.cos(ANGLE), np.sin(ANGLE)], axis=-1)
SIGMA, OFF = 0.004, 0.06


def vase(heights: Floats) -> Floats:
    return np.asarray(
        (0.52 + 0.18 * np.sin(3.5 * heights))[:, None] * (1 + 0.08 * np.cos(3 * ANGLE))
    )


def bumpy(heights: Floats) -> Floats:
    """With a bump that is a few points and a few contours wide."""
    away = np.angle(np.exp(1j * (ANGLE - 1.0)))
    bump = np.exp(-np.square((heights[:, None] - 0.4) / 0.12) - np.square(away / 0.25))
    return vase(heights) + 0.08 * bump


def wrong(share: float, seed: int) -> Bools:
    return np.asarray(np.random.default_rng(seed + 100).random((M, K)) < share)


def fitted(radius: Floats, outlying: Bools, seed: int, sigma: float = SIGMA) -> ContourLoft:
    rng = np.random.default_rng(seed)
    sign = rng.choice([-1.0, 1.0], (M, K))
    grid = (radius + OFF * sign * outlying)[..., None] * RIM + sigma * rng.normal(size=(M, K, 2))
    return fit_contour_loft(HEIGHTS, grid, low=-1.04, high=1.04)


def error(loft: ContourLoft, radius: Floats) -> float:
    off = np.linalg.norm(loft.at(HEIGHTS[:, None], np.arange(K) / K), axis=-1) - radius
    return float(np.sqrt(np.mean(off**2)))


@pytest.mark.parametrize("radius", [vase(HEIGHTS), bumpy(HEIGHTS)], ids=["vase", "bumpy"])
def test_2_percent_of_points_off_cost_less_than_a_tenth(radius):
    with_, without = [], []
    for seed in range(3):
        outlying = wrong(0.02, seed)
        loft = fitted(radius, outlying, seed)
        with_.append(error(loft, radius))
        without.append(error(fitted(radius, wrong(0.0, seed), seed), radius))
        assert loft.health.outlying == loft.outlying.sum()
        assert (loft.outlying & outlying).sum() >= 0.9 * outlying.sum()
        assert (loft.outlying & ~outlying).sum() <= 5
        assert loft.health.sigma == pytest.approx(SIGMA, rel=0.15)
    assert np.mean(with_) <= 1.1 * np.mean(without)


@pytest.mark.parametrize("radius", [vase(HEIGHTS), bumpy(HEIGHTS)], ids=["vase", "bumpy"])
def test_of_good_points_none_is_left_out(radius):
    for seed in range(3):
        for sigma in (0.0, SIGMA, 5 * SIGMA):
            assert not fitted(radius, wrong(0.0, seed), seed, sigma).outlying.any()


def test_10_percent_of_points_off_still_cost_less_than_a_plain_fit():
    radius = vase(HEIGHTS)
    outlying = wrong(0.10, 0)
    clean = error(fitted(radius, wrong(0.0, 0), 0), radius)
    assert error(fitted(radius, outlying, 0), radius) < 2.0 * clean


def test_a_single_point_sticks_out_and_a_ridge_does_not():
    rng = np.random.default_rng(0)
    off = rng.normal(size=(M, K))
    off[10, 30] = 12.0
    assert local_outliers(off)[10, 30]
    assert local_outliers(off).sum() <= 2  # one good point of 2160 may be as far off
    ridge = rng.normal(size=(M, K))
    ridge[:, 30] += 12.0
    assert not local_outliers(ridge)[:, 29:32].any()


def test_single_contours_and_still_ones_do_not_stick_out():
    assert not local_outliers(np.random.default_rng(1).normal(size=(1, K))).any()
    assert not local_outliers(np.zeros((5, 12))).any()


def test_few_points_are_not_judged():
    grid = np.repeat(RIM[None, ::16], 9, axis=0)
    grid[4, 2] *= 3.0
    loft = fit_contour_loft(np.arange(9.0), grid, low=-1.0, high=10.0)
    assert not loft.outlying.any()


def test_the_sharp_edges_of_an_exact_box_are_its_own():
    turn, heights = 2 * np.pi * np.arange(80) / 80, np.linspace(-45.0, 45.0, 27)
    ring = np.column_stack([np.cos(turn), np.sin(turn)])
    ring *= 30.0 * (np.abs(ring) ** 10).sum(axis=1, keepdims=True) ** -0.1
    scale = (1.0 - np.abs(heights / 50.0) ** 10) ** 0.1
    loft = fit_contour_loft(heights, scale[:, None, None] * ring, low=-50.0, high=50.0)
    assert loft.health.outlying == 0
    assert (
        np.abs(loft.at(heights[:, None], turn / (2 * np.pi)) - scale[:, None, None] * ring).max()
        < 0.5
    )
