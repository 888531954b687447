"""Single points and whole contours that contradict their neighbours."""

from collections.abc import Callable
from itertools import product
from typing import Any

import numpy as np
import pytest

from palpate.core.arrays import Bools, Floats
from palpate.core.rebuild import contours as stacks
from tests.core.rebuild.objects import along, at_height, circle, polar, turned

HEIGHTS = np.linspace(-45.0, 45.0, 15)
COUNT = 60


def vase(edged: bool, noise: float = 0.0, seed: int = 0) -> Floats:
    """Contours (15, 60, 3) of a lobed vase, or of a square tube."""
    turns = np.arange(COUNT) / COUNT
    if edged:
        square = along(30.0 * np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]), turns)
        points = np.stack([at_height(square, z) for z in HEIGHTS])
    else:
        lobed = polar(turns, 1 + 0.1 * np.cos(6 * np.pi * turns))
        points = np.stack([at_height((30 + 5 * np.sin(z / 20)) * lobed, z) for z in HEIGHTS])
    return points + noise * np.random.default_rng(seed).normal(size=points.shape)


def outliers_of(contours: Floats) -> tuple[Any, Any]:
    """The contours as curves, and the outliers among their points."""
    slices = stacks.stack_curves(stacks.contour_curves(list(contours)))
    places = stacks.match_slices(slices, COUNT).places
    return slices.loops, stacks.point_outliers(slices.loops, places)


def found_in(contours: Floats) -> Bools:
    """Mask of the outliers (m, n) in their given order."""
    loops, outliers = outliers_of(contours)
    out = np.zeros(contours.shape[:2], bool)
    for row, (mask, loop) in enumerate(zip(outliers.masks, loops, strict=True)):
        bad = {tuple(point) for point in loop.as_given[mask].tolist()}
        out[row] = [tuple(point) in bad for point in contours[row, :, :2].tolist()]
    return out


@pytest.mark.parametrize("edged", [False, True])
@pytest.mark.parametrize("noise", [0.0, 0.2])
def test_outliers_are_found_and_good_points_stay(edged, noise):
    hits = misses = false_hits = 0
    for seed in range(2):
        assert not found_in(vase(edged, noise, seed)).any()
        rng = np.random.default_rng(seed + 50)
        contours = vase(edged, noise, seed)
        wrong = rng.random(contours.shape[:2]) < 0.02
        away = rng.normal(size=contours.shape)
        away *= 3.0 / np.linalg.norm(away, axis=2, keepdims=True)
        out = found_in(contours + away * wrong[..., None])
        hits, misses = hits + (out & wrong).sum(), misses + (~out & wrong).sum()
        false_hits += (out & ~wrong).sum()
    assert hits > 8 * misses
    assert false_hits <= 0.01 * 2 * 15 * COUNT


def test_outlier_is_moved_and_its_curve_refitted():
    contours = vase(False)
    wanted = contours[7, 20, :2].copy()
    contours[7, 20, :2] *= 1.1
    loops, outliers = outliers_of(contours)
    assert [int(mask.sum()) for mask in outliers.masks] == [int(row == 7) for row in range(15)]
    assert np.linalg.norm(outliers.mended[7] - wanted, axis=1).min() < 0.02
    again, same = (
        stacks.refitted_curve(loops[row], outliers.mended[row], outliers.masks[row])
        for row in (7, 3)
    )
    assert again.outlier.sum() == 1
    assert np.array_equal(np.sort(again.as_given, axis=0), np.sort(loops[7].as_given, axis=0))
    clean = stacks.contour_curves([vase(False)[7]])[0]
    assert again.perimeter == pytest.approx(clean.perimeter, rel=1e-4)
    assert same.curve is loops[3].curve


def test_corner_shared_by_neighbours_is_no_outlier():
    ridge, alone = vase(False, 0.05), vase(False, 0.05)
    ridge[:, 20, :2] *= 1.1
    alone[7, 20, :2] *= 1.1
    assert not found_in(ridge).any()
    assert np.argwhere(found_in(alone)).tolist() == [[7, 20]]
    alone[7, 21, :2] *= 0.93  # adjacent outliers
    alone[7, 22, :2] *= 1.1
    assert np.argwhere(found_in(alone)).tolist() == [[7, 20], [7, 21], [7, 22]]


