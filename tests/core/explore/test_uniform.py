from __future__ import annotations

import math

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.explore.uniform import (
    APPROACH,
    CAP_SHARE,
    CLEARANCE,
    END_SHARE,
    approach,
    cap_places,
    from_above,
    retry_height,
    search_places,
    slice_heights,
    uncovered_height,
)
from palpate.core.frames import DOWN, split_pose
from palpate.core.plane.area_centroid import area_centroid


def polygon(azimuth: Floats, radius: Floats | float, middle: tuple[float, float]) -> Floats:
    away = np.column_stack([np.cos(azimuth), np.sin(azimuth)]) * np.reshape(radius, (-1, 1))
    return np.column_stack([away + middle, np.full(len(azimuth), 0.05)])


def square(half: float, count: int) -> Floats:
    """Points all along a square's sides, counter-clockwise, (4 count, 3)."""
    along = np.linspace(-half, half, count, endpoint=False)
    side = np.column_stack([np.full(count, half), along])
    turns = [np.linalg.matrix_power(np.array([[0, -1], [1, 0]]), k) for k in range(4)]
    return np.column_stack([np.concatenate([side @ t.T for t in turns]), np.zeros(4 * count)])


@pytest.mark.parametrize("count", [1, 2, 3, 4, 5, 12, 33])
def test_heights_are_even_and_start_in_the_middle_then_go_up_then_down(count: int) -> None:
    heights = slice_heights(0.1, 0.3, count)
    assert len(heights) == count
    ordered = np.sort(heights)
    assert np.allclose(np.diff(ordered), np.diff(ordered).mean() if count > 1 else 0, rtol=1e-9)
    assert abs(heights[0] - 0.2) <= 0.2 / max(count, 2)
    up = [h for h in heights if h >= heights[0]]
    down = [h for h in heights if h < heights[0]]
    assert heights == sorted(up) + sorted(down, reverse=True)


def test_the_ends_keep_their_distance_from_the_objects_ends() -> None:
    heights = slice_heights(0.0, 1.0, 9)
    assert min(heights) == pytest.approx(END_SHARE)
    assert max(heights) == pytest.approx(1.0 - END_SHARE)


def test_the_plan_is_the_same_in_millimetres_and_metres() -> None:
    metres, millimetres = slice_heights(0.01, 0.08, 7), slice_heights(10.0, 80.0, 7)
    assert np.allclose(1e3 * np.array(metres), millimetres, rtol=1e-12)
    assert 1e3 * retry_height(0.02, 0.01, 0.08, 7) == pytest.approx(retry_height(20, 10, 80, 7))
    contour = square(0.02, 30)
    assert np.allclose(1e3 * area_centroid(contour), area_centroid(1e3 * contour))
    assert np.allclose(
        1e3 * np.array(cap_places(contour, 0.015)), cap_places(1e3 * contour, 15.0), rtol=1e-12
    )


@pytest.mark.parametrize(
    ("bottom", "top", "count", "words"),
    [
        (0.1, 0.1, 5, "the top must be above the bottom 0.1 m, got 0.1 m"),
        (0.1, 0.0, 5, "the top must be above the bottom"),
        (0.1, math.nan, 5, "the top must be above the bottom 0.1 m, got nan m"),
        (0.0, 0.1, 0, "count must be at least 1, got 0"),
    ],
)
def test_a_plan_that_cannot_be_is_refused(
    bottom: float, top: float, count: int, words: str
) -> None:
    with pytest.raises(ValueError, match=words):
        slice_heights(bottom, top, count)


def test_a_slice_is_tried_again_nearer_to_the_middle() -> None:
    heights = slice_heights(0.0, 1.0, 11)
    spacing = 0.094
    for height in heights:
        again = retry_height(height, 0.0, 1.0, 11)
        assert abs(again - height) == pytest.approx(0.25 * spacing)
        if abs(height - 0.5) > 1e-9:
            assert abs(again - 0.5) < abs(height - 0.5)


def test_the_object_is_looked_for_at_the_origin_first_and_then_around_it() -> None:
    places = search_places(0.05, 0.012)
    distances = [float(np.linalg.norm(place)) for place in places]
    assert distances[0] == 0.0
    assert np.allclose(distances, sorted(distances), rtol=0, atol=1e-15)
    assert len(places) == 1 + 6 * (1 + 2 + 3 + 4)
    assert distances[-1] <= 0.05
    # Neighbours are no farther apart than a pad is wide.
    apart = np.linalg.norm(np.subtract.outer(places, places).diagonal(axis1=1, axis2=3), axis=-1)
    np.fill_diagonal(apart, np.inf)
    assert apart.min(axis=1).max() <= 0.013


