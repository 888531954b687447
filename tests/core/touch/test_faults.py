"""Frames that no surface can have made: cut-off tops, dead, impossible, saturated and frozen."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.touch import FAULTS, clean, is_repeated, surface_patch
from tests.core.touch.touches import FLAT, X, Y

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
    ("image", "given", "kind", "fault"),
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
def test_a_frame_at_fault_has_no_curvature(image, given, kind, fault):
    patch = surface_patch(image, PITCH, **given)
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
def test_frames_are_judged_before_a_surface_is_sought(frame, noise, pressed, fault):
    found = clean(FLAT, frame, noise, CONTACT, "auto", pressed=pressed)
    assert found.fault == fault and FAULTS[fault] == FAULTS[found.fault]
    if fault != "none":
        assert not found.touched.any() and found.impulses == 0


def test_each_fault_has_a_sentence():
    assert set(FAULTS) == {"none", "dead", "impossible", "saturated", "frozen"}
    assert [fault for fault, sentence in FAULTS.items() if not sentence] == ["none"]


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
def test_a_noisy_frame_that_comes_again_is_frozen(frame, before, noise, repeated):
    assert is_repeated(frame, before, noise) is repeated
