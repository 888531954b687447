"""Filters of Wiener and median, and the impulses of a frame."""

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.shapes import Superquadric
from palpate.core.touch import (
    Pad,
    adaptive_wiener,
    clean,
    guarded_move,
    median_filter,
    median_then_wiener,
    neighbourhoods,
    remove_impulses,
    wiener_then_median,
)
from tests.core.touch.touches import DOMED, FLAT, SURFACES, X, Y, above, draw_touch

NOISE, CONTACT, DEEPEST = 10e-6, 50e-6, 2.4e-3
BUMP: Floats = np.maximum(1.5e-3 - 0.5 * (X**2 + Y**2) / 0.03, 0.0)
SHALLOW: Floats = 1.2e-3 + 0.3 * np.maximum(1.5e-3 - 0.5 * (X**2 + Y**2) / 0.1, 0.0)


def white(seed: int, *shape: int) -> Floats:
    return np.random.default_rng(seed).normal(size=shape or (16, 16))


def test_wiener_pulls_to_the_mean_by_the_noise_share():
    image = white(4, 7, 9)
    padded = np.pad(image, 1, mode="reflect")
    for variance in (0.0, 0.01, 0.5, 1.0, 100.0):
        result = adaptive_wiener(image, variance)
        for row, col in np.ndindex(7, 9):
            nine = padded[row : row + 3, col : col + 3]
            signal = max(nine.var() - variance, 0.0)
            pulled = nine.mean() + signal / nine.var() * (image[row, col] - nine.mean())
            assert result[row, col] == pytest.approx(pulled, abs=1e-13)
    for offset, rounding in ((1e6, 1e-8), (1e8, 1e-6)):
        # A variance by squares less squared mean gives -2.0 for 1.02 there.
        there = adaptive_wiener(white(3) + offset, 0.5) - offset
        assert np.allclose(there, adaptive_wiener(white(3), 0.5), rtol=0, atol=rounding)


def test_median_is_that_of_nine_with_reflected_borders():
    image = white(6, 7, 9)
    padded, filtered = np.pad(image, 1, mode="reflect"), median_filter(image)
    for row, col in np.ndindex(7, 9):
        nine = padded[row : row + 3, col : col + 3]
        assert filtered[row, col] == np.median(nine)
        assert np.array_equal(neighbourhoods(image)[row, col], nine.ravel())


def test_order_selects_the_filters():
    frame, variance = BUMP + NOISE * white(8), NOISE**2
    wanted = {
        "none": frame,
        "wiener": adaptive_wiener(frame, variance),
        "median": median_filter(frame),
        "median-first": median_then_wiener(frame, variance),
        "wiener-first": wiener_then_median(frame, variance),
        "auto": frame,
    }
    for order, image in wanted.items():
        result = clean(FLAT, frame, NOISE, CONTACT, order)
        assert np.array_equal(result.compression, image) and result.impulses == 0
        assert np.array_equal(result.touched, image > CONTACT)


def test_lost_taxels_get_mean_of_neighbours_and_are_untouched():
    lost = np.zeros((16, 16), bool)
    lost[7, 7:9], lost[0, 0], lost[3:6, 3:6] = True, True, True
    frame = np.where(lost, DEEPEST, SHALLOW)
    result = clean(FLAT, frame, NOISE, CONTACT, "auto", lost)
    assert not result.touched[lost].any() and result.touched[~lost].all() and result.impulses <= 1
    assert np.array_equal(result.compression[~lost], SHALLOW[~lost])
    around = [SHALLOW[i, j] for i in (6, 7, 8) for j in (6, 7, 8) if not lost[i, j]]
    assert result.compression[7, 7] == pytest.approx(np.mean(around))


@pytest.mark.parametrize(
    ("share", "frames", "missed", "wrong"),
    [(0.02, 30, 0.02, 0.0), (0.08, 20, 0.02, 0.0), (0.2, 10, 0.06, 0.01)],
)
def test_impulses_are_found_and_mended_in_any_unit(share, frames, missed, wrong):
    rng, large, counts = np.random.default_rng(0), Pad(16, 16, 1.0, 3.0, 0.0, 0.8), np.zeros(3)
    for _ in range(frames):
        hit, up = rng.random((2, 16, 16))
        noisy = BUMP + NOISE * rng.normal(size=BUMP.shape)
        frame = np.where(hit < share, np.where(up < 0.5, 0.0, DEEPEST), noisy)
        impulses = np.abs(frame - BUMP) > 0.5e-3  # where they are seen
        result = remove_impulses(FLAT, frame, CONTACT, NOISE)
        false = result.impulses & (np.abs(frame - BUMP) < 0.1e-3)
        counts += [impulses.sum(), (impulses & ~result.impulses).sum(), false.sum()]
        assert np.array_equal(result.image[~result.impulses], frame[~result.impulses])
        mended = np.abs(result.image - BUMP)[impulses & result.impulses]
        assert share > 0.1 or mended.max(initial=0.0) < 0.15e-3
        other = remove_impulses(large, 1e3 * frame, 1e3 * CONTACT, 1e3 * NOISE)
        assert np.array_equal(result.impulses, other.impulses)
        assert np.allclose(1e3 * result.image, other.image, atol=1e-9)
    assert counts[0] > 100 and counts[1] <= missed * counts[0] and counts[2] <= wrong * counts[0]


PAIRS = [[(8, 8), (8, 9)], [(8, 8), (9, 8)], [(8, 8), (9, 9)], [(8, 8), (9, 7)]]
PAIRS += [[(0, 0), (0, 1)], [(14, 6), (15, 6)]]


