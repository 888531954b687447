"""What an exploration has found: ends, contours as planners see them, fingers, swept space."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from palpate.core import explore
from palpate.core.explore.grasp import ObjectFrame
from palpate.core.explore.planners import Limits, SliceOutcome
from palpate.core.poses import FACING_DOWN, Pose
from palpate.core.touch import Pad

ENDS = {"low": 0.0, "high": 0.09, "low_deviation": 1e-3, "high_deviation": 1e-3}
FRAME = ObjectFrame(Pose(np.zeros(3), np.eye(3)), 0.0, 0.09, 0.03, "given", 0.0, 0.0, 1e-3)
SETUP = explore.Setup(0.0, 0.15, None, pad_width=0.016, resolution=1e-5, contact_error=1e-4)
SURVEY = explore.Survey(frame=FRAME, **ENDS, standing=False, reached=(0.01, 0.08))
DEMAND = explore.Demand(tolerance=2e-4, feature=2.5e-3, most_touches=100.0, most_seconds=60.0)
COUNT = 240
TURN = 2.0 * math.pi * np.arange(COUNT) / COUNT
OUT = np.column_stack([np.cos(TURN), np.sin(TURN)])


def cone(height: float, lean: Any = (0.0, 0.0), **changes: Any) -> explore.TracedContour:
    """A slice of a cone of radius 30 - 0.2 z mm whose axis leans."""
    radius, lean = 0.03 - 0.2 * height, np.array(lean)
    # At constant azimuth: n . (r' e_r + lean + e_z) = 0.
    normals = np.column_stack([OUT, 0.2 - OUT @ lean])
    fields = {
        "points": np.column_stack([height * lean + radius * OUT, np.full(COUNT, height)]),
        "normals": normals / np.linalg.norm(normals, axis=1, keepdims=True),
        "across": np.full(COUNT, 3.0),
        "contact_low": np.full(COUNT, height - 4e-3),
        "contact_high": np.full(COUNT, height + 3e-3),
    }
    given = {"status": "closed", "missing": 0.0, "touches": 20, "seconds": 25.0}
    return explore.TracedContour(height=height, **(given | fields | changes))


def observed(survey: explore.Survey, demand: explore.Demand = DEMAND):
    idle = {1: explore.Finger()}
    known = explore.Exploration(setup=SETUP, fingers=idle, survey=survey, touches=7, seconds=3.0)
    return known.observation(demand)


def surveyed(*contours: explore.TracedContour, **changes: Any) -> explore.Survey:
    survey = replace(SURVEY, **changes)
    for one in contours:
        survey = survey.with_slice(one)
    return survey


def test_touch_beyond_end_moves_it_unless_object_stands_there():
    survey = SURVEY.reaching(-0.002, 0.085).reaching(0.05, 0.093)
    assert (survey.low, survey.high) == survey.reached == (-0.002, 0.093)
    assert replace(SURVEY, standing=True).reaching(-1e-4, 0.05).low == 0.0
    traced = surveyed(cone(0.088))  # its band reaches 91 mm
    assert (traced.high, traced.reached) == (pytest.approx(0.091), (0.01, pytest.approx(0.091)))
    assert surveyed(cone(0.088, status="pole")).high == 0.09


@pytest.mark.parametrize(
    ("tip", "upper", "low", "high"),
    [
        (0.085, True, (0.0, 1e-3), (0.085, 0.0)),
        (0.07, True, (0.0, 1e-3), (0.08, 0.0)),
        (0.004, False, (0.004, 0.0), (0.09, 1e-3)),
        (0.03, False, (0.01, 0.0), (0.09, 1e-3)),
    ],
)
def test_touched_end_lies_at_touch_or_beyond(tip, upper, low, high):
    survey = SURVEY.ended(np.array([0.0, 0.0, tip]), upper=upper)
    assert (survey.high, survey.high_deviation) == high
    assert (survey.low, survey.low_deviation) == low
    again = survey.ended(np.array([0.01, 0.0, 0.088 if upper else 0.002]), upper=upper)
    other = again.ended(np.zeros(3) + (0.0 if upper else 0.09), upper=not upper)
    assert [len(one.tips) for one in (survey, again, other)] == [1, 1, 2]  # one an end, the last
    assert again.tips[0][0] == 0.01


@pytest.mark.parametrize("lean", [(0.0, 0.0), (0.2, -0.1)])
def test_planner_sees_radii_and_slopes_about_leaning_axis(lean):
    traced = [cone(height, lean) for height in (0.05, 0.02, 0.08)]
    uncertain = explore.ModelUncertainty(
        np.array([0.02, 0.08]), np.array([1e-5, 4e-5]), 6e-5, 2e-5, 3e-5
    )
    observation = observed(surveyed(*traced, uncertainty=uncertain))
    for one, made in zip(observation.slices, traced, strict=True):
        np.testing.assert_allclose(one.radii, 0.03 - 0.2 * made.height, rtol=1e-3)
        np.testing.assert_allclose(one.slopes, -0.2, atol=2e-3)
        np.testing.assert_allclose(one.curvatures, 3.0)
        np.testing.assert_allclose(one.contact_low, made.height - 4e-3)
        np.testing.assert_allclose(one.contact_high, made.height + 3e-3)
    assert [one.deviation for one in observation.slices] == pytest.approx([2.5e-5, 1e-5, 4e-5])
    assert (observation.deviation, observation.ends_deviation) == (6e-5, 2e-5)
    assert (observation.pose_deviation, observation.all_taxels) == (3e-5, True)
    assert observation.finger_spacing == pytest.approx(1.5 * 0.016)
    budget = observation.budget
    assert (budget.touches, budget.seconds, budget.most_touches) == (7, 3.0, 100.0)
    assert observation.limits == DEMAND.limits == Limits(tolerance=2e-4, feature=2.5e-3)
    assert observed(SURVEY).deviation is None
    fine, lifted = DEMAND._replace(feature=1e-9), replace(SURVEY, low=0.05)
    least = observed(lifted, fine).feature  # of the height
    assert least == pytest.approx(1e-4 * (0.09 - 0.05))


def test_contour_off_axis_is_seen_from_its_own_middle():
    away = np.array([0.0, 0.05, 0.0])
    traced = [cone(height) for height in (0.02, 0.05, 0.08)]
    bent = [
        replace(one, points=one.points + [x, 0.0, 0.0]) for one, x in zip(traced, away, strict=True)
    ]
    slices = observed(surveyed(*bent)).slices
    for one, made in zip(slices, traced, strict=True):
        np.testing.assert_allclose(one.radii, 0.03 - 0.2 * made.height, rtol=1e-3)
    # The axis moves by 50 mm in 30 mm, upwards and then back: the walls lean towards it.
    lean = np.gradient(away, [0.02, 0.05, 0.08])
    at = 2.0 * math.pi * np.arange(len(slices[0].slopes)) / len(slices[0].slopes)
    for one, slope in zip(slices, lean, strict=True):
        np.testing.assert_allclose(one.slopes, -0.2 - slope * np.cos(at), atol=5e-3)


def test_band_reaches_half_feature_aside_and_no_farther():
    low = np.full(COUNT, 0.05)
    low[60] = 0.04  # measured deep on one azimuth alone
    one = cone(0.05, contact_low=low)
    step = 2.0 * math.pi * 0.02 / COUNT
    for feature, reached in ((0.9, [60]), (4.1, [58, 59, 60, 61, 62])):
        wide = explore.widened(one, feature * step)
        assert np.flatnonzero(wide.contact_low < 0.05).tolist() == reached
        assert (wide.contact_high == one.contact_high).all()


NO_POINTS = {"points": np.zeros((0, 3))}


@pytest.mark.parametrize(
    ("changes", "outcome"),
    [
        ({}, SliceOutcome.CLOSED),
        ({"status": "occluded", "missing": 0.01}, SliceOutcome.OCCLUDED),
        ({"status": "occluded", "missing": 0.06}, SliceOutcome.FAILED),
        ({"status": "stuck"}, SliceOutcome.FAILED),
        ({"status": "budget"}, SliceOutcome.CUT),
        ({"status": "pole"}, SliceOutcome.LOST),
        ({"status": "no_contact", **NO_POINTS}, SliceOutcome.LOST),
        ({"status": "occluded", **NO_POINTS}, SliceOutcome.FAILED),
        ({"dropped": True}, SliceOutcome.FAILED),
    ],
)
def test_outcome_of_contour_is_that_of_slice(changes, outcome):
    one = cone(0.05, **changes)
    [seen] = observed(replace(SURVEY, traced=(one,))).slices
    assert one.outcome == seen.outcome == outcome
    assert seen.usable == one.usable == (outcome in (SliceOutcome.CLOSED, SliceOutcome.OCCLUDED))
    assert (seen.touches, seen.seconds, seen.height) == (20, 25.0, 0.05)


def test_slice_is_approached_about_nearest_contour_from_outside_all():
    assert SURVEY.approach(0.05)[1] - 0.03 == pytest.approx(margin := 0.03)
    aside = cone(0.07)
    aside = replace(aside, points=aside.points + [0.01, 0.0, 0.0])
    survey = surveyed(cone(0.02), aside)
    middle, distance = survey.approach(0.08)
    assert middle == pytest.approx([0.01, 0.0], abs=1e-12)
    assert distance == pytest.approx(0.026 + 0.01 + margin)
    assert survey.approach(0.03)[0] == pytest.approx([0.0, 0.0], abs=1e-12)
    assert survey.outermost(upper=True).height == 0.07 > survey.outermost(upper=False).height
    assert SURVEY.outermost(upper=True) is None
    tip = np.array([0.05, 0.0, 0.12])  # a slice on the way to a tip aside is expected there
    for height, tips, x in ((0.1, (tip,), 0.034), (0.1, (0.2 * tip + [0, 0, 0.096],), 0.01)):
        assert replace(survey, tips=tips).approach(height)[0] == pytest.approx([x, 0.0])
    assert replace(survey, tips=(tip,)).approach(0.015)[0] == pytest.approx(0.0, abs=1e-12)


# Swept space

PAD = Pad(rows=16, cols=16, pitch=1e-3, thickness=6e-3, dome=0.0, saturation=0.5)
START, END = (Pose(np.array([0.0, 0.0, z]), FACING_DOWN) for z in (0.06, 0.04))


@pytest.mark.parametrize(("reach", "platform"), [(0.05, 0.01), (1.0, 0.0)])
def test_map_covers_reach_of_finger_in_bounded_memory(reach, platform):
    space = explore.empty_map(reach, platform, (0.01, 0.0))
    assert space.low == pytest.approx([0.01 - reach, -reach, platform])
    high = space.low + space.step * (np.array(space.states.shape) - 1)
    assert (high >= np.array([0.01 + reach, reach, platform + reach]) - 1e-12).all()
    assert (high < np.array([0.01 + reach, reach, platform + reach]) + space.step).all()
    assert not space.states.any() and space.states.size < 1.05 * 2**23
    assert (space.step == explore.SweepSettings().voxel) == (reach < 0.2)


def test_touched_voxel_is_never_freed_and_places_beyond_have_none():
    space = explore.empty_map(0.05, 0.0)
    first, second = space.numbers(np.array([[0, 0, 0.02]])), space.numbers(np.array([[0, 0, 0.03]]))
    marked = space.marked(np.concatenate([first, second]), first)
    assert marked.free_places() == pytest.approx(np.array([[0.0, 0.0, 0.03]]))
    again = marked.marked(first, np.zeros(0, np.int64))
    assert again.states.flat[first] == explore.TOUCHED == marked.states.max()
    assert not space.states.any()  # a map is a value
    beyond = np.array([[0.0, 0.0, -0.01], [0.06, 0.0, 0.02]])
    assert not len(space.numbers(beyond))


@pytest.mark.parametrize("touched", [False, True])
def test_move_frees_volume_swept_by_face_but_not_what_it_met(touched):
    step = explore.SweepSettings().voxel
    places = explore.swept_places(PAD, START, END, step, touched=touched)
    low, high = places.min(axis=0), places.max(axis=0)
    assert low[:2] == pytest.approx(-7.5e-3, abs=1.1e-3)
    assert high[:2] == pytest.approx(7.5e-3, abs=1.1e-3)
    assert high[2] == pytest.approx(0.06)
    margin = 1.5e-3 + 1.5 * step if touched else 0.0  # pressed, and what poses err by
    assert 0.0 <= low[2] - 0.04 - margin <= 0.5 * step
    assert explore.swept_places(PAD, END, END, step, touched=touched).shape == (0, 3)


def test_untouched_taxels_between_touched_ones_are_spanned():
    (x, y), touched = PAD.grid(), np.ones((16, 16), np.bool_)
    touched[5:9, 6:12] = False
    places = explore.spanned_places(PAD, END, touched)
    wanted = np.column_stack([x[~touched], -y[~touched], np.full(24, 0.04)])
    assert np.sort(places, axis=0) == pytest.approx(np.sort(wanted, axis=0))
    assert not len(explore.spanned_places(PAD, END, np.hypot(x, y) < 4e-3))


@pytest.mark.parametrize(("lean", "opens"), [(0.0, True), (0.3, True), (-0.1, True), (-0.3, False)])
def test_strip_between_sides_that_lean_together_is_no_opening(lean, opens):
    (x, y), touched = PAD.grid(), np.ones((16, 16), np.bool_)
    touched[:, 6:10] = False
    points = END.to_outer(np.column_stack([x[touched], y[touched], np.zeros(touched.sum())]))
    aside = np.sin(lean) * np.sign(points[:, 0])
    normals = np.column_stack([aside, 0.0 * aside, np.sqrt(1.0 - aside**2)])
    spans = explore.untouched_places(PAD, END, touched, points, normals)
    assert [len(one) for one in spans] == ([64, 0, 0, 0] if opens else [0, 64, 64, 0])
    assert spans.slopes == pytest.approx(np.tan(0.3))
    touched[:, 10:] = False  # on one side alone: every second taxel, along rows and columns
    spans = explore.untouched_places(PAD, END, touched, points, normals)
    assert [len(one) for one in spans] == [0, 0, 0, 40]
    touched[:, 10:] = True
    touched[[0, -1]] = True  # all around: whatever the sides, it may be deep
    spans = explore.untouched_places(PAD, END, touched, points, normals)
    assert [len(one) for one in spans] == [56, 0, 0, 0]
