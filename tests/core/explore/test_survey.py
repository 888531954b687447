import itertools
import math
from dataclasses import replace

import numpy as np
import pytest

from palpate.core.explore.grasp.hand import search_places
from palpate.core.explore.planners.protocol import SliceOutcome
from palpate.core.explore.survey import (
    APPROACH,
    Survey,
    TracedContour,
    contour_axis,
    expected_approach,
    next_finished,
    observed_slices,
    widened,
)


def _survey(standing=False):
    return Survey(
        low=0.0,
        high=0.09,
        low_deviation=1e-3,
        high_deviation=1e-3,
        radius=0.03,
        pad_width=0.016,
        resolution=1e-5,
        standing=standing,
        reached=(0.01, 0.08),
    )


def test_what_was_touched_beyond_an_end_moves_it():
    survey = _survey().reaching(-0.002, 0.085).reaching(0.05, 0.093)
    assert (survey.low, survey.high) == (-0.002, 0.093)
    assert survey.reached == (-0.002, 0.093)


def test_an_object_that_stands_ends_where_it_stands():
    assert _survey(standing=True).reaching(-1e-4, 0.05).low == 0.0


@pytest.mark.parametrize(
    ("tip", "upper", "low", "high"),
    [
        (0.085, True, (0.0, 1e-3), (0.085, 0.0)),
        (0.07, True, (0.0, 1e-3), (0.08, 0.0)),
        (0.004, False, (0.004, 0.0), (0.09, 1e-3)),
        (0.03, False, (0.01, 0.0), (0.09, 1e-3)),
    ],
)
def test_a_touched_end_lies_where_it_was_touched_or_beyond(tip, upper, low, high):
    survey = _survey().ended(np.array([0.0, 0.0, tip]), upper=upper)
    assert (survey.high, survey.high_deviation) == high
    assert (survey.low, survey.low_deviation) == low


def test_each_end_has_one_tip_the_last_one():
    survey = _survey()
    for height in (0.085, 0.088, 0.002):
        survey = survey.ended(np.array([0.01, 0.0, height]), upper=height > 0.04)
    assert sorted(float(tip[2]) for tip in survey.tips) == [0.002, 0.088]
    assert (survey.low, survey.low_deviation) == (0.002, 0.0)


COUNT = 240
TURN = 2.0 * np.pi * np.arange(COUNT) / COUNT
OUT = np.column_stack([np.cos(TURN), np.sin(TURN)])


def cone(height, lean=None, **changes):
    """A slice of a cone of radius 30 - 0.2 z mm whose axis leans."""
    lean = np.zeros(2) if lean is None else lean
    radius = 0.03 - 0.2 * height
    # At constant azimuth: n . (r' e_r + lean + e_z) = 0.
    normals = np.column_stack([OUT, -(-0.2 + OUT @ lean)])
    fields = {
        "height": height,
        "status": "closed",
        "points": np.column_stack([height * lean + radius * OUT, np.full(COUNT, height)]),
        "normals": normals / np.linalg.norm(normals, axis=1, keepdims=True),
        "across": np.full(COUNT, 3.0),
        "contact_low": np.full(COUNT, height - 4e-3),
        "contact_high": np.full(COUNT, height + 3e-3),
        "missing": 0.0,
        "touches": 20,
        "seconds": 25.0,
    }
    return TracedContour(**(fields | changes))


@pytest.mark.parametrize("lean", [(0.0, 0.0), (0.2, -0.1)])
def test_radii_and_slopes_are_told_about_the_axis_even_if_it_leans(lean):
    traced = [cone(height, np.array(lean)) for height in (0.02, 0.05, 0.08)]
    slices = observed_slices(tuple(traced), (0.0, 1e-5, 0.0))
    for one, made in zip(slices, traced, strict=True):
        np.testing.assert_allclose(one.radii, 0.03 - 0.2 * made.height, rtol=1e-3)
        np.testing.assert_allclose(one.slopes, -0.2, atol=2e-3)
        np.testing.assert_allclose(one.curvatures, 3.0)
    assert [one.deviation for one in slices] == [0.0, 1e-5, 0.0]


def test_an_axis_that_leaves_a_contour_is_bent_from_middle_to_middle():
    away = [0.0, 0.05, 0.0]
    bent = []
    for height, x in zip((0.02, 0.05, 0.08), away, strict=True):
        one = cone(height)
        bent.append(replace(one, points=one.points + [x, 0.0, 0.0]))
    places, leans = contour_axis(bent)
    np.testing.assert_allclose(places[:, 0], away, atol=1e-6)
    np.testing.assert_allclose(leans[:, 0], np.gradient(away, [0.02, 0.05, 0.08]), atol=1e-4)