LEVELS = np.linspace(-0.98, 0.98, 27)
NOISE = 0.01  # Half a percent of the height
OVAL = polar(np.arange(60) / 60, 1 + 0.1 * np.cos(4 * np.pi * np.arange(60) / 60))
PROFILES: dict[str, Callable[[Floats], Any]] = {
    "lobed": lambda z: np.sqrt(1.04 - z * z) * (0.75 + 0.18 * np.sin(9 * z)),
    "ball": lambda z: np.sqrt(1.0004 - z * z),
    "cylinder": lambda z: 0.6 + 0 * z,
    "cone": lambda z: 0.1 + 0.3 * (1 - z),
    "edge": lambda z: 0.2 + 0.6 * (1 - np.abs(z)),
    "step": lambda z: 0.4 + 0.3 * (z > 0.1),
    "two steps": lambda z: 0.4 + 0.3 * (z > 0.13) - 0.2 * (z > 0.62),
    "neck": lambda z: 0.7 - 0.4 * np.exp(-(((z - 0.1) / 0.08) ** 2)),
    "groove": lambda z: 0.7 - 0.2 * (np.abs(z - 0.1) < 0.085),
    "flange": lambda z: 0.5 + 0.3 * (np.abs(z - 0.1) < 0.085),
    "capsule": lambda z: np.sqrt(np.maximum(0.36 - np.maximum(np.abs(z) - 0.4, 0) ** 2, 1e-4)),
    "bottle": lambda z: 0.25 + 0.4 * np.clip((0.5 - z) / 0.3, 0, 1),
    "zigzag": lambda z: 0.6 + 0.1 * np.arcsin(np.sin(4 * np.pi * z)),
    "fine zigzag": lambda z: 0.6 + 0.1 * np.arcsin(np.sin(12 * np.pi * z)),
}


def grid_of(name: str, heights: Floats = LEVELS, noise: float = 0.0) -> Floats:
    grid = np.asarray(PROFILES[name](heights)[:, None, None] * OVAL)
    return grid + noise * np.random.default_rng(0).normal(size=grid.shape)


@pytest.mark.parametrize("name", PROFILES)
def test_good_contours_are_consistent(name):
    uneven = LEVELS.copy()
    shift = np.random.default_rng(0).uniform(-1, 1, 25)
    uneven[1:-1] += 0.3 * (LEVELS[1] - LEVELS[0]) * shift
    for noise, heights in product((0.0, 0.4 * NOISE, NOISE), (LEVELS, uneven)):
        result = stacks.inconsistent_contours(heights, grid_of(name, heights, noise))
        assert not result.bad.any() and not result.offsets.any()


@pytest.mark.parametrize("name", ["lobed", "ball", "cylinder", "edge", "bottle"])
def test_contour_of_other_size_is_inconsistent(name):
    for factor, noise, row in product((1.3, 0.7), (0.0, NOISE), (3, 9, 12)):
        grid = grid_of(name, noise=noise)
        size = np.sqrt((grid[row] ** 2).sum(axis=1).mean())
        grid[row] *= factor
        result = stacks.inconsistent_contours(LEVELS, grid)
        assert np.flatnonzero(result.bad).tolist() == [row]
        assert result.offsets[row] == pytest.approx(0.3 * size, rel=0.25)
        scaled = stacks.inconsistent_contours(1e-3 * LEVELS + 4.0, 1e-3 * grid + [7.0, -3.0])
        assert scaled.offsets == pytest.approx(1e-3 * result.offsets, rel=1e-6)


def spoilt(name: str, rows: Any, by: float = 1.3) -> Floats:
    grid = grid_of(name)
    grid[rows] *= by
    return grid


@pytest.mark.parametrize(
    ("grid", "bad"),
    [
        (spoilt("cylinder", 25, 1.05), [25]),  # next to an end, if the object does not round off
        (spoilt("ball", 25, 1.05), []),
        (spoilt("cylinder", 0), []),
        (spoilt("cylinder", 26), []),
        (spoilt("zigzag", 9), []),  # next to edges of the object
        (spoilt("cylinder", slice(2, None, 5)), [2, 7, 12, 17, 22]),
        (spoilt("cylinder", slice(0, None, 2)), []),
        (spoilt("cylinder", 13, 1.02), []),  # too small to matter
        *((spoilt("lobed", rows), rows) for rows in ([5, 13, 20], [5, 8, 20], [2, 12, 24])),
        *((spoilt(name, [9, 11, 18]), [9, 11, 18]) for name in ("lobed", "cylinder", "ball")),
        (spoilt("cylinder", 4)[:9], [4]),  # eight contours are too few
        (spoilt("cylinder", 4)[:8], []),
        (grid_of("bottle") + [0.1, -0.05] * (np.arange(27) == 7)[:, None, None], [7]),
        (np.where((np.arange(27) == 7)[:, None, None], turned(1.6 * OVAL, 0.45), 1.6 * OVAL), [7]),
    ],
)
def test_inconsistent_contours_are_found_among_features(grid, bad):
    levels, unsure = LEVELS[: len(grid)], np.full(len(grid), 0.8)  # error between points
    assert np.flatnonzero(stacks.inconsistent_contours(levels, grid).bad).tolist() == bad
    assert not stacks.inconsistent_contours(levels, grid, unsure).bad.any()