@pytest.mark.parametrize("pair", PAIRS)
@pytest.mark.parametrize("value", [0.0, DEEPEST])
def test_two_impulses_side_by_side_are_both_found(pair, value):
    frame = SHALLOW + NOISE * white(2)
    for taxel in pair:
        frame[taxel] = value
    result = remove_impulses(FLAT, frame, CONTACT, NOISE)
    assert [tuple(taxel) for taxel in np.argwhere(result.impulses).tolist()] == pair
    assert np.abs(result.image - SHALLOW).max() < 0.1e-3


def test_impulses_beside_a_contact_are_found():
    small = np.maximum(0.4e-3 - 0.5 * (X**2 + Y**2) / 0.02, 0.0)
    blade = np.where(np.arange(16)[:, None] == 8, 1e-3, 0.0 * X)  # it has no jet
    level = np.full((16, 16), 1.2e-3)
    cases = [
        (small, {p: 1e-3 for p in ((0, 0), (1, 14), (14, 2), (15, 9), (14, 14), (14, 13))}),
        (blade, {(3, 3): 1e-3}),
        # One up and one down do not hold each other.
        (level, {(8, 7): 2.4e-3, (8, 9): 0.0, (3, 3): 0.0, (5, 5): 2.4e-3}),
    ]
    for exact, impulses in cases:
        frame = exact.copy()
        for at, value in impulses.items():
            frame[at] = value
        result = remove_impulses(FLAT, frame, CONTACT, NOISE)
        assert np.array_equal(result.impulses, frame != exact)
        assert np.array_equal(result.image > CONTACT, exact > CONTACT)


@pytest.mark.parametrize("name", SURFACES)
def test_faces_edges_corners_steps_and_rims_are_no_impulses(name):
    rng, taxels, wrong = np.random.default_rng(4), 0, 0
    for _ in range(30):
        pad, compression, touched, noise = draw_touch(rng, name)
        image, contact = np.where(touched, compression, 0.0), max(CONTACT, 5 * noise)
        result = remove_impulses(pad, image, contact, noise).impulses.sum()
        assert result <= 2  # the end of a ridge, at most
        wrong, taxels = wrong + int(result), taxels + int(touched.sum())
    assert wrong <= 1e-3 * taxels


def test_frames_without_impulses_are_unchanged():
    frames = [np.zeros((16, 16)), np.full((16, 16), 1e-3), 2.0 * X, 0.49 * (X + Y)]
    frames += [np.maximum(1e-3 - np.abs(X), 0.0), np.maximum(1e-3 - np.maximum(X, Y), 0.0)]
    frames += [np.where((X > 0) & (Y > 0), 1e-3, 0.0), np.where(X > 0, 1e-3, 0.0)]
    frames += [np.where(np.arange(16)[:, None] == 8, 1e-3, 0.0 * X)]  # a blade
    # The corners of a bar on a face are as high as what lies beside them.
    bars = [(np.abs(X) < wide) & (np.abs(Y) < 4e-3) for wide in (0.6e-3, 1e-3)]
    frames += [base + 0.6e-3 * bar for bar in bars for base in (0.5e-3, 1e-3)]
    for radius in (0.001, 0.004, 0.03, 0.3):
        ball = Superquadric(np.full(3, radius), np.ones(2))
        moves = [guarded_move(ball, pad, above(radius + 0.01), 0.05, 1e-3) for pad in (FLAT, DOMED)]
        frames += [move.compression for move in moves]
    for frame in frames:
        result = remove_impulses(FLAT, frame, CONTACT, 0.0)
        assert not result.impulses.any() and np.array_equal(result.image, frame)
    # Cones and corners of three faces, over a taxel and beside it.
    turns = np.radians([10.0, 130.0, 250.0])[:, None, None]
    for steep in (0.5, 0.7, 1.0, 1.5):
        for off in (0.0, 0.25e-3, 0.5e-3):
            x, y = X - off, Y - off
            for tip in (np.hypot(x, y), np.max(x * np.cos(turns) + y * np.sin(turns), axis=0)):
                frame = np.maximum(2e-3 - steep * tip, 0.0)
                assert not remove_impulses(FLAT, frame, CONTACT, NOISE).impulses.any()
    for noise in 50e-6 * white(5, 60, 16, 16):
        assert not remove_impulses(FLAT, BUMP + noise, 250e-6, 50e-6).impulses.any()


@pytest.mark.parametrize("noise", [50e-6, 100e-6, 200e-6])
def test_impulses_and_noise_together_leave_little_more_than_noise(noise):
    ball = Superquadric(np.full(3, 0.015), np.ones(2))
    exact = guarded_move(ball, FLAT, above(0.025), 0.05, 1.5e-3).compression
    rng, squares = np.random.default_rng(6), []
    for _ in range(30):
        drawn = rng.random(exact.shape)
        noisy = exact + rng.normal(scale=noise, size=exact.shape)
        frame = np.where(drawn < 0.1, np.where(drawn < 0.05, 0.0, DEEPEST), noisy)
        cleaned = clean(FLAT, frame, noise, CONTACT, "auto")
        squares.append((cleaned.compression - exact)[cleaned.touched] ** 2)
    # Of one taxel in ten, full scale is off by 0.9 mm and more.
    assert np.sqrt(np.mean(np.concatenate(squares))) < 2.0 * noise


@pytest.mark.parametrize("noise", [0.0, 200e-6])
def test_frame_of_impulses_only_has_no_contact(noise):
    rng = np.random.default_rng(7)
    frame = np.where(rng.random((16, 16)) < 0.5, 0.0, DEEPEST) + noise * rng.normal(size=(16, 16))
    cleaned = clean(FLAT, frame, noise, CONTACT, "auto")
    assert not cleaned.touched.any() and cleaned.impulses > 50
