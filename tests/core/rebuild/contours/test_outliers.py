from __future__ import annotations

from collections.abc import Callable
from itertools import product
from typing import Any

import numpy as np
import pytest

from palpate.core.arrays import Bools, Floats
from palpate.core.rebuild.contours.curves import contour_curves, height_outliers, refitted_curve
from palpate.core.rebuild.contours.outliers import (
    InconsistentContours,
    PointOutliers,
    inconsistent_contours,
    look_like_features,
    neighbour_deviation,
    neighbour_misfits,
    neighbour_weights,
    point_outliers,
)
from palpate.core.rebuild.contours.slices import match_slices, stack_curves

HEIGHTS = np.linspace(-45.0, 45.0, 15)
COUNT = 60


def object_(edged: bool, noise: float, seed: int = 0) -> Floats:
    """Contours (15, 60, 3) of a lobed vase, or of a square tube."""
    turns = np.arange(COUNT) / COUNT
    angle = 2 * np.pi * turns
    if edged:
        side = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1], [1, 1]]) * 30.0
        ring = np.stack([np.interp(turns, np.arange(5) / 4, side[:, i]) for i in (0, 1)], axis=-1)
        plane = np.repeat(ring[None], len(HEIGHTS), axis=0)
    else:
        radius = (30 + 5 * np.sin(HEIGHTS / 20))[:, None] * (1 + 0.1 * np.cos(3 * angle))
        plane = radius[..., None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    z = np.broadcast_to(HEIGHTS[:, None, None], (*plane.shape[:2], 1))
    points = np.concatenate([plane, z], axis=2)
    return points + noise * np.random.default_rng(seed).normal(size=points.shape)


def found_in(contours: Floats) -> tuple[PointOutliers, list[Floats]]:
    slices = stack_curves(contour_curves(list(contours)))
    outliers = point_outliers(slices.loops, match_slices(slices, COUNT).places)
    return outliers, [loop.as_given for loop in slices.loops]


def are(outliers: PointOutliers, mended: list[Floats], wrong: Bools, contours: Floats) -> Bools:
    """Which points (15, 60), in their own order, were found."""
    out = np.zeros(wrong.shape, bool)
    for row, (mask, points) in enumerate(zip(outliers.masks, mended, strict=True)):
        bad = {tuple(point) for point in points[mask].tolist()}
        out[row] = [tuple(point) in bad for point in contours[row, :, :2].tolist()]
    return out


@pytest.mark.parametrize("edged", [False, True])
@pytest.mark.parametrize("noise", [0.0, 0.2])
def test_of_good_points_none_is_an_outlier(edged, noise):
    for seed in range(3):
        outliers, _ = found_in(object_(edged, noise, seed))
        assert not np.concatenate(outliers.masks).any()


@pytest.mark.parametrize("edged", [False, True])
@pytest.mark.parametrize("noise", [0.0, 0.2])
def test_nine_of_ten_points_3_mm_off_are_found_and_next_to_no_others(edged, noise):
    hits = misses = others = 0
    for seed in range(3):
        rng = np.random.default_rng(seed + 50)
        contours = object_(edged, noise, seed)
        wrong = rng.random(contours.shape[:2]) < 0.02
        away = rng.normal(size=contours.shape)
        away *= 3.0 / np.linalg.norm(away, axis=2, keepdims=True)
        contours = contours + away * wrong[..., None]
        outliers, mended = found_in(contours)
        out = are(outliers, mended, wrong, contours)
        hits, misses = hits + (out & wrong).sum(), misses + (~out & wrong).sum()
        others += (out & ~wrong).sum()
    assert hits > 8 * misses
    assert others <= 0.01 * 3 * 15 * COUNT


def test_an_outlier_is_put_where_its_neighbours_tell():
    contours = object_(False, 0.0)
    wanted = contours[7, 20, :2].copy()
    contours[7, 20, :2] *= 1.1
    outliers, _ = found_in(contours)
    assert [int(mask.sum()) for mask in outliers.masks] == [int(row == 7) for row in range(15)]
    assert np.linalg.norm(outliers.mended[7] - wanted, axis=1).min() < 0.02


def test_a_corner_that_neighbours_share_stays_and_one_alone_does_not():
    ridge, alone = object_(False, 0.05), object_(False, 0.05)
    ridge[:, 20, :2] *= 1.1
    alone[7, 20, :2] *= 1.1
    assert not np.concatenate(found_in(ridge)[0].masks).any()
    assert np.concatenate(found_in(alone)[0].masks).sum() == 1


def test_few_points_and_contours_that_are_like_that_are_left_alone():
    contours = object_(False, 0.0)
    few = contours[:, ::6].copy()
    few[7, 3, :2] *= 1.2
    assert not np.concatenate(found_in(few)[0].masks).any()
    rough = contours.copy()
    rough[7, ::5, :2] *= 1.1
    assert not found_in(rough)[0].masks[7].any()


def test_a_curve_is_made_again_without_outliers():
    contours = object_(False, 0.0)
    contours[7, 20, :2] *= 1.1
    slices = stack_curves(contour_curves(list(contours)))
    outliers = point_outliers(slices.loops, match_slices(slices, COUNT).places)
    again = refitted_curve(slices.loops[7], outliers.mended[7], outliers.masks[7])
    assert again.outlier.sum() == 1
    assert np.array_equal(
        np.sort(again.as_given, axis=0), np.sort(slices.loops[7].as_given, axis=0)
    )
    assert again.perimeter < slices.loops[7].perimeter
    same = refitted_curve(slices.loops[3], outliers.mended[3], outliers.masks[3])
    assert same.curve is slices.loops[3].curve


def test_single_heights_that_are_off_are_told_from_a_tilt():
    angle = 2 * np.pi * np.arange(40) / 40
    for z in (0.1 * np.cos(angle), 0.05 * np.cos(2 * angle), np.zeros(40)):
        assert not height_outliers(z, 6.3).any()
        off = z.copy()
        off[[5, 6, 30]] += [0.4, 0.3, -0.5]
        assert np.flatnonzero(height_outliers(off, 6.3)).tolist() == [5, 6, 30]
    noisy = 0.01 * np.random.default_rng(0).normal(size=40)
    assert not height_outliers(noisy, 6.3).any()
    assert not height_outliers(np.where(np.arange(40) % 4 == 0, 1.0, 0.0), 6.3).any()
    assert not height_outliers(np.array([0.0, 0.0, 0.0, 9.0]), 6.3).any()


def test_one_wrong_neighbour_does_not_put_a_point_off_its_course():
    ahead = np.arange(-3.0, 4.0)
    beside = np.stack([ahead, np.zeros(7)], axis=-1)
    for wrong in (0, 1, 2, 4, 5, 6):
        spoilt = beside.copy()
        spoilt[wrong, 1] = 0.5
        assert abs(neighbour_deviation(spoilt[None], ahead[None]).off[0, 1]) < 0.13
    beside[3, 1] = 0.5
    found = neighbour_deviation(beside[None], ahead[None])
    assert np.abs(found.off[0]) == pytest.approx([0.0, 0.5])
    assert np.abs(found.predicted(np.zeros((1, 2))) - [0.0, 0.0]).max() < 1e-15


LEVELS = np.linspace(-0.98, 0.98, 27)
ANGLE = 2 * np.pi * np.arange(60) / 60
NOISE = 0.01  # Half a percent of the height
Sections = dict[str, Callable[[Floats, float], Floats]]
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


def grid_of(name: str, heights: Floats = LEVELS) -> Floats:
    around = (1 + 0.1 * np.cos(2 * ANGLE))[:, None] * np.column_stack(
        [np.cos(ANGLE), np.sin(ANGLE)]
    )
    return np.asarray(PROFILES[name](heights)[:, None, None] * around)


def rows(found: InconsistentContours) -> list[int]:
    return np.flatnonzero(found.bad).tolist()


def shaken(grid: Floats, noise: float, seed: int = 0) -> Floats:
    return grid + noise * np.random.default_rng(seed).normal(size=grid.shape)


@pytest.mark.parametrize("name", PROFILES)
def test_of_clean_contours_none_is_bad(name):
    """Hard case 47: necks, steps, edges and zigzags are the object's own."""
    uneven = LEVELS.copy()
    step = LEVELS[1] - LEVELS[0]
    uneven[1:-1] += 0.3 * step * np.random.default_rng(0).uniform(-1, 1, 25)
    for noise in (0.0, 0.4 * NOISE, NOISE):
        for heights in (LEVELS, uneven):
            found = inconsistent_contours(heights, shaken(grid_of(name, heights), noise))
            assert (noise, rows(found), found.off.any()) == (noise, [], False)


@pytest.mark.parametrize("name", ["lobed", "ball", "cylinder", "edge", "bottle"])
def test_one_contour_of_another_size_is_found(name):
    """Hard case 47."""
    for factor, noise, row in product((1.3, 0.7), (0.0, NOISE), (3, 9, 12)):
        grid = shaken(grid_of(name), noise)
        size = np.sqrt((grid[row] ** 2).sum(axis=1).mean())
        grid[row] *= factor
        found = inconsistent_contours(LEVELS, grid)
        assert rows(found) == [row]
        assert found.off[row] == pytest.approx(abs(factor - 1) * size, rel=0.25)


@pytest.mark.parametrize("name", ["lobed", "cylinder", "ball"])
def test_three_of_27_are_found(name):
    for bad in ([5, 13, 20], [5, 8, 20], [9, 11, 18], [2, 12, 24]):
        for noise in (0.0, NOISE):
            grid = shaken(grid_of(name), noise)
            grid[bad] *= 1.3
            assert rows(inconsistent_contours(LEVELS, grid)) == bad


def test_a_contour_that_was_moved_or_turned_is_found():
    moved, turned = grid_of("bottle"), grid_of("bottle")
    moved[7] += [0.1, -0.05]
    turned[7] = turned[7] @ np.array([[0.9, 0.436], [-0.436, 0.9]])
    assert (
        rows(inconsistent_contours(LEVELS, moved))
        == rows(inconsistent_contours(LEVELS, turned))
        == [7]
    )


def test_a_contour_next_to_an_end_is_bad_only_where_the_object_goes_on_evenly():
    for name, wanted in (("cylinder", [25]), ("ball", [])):
        grid = grid_of(name)
        grid[25] *= 1.05
        assert rows(inconsistent_contours(LEVELS, grid)) == wanted
    for end in (0, 26):
        grid = grid_of("cylinder")
        grid[end] *= 1.3
        assert rows(inconsistent_contours(LEVELS, grid)) == []


def test_next_to_sharp_edges_of_the_object_a_bad_contour_stays():
    grid = grid_of("zigzag")
    grid[9] *= 1.3
    assert rows(inconsistent_contours(LEVELS, grid)) == []


def test_one_in_five_is_found_and_of_every_other_one_none_is_singled_out():
    for every, wanted in ((slice(2, None, 5), [2, 7, 12, 17, 22]), (slice(0, None, 2), [])):
        grid = grid_of("cylinder")
        grid[every] *= 1.3
        assert rows(inconsistent_contours(LEVELS, grid)) == wanted


def test_of_nine_contours_one_is_found_and_fewer_are_not_judged():
    for count, wanted in ((9, [4]), (8, [])):
        grid = grid_of("cylinder", LEVELS[:count])
        grid[4] *= 1.3
        assert rows(inconsistent_contours(LEVELS[:count], grid)) == wanted


def test_unit_and_place_change_nothing():
    grid = shaken(grid_of("lobed"), NOISE)
    grid[13] *= 1.3
    wanted = inconsistent_contours(LEVELS, grid)
    found = inconsistent_contours(1e-3 * LEVELS + 4.0, 1e-3 * grid + [7.0, -3.0])
    assert rows(found) == rows(wanted) == [13]
    assert found.off[13] == pytest.approx(1e-3 * wanted.off[13], rel=1e-6)


def test_traced_contours_are_cleaned_of_a_bad_one_by_all_steps_together(traced, sections):
    """Hard case 47: matched, judged, left out, matched again."""
    contours = traced(sections["lobed"]).contours(LEVELS, 81, noise=NOISE)
    contours[11][:, :2] *= 1.3
    slices = stack_curves(contour_curves(contours))
    found = inconsistent_contours(slices.heights, match_slices(slices, 60).grid)
    left = slices.without(found.bad, "unlike its neighbours", found.off)
    (dropped,) = left.dropped
    assert dropped[:2] == (11, "unlike its neighbours")
    assert dropped.height == slices.heights[11] and dropped.off == found.off[11] > 0.1
    again = inconsistent_contours(left.heights, match_slices(left, 60).grid)
    assert rows(again) == []


ANGLE_40 = 2 * np.pi * np.arange(40) / 40
RIM = np.stack([np.cos(ANGLE_40), np.sin(ANGLE_40)], axis=-1)


def stack(radii: Floats) -> tuple[Floats, Floats]:
    return np.linspace(-40.0, 40.0, len(radii)), np.asarray(radii)[:, None, None] * RIM


@pytest.mark.parametrize("count", [4, 6, 8])
def test_one_contour_far_off_is_a_candidate_and_tells_by_how_much(count):
    for row in range(1, count - 1):
        radii = np.full(count, 30.0)
        radii[row] = 39.0
        off = neighbour_misfits(*stack(radii))
        assert np.flatnonzero(off).tolist() == [row]
        assert off[row] == pytest.approx(9.0, rel=0.3)


@pytest.mark.parametrize("count", [3, 9])
def test_a_candidate_is_off_by_a_tenth_of_the_radius_in_any_unit(count):
    for share, listed in ((0.93, 0), (0.8, 1)):
        radii = np.full(count, 30.0)
        radii[count // 2] *= share
        heights, grid = stack(radii)
        found = neighbour_misfits(heights, grid)
        assert np.count_nonzero(found) == listed
        for scale in (1e-3, 1e3):
            assert neighbour_misfits(scale * heights, scale * grid) == pytest.approx(scale * found)


@pytest.mark.parametrize("count", [3, 4, 6, 9, 27])
def test_smooth_objects_are_not_a_candidate(count):
    heights = np.linspace(-49.5, 49.5, count)
    ball = np.sqrt(50.0**2 - heights**2)
    vase = 30.0 + 8.0 * np.sin(heights / 25.0)
    leaning = 30.0 * RIM + 0.3 * heights[:, None, None] * [1.0, 0.0]
    for grid in (ball[:, None, None] * RIM, vase[:, None, None] * RIM, leaning):
        assert not neighbour_misfits(heights, grid).any()


def test_an_end_is_a_candidate_if_it_is_wider_or_aside_but_not_if_it_rounds_off():
    for end in (0, -1):
        for radius, suspect in ((45.0, True), (5.0, False)):
            radii = np.full(9, 30.0)
            radii[end] = radius
            assert (neighbour_misfits(*stack(radii))[end] > 0.0) == suspect
        heights, grid = stack(np.full(9, 30.0))
        grid[end] += [20.0, 0.0]
        assert neighbour_misfits(heights, grid)[end] == pytest.approx(20.0)


def test_of_three_the_middle_one_is_a_candidate_if_it_is_narrow_or_aside():
    assert neighbour_misfits(*stack(np.array([30.0, 20.0, 30.0]))).tolist() == [0.0, 10.0, 0.0]
    assert not neighbour_misfits(*stack(np.array([30.0, 45.0, 30.0]))).any()
    heights, grid = stack(np.full(3, 30.0))
    grid[1] += [0.0, 15.0]
    assert neighbour_misfits(heights, grid).tolist() == pytest.approx([0.0, 15.0, 0.0])
    assert not neighbour_misfits(*stack(np.array([30.0, 10.0]))).any()


def test_what_is_alike_but_for_its_size_may_be_a_feature():
    _, grid = stack(np.array([30.0, 30.0, 20.0, 30.0, 30.0]))
    grid[3] *= [1.4, 1.0]
    bad = np.array([False, False, True, True, False])
    star = np.ones(5, bool)
    assert look_like_features(grid, star, bad).tolist() == [False, False, True, False, False]
    star[2] = False
    assert not look_like_features(grid, star, bad).any()


UNEVEN = np.array([0.0, 0.4, 1.0, 1.7, 2.0, 3.1, 3.5])


def test_cubics_are_predicted_inside_and_parabolas_at_the_ends():
    weights = neighbour_weights(UNEVEN)
    assert np.allclose(weights @ UNEVEN**2, UNEVEN**2)
    inner = slice(2, -2)
    assert np.allclose((weights @ UNEVEN**3)[inner], UNEVEN[inner] ** 3)
    assert np.allclose(weights.sum(axis=1), 1.0)


def test_no_contour_predicts_itself_and_only_neighbours_count():
    weights = neighbour_weights(UNEVEN)
    away = np.abs(np.arange(7)[:, None] - np.arange(7))
    assert (weights[away == 0] == 0.0).all()
    assert (weights[away > 3] == 0.0).all()
    assert np.count_nonzero(weights[3]) == 4


@pytest.mark.parametrize("count", [1, 2])
def test_too_few_contours_predict_nothing(count):
    assert not neighbour_weights(UNEVEN[:count]).any()


def test_three_contours_predict_each_other_linearly():
    weights = neighbour_weights(UNEVEN[:3])
    assert np.allclose(weights @ UNEVEN[:3], UNEVEN[:3])
    assert (np.count_nonzero(weights, axis=1) == 2).all()
