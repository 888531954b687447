import math

import numpy as np
import pytest

from palpate.core.explore.planners.coverage import (
    DEVIATION,
    ENDS,
    FEW,
    LEFT,
    NOISE,
    error_indicators,
    estimate_error,
    hermite,
    predict_error,
    profile_of,
    untouched_spans,
)
from palpate.core.explore.planners.predicted import Predicted
from palpate.core.explore.planners.protocol import (
    ALL_REACHED,
    Budget,
    Height,
    SliceOutcome,
    Stop,
    Wait,
)

COVER = (0.5, 0.97, 0.03)


def rms_error(observation, side):
    """Of the side between the first slice and the last, over the height, along the radius."""
    shares = np.linspace(0.03, 0.97, 301)
    squares = hermite(profile_of(observation), shares)[:, 0]
    truth = np.array([side(share) for share in shares])
    return float(np.sqrt(np.mean((np.sqrt(np.maximum(squares, 0.0)) - truth) ** 2)))


def test_the_cover_comes_first_from_the_middle(sides, explored):
    heights, _ = explored(Predicted(), sides["bottle"])
    np.testing.assert_allclose(heights[:3], COVER)
    heights, _ = explored(Predicted(cover=5), sides["bottle"])
    np.testing.assert_allclose(heights[:5], [0.5, 0.735, 0.265, 0.97, 0.03])


def test_where_a_slice_could_not_be_traced_the_cover_returns_last(
    sides, slice_of, failed, observation
):
    slices = [slice_of(sides["cylinder"], 0.5), failed(0.97 * 0.09)]
    choice = Predicted().next(observation(slices))
    assert isinstance(choice, Height) and choice.height == pytest.approx(0.03 * 0.09)
    choice = Predicted().next(observation([*slices, slice_of(sides["cylinder"], 0.03)]))
    assert isinstance(choice, Height) and choice.height > 0.7 * 0.09


@pytest.mark.parametrize("name", ["vase", "bottle", "ball", "cylinder"])
def test_case_64_the_plan_in_millimetres_is_the_plan_in_metres(name, sides, explored):
    metres, stop = explored(Predicted(), sides[name])
    millimetres, other = explored(Predicted(), sides[name], 1000.0)
    np.testing.assert_allclose(millimetres, metres, rtol=1e-9)
    assert other.reason == stop.reason
    assert (other.rms_bound_95 or 0.0) == pytest.approx(1000.0 * (stop.rms_bound_95 or 0.0))


def test_case_66_a_bottles_neck_is_not_stepped_over(sides, explored, slice_of, observation):
    heights, stop = explored(Predicted(), sides["bottle"])
    found = observation([slice_of(sides["bottle"], share) for share in heights])
    assert stop.reached
    assert rms_error(found, sides["bottle"]) < 0.0025
    np.testing.assert_allclose([min(heights), max(heights)], [0.03, 0.97])
    assert sum(0.62 < height < 0.82 for height in heights) >= 3


@pytest.mark.parametrize("name", ["cylinder", "ball"])
def test_case_67_flat_tops_and_poles_end_the_plan(name, sides, explored):
    heights, stop = explored(Predicted(), sides[name])
    assert stop.reached
    assert len(heights) <= 11


def test_case_67_a_height_beyond_the_top_is_not_asked_for_again(sides, explored):
    heights, stop = explored(Predicted(), sides["cylinder"], top=0.93)
    assert stop is not None
    assert len(set(heights)) == len(heights)
    assert sum(height > 0.93 for height in heights) <= 3


def test_a_groove_between_two_pads_is_found_though_nothing_predicts_it(
    explored, slice_of, observation
):
    def grooved(z):
        return 0.3 - 0.03 * float(np.exp(-(((z - 0.26) / 0.035) ** 2)))

    cover = observation([slice_of(grooved, share) for share in COVER])
    assert predict_error(cover, profile_of(cover), untouched_spans(cover)).rms_bound_95 < 0.0025
    assert rms_error(cover, grooved) > 0.003
    heights, stop = explored(Predicted(), grooved)
    found = observation([slice_of(grooved, share) for share in heights])
    assert stop.reached
    assert rms_error(found, grooved) < 0.0025


