import numpy as np
import pytest

from palpate.core.explore.planners.protocol import SliceOutcome
from palpate.core.explore.planners.trial import (
    AROUND,
    EXTENT,
    HEIGHTS,
    TUNED,
    PlannerTrial,
    measure_side,
    observation_of,
    run_planner,
)
from palpate.core.explore.planners.uniform import Uniform
from tests.studies.drawn import drawn_objects
from tests.studies.held_out import HELD_OUT

ALL = {**TUNED, **HELD_OUT, **drawn_objects(60, 11)}


@pytest.mark.parametrize("name", ALL)
def test_every_object_has_a_side_that_a_pad_can_feel(name):
    side = measure_side(ALL[name], HEIGHTS, AROUND)
    assert np.isfinite(side.curvatures).all()
    assert 0.025 < side.radii.min() < side.radii.max() < 0.7


def test_objects_for_tuning_and_for_judging_are_others_and_enough():
    assert len(TUNED) >= 14
    assert len(HELD_OUT) >= 14
    assert not set(TUNED) & set(HELD_OUT)


def test_the_same_seed_draws_the_same_objects():
    one, two, other = (drawn_objects(3, seed)["drawn 2"] for seed in (5, 5, 6))
    z, t = np.full(1, 0.3), np.full(1, 1.0)
    assert one(z, t) == two(z, t) != other(z, t)


def test_slopes_and_curvatures_are_those_of_the_sphere():
    side = measure_side(TUNED["sphere"], np.array([0.3, 0.5]), AROUND)
    np.testing.assert_allclose(side.slopes[:, 0], [0.2 / np.sqrt(0.21), 0.0], atol=1e-6)
    np.testing.assert_allclose(side.curvatures, 2.0, rtol=1e-4)


def test_a_side_is_judged_by_its_distance_along_the_normal():
    trial = PlannerTrial(lambda z, t: 0.4 - 0.2 * z + 0.0 * t)
    exact = [trial.slice_at(share * EXTENT) for share in (0.03, 0.97)]
    assert trial.rms(exact) < 1e-3
    assert trial.rms(exact[:1]) == 1.0
    wider = PlannerTrial(lambda z, t: 0.41 - 0.2 * z + 0.0 * t)
    off = wider.rms([trial.slice_at(share * EXTENT) for share in (0.03, 0.4, 0.97)])
    assert off == pytest.approx(0.01 / np.hypot(1.0, 0.2), rel=0.01)


def test_slopes_help_and_positions_alone_do_too():
    trial = PlannerTrial(TUNED["vase"])
    slices, _ = run_planner(Uniform(count=9), trial, 0.0025)
    assert trial.rms(slices) < 0.2 * trial.rms(slices, slopes=False) < 0.01
    assert trial.rms(slices[:2], slopes=False) < 1.0


def test_beside_the_object_there_is_nothing():
    slice_ = PlannerTrial(TUNED["vase"]).slice_at(0.1)
    assert slice_.outcome is SliceOutcome.LOST
    assert not slice_.usable


def test_noise_is_the_same_for_one_seed_and_of_the_size_that_is_stated():
    noisy, again, exact = (PlannerTrial(TUNED["vase"], n, 3) for n in (1e-4, 1e-4, 0.0))
    slices = [trial.slice_at(0.03) for trial in (noisy, again, exact)]
    np.testing.assert_array_equal(slices[0].radii, slices[1].radii)
    spread = (slices[0].radii - slices[2].radii).std()
    assert 0.4e-4 < spread < 2e-4


def test_a_run_ends_with_the_plan_or_with_the_patience():
    trial = PlannerTrial(TUNED["vase"])
    slices, stop = run_planner(Uniform(count=7), trial, 0.0025)
    assert (len(slices), stop is None) == (7, False)
    slices, stop = run_planner(Uniform(count=7), trial, 0.0025, most=4)
    assert (len(slices), stop) == (4, None)
    assert observation_of(slices, 0.0025).tolerance == pytest.approx(0.000225)
