"""Lofts of corresponding contours: fidelity, noise, outliers, stated errors."""

from typing import Any

import numpy as np
import pytest

from palpate.core.arrays import Bools, Floats
from palpate.core.rebuild.side import ContourLoft, contour_noise, fit_contour_loft
from tests.core.rebuild.objects import assert_derivatives, circle, rms

HEIGHT, POLE = 2.0, float(np.sqrt(1.04))
LEVELS, TURNS = np.linspace(-1.0, 1.0, 27), np.arange(24) / 24
AXIS = np.zeros(2)  # where most solids here close


def wavy(heights: Floats, angle: Floats) -> Floats:
    """Radius of a lobed zigzag that closes at the heights -POLE and POLE."""
    lobes = 1 + 0.12 * np.cos(3 * angle) + 0.08 * np.sin(2 * angle + 2 * heights)
    return np.asarray(np.sqrt(1.04 - heights**2) * (0.75 + 0.18 * np.sin(9 * heights)) * lobes)


def contours(heights: Floats, count: int, sigma: float = 0.0, seed: int = 0) -> Floats:
    radius = wavy(heights[:, None], 2 * np.pi * np.arange(count) / count)[..., None]
    noise = np.random.default_rng(seed).normal(size=(len(heights), count, 2))
    return radius * circle(count) + sigma * noise


def lofted(heights: Floats, grid: Floats, **more: Any) -> ContourLoft:
    return fit_contour_loft(heights, grid, **{"low": -1.04, "high": 1.04, **more})


def errors(loft: ContourLoft) -> Floats:
    """Normal distances, to first order, on a grid."""
    heights, step = np.linspace(-1.0, 1.0, 121)[:, None], 1e-6
    places = loft.patch.rings(heights[:, 0], (np.arange(120) + 0.3) / 120)
    angle = np.arctan2(places[..., 1], places[..., 0])
    radius = wavy(heights, angle)
    inwards = np.clip(heights + np.array([-step, step])[:, None, None], -1.0, 1.0)
    up = np.diff(wavy(inwards, angle), axis=0)[0] / np.diff(inwards, axis=0)[0]
    around = (wavy(heights, angle + step) - wavy(heights, angle - step)) / (2 * step)
    slope = np.sqrt(1 + up**2 + (around / radius) ** 2)
    return np.asarray((np.hypot(places[..., 0], places[..., 1]) - radius) / slope)


@pytest.mark.parametrize("heights", [LEVELS, np.sin(0.5 * np.pi * LEVELS)], ids=["even", "uneven"])
def test_exact_contours_with_poles_are_followed(heights):
    loft = lofted(heights, contours(heights, 80), low=-POLE, high=POLE, pole=(AXIS, AXIS))
    assert rms(errors(loft)) < 3e-4
    assert loft.health.condition < 1e3 and loft.health.outlying == 0
    ends = loft.patch.rings(np.array([-POLE, POLE]), np.arange(9) / 9)
    assert np.ptp(ends, axis=1).max() < 1e-12


@pytest.mark.parametrize("sigma", [0.01, 0.03])
def test_error_is_quarter_of_noise(sigma):
    error = []
    for seed in range(2):
        grid = contours(LEVELS, 80, sigma, seed)
        loft = lofted(LEVELS, grid)
        error.append(rms(errors(loft)))
        assert loft.health.sigma == pytest.approx(sigma, rel=0.05)
        assert contour_noise(LEVELS, grid) == pytest.approx(sigma, rel=0.06)
        assert loft.health.outlying == 0
    assert np.mean(error) < 0.27 * sigma
    heights = np.delete(LEVELS, 12)  # a missing contour costs little, and widens the band
    loft = lofted(heights, contours(heights, 80, sigma))
    assert rms(errors(loft)) < 0.3 * sigma
    assert loft.uncertainty().resolution == pytest.approx(HEIGHT / 26)
    gap, beside = (loft.deviation([z], TURNS) for z in (-1 + 12 / 13, -1 + 17.5 / 13))
    assert rms(gap) > 1.2 * rms(beside)


def test_correlated_noise_is_not_followed():
    heights = np.linspace(-0.95, 0.95, 27)
    radius = (1.0 + 0.2 * heights[:, None]) * (1.0 + 0.1 * np.cos(6 * np.pi * TURNS))
    grid = radius[..., None] * circle(24)
    for seed in range(3):
        noise = 0.02 * np.random.default_rng(seed).normal(size=grid.shape)
        noise = (noise + 0.4 * np.roll(noise, 1, 1)) / np.sqrt(1.16)
        loft = lofted(heights, grid + noise)
        assert loft.health.freedom < 0.25 * grid[..., 0].size
        assert rms(loft.patch.rings(heights, TURNS) - grid) < 0.012


