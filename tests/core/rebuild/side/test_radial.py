"""The side as a radial spline of contact points: fidelity, gaps, shifts of touches, errors."""

from functools import cache
from typing import Any

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.rebuild import side as sides
from palpate.core.rebuild.contours import ContactPoints, stack_points
from palpate.core.rebuild.side import RadialSpline, coverage_of, with_gaps_bridged
from tests.core.rebuild import objects
from tests.core.rebuild.objects import Oracle, at_height, circle, contacts, rms, slow

HEIGHT = 0.06  # of most objects here [m]
TURNS = np.linspace(0.0, 1.0, 24, endpoint=False)
LEVELS = np.linspace(0.008, 0.052, 30)
BALL, EGG = Oracle([0.03] * 3, [1.0, 1.0]), Oracle([0.04, 0.025, 0.03], [1.0, 1.0])
UP = sides.fit_axis_curve(np.array([0.0]), np.zeros((1, 2)))


def everywhere(true: Oracle, count: int = 49, most: float = 0.98) -> ContactPoints:
    rings = [true.section(share) for share in np.linspace(-most, most, count)]
    return true.contacts_at(np.concatenate(rings))


def fitted(touched: ContactPoints) -> RadialSpline:
    return sides.fit_radial_spline(touched, UP, 0.0, HEIGHT)


def noisy(touched: ContactPoints, sigma: float, seed: int) -> ContactPoints:
    noise = np.random.default_rng(seed).normal(scale=sigma, size=(len(touched.points), 1))
    return touched._replace(points=touched.points + noise * np.asarray(touched.normals))


def radius_of(heights: Floats, a: float = 0.03, b: float = 0.03) -> Floats:
    """Distance (heights, turns) from the axis of an ellipsoid that stands on height 0."""
    azimuth = 2 * np.pi * TURNS
    level = 1 - (heights / (HEIGHT / 2) - 1) ** 2
    across = (np.cos(azimuth) / a) ** 2 + (np.sin(azimuth) / b) ** 2
    return np.asarray(np.sqrt(level[:, None] / across))


@pytest.mark.parametrize("fit", [sides.fit_radial_spline, sides.fit_side_spline])
def test_spline_of_ellipsoid_is_ellipsoid(fit):
    spline = fit(everywhere(EGG), UP, 0.0, HEIGHT)
    heights = np.linspace(0.003, 0.057, 40)
    wanted = radius_of(heights, 0.04, 0.025)
    assert np.sqrt(spline.squared(heights, TURNS)) == pytest.approx(wanted, abs=5e-6)
    rings = wanted[..., None] * circle(24)
    assert spline.rings(heights, TURNS) == pytest.approx(rings, abs=5e-6)
    assert spline.sigma < 2e-6
    assert spline.squared(np.array([-1.0, 1.0]), TURNS).min() > 0.0
    egg = everywhere(EGG)
    inner = egg._replace(normals=-np.asarray(egg.normals))
    assert sides.looks_inward(stack_points([egg, inner]), UP)
    assert not sides.looks_inward(egg, UP)
    assert not sides.looks_inward(inner._replace(normals=None), UP)
    blunt = fit(everywhere(Oracle([0.04, 0.025, 0.03], [0.5, 1.0]), 133, 0.995), UP, 0.0, HEIGHT)
    next_to_ends = np.abs(blunt.rows.heights / 0.03 - 1.0) > 0.95
    assert rms(blunt.misfits[next_to_ends]) < 4e-6  # even spans leave 1e-5
    assert 1.0 < spline.system.condition() < 1e8


def test_spline_follows_leaning_axis():
    heights = np.repeat(np.linspace(0.0, HEIGHT, 30), 60)
    lean = heights[:, None] * [0.2, -0.1]
    rim = np.tile(circle(60), (30, 1))
    ends = np.array([0.0, HEIGHT])
    axis = sides.fit_axis_curve(ends, ends[:, None] * [0.2, -0.1])
    touched = contacts(np.column_stack([lean + 0.02 * rim, heights]), at_height(rim, 0.0))
    spline = sides.fit_radial_spline(touched, axis, 0.0, HEIGHT)
    squared = spline.squared(np.linspace(0, HEIGHT, 20), TURNS)
    assert np.allclose(np.sqrt(squared), 0.02, rtol=0, atol=1e-9)
    places = spline.rings(np.array([0.05]), TURNS)[0]
    assert places == pytest.approx([0.01, -0.005] + 0.02 * circle(24), abs=1e-9)


