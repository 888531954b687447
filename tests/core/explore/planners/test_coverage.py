"""What no pad has touched, and how large the error is between slices."""

import math

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from palpate.core.explore import planners
from palpate.core.explore.planners import PlannerTrial, Predicted, estimate_error, untouched_spans
from tests.core.explore.planners import sides
from tests.core.explore.planners.sides import CYLINDER, HEIGHT, explore, failed, known, slices_of

ROW = 2.5e-3 / 8  # Heights at which it is asked whether anything was touched [m]
ENDS = (0.03, 0.97)


def wavy(z: float) -> float:
    return 0.3 + 0.05 * math.sin(7.0 * z)


def predicted(observation: planners.Observation):
    return estimate_error(observation).prediction


def test_untouched_spans_lie_between_touched_bands():
    (whole,) = untouched_spans(known())
    assert whole == pytest.approx((0.03 * HEIGHT, 0.97 * HEIGHT))
    assert (whole.middle, whole.length) == pytest.approx((0.045, 0.94 * HEIGHT))
    spans = untouched_spans(known(slices_of(CYLINDER, (0.03, 0.5, 0.97))))
    np.testing.assert_allclose(spans, [(0.0097, 0.038), (0.052, 0.0803)], atol=ROW)
    estimate = estimate_error(known(slices_of(CYLINDER, (0.03, 0.5, 0.97))))
    assert estimate.largest_untouched == pytest.approx(max(one.length for one in spans))
    loose = estimate_error(known(slices_of(CYLINDER, (0.03, 0.5, 0.97)), high_deviation=0.02))
    assert loose.largest_untouched == pytest.approx(0.04)
    for open_azimuths in (1, 2):  # a tenth of sixteen may stay untouched
        low = np.where(np.arange(16) < open_azimuths, HEIGHT, 0.0)
        one = sides.slice_of(CYLINDER, 0.5, contact_low=low, contact_high=np.full(16, HEIGHT))
        assert (untouched_spans(known([one])) == []) == (open_azimuths == 1)
    ends = sides.slices_of(CYLINDER, ENDS)
    for height, outcome in ((0.045, "failed"), (0.045, "lost"), (0.005, "failed")):
        tried = known([*ends, sides.failed(height, planners.SliceOutcome(outcome))])
        in_vain = (height, outcome) == (0.045, "failed")
        length = untouched_spans(tried)[0].length if in_vain else 0.0
        assert planners.untraceable_height(tried) == pytest.approx(length)
    spans = [planners.Span(0.0, 1.0), planners.Span(2.0, 3.0 + 1e-9), planners.Span(5.0, 7.0)]
    assert planners.longest_first(spans, 1.0) == [spans[2], spans[0], spans[1]]


@settings(derandomize=True, deadline=None, max_examples=20)
@given(
    wanted=st.floats(0.01, 0.08),
    tried=st.lists(st.floats(0.0, HEIGHT), max_size=12),
    busy=st.lists(st.floats(0.0, HEIGHT), max_size=2),
)
def test_free_height_is_nearest_that_keeps_its_distance(wanted, tried, busy):
    others = np.array([*tried, *busy])
    room = np.array([2.5e-3] * len(tried) + [0.01] * len(busy))
    observation = known([failed(one) for one in tried], busy_heights=busy, finger_spacing=0.01)
    height = planners.free_height(observation, wanted, planners.Span(0.01, 0.08))
    grid = np.linspace(0.01, 0.08, 1401)
    free = grid[(np.abs(grid[:, None] - others) >= room).all(axis=1)]
    if height is not None:
        assert 0.01 <= height <= 0.08 and (np.abs(height - others) >= 0.9999 * room).all()
        assert abs(height - wanted) <= np.abs(free - wanted).min(initial=1.0) + 1e-9


def test_slices_are_closer_where_surface_leans_and_enter_middle_without_bands():
    for side in ("ball", "cylinder"):
        shares, _, estimate = explore(Predicted(), sides.SIDES[side], all_taxels=True)
        assert estimate.largest_untouched <= 2.5e-3 + ROW
        upper = np.diff(sorted(share for share in shares if share > 0.49))
        assert (upper[-1] < 0.9 * upper[0]) == (side == "ball")
    # Bands of 14 mm with gaps of at most a feature of 2.5 mm, in 28.3 mm on either side.
    whole = known(slices_of(CYLINDER, (0.03, 0.5, 0.97)), all_taxels=True)
    span = untouched_spans(whole)[0]
    gap = (span.length - 2 * 14e-3) / 3
    assert Predicted().next(whole).height == pytest.approx(span.low + 2 * gap + 21e-3)
    assert len(shares) == 3 + 2 * 2  # of the cylinder
    plain = known(slices_of(CYLINDER, (0.03, 0.5, 0.97)))  # where contours alone count
    assert Predicted().next(plain).height == pytest.approx(untouched_spans(plain)[0].middle)


# Errors