def test_known_noise_gives_least_error():
    grid = contours(LEVELS, 24, 0.05, 3)
    known = {noise: lofted(LEVELS, grid, noise=noise) for noise in (2e-3, 0.05, 0.8)}
    misses = {noise: rms(errors(loft)) for noise, loft in known.items()}
    assert misses[0.05] < min(misses[2e-3], misses[0.8])
    bands = [rms(loft.deviation(LEVELS, [0.1])) for loft in known.values()]
    assert bands == sorted(bands)
    assert [loft.health.sigma for loft in known.values()] == pytest.approx([2e-3, 0.05, 0.8])


@pytest.mark.parametrize("closed", [(False, False), (True, False), (False, True), (True, True)])
@pytest.mark.parametrize("count", [1, 2, 3])
def test_loft_passes_few_contours_and_closes_at_poles(count, closed):
    heights = np.linspace(-0.5, 0.4, count)
    grid = contours(heights, 24)
    pole = [AXIS if is_closed else None for is_closed in closed]
    loft = lofted(heights, grid, low=-1.0, high=1.0, pole=pole)
    assert np.allclose(loft.patch.rings(heights, TURNS), grid, atol=1e-4)
    ends = np.ptp(loft.patch.rings(np.array([-1.0, 1.0]), TURNS), axis=1).max(axis=1)
    assert tuple(ends < 1e-12) == closed
    assert np.isfinite(loft.deviation(np.linspace(-1.0, 1.0, 30), np.arange(9) / 9)).all()
    assert np.isfinite(loft.uncertainty()).all()
    pole = [AXIS + 2.0 if is_closed else None for is_closed in closed]
    line = lofted(heights, np.full((count, 12, 2), 2.0), pole=pole)  # all points in one place
    assert np.allclose(line.patch.rings(np.array([0.5, 0.8]), np.array([0.1, 0.2])), 2.0)
    assert (line.deviation([0.5], [0.0]), *line.uncertainty()[:2]) == ([[0.0]], 0.0, 0.0)
    if (count, closed) == (1, (False, False)):  # a prism
        assert np.allclose(loft.patch.rings(np.linspace(-1, 1, 9), TURNS), grid, atol=1e-4)
        assert loft.uncertainty().resolution == pytest.approx(1.0)


@pytest.mark.parametrize(("count", "around"), [(24, 40), (27, 80)])
def test_band_of_95_percent_holds_95_percent(count, around):
    heights, covered = np.linspace(-1.0, 1.0, count), []
    for seed in range(4):
        loft = lofted(heights, contours(heights, around, 0.01, seed))
        band = loft.deviation(np.linspace(-1, 1, 121), (np.arange(120) + 0.3) / 120)
        off = np.abs(errors(loft))
        covered.append(np.mean(off <= 1.96 * band))
        claimed = loft.uncertainty()
        assert rms(off) < claimed.rms < 3.0 * rms(off)
        assert off.max() < claimed.most < 6.0 * off.max()
    assert 0.89 <= np.mean(covered) <= 0.985


def exact(sites: Floats, radius: Floats) -> ContourLoft:
    """Of contours with radii (m,) or (m, 24), known to be without noise."""
    radius = np.broadcast_to(radius.reshape(len(sites), -1), (len(sites), 24))
    return lofted(sites, radius[..., None] * circle(24), noise=0.0)


def test_deviation_is_large_where_neighbours_mispredict():
    sites = np.linspace(-1.0, 1.0, 13)
    smooth = exact(sites, 1.0 + 0.3 * sites - 0.2 * sites**2)
    assert smooth.deviation(np.linspace(-1.0, 1.0, 50), TURNS).max() < 1e-9
    waves = exact(sites, 1.0 + 0.2 * np.sin(10.0 * sites))
    assert waves.deviation(sites, TURNS).max() < 1e-9
    between = waves.deviation(np.linspace(sites[4], sites[5], 21), np.zeros(1))[:, 0]
    assert between[1:-1].min() > 5e-3 > 1e-9 > between[[0, -1]].max()
    bump = np.exp(-np.square(sites[:, None] / 0.1) - np.square((TURNS - 0.5) / 0.05))
    local = exact(sites, 1.0 + 0.1 * bump).deviation(np.linspace(-0.2, 0.2, 21), [0.0, 0.5])
    assert local[:, 0].max() < 1e-3 * local[:, 1].max()
    ahead = exact(np.linspace(-0.5, 0.5, 11), 1.0 + 0.2 * np.sin(20.0 * sites[1:-1]))
    near, far = ahead.deviation([0.55, 0.6], np.zeros(1))[:, 0]
    assert far == pytest.approx(2.0 * near, rel=0.05)  # along the normal