def test_a_band_reaches_half_a_feature_aside_and_no_farther():
    low = np.full(COUNT, 0.05)
    low[60] = 0.04  # measured deep on one azimuth alone
    one = cone(0.05, contact_low=low)
    step = 2.0 * math.pi * 0.02 / COUNT
    narrow, wide = widened(one, 0.9 * step), widened(one, 4.1 * step)
    assert np.flatnonzero(narrow.contact_low < 0.05).tolist() == [60]
    assert np.flatnonzero(wide.contact_low < 0.05).tolist() == [58, 59, 60, 61, 62]
    assert (wide.contact_high == one.contact_high).all()


@pytest.mark.parametrize(
    ("changes", "outcome"),
    [
        ({}, SliceOutcome.CLOSED),
        ({"status": "occluded", "missing": 0.01}, SliceOutcome.OCCLUDED),
        ({"status": "occluded", "missing": 0.06}, SliceOutcome.FAILED),
        ({"status": "stuck"}, SliceOutcome.FAILED),
        ({"status": "budget"}, SliceOutcome.CUT),
        ({"status": "pole"}, SliceOutcome.LOST),
        ({"status": "no_contact", "points": np.zeros((0, 3))}, SliceOutcome.LOST),
        ({"status": "occluded", "points": np.zeros((0, 3))}, SliceOutcome.FAILED),
        ({"dropped": True}, SliceOutcome.FAILED),
    ],
)
def test_what_came_of_a_slice_is_what_a_planner_is_told(changes, outcome):
    one = cone(0.05, **changes)
    assert one.outcome == outcome
    [told] = observed_slices((one,), (0.0,))
    assert told.usable == one.usable == (outcome in (SliceOutcome.CLOSED, SliceOutcome.OCCLUDED))
    assert (told.touches, told.seconds) == (20, 25.0)


def test_the_object_is_looked_for_at_the_origin_first_and_then_around_it():
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


def test_a_slice_is_approached_from_outside_all_contours_about_the_nearest():
    turn = 2 * np.pi * np.arange(60) / 60
    rim = np.column_stack([np.cos(turn), np.sin(turn), 0 * turn])
    low, high = 0.02 * rim, 0.03 * rim + [0.01, 0.0, 0.0]
    middle, distance = expected_approach(0.08, [0.02, 0.07], [low, high])
    assert middle == pytest.approx([0.01, 0.0], abs=1e-12)
    assert distance == pytest.approx(0.03 + APPROACH)


def test_a_slice_on_the_way_to_a_tip_aside_is_expected_on_that_way():
    turn = 2 * np.pi * np.arange(60) / 60
    rim = 0.02 * np.column_stack([np.cos(turn), np.sin(turn), 0 * turn])
    aside, over = np.array([0.05, 0.0, 0.1]), np.array([0.01, 0.0, 0.1])
    middle, distance = expected_approach(0.09, [0.05], [rim], [aside])
    assert middle == pytest.approx([0.04, 0.0], abs=1e-12)
    assert distance == pytest.approx(0.06 + APPROACH)
    for height, tip in ((0.09, over), (0.02, aside), (0.05, aside)):
        assert expected_approach(height, [0.05], [rim], [tip])[0] == pytest.approx(
            [0.0, 0.0], abs=1e-12
        )


def test_the_earliest_result_is_taken_up_when_nobody_can_be_earlier():
    assert next_finished({}, {1, 2}, {}) is None
    assert next_finished({1: 5.0}, {1}, {}) == 1
    assert next_finished({1: 5.0}, {1, 2}, {2: 4.0}) is None
    assert next_finished({1: 5.0}, {1, 2}, {2: 5.5}) == 1
    assert next_finished({1: 5.0, 2: 4.0}, {1, 2}, {}) == 2


def test_a_finger_whose_clock_is_not_known_is_waited_for():
    assert next_finished({2: 5.0}, {1, 2}, {}) is None


def test_of_two_at_one_time_the_lower_number_comes_first():
    assert next_finished({1: 5.0, 2: 5.0}, {1, 2}, {}) == 1
    # Finger 1 may still end at 5 s, and would then come first; finger 3 would not.
    assert next_finished({2: 5.0}, {1, 2}, {1: 5.0}) is None
    assert next_finished({2: 5.0}, {2, 3}, {3: 5.0}) == 2


def test_the_order_does_not_depend_on_who_was_received_first():
    ends = {1: 3.0, 2: 2.0, 3: 4.0}
    for received in itertools.permutations(ends):
        finished = {}
        busy, busy_heights = set(ends), []
        for finger in received:
            finished[finger] = ends[finger]
            while (found := next_finished(finished, busy, finished)) is not None:
                busy_heights.append(found)
                busy.discard(found)
                del finished[found]
        assert busy_heights == [2, 1, 3]
