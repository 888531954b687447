from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from palpate.core.arrays import Floats
from palpate.core.geometry.polygons import winding_number
from palpate.core.rebuild.contours.curves import contour_curves
from palpate.core.rebuild.contours.slices import Slices, stack_curves

Make = Callable[..., Any]
HEIGHTS = np.linspace(-0.9, 0.9, 9)
Sections = dict[str, Callable[[Floats, float], Floats]]


def slices_of(contours: Any, heights: Any = None) -> Slices:
    return stack_curves(contour_curves(contours, heights))


def circle(radius: float, height: float, middle: tuple[float, float] = (0.0, 0.0)) -> Floats:
    angle = 2 * np.pi * np.arange(40) / 40
    x, y = middle
    z = np.full(40, height)
    return np.column_stack([x + radius * np.cos(angle), y + radius * np.sin(angle), z])


def reasons(slices: Slices) -> dict[int, str]:
    return {one.which: one.why for one in slices.dropped}


@pytest.fixture(scope="module")
def contours(traced: Make, sections: Sections) -> list[Floats]:
    found: list[Floats] = traced(sections["lobed"]).contours(HEIGHTS, 60)
    return found


def test_slices_rise_and_tell_which_contour_each_one_is(contours):
    slices = slices_of(contours[::-1])
    assert np.allclose(slices.heights, HEIGHTS, atol=1e-12)
    assert slices.rows.tolist() == list(range(9))[::-1]
    assert slices.dropped == ()
    assert [len(points) for points in slices.points] == [len(one) for one in contours]
    assert slices.fine.shape == (9, 512, 2)
    assert np.abs(slices.fine[3] - slices.curves[3].at(np.arange(512) / 512)).max() < 1e-14
    assert slices.star.all()
    assert not slices.self_intersecting.any() and not slices.tilted.any()


def test_direction_beginning_and_a_closing_point_change_nothing(contours):
    """Hard case 42."""
    wanted = slices_of(contours)
    others = [np.roll(one, 7 * i, axis=0)[:: 1 - 2 * (i % 2)] for i, one in enumerate(contours)]
    others = [np.vstack([one, one[:1]]) for one in others]
    found = slices_of(others)
    size = np.ptp(wanted.fine[4], axis=0).max()
    assert np.abs(found.fine - wanted.fine).max() < 1e-12 * size
    assert np.abs(found.middles - wanted.middles).max() < 1e-12 * size
    assert np.allclose(found.heights, wanted.heights, rtol=0, atol=1e-12)


def test_a_height_is_the_mean_of_noisy_ones(traced, sections):
    slices = slices_of(traced(sections["lobed"]).contours(HEIGHTS, 80, noise=0.01))
    assert np.abs(slices.heights - HEIGHTS).max() < 4 * 0.01 / np.sqrt(64)
    assert not slices.tilted.any()


def test_plane_contours_take_given_heights(contours):
    wanted = slices_of(contours)
    found = slices_of([one[:, :2] for one in contours], HEIGHTS)
    assert np.array_equal(found.fine, wanted.fine)
    assert np.allclose(found.heights, wanted.heights, atol=1e-15)


def test_rows_that_are_not_finite_are_left_out(contours):
    spoilt = [one.copy() for one in contours]
    spoilt[2] = np.insert(spoilt[2], 5, [0.1, 0.2, np.nan], axis=0)
    spoilt[4] = np.insert(spoilt[4], 0, [np.inf, 0.2, 0.0], axis=0)
    found, wanted = slices_of(spoilt), slices_of(contours)
    assert np.array_equal(found.fine, wanted.fine)
    assert np.array_equal(found.heights, wanted.heights)


def test_contours_that_enclose_nothing_are_dropped_and_tell_why(contours):
    line = np.column_stack([np.linspace(0, 1, 9), np.linspace(0, 2, 9), np.full(9, 2.0)])
    bad = [
        np.full((5, 3), np.nan),
        np.zeros((0, 3)),
        contours[0][:2],
        np.tile([0.1, 0.2, 1.5], (9, 1)),
        line,
        np.repeat(contours[0][:2], 3, axis=0),
    ]
    slices = slices_of([*bad, *contours])
    few = "too few points"
    assert list(reasons(slices).values()) == [few, few, few, "in one place", "on one line", few]
    assert slices.rows.tolist() == list(range(6, 15))


