"""Verdicts on a touch: smooth, edge, corner, insufficient or a miss, and frames at fault."""

import math
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.touch import clean, fit_patch, is_repeated, surface_patch
from tests.core.touch.touches import FLAT, KINDS, SURFACES, X, Y, draw_touch

ALL, ALONG_Y = np.ones((16, 16), bool), np.array([0.0, 1.0, 0.0])


def test_surface_kinds_are_classified_with_95_percent_accuracy():
    rng, calls = np.random.default_rng(1234), Counter()
    for name in np.repeat(list(SURFACES), 30):
        pad, compression, touched, noise = draw_touch(rng, name)
        height = pad.surface(compression, touched)
        calls[KINDS[name], fit_patch(pad, height, touched, ALONG_Y, noise).kind] += 1
    kinds = Counter(kind for kind, _ in calls.elements())
    for kind in ("smooth", "edge", "corner"):
        assert calls[kind, kind] >= 0.95 * kinds[kind], calls


ROOF, SQUARE = np.abs(X), np.maximum(np.abs(X), np.abs(Y))
THREE = np.maximum(0.4 * X, np.maximum(0.3 * Y - 0.2 * X, -0.4 * Y - 0.2 * X))
SIDE = (0.02 - np.sqrt(0.02**2 - Y**2)) / 0.7 - 0.8 * X  # of a cylinder
BOARD = (np.add.outer(range(16), range(16)) % 2).astype(bool)
CASES = [
    ("edge", 0.25 * ROOF),
    ("edge", -0.5 * np.abs(X + 0.3 * Y)),
    ("edge", np.where(X > 0, 1e-3, 0.0)),
    ("edge", np.where(X + Y > 3e-3, 0.2e-3, 0.0)),
    ("edge", np.maximum(0.6 * X, SIDE)),  # a cylinder's rim, although one face is curved
    ("edge", 0.5 * np.sqrt(X**2 + 0.2e-3**2)),  # rounded to 0.4 mm
    ("edge", 0.5 * 501.0 * X**2),  # it curves within two pitches, however well a jet fits
    ("edge", np.where(BOARD, 0.0, 2e-4)),  # a board of touches that differ in height
    ("corner", SQUARE),
    ("corner", THREE),
    ("smooth", 0.5 * (X**2 + Y**2) / 0.008),
    ("smooth", 0.3 * X - 0.2 * Y),
    ("smooth", X * Y / 0.02),
    ("smooth", 0.5 * np.sqrt(X**2 + 8e-3**2)),  # a wide rounding
    ("smooth", 0.5 * 499.0 * X**2),
]


@pytest.mark.parametrize(("kind", "height"), CASES)
@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e3])
def test_verdicts_do_not_depend_on_noise_turn_or_unit(kind, height, scale):
    pad = replace(FLAT, pitch=scale * FLAT.pitch)
    noisy = height + 2e-6 * np.random.default_rng(0).normal(size=height.shape)
    for frame, noise in ((height, 2e-6), (noisy, 2e-6), (noisy[::-1].T, 2e-6)):
        patch = fit_patch(pad, scale * np.ascontiguousarray(frame), ALL, ALONG_Y, scale * noise)
        assert patch.kind == kind


@pytest.mark.parametrize("height", [ROOF, SQUARE, np.where(X > 0, 1e-3, 0.0), -ROOF])
def test_edges_and_corners_have_a_normal_and_no_curvature(height):
    patch = fit_patch(FLAT, height, ALL, ALONG_Y, 10e-6)
    assert patch.kind in ("edge", "corner") and patch.jet is not None
    assert patch.principal == patch.principal_error == (0.0, 0.0)
    assert patch.across == patch.across_error == patch.gaussian == patch.mean == 0.0
    assert patch.umbilic and patch.shape is patch.shape_covariance is None
    assert (patch.principal_direction == 0.0).all() and 0.0 <= patch.confidence < 0.5
    assert patch.residual > 40e-6 and 0.0 < patch.normal_error < math.pi


def test_comb_is_an_edge_where_a_jet_misses_it():
    comb = np.zeros((16, 16), bool)
    comb[::2] = True  # no square of four is touched
    rough = 0.1e-3 * np.random.default_rng(0).normal(size=comb.shape)
    for share, kind in ((1.0, "edge"), (0.12, "smooth")):
        assert fit_patch(FLAT, share * rough, comb, ALONG_Y, 1e-6).kind == kind


MANY = [(i, j) for i in range(0, 16, 5) for j in range(0, 16, 5)]


@pytest.mark.parametrize(
    ("places", "smooth"),
    [
        *[(some, True) for some in ([], [(4, 4)], [(0, 15)], [(0, 0), (9, 12)])],
        ([(2, 3), (2, 5), (15, 15)], True),
        *[([(4, 4), beside], False) for beside in ((4, 5), (5, 5), (5, 3))],
        (MANY, False),
    ],
)
def test_up_to_three_single_outliers_make_no_edge(places, smooth):
    """A ball of 30 mm with noise, and single taxels that stand off it by 1 mm."""
    noise = 10e-6 * np.random.default_rng(0).normal(size=X.shape)
    height: Floats = 0.5 * (X**2 + Y**2) / 0.03 + noise
    for place in places:
        height[place] += 1e-3
    patch = fit_patch(FLAT, height, ALL, ALONG_Y, 10e-6)
    assert (patch.kind == "smooth") == smooth
    off = np.abs(np.subtract(patch.principal, 1 / 0.03))
    assert not smooth or (off < 4.0 * max(patch.principal_error)).all()


# Frames at fault

PITCH, CONTACT = 1e-3, 50e-6
BALL: Floats = np.maximum(1e-3 - 0.5 * (X**2 + Y**2) / 0.02, 0.0)  # of 20 mm, pressed by 1 mm
KNOWN = {"thickness": 3e-3, "saturation": 0.8}