def test_the_side_of_an_ellipsoid_is_exact_from_two_slices(sides, slice_of, observation):
    two = observation([slice_of(sides["ball"], share) for share in (0.03, 0.97)])
    assert rms_error(two, sides["ball"]) < 1e-5


def test_the_stop_says_what_is_untouched_and_how_far_to_trust_it(sides, explored):
    _, stop = explored(Predicted(), sides["vase"])
    assert stop.reason == ALL_REACHED
    assert stop.rms_bound_95 is not None
    assert stop.largest_untouched is not None
    assert 1e-5 <= stop.rms_bound_95 <= 0.0025 * 0.09
    assert stop.largest_untouched <= 2.5e-3


@pytest.mark.parametrize(
    ("budget", "words"),
    [
        (Budget(most_touches=60, touches=60), "60 of 60 touches"),
        (Budget(most_seconds=100.0, seconds=90.0, cut=True), "90 of 100 s of robot time"),
    ],
)
def test_nothing_is_begun_once_the_budget_is_spent(budget, words, sides, slice_of, observation):
    cover = [slice_of(sides["bottle"], share, touches=25, seconds=30.0) for share in COVER[:2]]
    stop = Predicted().next(observation(cover, budget=budget))
    assert isinstance(stop, Stop)
    assert words in stop.reason
    known = estimate_error(observation(cover, budget=budget))
    assert known.reached is False
    assert known.rms_bound_95 is not None
    assert known.largest_untouched > 0.02


def test_noise_beyond_the_tolerance_is_stated_and_not_cut_at_for_ever(sides, slice_of, observation):
    slices = []
    while isinstance(choice := Predicted().next(observation(slices)), Height):
        slices.append(slice_of(sides["vase"], choice.height / 0.09, deviation=1e-3))
    assert isinstance(choice, Stop)
    assert choice.reason.startswith("the noise of the slices is beyond the tolerance")
    assert estimate_error(observation(slices)).reached is False
    assert len(slices) <= 11


def test_a_tolerance_out_of_reach_ends_when_slices_lie_as_close_as_they_may(explored):
    def zigzag(z):
        return 0.3 + 0.02 * math.asin(math.sin(60.0 * z))

    heights, stop = explored(Predicted(), zigzag, tolerance=1e-5)
    assert stop.reason.startswith("the slices lie as close as they may")
    assert min(np.diff(sorted(heights))) >= 2.5e-3 / 0.09 * (1.0 - 1e-6)


def test_what_the_pad_cannot_reach_is_left_and_stated(sides, slice_of, failed, observation):
    slices = []
    while isinstance(choice := Predicted().next(observation(slices)), Height):
        share = choice.height / 0.09
        hidden = 0.6 < share < 0.9
        slices.append(failed(choice.height) if hidden else slice_of(sides["cylinder"], share))
        assert len(slices) < 60
    assert isinstance(choice, Stop)
    assert choice.reason == "what is left untouched cannot be reached"
    assert estimate_error(observation(slices)).largest_untouched > 2.5e-3


def test_an_object_that_nothing_can_be_traced_on_ends_the_plan(failed, observation):
    slices = []
    while isinstance(choice := Predicted().next(observation(slices)), Height):
        slices.append(failed(choice.height))
        assert len(slices) < 60
    assert isinstance(choice, Stop)
    assert choice.reason == "fewer than two slices could be traced"
    known = estimate_error(observation(slices))
    nothing = known.rms_bound_95, known.halving, known.prediction, known.open_area
    assert nothing == (None, None, None, None) and not known.reached
    assert known.largest_untouched == pytest.approx(0.94 * 0.09)


