from __future__ import annotations

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.frames import DOWN, pose_of
from palpate.core.shapes.superquadric import Superquadric
from palpate.core.touch.filters import (
    adaptive_wiener,
    median_filter,
    median_then_wiener,
    neighbourhoods,
    wiener_then_median,
)
from palpate.core.touch.pad import Pad, press

NOISE = 10e-6


def on_a_ball(pad: Pad, radius: float) -> Floats:
    ball = Superquadric(np.full(3, radius), np.ones(2))
    start = pose_of(np.array([0.0, 0.0, radius + 0.01]), DOWN)
    return press(ball, pad, start, 0.05, 1e-3).compression


def test_without_noise_wiener_changes_nothing() -> None:
    image = np.random.default_rng(0).normal(size=(16, 16))
    assert np.array_equal(adaptive_wiener(image, 0.0), image)


@pytest.mark.parametrize("value", [0.0, 1e-3, -7.0, 1e8])
def test_wiener_keeps_a_constant_frame(value: float) -> None:
    image = np.full((6, 9), value)
    assert np.allclose(adaptive_wiener(image, NOISE**2), image, rtol=1e-15, atol=0)


def test_wiener_takes_most_of_the_noise_from_a_flat_frame() -> None:
    noise = np.random.default_rng(1).normal(scale=NOISE, size=(200, 16, 16))
    left = np.stack([adaptive_wiener(frame, NOISE**2) for frame in noise])
    # A mean of nine leaves 1/9 of the variance; the sample variance of nine often passes for
    # signal, which leaves some more.
    assert np.var(left) < 0.3 * NOISE**2
    assert abs(float(left.mean())) < NOISE / 20


def test_wiener_hardly_touches_what_stands_far_above_the_noise() -> None:
    image = 1e-3 * np.random.default_rng(2).normal(size=(16, 16))
    moved = adaptive_wiener(image, NOISE**2) - image
    # The share taken is noise over signal variance, times the distance to the mean.
    assert np.abs(moved).max() < 1e-2 * 1e-3


def test_wiener_uses_variances_as_3_6_should_read() -> None:
    image = np.zeros((3, 3))
    image[1, 1] = 9.0
    variance = 9.0 - 1.0  # of eight zeros and a nine
    filtered = adaptive_wiener(image, 2.0)[1, 1]
    assert filtered == pytest.approx(1.0 + (variance - 2.0) / variance * 8.0)


@pytest.mark.parametrize(("offset", "rounding"), [(1e6, 1e-8), (1e8, 1e-6)])
def test_wiener_is_not_thrown_by_an_offset_of_1e8(offset: float, rounding: float) -> None:
    # A variance by squares less squared mean gives -2.0 for 1.02 there.
    image = np.random.default_rng(3).normal(size=(16, 16))
    there = adaptive_wiener(image + offset, 0.5) - offset
    assert np.allclose(there, adaptive_wiener(image, 0.5), rtol=0, atol=rounding)


def test_wiener_pulls_towards_the_mean_and_never_beyond() -> None:
    image = np.random.default_rng(4).normal(size=(16, 16))
    for variance in (0.01, 1.0, 100.0):
        filtered = adaptive_wiener(image, variance)
        assert filtered.min() >= image.min()
        assert filtered.max() <= image.max()


def test_the_median_of_a_neighbourhood_is_that_of_its_nine_with_reflected_borders() -> None:
    image = np.random.default_rng(6).normal(size=(7, 9))
    padded = np.pad(image, 1, mode="reflect")
    filtered = median_filter(image)
    for row, col in np.ndindex(7, 9):
        assert filtered[row, col] == np.median(padded[row : row + 3, col : col + 3])
        nine = padded[row : row + 3, col : col + 3].ravel()
        assert np.array_equal(neighbourhoods(image)[row, col], nine)


def test_the_median_takes_an_impulse_out_and_keeps_a_step(flat: Pad) -> None:
    x, _ = flat.grid()
    step = np.where(x > 0, 1e-3, 0.0)
    image = step.copy()
    image[5, 5], image[11, 12] = 2.4e-3, 0.0
    assert np.array_equal(median_filter(image), step)


def test_a_median_taken_everywhere_makes_plateaus(flat: Pad) -> None:
    x, y = flat.grid()
    top = median_filter(1e-3 - 0.5 * (x**2 + y**2) / 0.02)
    # The four highest taxels, and those around them, are made equal.
    assert np.ptp(top[7:9, 7:9]) < 1e-18
    assert top.max() < 1e-3 - 0.5 * (2 * (0.5e-3) ** 2) / 0.02


def test_without_impulses_both_orders_are_worth_the_same_and_with_them_median_first_wins(
    flat: Pad,
) -> None:
    clean = 1.2e-3 + 0.3 * on_a_ball(flat, 0.1)
    rng = np.random.default_rng(7)
    errors = np.zeros((2, 2))
    for _ in range(40):
        quiet = clean + 4 * NOISE * rng.normal(size=clean.shape)
        struck = np.where(rng.random(clean.shape) < 0.05, 2.4e-3, quiet)
        for number, frame in enumerate((quiet, struck)):
            for order, chain in enumerate((wiener_then_median, median_then_wiener)):
                # Where the noise is not known, the mean of the local variances stands in.
                seen = frame if order == 0 else median_filter(frame)
                variance = float(neighbourhoods(seen).var(axis=-1).mean())
                errors[number, order] += np.mean((chain(frame, variance) - clean) ** 2)
    assert errors[0, 0] == pytest.approx(errors[0, 1], rel=0.3)
    assert errors[1, 1] < 0.5 * errors[1, 0]