def test_of_two_contours_that_repeat_each_other_the_better_one_stays():
    good, coarse = circle(1.0, 0.5), circle(1.0, 0.5)[::4]
    for pair in ([good, coarse], [coarse, good]):
        slices = slices_of([circle(1.0, 0.0), *pair, circle(1.0, 1.0)])
        assert len(slices.heights) == 3
        assert len(slices.points[1]) == 40
        assert list(reasons(slices).values()) == ["repeats another at its height"]


@pytest.mark.parametrize(
    ("other", "why", "radius"),
    [
        (circle(0.3, 0.5), "inside another at its height", 1.0),
        (circle(2.0, 0.5), "inside another at its height", 2.0),
        (circle(0.8, 0.5, (3.0, 0.0)), "beside another at its height", 1.0),
        (circle(1.4, 0.5, (3.0, 0.0)), "beside another at its height", 1.4),
        (circle(1.2, 0.5, (1.0, 0.0)), "crosses another at its height", 1.0),
    ],
)
def test_of_two_loops_at_one_height_one_stays(other, why, radius):
    slices = slices_of([circle(1.0, 0.0), circle(1.0, 0.5), other, circle(1.0, 1.0)])
    assert len(slices.heights) == 3
    assert slices.perimeter[1] == pytest.approx(2 * np.pi * radius, rel=1e-4)
    assert list(reasons(slices).values()) == [why]


def test_heights_that_only_noise_tells_apart_are_one_but_a_step_is_not():
    rng = np.random.default_rng(0)
    shake = np.array([0.0, 0.0, 0.01])
    noisy = [
        circle(1.0, height) + shake * rng.normal(size=(40, 3)) for height in (0, 0.5, 0.5, 1.0)
    ]
    assert len(slices_of(noisy).heights) == 3
    step = [circle(1.0, 0.0), circle(1.0, 0.5), circle(0.6, 0.505), circle(0.6, 1.0)]
    assert len(slices_of(step).heights) == 4


def test_contours_all_at_one_height_are_one_slice():
    slices = slices_of([circle(1.0, 0.3), circle(1.0, 0.3 + 1e-17), circle(1.0, 0.3)])
    assert len(slices.heights) == 1
    assert len(slices.dropped) == 2


def test_a_tilted_contour_is_flagged_where_it_reaches_towards_the_next():
    tilted = circle(1.0, 0.5)
    tilted[:, 2] += 0.2 * tilted[:, 0]
    slices = slices_of([circle(1.0, 0.0), tilted, circle(1.0, 1.0)])
    assert slices.tilted.tolist() == [False, True, False]
    assert slices.tilt[1] == pytest.approx(0.2 / np.sqrt(2), rel=1e-6)
    assert slices.heights[1] == pytest.approx(0.5, abs=1e-12)
    assert slices_of([tilted]).tilted.tolist() == [True]
    assert slices_of([circle(1.0, 0.0)]).tilted.tolist() == [False]


def test_sections_that_are_not_star_shaped_are_told(traced, sections):
    slices = slices_of(traced(sections["kidney"]).contours(HEIGHTS, 60))
    assert not slices.star.any()
    for curve, middle in zip(slices.fine, slices.middles, strict=True):
        assert winding_number(curve, middle[None])[0] == 0


def test_a_figure_of_eight_is_flagged():
    angle = 2 * np.pi * np.arange(60) / 60
    eight = np.column_stack([np.cos(angle), 0.6 * np.sin(2 * angle), np.full(60, 0.5)])
    slices = slices_of([circle(1.0, 0.0), eight])
    assert slices.self_intersecting.tolist() == [False, True]
    assert slices.star.tolist() == [True, False]