@pytest.mark.parametrize("cut", [0.9e-3, 0.7e-3, 0.5e-3, 0.3e-3])
@pytest.mark.parametrize("noise", [0.0, 1e-5])
def test_errors_of_a_saturated_touch_cover_what_was_cut_off(cut, noise):
    whole = BALL + noise * np.random.default_rng(0).normal(size=(16, 16))
    full = surface_patch(whole, PITCH, noise=noise)
    patch = surface_patch(np.minimum(whole, cut), PITCH, noise=noise)
    top = whole >= cut
    assert (patch.kind, patch.fault) == ("smooth", "saturated")
    assert np.array_equal(patch.cut, top)
    share = float(np.mean(whole[whole > CONTACT] >= cut))
    assert patch.confidence <= (1.0 - share) * full.confidence + 1e-12
    for k, error in zip(patch.principal, patch.principal_error, strict=True):
        assert abs(k - 50.0) < 2.0 * error and error > 0.9 * share * k
    assert abs(patch.across - 50.0) < 2.0 * patch.across_error
    assert np.linalg.eigvalsh(patch.shape_covariance).min() > (0.4 * share * 50.0) ** 2


FLOOR = 1.5167e-3 - 0.5 * (X**2 + Y**2) / 0.015  # a plane that a domed pad met squarely
ARC = np.maximum(0.03 - np.sqrt(0.042**2 - np.hypot(X + 16.55e-3, 23.2e-3 - Y) ** 2), 0.0)


@pytest.mark.parametrize(
    ("image", "options", "kind", "fault"),
    [
        (BALL, KNOWN, "smooth", "none"),
        (BALL - 3e-3, {}, "invalid", "impossible"),
        (np.full((16, 16), 3e-3), KNOWN, "invalid", "impossible"),
        (np.full((16, 16), 2.4e-3), KNOWN, "invalid", "saturated"),
        (np.full((16, 16), 2.3e-3), KNOWN, "smooth", "none"),
        (np.full((16, 16), 3e-3), {"radius": 0.015}, "insufficient", "saturated"),
        (np.minimum(BALL, 1e-4), {}, "insufficient", "saturated"),
        (np.full((16, 16), 1e-3), {}, "smooth", "none"),  # a plane that was met squarely
        # Four taxels read most on a face that ends in an arc: nothing is cut off.
        (np.maximum(FLOOR - ARC, 0.0), {"radius": 0.015}, "edge", "none"),
    ],
)
def test_frame_at_fault_has_no_curvature(image, options, kind, fault):
    patch = surface_patch(image, PITCH, **options)
    assert (patch.kind, patch.fault) == (kind, fault)
    if image is not BALL:
        assert patch.principal == pytest.approx((0.0, 0.0), abs=1e-9)


HALF = np.where(X > 0.0, 1.0, 0.0)
QUARTER = np.where((X > 0.0) & (Y > 0.0), 1.0, 0.0)
SINGLE = np.zeros((16, 16))
SINGLE[5, 5] = 1e-3


@pytest.mark.parametrize(
    ("frame", "noise", "pressed", "fault"),
    [
        (BALL, 0.0, True, "none"),
        (0.0 * X, 0.0, False, "none"),  # nothing was pressed
        (0.0 * X, 0.0, True, "dead"),
        (0.9 * CONTACT + 0.0 * X, 0.0, True, "dead"),
        (4.9 * 2e-5 + 0.0 * X, 2e-5, True, "dead"),  # below five deviations of the noise
        (5.1 * 2e-5 + 0.0 * X, 2e-5, True, "none"),
        (SINGLE, 0.0, True, "none"),  # an impulse is felt by one taxel: it is not dead
        (2.8e-3 * HALF, 0.0, True, "impossible"),  # halfway from saturation to the thickness
        (2.6e-3 * HALF, 0.0, True, "saturated"),
        (2.39e-3 * HALF, 0.0, True, "none"),
        (BALL - 0.49e-3 * (1 - HALF), 0.0, True, "none"),  # drift of a half pitch below zero
        (BALL - 1.6e-3 * (1 - HALF), 0.0, True, "impossible"),
        (-0.6e-3 + 1.6e-3 * HALF, 0.15e-3, True, "none"),  # within five deviations
        (2.8e-3 * QUARTER, 0.0, True, "impossible"),  # more than half of what is touched
        (1e-3 + 1.8e-3 * QUARTER, 0.0, True, "none"),  # no more than a quarter of all
    ],
)
def test_faulty_frames_have_no_contact(frame, noise, pressed, fault):
    result = clean(FLAT, frame, noise, CONTACT, "auto", pressed=pressed)
    assert result.fault == fault
    if fault != "none":
        assert not result.touched.any() and result.impulses == 0


NOISY = BALL + 10e-6 * np.random.default_rng(0).normal(size=X.shape)
COUNTED = 5e-6 * np.rint(NOISY / 5e-6)


@pytest.mark.parametrize(
    ("frame", "before", "noise", "repeated"),
    [
        (NOISY, NOISY.copy(), 10e-6, True),
        (NOISY, NOISY + 1e-12, 10e-6, False),
        (NOISY, NOISY.copy(), 0.0, False),  # without noise equal touches give equal frames
        (COUNTED, COUNTED.copy(), 10e-6, True),
        (COUNTED, COUNTED.copy(), 5e-6 / 12.0**0.5, False),  # the noise is that of rounding
        (0.0 * X, 0.0 * X, 10e-6, False),  # all taxels alike: no noise is seen
    ],
)
def test_repeated_noisy_frame_is_frozen(frame, before, noise, repeated):
    assert is_repeated(frame, before, noise) is repeated
