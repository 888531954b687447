from __future__ import annotations

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.rebuild.contours.contacts import ContactPoints
from palpate.core.rebuild.radial.equations import AxisCurve, fit_axis_curve
from palpate.core.rebuild.radial.fit import (
    SECTORS,
    coverage_of,
    fit_shifted_spline,
    pose_sigma,
    radial_fit,
)
from palpate.core.rebuild.radial.spline import RadialSpline, fit_radial_spline

HEIGHT, POSE, TAXEL = 0.06, 1e-4, 1e-5
TURNS = np.arange(48) / 48


def upright() -> AxisCurve:
    return fit_axis_curve(np.array([0.0]), np.zeros((1, 2)))


def patches(seed: int, touches: int = 120, pose: float = POSE) -> ContactPoints:
    """Patches of 15 mm of a ball of 60 mm, each shifted as a whole, with noise on each taxel."""
    rng = np.random.default_rng(seed)
    centre = np.array([0.0, 0.0, 0.03])
    out = rng.normal(size=(touches, 3))
    out /= np.linalg.norm(out, axis=1, keepdims=True)
    aside = rng.uniform(-0.25, 0.25, (touches, 80, 3))
    normals = out[:, None] + aside
    normals /= np.linalg.norm(normals, axis=2, keepdims=True)
    shifts = pose * rng.normal(size=(touches, 1, 3))
    points = centre + 0.03 * normals + shifts + TAXEL * rng.normal(size=(touches, 80, 1)) * normals
    touch = np.repeat(np.arange(touches, dtype=np.int32), 80)
    return ContactPoints(points.reshape(-1, 3), normals.reshape(-1, 3), touch)


def error(spline: RadialSpline) -> float:
    heights = np.linspace(0.008, 0.052, 30)
    wanted = np.sqrt(0.03**2 - (heights - 0.03) ** 2)[:, None]
    off: Floats = (np.sqrt(spline.squared(heights, TURNS)) - wanted) * wanted / 0.03
    return float(np.sqrt(np.mean(off**2)))


def test_shifts_of_touches_are_found_with_the_surface() -> None:
    contacts = patches(0)
    plain = fit_radial_spline(contacts, upright(), 0.0, HEIGHT)
    shifted = fit_shifted_spline(contacts, plain)
    assert shifted.shifts is not None
    assert error(shifted.spline) < 0.7 * error(plain)
    assert shifted.spline.sigma < 2.0 * TAXEL
    sigma = pose_sigma(shifted)
    assert sigma is not None
    assert 0.6 * POSE < sigma < 1.3 * POSE


def test_the_band_of_a_shifted_skin_holds_the_surface() -> None:
    within = []
    for seed in range(4):
        contacts = patches(seed)
        shifted = fit_shifted_spline(contacts, fit_radial_spline(contacts, upright(), 0.0, HEIGHT))
        x, y, z = contacts.points.T
        seen = coverage_of(z, np.arctan2(y, x) / (2 * np.pi))
        assert seen is not None
        fit = radial_fit(shifted.spline, seen, pose_sigma(shifted), (0.008, 0.052), False)
        wanted = np.sqrt(0.03**2 - (fit.band_heights - 0.03) ** 2)[:, None]
        off = np.sqrt(shifted.spline.squared(fit.band_heights, TURNS)) - wanted
        within.append(np.abs(off * wanted / 0.03) < 1.96 * fit.band[:, None])
    assert 0.9 < np.mean(within) <= 1.0


def test_without_noise_no_shift_is_looked_for() -> None:
    contacts = patches(1, pose=0.0)
    exact = contacts._replace(
        points=np.array([0.0, 0.0, 0.03]) + 0.03 * np.asarray(contacts.normals)
    )
    plain = fit_radial_spline(exact, upright(), 0.0, HEIGHT)
    shifted = fit_shifted_spline(exact, plain)
    assert shifted.shifts is None
    assert shifted.spline is plain
    assert pose_sigma(shifted) is None


def test_edges_are_not_taken_for_shifts() -> None:
    # What a spline leaves of edges is no shift: waves within each touch.
    contacts = patches(2, pose=0.0)
    normals = np.asarray(contacts.normals)
    waves = 1e-4 * np.sin(4000.0 * contacts.points @ np.array([1.0, 0.3, 0.7]))
    rough = contacts._replace(points=contacts.points + waves[:, None] * normals)
    plain = fit_radial_spline(rough, upright(), 0.0, HEIGHT)
    assert fit_shifted_spline(rough, plain).shifts is None


def test_a_few_touches_are_not_shifted_but_smoothed() -> None:
    contacts = patches(3, touches=120)
    one = contacts._replace(touch=np.zeros(len(contacts.points), np.int32))
    plain = fit_radial_spline(one, upright(), 0.0, HEIGHT)
    shifted = fit_shifted_spline(one, plain)
    assert shifted.shifts is None
    assert shifted.spline.stiffness >= plain.stiffness


COVERAGE_TURNS = (np.arange(SECTORS) + 0.5) / SECTORS


def test_the_side_reaches_as_far_as_every_sector_was_felt() -> None:
    heights = np.concatenate([np.zeros(SECTORS), np.full(SECTORS, 0.04)])
    turns = np.tile(COVERAGE_TURNS, 2)
    heights[3], heights[SECTORS + 5] = 0.01, 0.03
    seen = coverage_of(heights, turns)
    assert seen is not None
    assert (seen.low, seen.high, seen.gap) == pytest.approx((0.01, 0.03, 0.04))
    assert (seen.lows[3], seen.highs[5]) == pytest.approx((0.01, 0.03))
    assert np.count_nonzero(seen.lows) == 1


def test_every_stretch_without_a_point_is_listed() -> None:
    levels = np.array([0.0, 0.01, 0.0101, 0.03])
    seen = coverage_of(np.repeat(levels, SECTORS), np.tile(COVERAGE_TURNS, 4))
    assert seen is not None
    assert np.sort(seen.gaps) == pytest.approx(np.repeat([0.01, 0.0199], SECTORS))


def test_the_gap_is_the_highest_stretch_that_a_sector_misses() -> None:
    levels = np.array([0.0, 0.01, 0.02, 0.03])
    heights, turns = np.repeat(levels, SECTORS), np.tile(COVERAGE_TURNS, 4)
    kept = ~((heights == 0.02) & (turns == COVERAGE_TURNS[7]))
    seen = coverage_of(heights[kept], turns[kept] + 3.0)
    assert seen is not None
    assert seen.gap == pytest.approx(0.02)


def test_a_side_that_was_not_felt_all_around_has_no_coverage() -> None:
    assert coverage_of(np.zeros(SECTORS - 1), COVERAGE_TURNS[1:]) is None
    assert coverage_of(np.zeros(0), np.zeros(0)) is None
