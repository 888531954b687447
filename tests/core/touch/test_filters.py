from __future__ import annotations

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.frames import DOWN, pose_of
from palpate.core.shapes.superquadric import Superquadric
from palpate.core.touch.filters import adaptive_wiener, median_filter
from palpate.core.touch.pad import Pad, press

NOISE = 10e-6
STEP = 0.5e-3


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


def test_wiener_is_not_thrown_by_a_large_offset() -> None:
    image = np.random.default_rng(3).normal(size=(16, 16))
    there = adaptive_wiener(image + 1e6, 0.5) - 1e6
    assert np.allclose(there, adaptive_wiener(image, 0.5), rtol=0, atol=1e-8)


def test_wiener_pulls_towards_the_mean_and_never_beyond() -> None:
    image = np.random.default_rng(4).normal(size=(16, 16))
    for variance in (0.01, 1.0, 100.0):
        filtered = adaptive_wiener(image, variance)
        assert filtered.min() >= image.min()
        assert filtered.max() <= image.max()


@pytest.mark.parametrize("place", [(0, 0), (0, 7), (15, 15), (8, 3), (1, 1), (15, 0)])
@pytest.mark.parametrize("value", [0.0, 2.4e-3])
def test_a_single_impulse_is_found_and_mended_wherever_it_is(
    place: tuple[int, int], value: float, flat: Pad
) -> None:
    clean = 1.2e-3 + 0.3 * on_a_ball(flat, 0.1)
    image = clean.copy()
    image[place] = value
    mended, impulses = median_filter(image, STEP)
    assert np.argwhere(impulses).tolist() == [list(place)]
    assert mended[place] == pytest.approx(clean[place], abs=0.05e-3)
    assert np.array_equal(mended[~impulses], image[~impulses])


def test_scattered_salt_and_pepper_goes_and_the_surface_stays(flat: Pad) -> None:
    clean = 1.2e-3 + 0.3 * on_a_ball(flat, 0.1)
    image = clean.copy()
    image[2::5, 1::5] = 2.4e-3
    image[4::5, 3::5] = 0.0
    mended, impulses = median_filter(image, STEP)
    assert np.array_equal(impulses, image != clean)
    assert np.abs(mended - clean).max() < 0.05e-3


def test_clean_frames_come_back_as_they_are(flat: Pad, domed: Pad) -> None:
    x, y = flat.grid()
    frames = [on_a_ball(pad, radius) for pad in (flat, domed) for radius in (0.004, 0.03, 0.3)]
    frames += [np.zeros((16, 16)), np.full((16, 16), 1e-3), 0.49 * (x + y), -2.0 * x]
    frames += [np.where(x > 0, 1e-3, 0.0), np.where((x > 0) & (y > 0), 1e-3, 0.0)]
    for frame in frames:
        filtered, impulses = median_filter(frame, STEP)
        assert not impulses.any()
        assert np.array_equal(filtered, frame)


def test_the_tip_of_a_needle_that_presses_four_taxels_is_left_alone(flat: Pad) -> None:
    tip = on_a_ball(flat, 0.001)
    assert (tip > 0).sum() == 4
    assert np.array_equal(median_filter(tip, STEP)[0], tip)


def test_noise_alone_has_no_impulses() -> None:
    noise = np.random.default_rng(5).normal(scale=NOISE, size=(100, 16, 16))
    assert not any(median_filter(frame, 0.0)[1].any() for frame in noise)