def test_occluded_slices_count_as_far_as_they_were_touched(sides, slice_of, observation):
    shares = np.linspace(0.03, 0.97, 8)
    whole = [slice_of(sides["cylinder"], share) for share in shares]
    assert isinstance(Predicted().next(observation(whole)), Stop)
    gap = whole[4]
    low = gap.contact_low.copy()
    low[:6] = gap.contact_high[:6] + 1.0  # nothing measured on six of sixteen azimuths
    whole[4] = slice_of(
        sides["cylinder"], shares[4], outcome=SliceOutcome.OCCLUDED, contact_low=low
    )
    choice = Predicted().next(observation(whole))
    assert isinstance(choice, Height)
    assert choice.reason == "nothing has touched what lies there"
    assert abs(choice.height / 0.09 - shares[4]) < 0.09


def test_fingers_get_heights_of_their_own_and_wait_when_there_is_none(sides, slice_of, observation):
    busy_heights = []
    while isinstance(
        choice := Predicted().next(
            observation(busy_heights=tuple(busy_heights), finger_spacing=0.02)
        ),
        Height,
    ):
        busy_heights.append(choice.height)
    np.testing.assert_allclose(np.array(busy_heights) / 0.09, COVER)
    assert isinstance(choice, Wait)
    cover = [slice_of(sides["bottle"], share) for share in COVER]
    first = Predicted().next(observation(cover))
    assert isinstance(first, Height)
    other = Predicted().next(observation(cover, busy_heights=(first.height,), finger_spacing=0.02))
    assert isinstance(other, Height)
    assert abs(other.height - first.height) >= 0.02
    both = observation(cover, busy_heights=(first.height, other.height), finger_spacing=0.04)
    assert isinstance(Predicted().next(both), Wait)


def test_of_two_heights_worth_the_same_the_nearer_is_taken(slice_of, observation):
    def wavy(z):
        return 0.3 + 0.05 * math.cos(4.0 * math.pi * (z - 0.5))

    for last, first in ((0.97, 0.5), (0.03, 0.5)):
        order = [slice_of(wavy, share) for share in (1.0 - last, first, last)]
        choice = Predicted().next(observation(order))
        assert isinstance(choice, Height)
        assert (choice.height / 0.09 > 0.5) == (last > 0.5)


def test_uncertain_ends_are_kept_away_from(observation, slice_of):
    middle = [slice_of(lambda z: 0.3, 0.5)]
    choice = Predicted().next(observation(middle, high_deviation=5e-3))
    assert isinstance(choice, Height)
    assert choice.height == pytest.approx(0.09 - 0.01)


def test_an_even_cover_is_refused():
    with pytest.raises(ValueError, match="cover must be odd, so that the middle is in it, got 4"):
        Predicted(cover=4)
    with pytest.raises(ValueError, match="hidden_error is 2"):
        Predicted(hidden_error=2.0)


def wavy(z):
    return 0.3 + 0.05 * math.sin(7.0 * z)


def prediction(side, shares, make, observation):
    all_known = observation([make(side, share) for share in shares])
    return predict_error(all_known, profile_of(all_known), untouched_spans(all_known))


def test_positions_and_slopes_are_kept_and_cubic_in_square_is_exact(slice_of, observation):
    def cubic(z):
        return math.sqrt(0.1 + 0.2 * z - 0.3 * z**2 + 0.25 * z**3)

    profile = profile_of(observation([slice_of(cubic, share) for share in (0.1, 0.4, 0.9)]))
    heights = np.linspace(0.1, 0.9, 33)
    exact = np.array([cubic(height) ** 2 for height in heights])
    np.testing.assert_allclose(hermite(profile, heights)[:, 0], exact, atol=1e-8)
    signs = error_indicators(profile)
    assert signs.rise_mismatch.max() < 1e-6
    assert signs.quintic_gap.max() < 1e-6


def test_the_predicted_error_falls_like_the_true_one(slice_of, observation):
    coarse, fine = (
        prediction(wavy, np.linspace(0.03, 0.97, n).tolist(), slice_of, observation)
        for n in (9, 17)
    )
    assert math.log2(coarse.curve / fine.curve) == pytest.approx(4.0, abs=0.3)


