import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from palpate.core.explore.planners.coverage import (
    Span,
    cut_further,
    even_heights,
    free_height,
    longest_first,
    parts_needed,
    untouched_spans,
    untraceable_height,
)
from palpate.core.explore.planners.protocol import Observation, ObservedSlice, SliceOutcome


def test_without_a_slice_the_whole_side_is_untouched(observation):
    (run,) = untouched_spans(observation())
    assert run == pytest.approx((0.03 * 0.09, 0.97 * 0.09))
    assert run.middle == pytest.approx(0.045)


def test_what_lies_between_the_touched_bands_is_untouched(slice_of, observation):
    slices = [slice_of(lambda z: 0.3, share) for share in (0.03, 0.5, 0.97)]
    runs = untouched_spans(observation(slices))
    np.testing.assert_allclose(runs, [(0.0097, 0.038), (0.052, 0.0803)], atol=2.5e-3 / 8)


def test_a_tenth_of_the_azimuths_may_stay_untouched_and_no_more(slice_of, observation):
    for open_azimuths, whole in ((1, True), (2, False)):
        low = np.full(16, 0.0)
        low[:open_azimuths] = 0.09
        one = slice_of(lambda z: 0.3, 0.5, contact_low=low, contact_high=np.full(16, 0.09))
        assert (untouched_spans(observation([one])) == []) == whole


def test_the_longest_run_comes_first_and_of_equal_ones_the_lowest():
    runs = [Span(0.0, 1.0), Span(2.0, 3.0 + 1e-9), Span(5.0, 7.0)]
    assert longest_first(runs, 1.0) == [runs[2], runs[0], runs[1]]


@settings(derandomize=True, deadline=None, max_examples=50)
@given(
    wanted=st.floats(0.01, 0.08),
    tried=st.lists(st.floats(0.0, 0.09), max_size=12),
    busy_heights=st.lists(st.floats(0.0, 0.09), max_size=2),
)
def test_a_free_height_keeps_its_distance_from_all_others(wanted, tried, busy_heights):
    none = np.zeros(0)
    slices = [
        ObservedSlice(
            height=height,
            outcome="failed",
            radii=none,
            slopes=none,
            curvatures=none,
            contact_low=none,
            contact_high=none,
        )
        for height in tried
    ]
    observation = Observation(
        low=0.0,
        high=0.09,
        tolerance=1e-4,
        resolution=1e-5,
        feature=2.5e-3,
        slices=tuple(slices),
        busy_heights=tuple(busy_heights),
        finger_spacing=0.01,
    )
    height = free_height(observation, wanted, Span(0.01, 0.08))
    if height is not None:
        assert 0.01 <= height <= 0.08
        assert all(abs(height - other) >= 2.4999e-3 for other in tried)
        assert all(abs(height - other) >= 0.01 for other in busy_heights)
        assert tried or busy_heights or height == wanted


def test_the_fewest_parts_are_planned_and_equal_intervals_get_equal_parts():
    assert parts_needed(np.array([1.0, 1.0]), 0.1, 3.0).tolist() == [3, 3]
    assert parts_needed(np.array([1e-4, 1e-4]), 0.1, 3.0).tolist() == [1, 1]
    parts = parts_needed(np.array([1.0, 1e-3, 0.1]), 0.05, 2.0)
    variances = np.array([1.0, 1e-3, 0.1])
    assert (variances * parts**-4.0).sum() <= 0.05**2
    assert parts[0] > parts[2] > parts[1]


def test_bands_that_are_touched_leave_less_of_a_cut_interval_than_its_parts():
    variances, touched = np.array([1.0, 1.0]), np.array([0.0, 0.3])
    cuts = list(cut_further(variances, 3.0, 1.0 - touched))
    assert cuts[0][1] == 2.0 and cuts[1][0].tolist() == [1, 2]
    assert cuts[1][1] == pytest.approx(1.0 + 2.0**-6 * (0.4 / 0.7) ** 4)
    whole = [left for _, left in cut_further(variances, 3.0)]
    assert all(left <= other for (_, left), other in zip(cuts, whole, strict=True))
    # What three bands cover is touched.
    covered = list(cut_further(variances[1:], 3.0, 1.0 - np.array([0.4])))
    assert covered[2][1] == 0.0


