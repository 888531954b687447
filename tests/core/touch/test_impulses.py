from __future__ import annotations

import math

import numpy as np
import pytest

from palpate.core.arrays import Bools, Floats
from palpate.core.frames import DOWN, pose_of
from palpate.core.shapes.superquadric import Superquadric
from palpate.core.touch.impulses import robust_clean
from palpate.core.touch.pad import Pad, press
from palpate.launch.bench_patches import SURFACES, draw_touch

NOISE = 10e-6
CONTACT = 50e-6
DEEPEST = 2.4e-3
ACROSS = (
    ((8, 8), (8, 9)),
    ((8, 8), (9, 8)),
    ((8, 8), (9, 9)),
    ((8, 8), (9, 7)),
    ((0, 0), (0, 1)),
    ((15, 6), (14, 6)),
)
"""Pairs side by side: in the middle, at a corner and at a border of the array."""


def bump(pad: Pad, depth: float = 1.5e-3, radius: float = 0.03) -> Floats:
    """Compression under a ball."""
    x, y = pad.grid()
    return np.maximum(depth - 0.5 * (x**2 + y**2) / radius, 0.0)


def struck(clean: Floats, share: float, rng: np.random.Generator) -> tuple[Floats, Bools]:
    """The frame with noise and impulses, and where the impulses are seen."""
    hit, up = rng.random((2, *clean.shape))
    noisy = clean + NOISE * rng.normal(size=clean.shape)
    frame = np.where(hit < share, np.where(up < 0.5, 0.0, DEEPEST), noisy)
    return frame, np.abs(frame - clean) > 0.5e-3


@pytest.mark.parametrize("share", [0.02, 0.08])
def test_salt_and_pepper_are_found_and_nothing_else(share: float, flat: Pad) -> None:
    rng = np.random.default_rng(0)
    missed = wrong = all_of_them = 0
    for _ in range(60):
        clean = bump(flat)
        frame, impulses = struck(clean, share, rng)
        mended = robust_clean(flat, frame, CONTACT, NOISE)
        missed += int((impulses & ~mended.impulses).sum())
        wrong += int((mended.impulses & (np.abs(frame - clean) < 0.1e-3)).sum())
        all_of_them += int(impulses.sum())
        good = impulses & mended.impulses
        assert np.abs(mended.image - clean)[good].max(initial=0.0) < 0.15e-3
        assert np.array_equal(mended.image[~mended.impulses], frame[~mended.impulses])
    assert all_of_them > 100
    assert missed <= 0.02 * all_of_them
    assert wrong == 0


def test_a_fifth_of_impulses_is_mostly_found(flat: Pad) -> None:
    rng = np.random.default_rng(1)
    missed = wrong = all_of_them = 0
    for _ in range(40):
        clean = bump(flat)
        frame, impulses = struck(clean, 0.2, rng)
        found = robust_clean(flat, frame, CONTACT, NOISE).impulses
        missed += int((impulses & ~found).sum())
        wrong += int((found & (np.abs(frame - clean) < 0.1e-3)).sum())
        all_of_them += int(impulses.sum())
    assert missed < 0.06 * all_of_them
    assert wrong < 0.01 * all_of_them


@pytest.mark.parametrize("pair", ACROSS)
@pytest.mark.parametrize("value", [0.0, DEEPEST])
def test_two_impulses_side_by_side_are_both_found(
    pair: tuple[tuple[int, int], tuple[int, int]], value: float, flat: Pad
) -> None:
    clean = 1.2e-3 + 0.3 * bump(flat, radius=0.1)
    frame = clean + NOISE * np.random.default_rng(2).normal(size=clean.shape)
    for place in pair:
        frame[place] = value
    found = robust_clean(flat, frame, CONTACT, NOISE)
    assert np.argwhere(found.impulses).tolist() == sorted([list(place) for place in pair])
    assert np.abs(found.image - clean).max() < 0.1e-3


def test_salt_beside_the_contact_is_found(flat: Pad) -> None:
    clean = bump(flat, depth=0.4e-3, radius=0.02)
    assert (clean > 0).sum() < 60
    frame = clean.copy()
    for place in ((0, 0), (1, 14), (14, 2), (15, 9), (14, 14), (14, 13)):
        assert clean[place] == 0.0
        frame[place] = 1e-3
    found = robust_clean(flat, frame, CONTACT, NOISE)
    assert np.array_equal(found.impulses, frame != clean)
    assert np.array_equal(found.image > CONTACT, clean > CONTACT)


