from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy.interpolate import CubicSpline
from scipy.spatial import cKDTree

from palpate.core.arrays import Floats
from palpate.core.geometry.polygons import winding_number
from palpate.core.rebuild.contours.curves import contour_curves
from palpate.core.rebuild.contours.slices import (
    Correspondence,
    Slices,
    begin_turns,
    circular_peak,
    follow_signatures,
    match_slices,
    minimum_twist,
    slice_distance,
    stack_curves,
    start_ray,
)

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


COUNT = 80
AROUND = np.arange(COUNT) / COUNT
BETWEEN = np.linspace(-0.96, 0.96, 60)
NAMES = ["lobed", "three lobes", "four lobes", "square", "bent tube", "star", "kidney", "box"]
Section = Callable[[Floats, float], Floats]
Sections = dict[str, Section]


def loft_error(section: Section, slices: Slices, grid: Floats) -> float:
    """Mean distance between the object and a cubic through each row of places."""
    found = CubicSpline(slices.heights, grid, axis=0)(BETWEEN)
    truth = np.stack([section(np.arange(1600) / 1600, z) for z in BETWEEN])
    return float(slice_distance(truth, found[None]).mean())


def perfect(section: Section, slices: Slices) -> Floats:
    """The same curves at the places that belong together by the object's making."""
    rows = []
    for curve, z in zip(slices.curves, slices.heights, strict=True):
        fine = curve.at(np.arange(8000) / 8000)
        rows.append(fine[cKDTree(fine).query(section(AROUND, float(z)))[1]])
    return np.stack(rows)


def stack(traced: Make, section: Section, count: int, points: int) -> Slices:
    return stack_curves(
        contour_curves(traced(section).contours(np.linspace(-0.97, 0.97, count), points))
    )


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize(("count", "points"), [(27, 81), (9, 24)])
def test_any_start_direction_and_count_cost_next_to_nothing(traced, sections, name, count, points):
    section = sections[name]
    slices = stack(traced, section, count, points)
    found = match_slices(slices, COUNT)
    error = loft_error(section, slices, found.grid)
    # 24 points do not hold the corners of a square: which of them are cut is chance.
    allowed = 1.15 if (name, count) == ("square", 9) else 1.03
    assert error < allowed * loft_error(section, slices, perfect(section, slices)) + 5e-6


@pytest.mark.parametrize("name", ["three lobes", "four lobes"])
def test_lobes_that_turn_are_followed_by_their_signature(traced, sections, name):
    slices = stack(traced, sections[name], 9, 40)
    found = match_slices(slices, COUNT)
    assert found.method == "signature"
    assert min(found.scores, key=lambda method: found.scores[method]) == "signature"
    errors = {
        method: loft_error(sections[name], slices, match_slices(slices, COUNT, method).grid)
        for method in found.scores
    }
    assert errors["signature"] < 0.5 * min(errors["twist"], errors["ray"], errors["azimuth"])


def test_a_step_of_the_object_does_not_hide_how_its_lobes_turn(traced, sections):
    section = sections["four lobes"]
    slices = stack(traced, lambda t, z: section(t, z) * (1.0 if z < 0.1 else 0.6), 27, 60)
    assert match_slices(slices, COUNT).method == "signature"


def test_a_slice_whose_middle_lies_outside_is_matched(traced, sections):
    """Hard case 44: a ray from there meets the contour 0, 2 or 4 times."""
    slices = stack(traced, sections["kidney"], 27, 81)
    for curve, middle in zip(slices.fine, slices.middles, strict=True):
        assert winding_number(curve, middle[None])[0] == 0
    found = match_slices(slices, COUNT)
    assert "azimuth" not in found.scores
    error = loft_error(sections["kidney"], slices, found.grid)
    assert error < 3e-4
    azimuth = match_slices(slices, COUNT, "azimuth")
    assert np.isfinite(azimuth.grid).all()
    assert loft_error(sections["kidney"], slices, azimuth.grid) > error