def test_points_nearer_than_their_noise_are_smoothed_instead_of_making_loops():
    rng = np.random.default_rng(0)
    angle = 2 * np.pi * np.arange(800) / 800
    dense = np.column_stack([np.cos(angle), np.sin(angle)]) + 0.02 * rng.normal(size=(800, 2))
    slices = slices_of([dense], [0.0])
    assert not slices.self_intersecting.any()
    assert slices.curves[0].smoothing > 0.0
    assert slices.perimeter[0] == pytest.approx(2 * np.pi, rel=0.01)


def test_contours_can_be_left_out_afterwards(contours):
    slices = slices_of([np.zeros((2, 3)), *contours])
    bad = np.isin(np.arange(9), [0, 5])
    left = slices.without(bad, "unlike its neighbours")
    assert left.rows.tolist() == [2, 3, 4, 5, 7, 8, 9]
    assert np.array_equal(left.fine, slices.fine[~bad])
    assert left.curves[0] is slices.curves[1]
    assert len(left.points) == 7
    assert list(reasons(left)) == [0, 1, 6]
    with pytest.raises(ValueError, match="bad must leave at least one of 9 slices, got"):
        slices.without(np.ones(9, bool), "unlike its neighbours")
    with pytest.raises(ValueError, match="bad must leave at least one of 9 slices, got"):
        slices.without(np.zeros(8, bool), "unlike its neighbours")


@given(
    exponent=st.integers(-9, 9), turn=st.floats(0, 7), shift=st.tuples(*[st.floats(-50, 50)] * 3)
)
@settings(derandomize=True, deadline=None, max_examples=20)
def test_unit_place_and_direction_of_the_object_change_nothing(exponent, turn, shift):
    given = [circle(1 + 0.3 * z, z)[:: 1 + (z > 0)] for z in (-1.0, -0.999999, 0.0, 0.7, 1.0)]
    given[2] *= [1.0, 0.4, 1.0]
    scale, (c, s) = 10.0**exponent, (np.cos(turn), np.sin(turn))
    motion = np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])
    wanted = slices_of(given)
    found = slices_of([scale * (one @ motion + shift) for one in given])
    assert np.array_equal(found.rows, wanted.rows)
    assert [one[:2] for one in found.dropped] == [one[:2] for one in wanted.dropped]
    assert np.array_equal(found.star, wanted.star)
    assert np.allclose(found.perimeter / scale, wanted.perimeter, rtol=1e-9)
    assert np.allclose(found.heights / scale - shift[2], wanted.heights, atol=1e-11)
    middles = wanted.middles @ motion[:2, :2] + shift[:2]
    assert np.allclose(found.middles / scale, middles, atol=1e-10)


@pytest.mark.parametrize(
    ("contours", "heights", "words"),
    [
        ([], None, "contours must be at least one, got none"),
        ([np.zeros((4, 2))], None, r"contour 0 must have shape \(any, 3\), got \(4, 2\)"),
        ([np.zeros((4, 3))], [0.0], r"contour 0 must have shape \(any, 2\), got \(4, 3\)"),
        ([np.zeros((4, 2))], [0.0, 1.0], r"heights must have shape \(1\), got \(2,\)"),
        ([np.zeros((4, 2))], [np.nan], "heights must be finite"),
        ("ring", None, "contours must be a sequence of arrays, got str"),
        (None, None, "contours must be a sequence of arrays, got NoneType"),
        ([[[0, 0, 0], [1, 1]]], None, "contour 0 must be an array of real numbers"),
        ([["a"]], None, "contour 0 must be an array of real numbers"),
        ([np.zeros((4, 3), complex)], None, "contour 0 must be an array of real numbers"),
        (
            [np.zeros((4, 3)), np.zeros((1, 3))],
            None,
            "at least one of 3 points around an area, got contour 0: in one place; contour 1: too",
        ),
    ],
)
def test_what_is_no_stack_of_contours_is_refused(contours, heights, words):
    with pytest.raises(ValueError, match=words):
        slices_of(contours, heights)


def test_a_contour_without_points_is_left_out():
    slices = slices_of([circle(1.0, 0.0), [], circle(1.0, 1.0)])
    assert reasons(slices) == {1: "too few points"}