def test_salt_on_a_pad_that_touches_nothing_is_found(flat: Pad) -> None:
    rng = np.random.default_rng(3)
    for _ in range(20):
        frame = NOISE * rng.normal(size=(16, 16))
        hit = rng.random(frame.shape) < 0.04
        found = robust_clean(flat, np.where(hit, DEEPEST, frame), CONTACT, NOISE)
        touched = (found.image > CONTACT).sum()
        assert touched <= 4  # four in a square pass for a tip


def test_an_impulse_up_and_one_down_do_not_hold_each_other(flat: Pad) -> None:
    clean = np.full((16, 16), 1.2e-3)
    frame = clean.copy()
    frame[8, 7], frame[8, 9] = 2.4e-3, 0.0
    frame[3, 3], frame[5, 5] = 0.0, 2.4e-3
    assert np.array_equal(robust_clean(flat, frame, CONTACT, NOISE).impulses, frame != clean)


@pytest.mark.parametrize("name", [name for name in SURFACES if name not in ("grazing", "nothing")])
def test_faces_edges_corners_steps_and_rims_are_not_taken_for_impulses(name: str) -> None:
    rng = np.random.default_rng(4)
    taxels = wrong = 0
    for _ in range(80):
        touch = draw_touch(rng, name)
        if touch is None or touch.kind == "insufficient":
            continue
        image = np.where(touch.touched, -touch.height - touch.pad.sag(), 0.0)
        contact = max(CONTACT, 5 * touch.noise)
        found = robust_clean(touch.pad, image, contact, touch.noise).impulses
        assert found.sum() <= 2  # the end of a ridge, at most
        wrong += int(found.sum())
        taxels += int(touch.touched.sum())
    assert taxels > 500
    assert wrong <= (1e-2 if name == "rim" else 1e-3) * taxels


def test_clean_frames_come_back_as_they_are(flat: Pad, domed: Pad) -> None:
    x, y = flat.grid()
    frames = [np.zeros((16, 16)), np.full((16, 16), 1e-3), 2.0 * x, 0.49 * (x + y)]
    frames += [np.maximum(1e-3 - np.abs(x), 0.0), np.maximum(1e-3 - np.maximum(x, y), 0.0)]
    frames += [np.where((x > 0) & (y > 0), 1e-3, 0.0), np.where(x > 0, 1e-3, 0.0)]
    for pad in (flat, domed):
        for radius in (0.001, 0.004, 0.03, 0.3):
            ball = Superquadric(np.full(3, radius), np.ones(2))
            start = pose_of(np.array([0.0, 0.0, radius + 0.01]), DOWN)
            frames.append(press(ball, pad, start, 0.05, 1e-3).compression)
    for frame in frames:
        found = robust_clean(flat, frame, CONTACT, 0.0)
        assert not found.impulses.any()
        assert np.array_equal(found.image, frame)


def test_the_tip_of_a_corner_and_of_a_cone_are_left_alone(flat: Pad) -> None:
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
                assert not robust_clean(flat, image, CONTACT, NOISE).impulses.any()


def test_noise_alone_has_no_impulses(flat: Pad) -> None:
    rng = np.random.default_rng(5)
    for _ in range(100):
        frame = bump(flat) + 50e-6 * rng.normal(size=(16, 16))
        assert not robust_clean(flat, frame, 250e-6, 50e-6).impulses.any()


def test_it_is_the_same_in_millimetres(flat: Pad) -> None:
    rng = np.random.default_rng(6)
    large = Pad(16, 16, 1.0, 3.0, 0.0, 0.8)
    for _ in range(20):
        frame, _ = struck(bump(flat), 0.08, rng)
        metres = robust_clean(flat, frame, CONTACT, NOISE)
        other = robust_clean(large, 1e3 * frame, 1e3 * CONTACT, 1e3 * NOISE)
        assert np.array_equal(metres.impulses, other.impulses)
        assert np.allclose(1e3 * metres.image, other.image, atol=1e-9)


def test_a_contact_on_one_line_has_no_jet_and_keeps_its_taxels(flat: Pad) -> None:
    blade = np.zeros((16, 16))
    blade[8, :] = 1e-3
    assert not robust_clean(flat, blade, CONTACT, NOISE).impulses.any()
    blade[3, 3] = 1e-3
    assert np.argwhere(robust_clean(flat, blade, CONTACT, NOISE).impulses).tolist() == [[3, 3]]