def test_untouched_band_is_bridged_with_large_deviation():
    touched = stack_points([BALL.band(share) for share in (-0.8, 0.8)] + [BALL.top()])
    heights = np.linspace(0.01, 0.05, 30)
    radius = np.sqrt(fitted(touched).squared(heights, TURNS))
    assert np.abs(radius - radius_of(heights)).max() < 1e-3
    bands = noisy(stack_points([BALL.band(-0.7), BALL.band(0.7)]), 2e-5, 0)
    at_bands, between = fitted(bands).deviation(np.array([0.009, 0.03]), TURNS).mean(axis=1)
    assert 0.0 < 10 * at_bands < min(between, 3e-4)


def test_stated_deviation_is_error_of_averaged_noise():
    sigma, heights = 5e-5, np.linspace(0.01, 0.05, 30)
    touched = noisy(everywhere(BALL), sigma, 1)
    # A single touch has no shift, and the spline becomes stiffer with the noise.
    spline, pose = sides.fit_shifted_spline(touched, fitted(touched))
    assert pose is None and spline.stiffness > 1.0
    pooled = rms(ball_errors(spline, heights))
    assert spline.sigma == pytest.approx(sigma, rel=0.1)
    assert pooled < 0.5 * sigma
    assert 0.6 < rms(spline.deviation(heights, TURNS)) / pooled < 1.7


def test_level_faces_and_points_outside_heights_are_left_out():
    up, out = np.array([[0.0, 0.0, 1.0]]), np.array([[1.0, 0.0, 0.0]])
    parts = [
        everywhere(BALL),
        contacts(np.tile([0.001, 0.0, 0.03], (50, 1)), np.tile(up, (50, 1))),
        contacts(np.tile([0.5, 0.0, 0.09], (50, 1)), np.tile(out, (50, 1))),
        contacts(np.array([[0.0, 0.0, 0.03]]), out),
    ]
    alone, with_them = fitted(parts[0]), fitted(stack_points(parts))
    assert np.array_equal(alone.coefficients, with_them.coefficients)
    for none in (contacts(np.array([[0.01, 0.0, 0.03]]), up), stack_points([])):
        with pytest.raises(ValueError, match="no contact point lies on the side between 0 and"):
            fitted(none)


def test_estimated_normals_are_those_of_surface():
    touched = everywhere(EGG)
    side = np.abs(touched.points[:, 2] - 0.03) < 0.02
    normals = sides.with_normals(touched._replace(normals=None), UP, 0.0, HEIGHT).normals
    assert normals is not None and touched.normals is not None
    cosines = np.einsum("ni,ni->n", normals, touched.normals)[side]
    assert cosines.min() > np.cos(np.radians(0.5))
    assert sides.with_normals(touched, UP, 0.0, HEIGHT) is touched