def test_the_middle_of_an_unevenly_felt_circle_is_its_centre() -> None:
    rng = np.random.default_rng(0)
    azimuth = np.sort(np.concatenate([rng.uniform(0, 2 * np.pi, 60), rng.uniform(0, 0.5, 300)]))
    contour = polygon(azimuth, 0.03, (0.1, -0.2))
    assert np.linalg.norm(area_centroid(contour) - [0.1, -0.2]) < 0.01 * 0.03
    assert np.linalg.norm(contour[:, :2].mean(axis=0) - [0.1, -0.2]) > 0.5 * 0.03


def test_the_middle_does_not_depend_on_direction_or_start_or_a_repeated_end() -> None:
    azimuth = np.sort(np.random.default_rng(1).uniform(0, 2 * np.pi, 40))
    contour = polygon(azimuth, 0.03 + 0.01 * np.cos(3 * azimuth), (1.0, 2.0))
    middle = area_centroid(contour)
    for other in (
        contour[::-1],
        np.roll(contour, 13, axis=0),
        np.concatenate([contour, contour[:1]]),
    ):
        assert np.allclose(area_centroid(other), middle, rtol=0, atol=1e-15)


def test_the_middle_of_a_small_ring_far_away_keeps_its_digits() -> None:
    azimuth = np.linspace(0, 2 * np.pi, 50, endpoint=False)
    contour = polygon(azimuth, 1e-6, (1e3, -1e3))
    assert np.linalg.norm(area_centroid(contour) - [1e3, -1e3]) < 1e-11


@pytest.mark.parametrize("count", [1, 2, 40])
def test_points_that_enclose_nothing_have_the_middle_of_the_points(count: int) -> None:
    on_a_line = np.outer(np.linspace(1.0, 2.0, count), [0.01, 0.02, 0.0])
    assert np.allclose(area_centroid(on_a_line), on_a_line.mean(axis=0)[:2], atol=1e-15)


def test_touches_from_above_lie_inside_the_contour_towards_its_corners() -> None:
    contour = square(0.02, 50)
    places = cap_places(contour, 0.015)
    assert len(places) == 4
    assert np.allclose([np.abs(p) for p in places], CAP_SHARE * 0.02, rtol=0.02)
    assert len({tuple(np.sign(p)) for p in places}) == 4


def test_touches_from_above_follow_a_contour_that_stands_aside() -> None:
    azimuth = np.linspace(0, 2 * np.pi, 100, endpoint=False)
    contour = polygon(azimuth, 0.03, (0.05, 0.01))
    for place in cap_places(contour, 0.015):
        assert np.linalg.norm(place - [0.05, 0.01]) == pytest.approx(CAP_SHARE * 0.03, rel=1e-3)


def test_a_contour_no_wider_than_the_pad_needs_no_more_touches() -> None:
    azimuth = np.linspace(0, 2 * np.pi, 40, endpoint=False)
    assert cap_places(polygon(azimuth, 0.007, (0.0, 0.0)), 0.015) == []
    assert len(cap_places(polygon(azimuth, 0.008, (0.0, 0.0)), 0.015)) == 4


def test_a_pad_from_above_starts_clear_of_the_height_and_looks_down() -> None:
    place, axes = split_pose(from_above(np.array([0.01, 0.02]), 0.07))
    assert place[:2].tolist() == [0.01, 0.02]
    assert place[2] >= 0.07 + CLEARANCE
    assert np.array_equal(axes, DOWN)


def test_nothing_is_uncovered_when_every_slice_is_traced() -> None:
    heights = slice_heights(0.0, 0.1, 9)
    assert uncovered_height(0.0, 0.1, 9, heights) == 0.0


@pytest.mark.parametrize("shift", [1e-17, -1e-17, 1e-16])
def test_a_slice_that_is_off_by_a_rounding_leaves_nothing_uncovered(shift: float) -> None:
    heights = [height + shift for height in slice_heights(0.0, 0.08, 9)]
    assert uncovered_height(0.0, 0.08, 9, heights) == 0.0


def test_a_missing_slice_leaves_its_stretch_uncovered() -> None:
    heights = sorted(slice_heights(0.0, 0.1, 9))
    spacing = heights[1] - heights[0]
    assert uncovered_height(0.0, 0.1, 9, heights[:4] + heights[5:]) == pytest.approx(spacing)
    assert uncovered_height(0.0, 0.1, 9, []) == pytest.approx(0.1 - spacing)
    assert uncovered_height(0.1, 0.1, 9, []) == 0.0


def test_a_slice_is_approached_from_outside_all_contours_about_the_nearest() -> None:
    turn = 2 * np.pi * np.arange(60) / 60
    rim = np.column_stack([np.cos(turn), np.sin(turn), 0 * turn])
    low, high = 0.02 * rim, 0.03 * rim + [0.01, 0.0, 0.0]
    middle, distance = approach(0.08, [0.02, 0.07], [low, high])
    assert middle == pytest.approx([0.01, 0.0], abs=1e-12)
    assert distance == pytest.approx(0.03 + APPROACH)
