import math

import numpy as np
import pytest

from palpate.core.poses import FACING_DOWN, pose_of
from palpate.core.shapes.superquadrics import Superquadric
from palpate.core.touch.filters import (
    adaptive_wiener,
    clean,
    median_filter,
    median_then_wiener,
    neighbourhoods,
    remove_impulses,
    wiener_then_median,
)
from palpate.core.touch.pad import Pad, guarded_move
from tests.studies.surfaces import SURFACES, draw_touch

NOISE = 10e-6


def on_a_ball(pad, radius, depth=1e-3):
    ball = Superquadric(np.full(3, radius), np.ones(2))
    start = pose_of(np.array([0.0, 0.0, radius + 0.01]), FACING_DOWN)
    return guarded_move(ball, pad, start, 0.05, depth).compression


def test_without_noise_wiener_changes_nothing():
    image = np.random.default_rng(0).normal(size=(16, 16))
    assert np.array_equal(adaptive_wiener(image, 0.0), image)


@pytest.mark.parametrize("value", [0.0, 1e-3, -7.0, 1e8])
def test_wiener_keeps_a_constant_frame(value):
    image = np.full((6, 9), value)
    assert np.allclose(adaptive_wiener(image, NOISE**2), image, rtol=1e-15, atol=0)


def test_wiener_takes_most_of_the_noise_from_a_flat_frame():
    noise = np.random.default_rng(1).normal(scale=NOISE, size=(200, 16, 16))
    left = np.stack([adaptive_wiener(frame, NOISE**2) for frame in noise])
    # A mean of nine leaves 1/9 of the variance; the sample variance of nine often passes for
    # signal, which leaves some more.
    assert np.var(left) < 0.3 * NOISE**2
    assert abs(float(left.mean())) < NOISE / 20


def test_wiener_hardly_touches_what_stands_far_above_the_noise():
    image = 1e-3 * np.random.default_rng(2).normal(size=(16, 16))
    moved = adaptive_wiener(image, NOISE**2) - image
    # The share taken is noise over signal variance, times the distance to the mean.
    assert np.abs(moved).max() < 1e-2 * 1e-3


def test_wiener_uses_variances_as_3_6_should_read():
    image = np.zeros((3, 3))
    image[1, 1] = 9.0
    variance = 9.0 - 1.0  # of eight zeros and a nine
    filtered = adaptive_wiener(image, 2.0)[1, 1]
    assert filtered == pytest.approx(1.0 + (variance - 2.0) / variance * 8.0)


@pytest.mark.parametrize(("offset", "rounding"), [(1e6, 1e-8), (1e8, 1e-6)])
def test_wiener_is_not_thrown_by_an_offset_of_1e8(offset, rounding):
    # A variance by squares less squared mean gives -2.0 for 1.02 there.
    image = np.random.default_rng(3).normal(size=(16, 16))
    there = adaptive_wiener(image + offset, 0.5) - offset
    assert np.allclose(there, adaptive_wiener(image, 0.5), rtol=0, atol=rounding)


def test_wiener_pulls_towards_the_mean_and_never_beyond():
    image = np.random.default_rng(4).normal(size=(16, 16))
    for variance in (0.01, 1.0, 100.0):
        filtered = adaptive_wiener(image, variance)
        assert filtered.min() >= image.min()
        assert filtered.max() <= image.max()


def test_the_median_of_a_neighbourhood_is_that_of_its_nine_with_reflected_borders():
    image = np.random.default_rng(6).normal(size=(7, 9))
    padded = np.pad(image, 1, mode="reflect")
    filtered = median_filter(image)
    for row, col in np.ndindex(7, 9):
        assert filtered[row, col] == np.median(padded[row : row + 3, col : col + 3])
        nine = padded[row : row + 3, col : col + 3].ravel()
        assert np.array_equal(neighbourhoods(image)[row, col], nine)


def test_the_median_takes_an_impulse_out_and_keeps_a_step(flat):
    x, _ = flat.grid()
    step = np.where(x > 0, 1e-3, 0.0)
    image = step.copy()
    image[5, 5], image[11, 12] = 2.4e-3, 0.0
    assert np.array_equal(median_filter(image), step)


def test_a_median_taken_everywhere_makes_plateaus(flat):
    x, y = flat.grid()
    top = median_filter(1e-3 - 0.5 * (x**2 + y**2) / 0.02)
    # The four highest taxels, and those around them, are made equal.
    assert np.ptp(top[7:9, 7:9]) < 1e-18
    assert top.max() < 1e-3 - 0.5 * (2 * (0.5e-3) ** 2) / 0.02


def test_without_impulses_both_orders_are_worth_same_and_with_them_median_first_wins(flat):
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