def test_side_with_cubic_square_is_exact_from_two_slices():
    for side in (
        lambda z, t: np.sqrt(z * (1.0 - z)) + 0.0 * t,
        lambda z, t: np.sqrt(0.1 + 0.2 * z - 0.3 * z**2 + 0.25 * z**3) + 0.0 * t,
    ):
        trial = PlannerTrial(side)
        two = [trial.slice_at(share * HEIGHT) for share in ENDS]
        assert trial.rms(two) < 1e-5
        assert predicted(known(two)).curve < 1e-4
        assert trial.rms(two, slopes=False) > 1e-3


@pytest.mark.parametrize("count", [4, 9])
def test_each_interval_errs_about_as_predicted(count):
    trial = planners.PlannerTrial(lambda z, t: 0.3 + 0.05 * np.sin(7.0 * z) + 0.0 * t)
    slices, dense = (
        [trial.slice_at(z * HEIGHT) for z in np.linspace(*ENDS, n)] for n in (count, 40)
    )
    prediction = predicted(known(slices))
    assert prediction.heights == pytest.approx(np.linspace(*ENDS, count))
    assert prediction.shares.sum() == pytest.approx(1.0)
    for low, high, error, share in zip(
        slices[:-1], slices[1:], prediction.errors, prediction.shares, strict=True
    ):  # the true error of one interval: everywhere else the slices are dense
        others = [one for one in dense if not low.height < one.height < high.height]
        true = trial.rms([*others, *slices]) / math.sqrt(share)
        assert error / 5.0 < true < 3.0 * error + 1e-6
    finer = predicted(known(slices_of(wavy, np.linspace(*ENDS, 2 * count - 1))))
    assert count < 9 or math.log2(prediction.curve / finer.curve) == pytest.approx(4.0, abs=0.3)
    for end in (0.97, 0.03):  # a cut is drawn to the end that bends more
        knee = slices_of(lambda z: 0.4 - 0.1 * math.exp(-10.0 * abs(z - end)), ENDS)  # noqa: B023
        side = predicted(known(knee)).indicators.bend_side[0]
        assert side > 0.8 if end > 0.5 else side < 0.2


def test_bound_adds_noise_to_curve_and_is_at_least_resolution():
    noises = []
    for deviation in (0.0, 9e-5, 18e-5):
        bound = predicted(known(slices_of(wavy, np.linspace(*ENDS, 12), deviation=deviation)))
        assert bound.rms_bound_95 == pytest.approx(math.hypot(bound.noise.all, bound.curve))
        noises.append(bound.noise.all)
    assert noises[0] == pytest.approx(1e-5 / HEIGHT)
    fades = np.sqrt(np.square(noises[1:]) - noises[0] ** 2)
    assert fades[1] == pytest.approx(2.0 * fades[0])
    assert 0.5e-3 < fades[0] < 1.5e-3  # 90 um over 90 mm, and a margin
    # Slices are wanted while they can bring the bound down, and not for the sake of noise.
    assert not bound.wants_refinement(1.01 * bound.rms_bound_95)
    assert not bound.wants_refinement(0.5 * bound.noise.all)
    assert bound._replace(curve=bound.noise.all).wants_refinement(0.5 * bound.noise.all)


def stated(count: int = 4, band: float = 3e-5, **changes: float) -> planners.Observation:
    """Slices of a solid of all taxels that states its own deviations."""
    slices = slices_of(wavy, np.linspace(*ENDS, count), deviation=band)
    own = {"all_taxels": True, "deviation": 9e-5, "ends_deviation": 2e-5, "pose_deviation": 1e-4}
    return known(slices, **(own | changes))


def test_stated_deviations_make_noise_of_bands_ends_and_between():
    noise = predicted(stated()).noise
    assert noise.lasting < noise.touched < noise.all
    assert noise.between == pytest.approx(math.sqrt(noise.all**2 - noise.touched**2))
    assert noise.touched == pytest.approx(math.hypot(noise.slices, noise.lasting))
    more = predicted(stated(ends_deviation=4e-5, band=6e-5)).noise
    none = predicted(stated(ends_deviation=0.0)).noise
    assert more.slices == pytest.approx(2.0 * noise.slices)
    assert more.lasting**2 - none.lasting**2 == pytest.approx(
        4.0 * (noise.lasting**2 - none.lasting**2)
    )
    assert none.lasting == pytest.approx(1.5e-4, abs=1e-5)  # resolution, and what edges leave
    side = predicted(stated(deviation=math.hypot(2e-5, 2.0 * math.sqrt(9e-5**2 - 2e-5**2)))).noise
    assert side.all**2 - side.lasting**2 == pytest.approx(4.0 * (noise.all**2 - noise.lasting**2))
    # Four times as many slices leave a quarter of the variance, its margin apart.
    bound = predicted(stated(6, band=4e-4, deviation=4e-4, pose_deviation=4e-4))
    left = math.hypot(0.4 * bound.noise.slices, bound.noise.lasting)
    assert bound.wants_averaging(1.01 * left, 6, 24) and not bound.wants_averaging(
        0.99 * left, 6, 24
    )
    assert not bound.wants_averaging(1.01 * bound.noise.touched, 6, 24)  # it is small enough
    # With few slices every deviation is less certain.
    assert predicted(stated(12)).noise.slices < 0.9 * noise.slices