@pytest.mark.parametrize("count", [4, 5, 7, 9])
def test_each_interval_errs_about_as_predicted(count, slice_of, observation):
    shares = np.linspace(0.03, 0.97, count)
    told = prediction(wavy, shares.tolist(), slice_of, observation)
    profile = profile_of(observation([slice_of(wavy, share) for share in shares]))
    heights = np.linspace(0.03, 0.97, 801)
    slopes = 0.35 * np.cos(7.0 * heights)
    off = np.sqrt(hermite(profile, heights)[:, 0]) - [wavy(height) for height in heights]
    off /= np.sqrt(1.0 + slopes**2)
    pieces = np.array_split(off, count - 1)
    true = np.array([math.sqrt(float(np.mean(piece**2))) for piece in pieces])
    assert (true < 3.0 * told.errors).all()
    assert (true > told.errors / 5.0).all()


def test_cuts_are_drawn_to_the_end_that_bends_more(slice_of, observation):
    def knee(z):
        return 0.4 - 0.1 * math.exp(10.0 * (z - 0.97))

    profile = profile_of(observation([slice_of(knee, share) for share in (0.03, 0.97)]))
    assert error_indicators(profile).bend_side[0] > 0.8


def test_noise_is_counted_once_and_cutting_ends_where_only_noise_is_left(slice_of, observation):
    noisy = observation(
        [slice_of(wavy, share, deviation=9e-5) for share in np.linspace(0.03, 0.97, 12)]
    )
    told = predict_error(noisy, profile_of(noisy), untouched_spans(noisy))
    noise = told.noise.all
    assert noise == pytest.approx(math.hypot(NOISE * 1e-3, 1e-5 / 0.09), rel=1e-6)
    assert told.rms_bound_95 == math.hypot(noise, told.curve)
    assert told.wants_refinement(told.rms_bound_95 * 0.99) == (noise < told.rms_bound_95 * 0.99)
    assert not told.wants_refinement(told.rms_bound_95 * 1.01)
    assert not told.wants_refinement(noise * 0.5)
    assert told._replace(curve=noise).wants_refinement(noise * 0.5)


def test_of_what_was_touched_only_the_untouched_share_of_an_interval_errs(slice_of, observation):
    slices = [slice_of(wavy, share) for share in np.linspace(0.03, 0.97, 5)]
    plain, whole = observation(slices), observation(slices, all_taxels=True)
    one = predict_error(plain, profile_of(plain), untouched_spans(plain))
    all_measured = predict_error(whole, profile_of(whole), untouched_spans(whole))
    shares = [run.length for run in untouched_spans(whole)] / (0.09 * one.indicators.width)
    np.testing.assert_allclose(all_measured.errors, one.errors * shares**2, rtol=1e-9)


def test_a_solid_of_all_that_was_touched_states_its_own_deviation(slice_of, observation):
    slices = [slice_of(wavy, share, deviation=9e-5) for share in np.linspace(0.03, 0.97, 12)]
    stated = observation(slices, all_taxels=True, deviation=5e-5)
    told = predict_error(stated, profile_of(stated), untouched_spans(stated))
    margin = DEVIATION * (1.0 + FEW / 11**3)
    expected = math.hypot(margin * 5e-5 / 0.09, 1e-5 / 0.09, LEFT)
    assert told.noise.all == pytest.approx(expected, rel=1e-9)


def test_noise_is_that_of_touched_bands_of_what_lies_between_and_of_the_ends(slice_of, observation):
    slices = [slice_of(wavy, share, deviation=3e-5) for share in np.linspace(0.03, 0.97, 4)]
    stated = observation(
        slices, all_taxels=True, deviation=9e-5, ends_deviation=2e-5, pose_deviation=1e-4
    )
    told = predict_error(stated, profile_of(stated), untouched_spans(stated)).noise
    margin = DEVIATION * (1.0 + FEW / 3**3)
    lasting = math.hypot(margin * ENDS * 2e-5 / 0.09, 1e-5 / 0.09, LEFT)
    assert told.lasting == pytest.approx(lasting, rel=1e-9)
    assert told.touched == pytest.approx(math.hypot(margin * 3e-5 / 0.09, lasting), rel=1e-9)
    assert told.between == pytest.approx(math.sqrt(told.all**2 - told.touched**2), rel=1e-9)