@pytest.mark.parametrize("order", [1.0, 3.0])
def test_no_cut_would_have_saved_more_elsewhere(order):
    for variances in 10.0 ** np.random.default_rng(0).uniform(-2.0, 0.0, (40, 3)):
        parts = parts_needed(variances, 0.1, order)
        last, now, more = (
            variances * np.maximum(parts + d, 1) ** (-2.0 * order) for d in (-1.0, 0.0, 1.0)
        )
        made = (last - now)[parts > 1].min()
        assert made >= (now - more).max() * (1.0 - 1e-5)
        assert now.sum() <= 0.1**2 < now.sum() + made


@pytest.mark.parametrize("lifted", [0.0, 0.4])
def test_the_places_in_a_run_do_not_depend_on_the_unit_of_length(lifted, slice_of, observation):
    def places(unit):
        moved = {"low": lifted * unit, "high": (lifted + 0.09) * unit}
        slices = [slice_of(lambda z: 0.5 - 0.3 * z * z, share, unit) for share in (0.03, 0.5, 0.97)]
        names = ("height", "contact_low", "contact_high")
        slices = [
            replace(one, **{name: getattr(one, name) + lifted * unit for name in names})
            for one in slices
        ]
        known = observation(slices, unit, all_taxels=True, **moved)
        return [
            np.array(even_heights(known, span)) / unit - lifted for span in untouched_spans(known)
        ]

    # The cone falls ever faster: pads touch less of its height above than below.
    wanted = [[0.0169009, 0.0310880], [0.0596338, 0.0737842]]
    for unit in (1.0, 1000.0):
        np.testing.assert_allclose(places(unit), wanted, atol=1e-7)


def test_as_few_slices_as_can_be_lie_evenly_in_a_run(slice_of, observation):
    ends = [slice_of(lambda z: 0.3, share) for share in (0.03, 0.97)]
    whole = observation(ends, all_taxels=True)
    [run] = untouched_spans(whole)
    places = even_heights(whole, run)
    # Bands of 14 mm, gaps of at most 2.5 mm, in 70.6 mm.
    assert len(places) == math.ceil((run.length - 2.5e-3) / 16.5e-3) == 5
    edges = [run.low, *places, run.high]
    gaps = np.diff(edges) - [7e-3, 14e-3, 14e-3, 14e-3, 14e-3, 7e-3]
    np.testing.assert_allclose(gaps, gaps[0], atol=1e-9)
    filled = observation([*ends, *(slice_of(lambda z: 0.3, place / 0.09) for place in places)])
    assert max(one.length for one in untouched_spans(filled)) <= 2.5e-3 + 0.4e-3  # to a row


def test_bands_are_lower_where_the_surface_leans(slice_of, observation):
    def ball(z):
        return math.sqrt(max(z * (1.0 - z), 1e-9))

    half = observation([slice_of(ball, share) for share in (0.03, 0.5)], all_taxels=True)
    run = max(untouched_spans(half), key=lambda one: one.length)
    places = even_heights(half, Span(run.low, 0.5 * 0.09 - 7e-3))
    steps = np.diff(places)
    assert (np.diff(steps) > 0.0).all()  # closer together towards the pole


def test_where_contours_alone_count_a_run_is_entered_in_its_middle(slice_of, observation):
    plain = observation([slice_of(lambda z: 0.3, share) for share in (0.03, 0.97)])
    [run] = untouched_spans(plain)
    assert even_heights(plain, run) == [run.middle]


def test_a_stretch_is_uncovered_only_where_a_slice_was_tried_in_vain(slice_of, observation, failed):
    ends = [slice_of(lambda z: 0.3, share) for share in (0.03, 0.97)]
    [run] = untouched_spans(observation(ends))
    assert untraceable_height(observation(ends)) == 0.0
    assert untraceable_height(observation([*ends, failed(0.045)])) == pytest.approx(run.length)
    assert untraceable_height(observation([*ends, failed(0.045, SliceOutcome.LOST)])) == 0.0
