from __future__ import annotations

import numpy as np
import pytest

from palpate.core.arrays import Bools, Floats
from palpate.core.rebuild.contours.correspondence import match_slices
from palpate.core.rebuild.contours.curves import contour_curves, height_outliers, refitted_curve
from palpate.core.rebuild.contours.outliers import (
    PointOutliers,
    neighbour_deviation,
    point_outliers,
)
from palpate.core.rebuild.contours.slices import stack_curves

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


def are(outliers: PointOutliers, felt: list[Floats], wrong: Bools, contours: Floats) -> Bools:
    """Which points (15, 60), in their own order, were found."""
    out = np.zeros(wrong.shape, bool)
    for row, (mask, points) in enumerate(zip(outliers.masks, felt, strict=True)):
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
        outliers, felt = found_in(contours)
        out = are(outliers, felt, wrong, contours)
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