CONTACT = 50e-6
DEEPEST = 2.4e-3
# Pairs side by side: in the middle, at a corner and at a border of the array.
ACROSS = (
    ((8, 8), (8, 9)),
    ((8, 8), (9, 8)),
    ((8, 8), (9, 9)),
    ((8, 8), (9, 7)),
    ((0, 0), (0, 1)),
    ((15, 6), (14, 6)),
)


def bump(pad, depth=1.5e-3, radius=0.03):
    """Compression under a ball."""
    x, y = pad.grid()
    return np.maximum(depth - 0.5 * (x**2 + y**2) / radius, 0.0)


def struck(clean, share, rng):
    """The frame with noise and impulses, and where the impulses are seen."""
    hit, up = rng.random((2, *clean.shape))
    noisy = clean + NOISE * rng.normal(size=clean.shape)
    frame = np.where(hit < share, np.where(up < 0.5, 0.0, DEEPEST), noisy)
    return frame, np.abs(frame - clean) > 0.5e-3


@pytest.mark.parametrize("share", [0.02, 0.08])
def test_salt_and_pepper_are_found_and_nothing_else(share, flat):
    rng = np.random.default_rng(0)
    missed = wrong = all_of_them = 0
    for _ in range(60):
        clean = bump(flat)
        frame, impulses = struck(clean, share, rng)
        mended = remove_impulses(flat, frame, CONTACT, NOISE)
        missed += int((impulses & ~mended.impulses).sum())
        wrong += int((mended.impulses & (np.abs(frame - clean) < 0.1e-3)).sum())
        all_of_them += int(impulses.sum())
        good = impulses & mended.impulses
        assert np.abs(mended.image - clean)[good].max(initial=0.0) < 0.15e-3
        assert np.array_equal(mended.image[~mended.impulses], frame[~mended.impulses])
    assert all_of_them > 100
    assert missed <= 0.02 * all_of_them
    assert wrong == 0


def test_a_fifth_of_impulses_is_mostly_found(flat):
    rng = np.random.default_rng(1)
    missed = wrong = all_of_them = 0
    for _ in range(40):
        clean = bump(flat)
        frame, impulses = struck(clean, 0.2, rng)
        found = remove_impulses(flat, frame, CONTACT, NOISE).impulses
        missed += int((impulses & ~found).sum())
        wrong += int((found & (np.abs(frame - clean) < 0.1e-3)).sum())
        all_of_them += int(impulses.sum())
    assert missed < 0.06 * all_of_them
    assert wrong < 0.01 * all_of_them


@pytest.mark.parametrize("pair", ACROSS)
@pytest.mark.parametrize("value", [0.0, DEEPEST])
def test_two_impulses_side_by_side_are_both_found(pair, value, flat):
    clean = 1.2e-3 + 0.3 * bump(flat, radius=0.1)
    frame = clean + NOISE * np.random.default_rng(2).normal(size=clean.shape)
    for place in pair:
        frame[place] = value
    found = remove_impulses(flat, frame, CONTACT, NOISE)
    assert np.argwhere(found.impulses).tolist() == sorted([list(place) for place in pair])
    assert np.abs(found.image - clean).max() < 0.1e-3


def test_salt_beside_the_contact_is_found(flat):
    clean = bump(flat, depth=0.4e-3, radius=0.02)
    assert (clean > 0).sum() < 60
    frame = clean.copy()
    for place in ((0, 0), (1, 14), (14, 2), (15, 9), (14, 14), (14, 13)):
        assert clean[place] == 0.0
        frame[place] = 1e-3
    found = remove_impulses(flat, frame, CONTACT, NOISE)
    assert np.array_equal(found.impulses, frame != clean)
    assert np.array_equal(found.image > CONTACT, clean > CONTACT)


def test_salt_on_a_pad_that_touches_nothing_is_found(flat):
    rng = np.random.default_rng(3)
    for _ in range(20):
        frame = NOISE * rng.normal(size=(16, 16))
        hit = rng.random(frame.shape) < 0.04
        found = remove_impulses(flat, np.where(hit, DEEPEST, frame), CONTACT, NOISE)
        touched = (found.image > CONTACT).sum()
        assert touched <= 4  # four in a square pass for a tip


def test_an_impulse_up_and_one_down_do_not_hold_each_other(flat):
    clean = np.full((16, 16), 1.2e-3)
    frame = clean.copy()
    frame[8, 7], frame[8, 9] = 2.4e-3, 0.0
    frame[3, 3], frame[5, 5] = 0.0, 2.4e-3
    assert np.array_equal(remove_impulses(flat, frame, CONTACT, NOISE).impulses, frame != clean)