def test_ends_that_are_uncertain_do_not_end_the_refinement_of_the_side(slice_of, observation):
    slices = [slice_of(wavy, share, deviation=2e-6) for share in np.linspace(0.03, 0.97, 4)]
    stated = observation(slices, all_taxels=True, deviation=2e-3, ends_deviation=2e-3)
    told = predict_error(stated, profile_of(stated), untouched_spans(stated))
    assert told.curve < 0.5 * told.noise.touched
    assert told.wants_refinement(told.curve)
    assert not told.wants_refinement(6.0 * told.curve)


def test_what_a_surface_misses_by_more_than_poses_err_is_refined_and_not_noise(
    slice_of, observation
):
    given = {"all_taxels": True, "deviation": 1e-3, "tolerance": 5e-4}

    def seen(count, pose):
        shares = np.linspace(0.03, 0.97, count)
        slices = [slice_of(wavy, share, deviation=1e-3) for share in shares]
        return observation(slices, pose_deviation=pose, **given)

    def told(count, pose):
        one = seen(count, pose)
        return predict_error(one, profile_of(one), untouched_spans(one))

    missed, noisy = told(5, 1e-5), told(5, 1e-3)
    assert missed.rms_bound_95 == pytest.approx(noisy.rms_bound_95, rel=1e-9)
    assert missed.noise.touched < 5e-4 / 0.09 < missed.rms_bound_95
    assert missed.wants_refinement(5e-4 / 0.09) and not noisy.wants_refinement(5e-4 / 0.09)
    # Where all was touched, no further slice tells more.
    assert not told(9, 1e-5).untouched.any() and not told(9, 1e-5).wants_refinement(5e-4 / 0.09)
    end = Predicted().next(seen(9, 1e-5))
    assert isinstance(end, Stop) and "does not follow what was touched" in end.reason


def test_what_lies_between_touched_bands_is_refined_though_it_counts_as_noise(
    slice_of, observation
):
    slices = [slice_of(wavy, share, deviation=2e-5) for share in np.linspace(0.03, 0.97, 4)]
    stated = observation(slices, all_taxels=True, deviation=9e-4, tolerance=2e-4)
    assert isinstance(Predicted().next(stated), Height)


def test_one_slice_states_no_bound_of_the_whole(slice_of, observation):
    one = estimate_error(observation([slice_of(wavy, 0.5)], all_taxels=True, deviation=2e-5))
    assert one.rms_bound_95 is None and not one.reached


def test_halving_takes_the_slices_that_are_predicted_to(slice_of, observation):
    shares = np.linspace(0.03, 0.97, 5)
    slices = [slice_of(wavy, share, touches=20, seconds=30.0) for share in shares]
    told = estimate_error(observation(slices))
    assert told.prediction is not None and told.halving is not None
    count = told.prediction.slices_to(0.5 * told.prediction.rms_bound_95, 5)
    assert count is not None and 1 <= count <= 6
    assert told.halving == (20.0 * count, 30.0 * count)
    noisy = [slice_of(wavy, share, deviation=1e-3, touches=20) for share in shares]
    assert estimate_error(observation(noisy)).halving is None


def test_noise_is_averaged_only_where_there_is_room_for_enough_slices(slice_of, observation):
    slices = [slice_of(wavy, share, deviation=4e-4) for share in np.linspace(0.03, 0.97, 6)]
    noisy = observation(slices, all_taxels=True, deviation=4e-4, pose_deviation=4e-4)
    told = predict_error(noisy, profile_of(noisy), untouched_spans(noisy))
    noise = told.noise
    left = math.hypot(0.5 * noise.slices / DEVIATION, noise.lasting)
    assert not told.wants_averaging(0.99 * left, 6, 24)
    assert told.wants_averaging(1.01 * left, 6, 24)
    assert not told.wants_averaging(1.01 * noise.touched, 6, 24)
    lasting = told._replace(noise=noise._replace(touched=1.2 * left, lasting=1.1 * left))
    assert not lasting.wants_averaging(1.01 * left, 6, 10**6)