def with_gap(width: float, height: float = 0.03, turn: float = 0.02) -> ContactPoints:
    """A ball of 60 mm, touched every mm but in a circle of a width, next to which it falls in."""
    rises, rise = np.tile(np.linspace(-0.97, 0.97, 61), 188), (height - 0.03) / 0.03
    azimuths = np.repeat(np.arange(188) / 188, 61)
    out = np.column_stack([objects.polar(azimuths, np.sqrt(1 - rises**2)), rises])
    centre = np.append(objects.polar(np.array([turn]), np.sqrt(1 - rise**2)), rise)
    towards = centre - out * (out @ centre)[:, None]
    apart = 0.03 * np.arccos(np.clip(out @ centre, -1, 1))
    into = np.clip(1 - (apart - 0.5 * width) / 1.5e-3, 0, 1) * (width > 0.0)
    steep = 2.0 * into / np.maximum(np.linalg.norm(towards, axis=1), 1e-9)
    normals = out + steep[:, None] * towards
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    points = [0.0, 0.0, 0.03] + (0.03 - 1.5e-3 * into**2)[:, None] * out
    kept = objects.only(
        contacts(points, normals, np.arange(len(points)) // 100), apart >= 0.5 * width
    )
    return kept._replace(touch=np.unique(kept.touch, return_inverse=True)[1])


def kept_of(spline: RadialSpline, pose: float | None = None, reach: float = 0.004) -> Any:
    seen = coverage_of(spline.rows.heights, spline.rows.places[:, 1])
    assert seen is not None
    return sides.radial_side(spline, seen, pose, (reach, HEIGHT - reach), False)


@pytest.mark.parametrize(("height", "turn"), [(0.0313, 0.479), slow(0.02, 0.6)])
def test_gap_has_deviation_of_its_size(height, turn):
    deviations = []
    for width in (0.0, 0.012):
        touched = with_gap(width, height, turn)
        fit = kept_of(with_gaps_bridged(touched, fitted(touched)))
        deviations.append(np.sqrt(np.interp(height, fit.band_heights, fit.deviations**2)))
    # Its share of the ring, and the mean depth of a cone of its width.
    ring = 2 * np.pi * np.sqrt(0.03**2 - (height - 0.03) ** 2)
    assert deviations[0] < 1e-5
    assert deviations[1] == pytest.approx(0.012 * np.sqrt(0.012 / ring / 3), rel=0.4)


def test_bridged_gap_does_not_plunge_to_axis():
    touched, across = with_gap(0.014), np.linspace(-0.04, 0.08, 25)
    plain = fitted(touched)
    bridged = with_gaps_bridged(touched, plain)
    plunging, bridge = (
        np.sqrt(fit.squared(np.array([0.03]), across)).min() for fit in (plain, bridged)
    )
    assert bridge > 0.02
    assert plunging < 0.5 * bridge
    # Without gaps nothing changes: none, between rings, and among single points.
    whole, holed = with_gap(0.0), with_gap(0.012)
    rings = objects.only(whole, np.abs(whole.points[:, 2] - 0.03) > 0.006)
    for touched in (whole, rings, holed._replace(touch=np.arange(len(holed.points)))):
        spline = fitted(touched)
        assert with_gaps_bridged(touched, spline) is spline


def test_coverage_ends_where_some_sector_is_untouched():
    turns, heights = np.tile((np.arange(24) + 0.5) / 24, 4), np.repeat([0.0, 0.01, 0.02, 0.03], 24)
    moved = heights.copy()
    moved[3], moved[77] = 0.005, 0.027
    seen = coverage_of(moved, turns + 3.0)
    assert seen is not None
    assert (seen.low, seen.high, seen.gap) == pytest.approx((0.005, 0.027, 0.01))
    touched = np.isfinite(seen.lows)
    assert np.count_nonzero(touched) == 24
    assert sorted(set(seen.lows[touched])) == [0.0, 0.005]
    assert sorted(set(seen.highs[touched])) == [0.027, 0.03]
    assert seen.lows[int(360 * turns[3])] == 0.005 and seen.highs[int(360 * turns[77])] == 0.027
    kept = np.arange(96) != 55
    missed = coverage_of(heights[kept], turns[kept])
    assert missed is not None and missed.gap == pytest.approx(0.02)
    assert coverage_of(np.zeros(23), turns[1:24]) is None
    assert coverage_of(np.zeros(0), np.zeros(0)) is None


POSE, TAXEL = 1e-4, 1e-5


def patches(seed: int, count: int = 120, pose: float = POSE, taxel: float = TAXEL) -> ContactPoints:
    rng = np.random.default_rng(seed)
    out = rng.normal(size=(count, 3))
    out /= np.linalg.norm(out, axis=1, keepdims=True)
    normals = out[:, None] + rng.uniform(-0.25, 0.25, (count, 80, 3))
    normals /= np.linalg.norm(normals, axis=2, keepdims=True)
    shifts = pose * rng.normal(size=(count, 1, 3))
    noise = taxel * rng.normal(size=(count, 80, 1)) * normals
    points = [0.0, 0.0, 0.03] + 0.03 * normals + shifts + noise
    return contacts(points.reshape(-1, 3), normals.reshape(-1, 3), np.repeat(np.arange(count), 80))


@cache
def shifted(seed: int, pose: float = POSE) -> tuple[RadialSpline, RadialSpline, float | None]:
    touched = patches(seed, pose=pose, count=120 if pose == POSE else 60)
    plain = fitted(touched)
    return (plain, *sides.fit_shifted_spline(touched, plain))


def ball_errors(spline: RadialSpline, heights: Floats) -> Floats:
    """Normal distances from the ball of 60 mm, to first order."""
    wanted = radius_of(heights)
    return np.asarray((np.sqrt(spline.squared(heights, TURNS)) - wanted) * wanted / 0.03)


@pytest.mark.parametrize(("pose", "gain"), [(POSE, 0.7), slow(1.5e-5, 0.8), slow(3e-4, 0.8)])
def test_shifts_of_touches_lower_error_of_surface(pose, gain):
    errors = []
    for seed in range(1 if pose == POSE else 2):
        plain, spline, sigma = shifted(seed, pose)
        assert sigma is not None and 0.5 * pose < sigma < 1.4 * pose
        assert spline.sigma < 2.0 * TAXEL
        errors.append([rms(ball_errors(one, LEVELS)) for one in (spline, plain)])
    after, before = np.mean(errors, axis=0)
    assert after < gain * before


def test_stated_errors_bound_errors_after_shifts():
    _, spline, sigma = shifted(0)
    stated = rms(spline.deviation(np.linspace(0.008, 0.052, 10), TURNS))
    error = rms(ball_errors(spline, LEVELS))
    assert error < 1.5 * stated < 4.0 * error
    fit = kept_of(spline, sigma, 0.008)
    off = ball_errors(spline, fit.band_heights)
    assert 0.9 < np.mean(np.abs(off) < 1.96 * fit.deviations[:, None]) <= 1.0
    v, turns = np.random.default_rng(0).uniform(0.02, 0.98, (2, 40))
    objects.assert_derivatives(fit.patch.at, v, turns, 1e-4, 1.0, fit.patch.on_grid)
    figures = fit.figures
    assert figures["radial_pose_sigma"] == sigma and figures["radial_pose_blocks"] == 1.0
    whole = fit.uncertainty()
    assert rms(fit.deviations) < whole.rms < whole.most
    assert whole.rms > rms(off) and whole.most > np.abs(off).max()


@pytest.mark.parametrize("kind", ["exact", slow("edges"), "one touch", "few taxels"])
def test_no_shift_is_estimated_without_pose_error(kind):
    touched = patches(2, 60, 0.0, 0.0 if kind == "exact" else TAXEL)
    if kind == "edges":  # residuals of a spline at edges: waves within each touch
        waves = 1e-4 * np.sin(4000.0 * touched.points @ [[1.0], [0.3], [0.7]])
        touched = touched._replace(points=touched.points + waves * np.asarray(touched.normals))
    if kind == "one touch":
        touched = patches(3, 60)._replace(touch=np.zeros(4800, np.int32))
    if kind == "few taxels":
        touched = patches(3, 60)._replace(touch=np.arange(4800, dtype=np.int32) // 8)
    plain = fitted(touched)
    spline, sigma = sides.fit_shifted_spline(touched, plain)
    assert sigma is None
    assert spline is plain if kind == "exact" else spline.stiffness >= plain.stiffness


def test_axis_bends_with_middles_but_not_with_noise():
    heights = np.linspace(0.0, 0.1, 9)
    middles = np.column_stack([0.03 * (heights > 0.09), np.zeros(9)])
    axis, step = sides.fit_axis_curve(heights, middles), 1e-6
    assert np.allclose(axis.at(heights), middles, rtol=0, atol=1e-15)
    between = np.array([0.033, 0.095])
    slope = (axis.at(between + step) - axis.at(between - step)) / (2 * step)
    assert np.allclose(axis.at(between, 1), slope, rtol=0, atol=1e-6)
    assert not axis.at(np.array([-0.01, 0.11]), 1).any()
    noise = 1e-4 * np.random.default_rng(0).normal(size=(9, 2))
    assert rms(sides.fit_axis_curve(heights, noise).at(heights)) < 0.8 * rms(noise)
    repeated = sides.fit_axis_curve(np.full(3, 0.02), np.array([[0.0, 0], [0.003, 0], [0, 0.003]]))
    assert np.allclose(repeated.at(np.array([0.0, 0.02, 1.0])), 0.001, atol=1e-17)