@pytest.mark.parametrize("name", [name for name in SURFACES if name not in ("grazing", "nothing")])
def test_faces_edges_corners_steps_and_rims_are_not_taken_for_impulses(name):
    rng = np.random.default_rng(4)
    taxels = wrong = 0
    for _ in range(80):
        touch = draw_touch(rng, name)
        if touch is None or touch.kind == "insufficient":
            continue
        image = np.where(touch.touched, -touch.height - touch.pad.sag(), 0.0)
        contact = max(CONTACT, 5 * touch.noise)
        found = remove_impulses(touch.pad, image, contact, touch.noise).impulses
        assert found.sum() <= 2  # the end of a ridge, at most
        wrong += int(found.sum())
        taxels += int(touch.touched.sum())
    assert taxels > 500
    assert wrong <= (1e-2 if name == "rim" else 1e-3) * taxels


def test_clean_frames_come_back_as_they_are(flat, domed):
    x, y = flat.grid()
    frames = [np.zeros((16, 16)), np.full((16, 16), 1e-3), 2.0 * x, 0.49 * (x + y)]
    frames += [np.maximum(1e-3 - np.abs(x), 0.0), np.maximum(1e-3 - np.maximum(x, y), 0.0)]
    frames += [np.where((x > 0) & (y > 0), 1e-3, 0.0), np.where(x > 0, 1e-3, 0.0)]
    for pad in (flat, domed):
        for radius in (0.001, 0.004, 0.03, 0.3):
            ball = Superquadric(np.full(3, radius), np.ones(2))
            start = pose_of(np.array([0.0, 0.0, radius + 0.01]), FACING_DOWN)
            frames.append(guarded_move(ball, pad, start, 0.05, 1e-3).compression)
    for frame in frames:
        found = remove_impulses(flat, frame, CONTACT, 0.0)
        assert not found.impulses.any()
        assert np.array_equal(found.image, frame)


def test_the_tip_of_a_corner_and_of_a_cone_are_left_alone(flat):
    x, y = flat.grid()
    for steep in (0.5, 0.7, 1.0, 1.5):
        for off in (0.0, 0.25e-3, 0.5e-3):
            away = np.hypot(x - off, y - off)
            faces = [
                (x - off) * math.cos(turn) + (y - off) * math.sin(turn)
                for turn in np.radians([10.0, 130.0, 250.0])
            ]
            for height in (away, np.max(faces, axis=0)):
                image = np.maximum(2e-3 - steep * height, 0.0)
                assert not remove_impulses(flat, image, CONTACT, NOISE).impulses.any()


def test_noise_alone_has_no_impulses(flat):
    rng = np.random.default_rng(5)
    for _ in range(100):
        frame = bump(flat) + 50e-6 * rng.normal(size=(16, 16))
        assert not remove_impulses(flat, frame, 250e-6, 50e-6).impulses.any()


def test_it_is_the_same_in_millimetres(flat):
    rng = np.random.default_rng(6)
    large = Pad(16, 16, 1.0, 3.0, 0.0, 0.8)
    for _ in range(20):
        frame, _ = struck(bump(flat), 0.08, rng)
        metres = remove_impulses(flat, frame, CONTACT, NOISE)
        other = remove_impulses(large, 1e3 * frame, 1e3 * CONTACT, 1e3 * NOISE)
        assert np.array_equal(metres.impulses, other.impulses)
        assert np.allclose(1e3 * metres.image, other.image, atol=1e-9)


def test_a_contact_on_one_line_has_no_jet_and_keeps_its_taxels(flat):
    blade = np.zeros((16, 16))
    blade[8, :] = 1e-3
    assert not remove_impulses(flat, blade, CONTACT, NOISE).impulses.any()
    blade[3, 3] = 1e-3
    assert np.argwhere(remove_impulses(flat, blade, CONTACT, NOISE).impulses).tolist() == [[3, 3]]


@pytest.mark.parametrize("noise", [50e-6, 100e-6, 200e-6])
def test_impulses_and_noise_together_leave_little_more_than_noise(noise):
    pad, rng = Pad(16, 16, 1e-3, 3e-3, 0.0, 0.8), np.random.default_rng(6)
    full, squares = pad.saturation * pad.thickness, []
    exact = on_a_ball(pad, 0.015, 1.5e-3)
    for _ in range(40):
        frame = exact + rng.normal(scale=noise, size=exact.shape)
        drawn = rng.random(exact.shape)
        frame[drawn < 0.1] = np.where(drawn[drawn < 0.1] < 0.05, 0.0, full)
        cleaned = clean(pad, frame, noise, 50e-6, "auto")
        squares.append((cleaned.compression - exact)[cleaned.touched] ** 2)
    # Of one taxel in ten, full scale is off by 0.9 mm and more.
    assert np.sqrt(np.mean(np.concatenate(squares))) < 2.0 * noise