RIM = circle(40)


@pytest.mark.parametrize(
    ("radii", "shift", "off"),
    [
        *(([39.0 if row == i else 30.0 for i in range(6)], 0.0, {row: 9.0}) for row in range(1, 5)),
        ([30.0] * 8 + [45.0], 0.0, {8: 15.0}),  # an end that is wider, or aside
        ([45.0] + [30.0] * 8, 0.0, {0: 15.0}),
        ([30.0] * 8 + [5.0], 0.0, {}),  # but not one that rounds off
        ([30.0] * 9, 20.0 * (np.arange(9) == 8), {8: 20.0}),
        ([30.0, 20.0, 30.0], 0.0, {1: 10.0}),  # the middle one of three, if it is narrow or aside
        ([30.0, 45.0, 30.0], 0.0, {}),
        ([30.0] * 3, np.array([0.0, 15.0, 0.0]), {1: 15.0}),
        ([30.0, 10.0], 0.0, {}),
        ([30.0] * 4 + [27.9] + [30.0] * 4, 0.0, {}),  # by less than a tenth
        ([30.0] * 4 + [25.5] + [30.0] * 4, 0.0, {4: 4.5}),
    ],
)
def test_feature_candidates_have_offset_from_neighbours(radii, shift, off):
    heights, grid = np.linspace(-40.0, 40.0, len(radii)), np.reshape(radii, (-1, 1, 1)) * RIM
    grid[..., 0] += np.reshape(shift, (-1, 1))
    misfits = stacks.neighbour_misfits(heights, grid)
    assert np.flatnonzero(misfits).tolist() == list(off)
    assert misfits[list(off)] == pytest.approx(list(off.values()), rel=0.3)
    assert stacks.neighbour_misfits(1e3 * heights, 1e3 * grid) == pytest.approx(1e3 * misfits)


@pytest.mark.parametrize("count", [3, 4, 6, 9, 27])
def test_smooth_objects_have_no_feature_candidates(count):
    heights = np.linspace(-49.5, 49.5, count)
    ball = np.sqrt(50.0**2 - heights**2)
    bellied = 30.0 + 8.0 * np.sin(heights / 25.0)
    leaning = 30.0 * RIM + 0.3 * heights[:, None, None] * [1.0, 0.0]
    for grid in (ball[:, None, None] * RIM, bellied[:, None, None] * RIM, leaning):
        assert not stacks.neighbour_misfits(heights, grid).any()


UNEVEN = np.array([0.0, 0.4, 1.0, 1.7, 2.0, 3.1, 3.5])


def test_neighbours_predict_cubics_inside_and_parabolas_at_ends():
    weights = stacks.neighbour_weights(UNEVEN)
    assert np.allclose(weights.sum(axis=1), 1.0)
    assert np.allclose(weights @ UNEVEN**2, UNEVEN**2)
    assert np.allclose((weights @ UNEVEN**3)[2:-2], UNEVEN[2:-2] ** 3)
    away = np.abs(np.arange(7)[:, None] - np.arange(7))
    assert (weights[(away == 0) | (away > 3)] == 0.0).all()
    assert np.count_nonzero(weights[3]) == 4
    three = stacks.neighbour_weights(UNEVEN[:3])
    assert np.allclose(three @ UNEVEN[:3], UNEVEN[:3])
    assert (np.count_nonzero(three, axis=1) == 2).all()
    for count in (1, 2):
        assert not stacks.neighbour_weights(UNEVEN[:count]).any()


def test_interpolation_errors_bound_true_errors():
    for count in (8, 12, 24):
        radius = 1.0 + 0.2 * np.cos(6 * np.pi * np.arange(count) / count)
        loops = stacks.contour_curves([at_height(radius[:, None] * circle(count), 0.0)])
        angle = np.arctan2(*loops[0].fine.T[::-1])
        off = np.linalg.norm(loops[0].fine, axis=1) - (1.0 + 0.2 * np.cos(3 * angle))
        (bound,) = stacks.interpolation_errors(loops)
        assert np.abs(off).max() < 1.5 * bound < 1.0
    few = stacks.contour_curves([at_height(circle(5), 0.0)])
    assert np.isinf(stacks.interpolation_errors(few)[0])