def test_loft_closes_at_leaning_poles():
    heights = np.linspace(-0.9, 0.9, 12)
    lean = np.column_stack([heights, -0.5 * heights])
    grid = np.sqrt(1.0 - heights**2)[:, None, None] * circle(24) + lean[:, None]
    poles = np.array([-0.9, 0.45]), np.array([1.0, -0.5])
    loft = lofted(heights, grid, low=-1.0, high=1.0, pole=poles)
    assert loft.health.round == (True, True)
    ends = loft.patch.rings(np.array([-1.0, 1.0]), np.zeros(1))[:, 0]
    assert ends == pytest.approx(np.stack(poles), abs=1e-12)
    assert np.allclose(loft.patch.rings(heights, TURNS), grid, atol=1e-5)
    grid = grid + 1e-3 * np.random.default_rng(0).normal(size=grid.shape)
    grid[5, 3] += [0.1, 0.1]
    rough = lofted(heights, grid, low=-1.0, high=1.0, pole=poles)
    assert rough.outlying[5, 3] and rough.outlying.sum() <= 2
    cone = (1.0 - heights)[:, None, None] * circle(24)
    sharp = lofted(heights, cone, low=-1.0, high=1.0, pole=(None, AXIS))
    assert sharp.health.round == (False, False)


def bumpy() -> Floats:
    """Radii (27, 80) of a vase with a bump that is a few points and a few contours wide."""
    angle = 2 * np.pi * np.arange(80) / 80
    away = np.angle(np.exp(1j * (angle - 1.0)))
    bump = np.exp(-np.square((LEVELS[:, None] - 0.4) / 0.12) - np.square(away / 0.25))
    radius = (0.52 + 0.18 * np.sin(3.5 * LEVELS))[:, None] * (1 + 0.08 * np.cos(3 * angle))
    return np.asarray(radius + 0.08 * bump)


def with_stray(outlying: Bools, seed: int, sigma: float = 4e-3) -> ContourLoft:
    rng = np.random.default_rng(seed)
    stray = 0.06 * rng.choice([-1.0, 1.0], (27, 80)) * outlying
    noise = sigma * rng.normal(size=(27, 80, 2))
    return lofted(LEVELS, (bumpy() + stray)[..., None] * circle(80) + noise)


def stray_error(loft: ContourLoft) -> float:
    return rms(np.linalg.norm(loft.patch.rings(LEVELS, np.arange(80) / 80), axis=-1) - bumpy())


def test_outliers_raise_error_by_tenth_at_most():
    with_, without = [], []
    for seed in range(2):
        wrong = np.random.default_rng(seed + 100).random((27, 80)) < 0.02
        loft, clean = with_stray(wrong, seed), with_stray(0 * wrong, seed)
        with_.append(stray_error(loft))
        without.append(stray_error(clean))
        assert loft.health.outlying == loft.outlying.sum()
        assert (loft.outlying & wrong).sum() >= 0.9 * wrong.sum()
        assert (loft.outlying & ~wrong).sum() <= 5
        assert loft.health.sigma == pytest.approx(4e-3, rel=0.15)
        assert not clean.outlying.any()
        many = np.random.default_rng(seed + 200).random((27, 80)) < 0.1
        assert stray_error(with_stray(many, seed)) < 2.0 * without[-1]
    assert np.mean(with_) <= 1.1 * np.mean(without)
    for sigma in (0.0, 0.02):
        assert not with_stray(np.zeros((27, 80), bool), 0, sigma).outlying.any()