def test_how_contours_were_begun_and_directed_changes_nothing(traced, sections):
    """Hard case 42."""
    contours = traced(sections["lobed"]).contours(np.linspace(-0.97, 0.97, 9), 60)
    wanted = match_slices(stack_curves(contour_curves(contours)), COUNT)
    others = [np.roll(one, 5 + 3 * i, axis=0)[:: 1 - 2 * (i % 2)] for i, one in enumerate(contours)]
    found = match_slices(stack_curves(contour_curves(others[::-1])), COUNT)
    assert found.method == wanted.method
    assert np.abs(found.grid - wanted.grid).max() < 1e-12


@pytest.mark.parametrize("method", ["twist", "signature", "ray", "azimuth"])
def test_places_lie_on_the_curves_in_order(traced, sections, method):
    slices = stack(traced, sections["lobed"], 9, 60)
    found = match_slices(slices, COUNT, method)
    assert found.method == method
    assert list(found.scores) == [method]
    for curve, places, row in zip(slices.curves, found.places, found.grid, strict=True):
        assert np.abs(curve.at(places) - row).max() < 1e-14
    assert (np.diff(found.places, axis=1) > 0).all()
    assert (found.places[:, -1] - found.places[:, 0] < 1).all()
    assert ((found.turns >= 0) & (found.turns < 1)).all()
    assert np.allclose(np.mod(found.places[:, 0] - found.turns + 0.5, 1), 0.5)


def test_equal_azimuths_correspond_about_the_middles(traced, sections):
    slices = stack(traced, sections["lobed"], 9, 80)
    away = match_slices(slices, COUNT, "azimuth").grid - slices.middles[:, None]
    angle = np.unwrap(np.arctan2(away[..., 1], away[..., 0]), axis=1)
    assert np.abs(angle - 2 * np.pi * AROUND).max() < 1e-3


def test_the_first_place_of_the_middle_slice_is_on_the_ray(traced, sections):
    slices = stack(traced, sections["box"], 9, 60)
    found = match_slices(slices, COUNT, "twist")
    off = found.grid[4, 0] - slices.middles[4]
    assert off[0] > 0
    assert abs(off[1]) < 1e-3


def test_a_score_is_about_what_leaving_contours_out_would_cost(traced, sections):
    section = sections["bent tube"]
    slices = stack(traced, section, 17, 60)
    found = match_slices(slices, COUNT)
    left = np.arange(17) % 2 == 0
    coarse = slices.without(~left, "unlike its neighbours")
    costs = loft_error(section, coarse, found.grid[left])
    assert found.scores[found.method] / 20 < costs < 20 * found.scores[found.method]


@pytest.mark.parametrize("count", [1, 2])
def test_with_fewer_than_three_slices_nothing_is_scored(traced, sections, count):
    found = match_slices(stack(traced, sections["bent tube"], count, 40), 20)
    assert isinstance(found, Correspondence)
    assert found.grid.shape == (count, 20, 2)
    assert found.method == "twist"
    assert found.scores == {}


def test_unit_and_place_change_nothing(traced, sections):
    contours = traced(sections["four lobes"]).contours(np.linspace(-0.97, 0.97, 9), 40)
    wanted = match_slices(stack_curves(contour_curves(contours)), COUNT)
    found = match_slices(
        stack_curves(contour_curves([1e-3 * (one + [3.0, -5.0, 20.0]) for one in contours])), COUNT
    )
    assert found.method == wanted.method
    assert np.abs(1e3 * found.grid - [3.0, -5.0] - wanted.grid).max() < 1e-9
    assert found.scores[found.method] == pytest.approx(1e-3 * wanted.scores[wanted.method])


@pytest.mark.parametrize(
    ("count", "method", "words"),
    [
        (2, "auto", "count must be at least 3, got 2"),
        (9, "best", "method must be auto or one of twist, signature, ray, azimuth, got 'best'"),
    ],
)
def test_what_no_match_can_be_is_refused(traced, sections, count, method, words):
    slices = stack(traced, sections["bent tube"], 2, 40)
    with pytest.raises(ValueError, match=words):
        match_slices(slices, count, method)


