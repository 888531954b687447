from __future__ import annotations

import numpy as np
import pytest

from palpate.core.arrays import Bools, Floats
from palpate.core.rebuild.skin.contour_skin import ContourSkin, fit_contour_skin
from palpate.core.rebuild.skin.outlying_points import sticking_out

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


def fitted(radius: Floats, outlying: Bools, seed: int, sigma: float = SIGMA) -> ContourSkin:
    rng = np.random.default_rng(seed)
    sign = rng.choice([-1.0, 1.0], (M, K))
    grid = (radius + OFF * sign * outlying)[..., None] * RIM + sigma * rng.normal(size=(M, K, 2))
    return fit_contour_skin(HEIGHTS, grid, low=-1.04, high=1.04)


def error(skin: ContourSkin, radius: Floats) -> float:
    off = np.linalg.norm(skin.at(HEIGHTS[:, None], np.arange(K) / K), axis=-1) - radius
    return float(np.sqrt(np.mean(off**2)))


@pytest.mark.parametrize("radius", [vase(HEIGHTS), bumpy(HEIGHTS)], ids=["vase", "bumpy"])
def test_2_percent_of_points_off_cost_less_than_a_tenth(radius: Floats) -> None:
    with_, without = [], []
    for seed in range(3):
        outlying = wrong(0.02, seed)
        skin = fitted(radius, outlying, seed)
        with_.append(error(skin, radius))
        without.append(error(fitted(radius, wrong(0.0, seed), seed), radius))
        assert skin.health.outlying == skin.outlying.sum()
        assert (skin.outlying & outlying).sum() >= 0.9 * outlying.sum()
        assert (skin.outlying & ~outlying).sum() <= 5
        assert skin.health.sigma == pytest.approx(SIGMA, rel=0.15)
    assert np.mean(with_) <= 1.1 * np.mean(without)


@pytest.mark.parametrize("radius", [vase(HEIGHTS), bumpy(HEIGHTS)], ids=["vase", "bumpy"])
def test_of_good_points_none_is_left_out(radius: Floats) -> None:
    for seed in range(3):
        for sigma in (0.0, SIGMA, 5 * SIGMA):
            assert not fitted(radius, wrong(0.0, seed), seed, sigma).outlying.any()


def test_10_percent_of_points_off_still_cost_less_than_a_plain_fit() -> None:
    radius = vase(HEIGHTS)
    outlying = wrong(0.10, 0)
    clean = error(fitted(radius, wrong(0.0, 0), 0), radius)
    assert error(fitted(radius, outlying, 0), radius) < 2.0 * clean


def test_a_single_point_sticks_out_and_a_ridge_does_not() -> None:
    rng = np.random.default_rng(0)
    off = rng.normal(size=(M, K))
    off[10, 30] = 12.0
    assert sticking_out(off)[10, 30]
    assert sticking_out(off).sum() <= 2  # one good point of 2160 may be as far off
    ridge = rng.normal(size=(M, K))
    ridge[:, 30] += 12.0
    assert not sticking_out(ridge)[:, 29:32].any()


def test_single_contours_and_still_ones_do_not_stick_out() -> None:
    assert not sticking_out(np.random.default_rng(1).normal(size=(1, K))).any()
    assert not sticking_out(np.zeros((5, 12))).any()


def test_few_points_are_not_judged() -> None:
    grid = np.repeat(RIM[None, ::16], 9, axis=0)
    grid[4, 2] *= 3.0
    skin = fit_contour_skin(np.arange(9.0), grid, low=-1.0, high=10.0)
    assert not skin.outlying.any()


def test_the_sharp_edges_of_an_exact_box_are_its_own() -> None:
    turn, heights = 2 * np.pi * np.arange(80) / 80, np.linspace(-45.0, 45.0, 27)
    ring = np.column_stack([np.cos(turn), np.sin(turn)])
    ring *= 30.0 * (np.abs(ring) ** 10).sum(axis=1, keepdims=True) ** -0.1
    scale = (1.0 - np.abs(heights / 50.0) ** 10) ** 0.1

    skin = fit_contour_skin(heights, scale[:, None, None] * ring, low=-50.0, high=50.0)

    assert skin.health.outlying == 0
    assert (
        np.abs(skin.at(heights[:, None], turn / (2 * np.pi)) - scale[:, None, None] * ring).max()
        < 0.5
    )