def test_ridges_edges_and_few_points_are_no_outliers():
    grid = bumpy()[..., None] * circle(80)
    grid += 4e-3 * np.random.default_rng(0).normal(size=grid.shape)
    grid[:, 30] *= 1.1
    assert not lofted(LEVELS, grid).outlying.any()
    few = np.repeat(circle(5)[None], 9, axis=0)
    few[4, 2] *= 3.0
    assert not lofted(np.arange(9.0), few, high=10.0).outlying.any()
    ring = 30.0 * circle(80) * (np.abs(circle(80)) ** 10).sum(axis=1, keepdims=True) ** -0.1
    heights = 45.0 * LEVELS
    box = (1.0 - np.abs(heights / 50.0) ** 10)[:, None, None] ** 0.1 * ring
    loft = lofted(heights, box, low=-50.0, high=50.0)
    assert loft.health.outlying == 0
    assert np.abs(loft.patch.rings(heights, np.arange(80) / 80) - box).max() < 0.5


def surface(kind: str, over: bool = False) -> Any:
    """A ball about (3, -2) closed below, or a step that makes the parameter follow its length."""
    if kind == "step":
        heights = np.array([-1.0, -0.5, 0.0, 0.02, 0.5, 0.9])
        radius = np.array([1.0, 1.0, 1.0, 0.6, 0.6, 0.6])
        heights, radius = (-heights[::-1], radius[::-1]) if over else (heights, radius)
        loft = lofted(heights, radius[:, None, None] * circle(40), low=-1.0, high=1.0)
        assert loft.patch.axial_parameter.reparametrisation is not None
        return loft.patch
    heights = np.linspace(-0.9, 0.9, 19)
    grid = np.sqrt(1.0 - heights**2)[:, None, None] * circle(40) + [3.0, -2.0]
    return lofted(heights, grid, low=-1.0, high=1.0, pole=([3.0, -2.0], None)).patch


@pytest.mark.parametrize("kind", ["ball", "step"])
def test_derivatives_of_loft_are_exact(kind):
    patch = surface(kind)
    v, turns = np.linspace(0.03, 0.97, 21), np.linspace(0.0, 2.1, 21)
    assert_derivatives(patch.at, v, turns, 1e-5, 0.8, patch.on_grid)  # but for knots
    assert patch.at(np.array([0.0, 1.0]), np.zeros(2))[:, 2] == pytest.approx([-1.0, 0.9])
    places = patch.at(v, turns)
    rings = patch.rings(places[:, 2], turns)[np.arange(21), np.arange(21)]
    assert rings == pytest.approx(places[:, :2], abs=1e-9)
    assert np.array_equal(*patch.rings(np.array([0.97, 0.9]), turns))  # beyond its reach
    if kind == "step":  # upside down it is the same
        mirrored = surface(kind, over=True).at(1.0 - v, turns) * [1.0, 1.0, -1.0]
        assert mirrored == pytest.approx(places, abs=1e-9)
        rims = np.linalg.norm(patch.rings(np.array([-0.5, 0.0, 0.02, 0.5]), turns[:1]), axis=-1)
        assert rims[:, 0] == pytest.approx([1.0, 1.0, 0.6, 0.6], abs=1e-3)
    if kind == "ball":
        ball = patch.at(np.linspace(0.0, 1.0, 100), np.linspace(0.0, 3.0, 100))
        assert np.abs(np.linalg.norm(ball - [3.0, -2.0, 0.0], axis=1) - 1.0).max() < 1e-4
        assert ball[0] == pytest.approx([3.0, -2.0, -1.0], abs=1e-12)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"heights": [0.0, np.inf]}, "heights must be finite"),
        ({"grid": np.ones((3, 12, 2))}, r"grid must have shape \(2, any, 2\), got \(3, 12, 2\)"),
        ({"heights": [0.75, 0.25]}, "heights must rise, got"),
        ({"low": 0.3}, "heights must lie from low 0.3 to high 1 m, got 0.25 to 0.75"),
        ({"high": 0.75, "pole": (None, AXIS)}, "a pole must lie beyond the last contour"),
        ({"pole": (np.ones(3), None)}, r"pole must have shape \(2\), got \(3,\)"),
        ({"noise": -1.0}, "noise must be 0 or more"),
    ],
)
def test_invalid_contours_of_loft_are_refused(change, words):
    options: dict[str, Any] = {"heights": [0.25, 0.75], "low": 0.0, "high": 1.0, **change}
    grid = options.pop("grid", np.stack([circle(12)] * 2))
    with pytest.raises(ValueError, match=words):
        fit_contour_loft(grid=grid, **options)
    with pytest.raises(ValueError, match="heights must be finite"):
        exact(LEVELS, np.ones(27)).deviation([np.nan], [0.0])