def start_circle(begin: float, middle: tuple[float, float] = (0.0, 0.0)) -> Floats:
    angle = 2 * np.pi * (np.arange(512) / 512 - begin)
    return np.column_stack([np.cos(angle), np.sin(angle)]) + middle


def test_a_curve_begins_where_it_comes_up_through_the_ray():
    begins = np.array([0.0, 0.2, 0.71, 0.9999])
    found = start_ray(np.stack([start_circle(begin) for begin in begins]))
    off = found - begins
    assert np.abs(off - np.round(off)).max() < 1e-8
    assert ((found >= 0) & (found < 1)).all()


def test_of_several_crossings_the_farthest_out_counts():
    angle = 2 * np.pi * np.arange(512) / 512
    bend = 1.9 * np.sin(angle)
    width = 0.52 + 0.16 * np.cos(angle)
    sausage = np.column_stack([width * np.cos(bend), width * np.sin(bend)])
    [turn] = start_ray(sausage[None])
    assert abs(turn - np.round(turn)) < 1e-9  # where the width is largest
    assert width[0] > sausage[256, 0] > 0  # the inner wall is crossed as well


def test_a_curve_that_never_meets_the_ray_begins_farthest_along_x():
    assert start_ray(start_circle(0.25, (0.0, 3.0))[None])[0] == pytest.approx(0.25, abs=1 / 512)


TURNS = np.arange(512) / 512


def lobes(count: int, depth: float, turn: float) -> Floats:
    """Lobes that have turned by so much, begun at azimuth 0."""
    radius = 1 + depth * np.cos(2 * np.pi * count * (TURNS - turn))
    angle = 2 * np.pi * TURNS
    return np.asarray(radius[:, None] * np.column_stack([np.cos(angle), np.sin(angle)]))


def signature_stack(count: int, depth: float, turn: float) -> Floats:
    return np.stack([lobes(count, depth, turn * level) for level in range(8)])


def test_lobes_are_followed_where_the_least_twist_follows_the_circle():
    shapes = signature_stack(3, 0.1, 0.06)
    steps = minimum_twist(shapes)
    assert np.abs(steps).max() < 0.02
    assert np.abs(follow_signatures(shapes, steps) - 0.06).max() < 0.002
    assert np.abs(follow_signatures(shapes[::-1], minimum_twist(shapes[::-1])) + 0.06).max() < 0.002


def test_what_turns_on_evenly_is_followed_to_nearly_half_a_lobe():
    shapes = signature_stack(4, 0.1, 0.11)
    assert np.abs(follow_signatures(shapes, minimum_twist(shapes)) - 0.11).max() < 0.002


def test_one_pair_that_looks_like_a_lobe_back_follows_the_others():
    turned = 0.1 * np.arange(8)
    turned[4:] += 0.05
    shapes = np.stack([lobes(4, 0.1, turn) for turn in turned])
    found = follow_signatures(shapes, minimum_twist(shapes))
    assert np.abs(found - np.diff(turned)).max() < 0.006


def test_round_contours_and_unlike_ones_stay_with_the_least_twist():
    for shapes in (
        signature_stack(3, 0.005, 0.06),
        np.stack([lobes(3, 0.2, 0.0), lobes(5, 0.2, 0.0), lobes(3, 0.2, 0.0)]),
        np.repeat(lobes(3, 0.0, 0.0)[None], 3, axis=0),
    ):
        steps = minimum_twist(shapes)
        assert np.abs(follow_signatures(shapes, steps) - steps).max() < 1e-12


def test_a_single_contour_has_no_steps():
    assert follow_signatures(lobes(3, 0.1, 0.0)[None], np.zeros(0)).shape == (0,)


EVEN_256 = np.arange(256) / 256