def test_misfit_beyond_pose_errors_is_refined_and_is_no_noise():
    misfit = {"band": 1e-3, "deviation": 1e-3, "ends_deviation": 0.0, "tolerance": 5e-4}
    missed = predicted(stated(5, pose_deviation=1e-5, **misfit))
    noisy = predicted(stated(5, pose_deviation=1e-3, **misfit))
    limit = 5e-4 / HEIGHT
    assert missed.rms_bound_95 == pytest.approx(noisy.rms_bound_95)
    assert missed.noise.touched < limit < missed.rms_bound_95
    assert missed.wants_refinement(limit) and not noisy.wants_refinement(limit)
    whole = stated(9, pose_deviation=1e-5, **misfit)  # no further slice shows more
    assert not predicted(whole).untouched.any() and not predicted(whole).wants_refinement(limit)
    assert "does not follow what was touched" in Predicted().next(whole).reason
    loose = stated(9, band=2e-6, deviation=2e-3, ends_deviation=2e-3)
    assert Predicted().next(loose).reason.startswith("the ends are uncertain beyond the tolerance")
    # Uncertain ends do not end the refinement of the side.
    bound = predicted(stated(band=2e-6, deviation=2e-3, ends_deviation=2e-3))
    assert bound.curve < 0.5 * bound.noise.touched
    assert bound.wants_refinement(bound.curve) and not bound.wants_refinement(6.0 * bound.curve)


def test_halving_costs_predicted_number_of_slices():
    slices = slices_of(wavy, np.linspace(*ENDS, 5), touches=20, seconds=30.0)
    estimate = estimate_error(known(slices))
    count = estimate.prediction.slices_to(0.5 * estimate.prediction.rms_bound_95, 5)
    assert 1 <= count <= 6 and estimate.halving == (20.0 * count, 30.0 * count)
    denser = slices_of(wavy, np.linspace(*ENDS, 5 + count + 1))
    assert estimate_error(known(denser)).rms_bound_95 < 0.5 * estimate.rms_bound_95
    assert estimate.prediction.slices_to(2.0 * estimate.prediction.rms_bound_95, 5) == 0
    noisy = slices_of(wavy, np.linspace(*ENDS, 5), deviation=1e-3, touches=20)
    assert estimate_error(known(noisy)).halving is None


@pytest.mark.parametrize("slices", [[], [sides.slice_of(wavy, 0.5)], [failed(0.03), failed(0.05)]])
def test_fewer_than_two_slices_state_no_bound(slices):
    estimate = estimate_error(known(slices, all_taxels=True, deviation=2e-5))
    unknown = estimate.rms_bound_95, estimate.halving, estimate.prediction, estimate.open_area
    assert unknown == (None, None, None, None) and not estimate.reached
    assert [one.name for one in estimate.verdict.failed] == ["error bound", "untouched gap"]
    assert estimate.largest_untouched > 0.35 * HEIGHT


# Trials


def test_trial_measures_by_distance_along_normal():
    trial = PlannerTrial(lambda z, t: 0.4 - 0.2 * z + 0.0 * t)
    exact = [trial.slice_at(share * HEIGHT) for share in ENDS]
    assert trial.rms(exact) < 1e-3 and trial.rms(exact[:1]) == 1.0
    wider = PlannerTrial(lambda z, t: 0.41 - 0.2 * z + 0.0 * t)
    slices, stop = planners.run_planner(planners.Uniform(count=7), trial, 0.0025)
    assert len(slices) == 7 and isinstance(stop, planners.Stop)
    slices, stop = planners.run_planner(planners.Uniform(count=7), trial, 0.0025, most=4)
    assert (len(slices), stop) == (4, None)
    assert planners.observation_of(slices, 0.0025).tolerance == pytest.approx(0.000225)
    off = wider.rms([trial.slice_at(share * HEIGHT) for share in (0.03, 0.4, 0.97)])
    assert off == pytest.approx(0.01 / np.hypot(1.0, 0.2), rel=0.01)
    assert PlannerTrial(planners.TUNED["vase"]).slice_at(0.1).outcome is planners.SliceOutcome.LOST


def test_trial_slice_is_that_of_sphere_and_noise_that_of_its_seed():
    one = planners.PlannerTrial(planners.TUNED["sphere"]).slice_at(0.3 * HEIGHT)
    slope = 0.2 / math.sqrt(0.21)
    assert one.radii == pytest.approx(HEIGHT * math.sqrt(0.21))
    assert one.slopes == pytest.approx(slope, abs=1e-6)
    assert one.curvatures == pytest.approx(2.0 / HEIGHT, rel=1e-4)
    assert one.contact_high - one.contact_low == pytest.approx(14e-3 / math.hypot(1.0, slope))
    noisy, again, other = (
        planners.PlannerTrial(planners.TUNED["sphere"], 1e-4, seed).slice_at(0.3 * HEIGHT).radii
        for seed in (3, 3, 4)
    )
    assert np.array_equal(noisy, again) and not np.array_equal(noisy, other)
    assert 0.4e-4 < (noisy - one.radii).std() < 2e-4