def ellipse(turns: Floats) -> Floats:
    angle = 2 * np.pi * turns
    return np.column_stack([2 * np.cos(angle) + 0.2 * np.cos(2 * angle), np.sin(angle)])


def test_curves_that_begin_elsewhere_are_brought_to_one_beginning():
    begins = np.array([0.0, 0.31, 0.87, 0.502])
    sizes = np.array([1.0, 1.3, 0.2, 5.0])
    shapes = np.stack([s * ellipse(EVEN_256 - b) for s, b in zip(sizes, begins, strict=True)])
    turns = begin_turns(minimum_twist(shapes), 1, 0.31)
    off = turns - begins
    assert np.abs(off - np.round(off)).max() < 1e-4
    assert (np.abs(minimum_twist(shapes)) <= 0.5).all()


def test_the_sum_of_squared_distances_is_least_there():
    first = ellipse(EVEN_256) + 0.3 * ellipse(3 * EVEN_256)
    second = ellipse(1.7 - EVEN_256[::-1]) @ np.array([[0.6, 0.8], [-0.8, 0.6]])
    step = minimum_twist(np.stack([first, second]))[0]
    costs = [((first - np.roll(second, -k, axis=0)) ** 2).sum() for k in range(256)]
    best = int(np.argmin(costs)) / 256
    off = step - best
    assert abs(off - np.round(off)) <= 0.5 / 256 + 1e-12


def test_one_curve_begins_where_it_is_told():
    assert len(minimum_twist(ellipse(EVEN_256)[None])) == 0
    assert begin_turns(np.zeros(0), 0, 0.25).tolist() == [0.25]


def test_peaks_are_found_between_samples_and_across_the_seam():
    peaks = np.array([0.3, 0.7012, 0.0, 0.9995])
    turns = np.arange(128) / 128
    values = np.cos(2 * np.pi * (turns - peaks[:, None]))
    off = circular_peak(values) - peaks
    assert np.abs(off - np.round(off)).max() < 1e-5


def test_a_peak_is_sought_at_the_sample_that_is_named():
    values = np.zeros((1, 16))
    values[0, [3, 9, 10]] = [5.0, 2.0, 1.0]
    assert circular_peak(values)[0] == 3 / 16
    assert 9 / 16 < circular_peak(values, np.array([9]))[0] < 10 / 16


def test_a_function_without_a_peak_gives_a_sample():
    assert circular_peak(np.ones((1, 8)))[0] == pytest.approx(0.0)


ANGLE = 2 * np.pi * np.arange(512) / 512
UNIT = np.column_stack([np.cos(ANGLE), np.sin(ANGLE)])


def test_points_are_as_far_as_from_the_true_circles_of_their_own_slices():
    rng = np.random.default_rng(0)
    radii, middles = np.array([1.0, 0.3, 2.0]), np.array([[0, 0], [40.0, 1], [-3, 9]])
    curves = radii[:, None, None] * UNIT + middles[:, None]
    points = rng.uniform(-3, 3, size=(2, 3, 50, 2)) + middles[:, None]
    wanted = np.abs(np.linalg.norm(points - middles[:, None], axis=-1) - radii[:, None])
    assert np.abs(slice_distance(curves, points) - wanted).max() < 2e-4


def test_distance_from_a_corner_is_that_of_the_corner():
    side = np.linspace(0, 1, 128, endpoint=False)
    one, nought = np.ones(128), np.zeros(128)
    square = np.column_stack(
        [
            np.concatenate([side, one, 1 - side, nought]),
            np.concatenate([nought, side, one, 1 - side]),
        ]
    )
    found = slice_distance(square[None], np.array([[[[2.0, 2.0], [0.5, 0.4]]]]))
    assert np.abs(found - [np.sqrt(2), 0.4]).max() < 0.01


def test_a_curve_in_one_place_is_a_point():
    found = slice_distance(np.zeros((1, 8, 2)), np.array([[[[3.0, 4.0]]]]))
    assert found.tolist() == [[[5.0]]]
