from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from palpate.core.explore.planners.cover import unfelt_runs
from palpate.core.explore.planners.foretold import DEVIATION, LEFT, NOISE, Foretold, foretell
from palpate.core.explore.planners.intervals import hermite, profile_of, signs_of
from palpate.core.explore.planners.known import Known, Slice

MakeSlice = Callable[..., Slice]
MakeKnown = Callable[..., Known]
Side = Callable[[float], float]


def wavy(z: float) -> float:
    return 0.3 + 0.05 * math.sin(7.0 * z)


def foretold(side: Side, shares: list[float], make: MakeSlice, known: MakeKnown) -> Foretold:
    all_known = known([make(side, share) for share in shares])
    return foretell(all_known, profile_of(all_known), unfelt_runs(all_known))


def test_positions_and_slopes_are_kept_and_a_cubic_in_the_square_is_exact(
    slice_of: MakeSlice, known: MakeKnown
) -> None:
    def cubic(z: float) -> float:
        return math.sqrt(0.1 + 0.2 * z - 0.3 * z**2 + 0.25 * z**3)

    profile = profile_of(known([slice_of(cubic, share) for share in (0.1, 0.4, 0.9)]))
    heights = np.linspace(0.1, 0.9, 33)
    exact = np.array([cubic(height) ** 2 for height in heights])
    np.testing.assert_allclose(hermite(profile, heights)[:, 0], exact, atol=1e-8)
    signs = signs_of(profile)
    assert signs.clash.max() < 1e-6
    assert signs.higher.max() < 1e-6


def test_the_foretold_error_falls_like_the_true_one(slice_of: MakeSlice, known: MakeKnown) -> None:
    coarse, fine = (
        foretold(wavy, np.linspace(0.03, 0.97, n).tolist(), slice_of, known) for n in (9, 17)
    )
    assert math.log2(coarse.curve / fine.curve) == pytest.approx(4.0, abs=0.3)


@pytest.mark.parametrize("count", [4, 5, 7, 9])
def test_each_interval_errs_about_as_foretold(
    count: int, slice_of: MakeSlice, known: MakeKnown
) -> None:
    shares = np.linspace(0.03, 0.97, count)
    said = foretold(wavy, shares.tolist(), slice_of, known)
    profile = profile_of(known([slice_of(wavy, share) for share in shares]))
    heights = np.linspace(0.03, 0.97, 801)
    slopes = 0.35 * np.cos(7.0 * heights)
    off = np.sqrt(hermite(profile, heights)[:, 0]) - [wavy(height) for height in heights]
    off /= np.sqrt(1.0 + slopes**2)
    pieces = np.array_split(off, count - 1)
    true = np.array([math.sqrt(float(np.mean(piece**2))) for piece in pieces])
    assert (true < 3.0 * said.errors).all()
    assert (true > said.errors / 5.0).all()


def test_cuts_are_drawn_to_the_end_that_bends_more(slice_of: MakeSlice, known: MakeKnown) -> None:
    def knee(z: float) -> float:
        return 0.4 - 0.1 * math.exp(10.0 * (z - 0.97))

    profile = profile_of(known([slice_of(knee, share) for share in (0.03, 0.97)]))
    assert signs_of(profile).pull[0] > 0.8


def test_noise_is_counted_once_and_cutting_ends_where_only_noise_is_left(
    slice_of: MakeSlice, known: MakeKnown
) -> None:
    noisy = known([slice_of(wavy, share, deviation=9e-5) for share in np.linspace(0.03, 0.97, 12)])
    said = foretell(noisy, profile_of(noisy), unfelt_runs(noisy))
    assert said.noise == pytest.approx(math.hypot(NOISE * 1e-3, 1e-5 / 0.09), rel=1e-6)
    assert said.bound == math.hypot(said.noise, said.curve)
    assert said.wants_cut(said.bound * 0.99) == (said.noise < said.bound * 0.99)
    assert not said.wants_cut(said.bound * 1.01)
    assert not said.wants_cut(said.noise * 0.5)
    assert said._replace(curve=said.noise).wants_cut(said.noise * 0.5)


def test_of_what_was_felt_only_the_unfelt_share_of_an_interval_errs(
    slice_of: MakeSlice, known: MakeKnown
) -> None:
    slices = [slice_of(wavy, share) for share in np.linspace(0.03, 0.97, 5)]
    plain, whole = known(slices), known(slices, taxels=True)
    one = foretell(plain, profile_of(plain), unfelt_runs(plain))
    all_felt = foretell(whole, profile_of(whole), unfelt_runs(whole))
    shares = [run.length for run in unfelt_runs(whole)] / (0.09 * one.signs.width)
    np.testing.assert_allclose(all_felt.errors, one.errors * shares**3, rtol=1e-9)


def test_a_solid_of_all_that_was_felt_states_its_own_deviation(
    slice_of: MakeSlice, known: MakeKnown
) -> None:
    slices = [slice_of(wavy, share, deviation=9e-5) for share in np.linspace(0.03, 0.97, 12)]
    stated = known(slices, taxels=True, deviation=5e-5)
    said = foretell(stated, profile_of(stated), unfelt_runs(stated))
    expected = math.hypot(DEVIATION * 5e-5 / 0.09, 1e-5 / 0.09, LEFT)
    assert said.noise == pytest.approx(expected, rel=1e-9)


def test_noise_is_averaged_only_where_there_is_room_for_enough_slices(
    slice_of: MakeSlice, known: MakeKnown
) -> None:
    slices = [slice_of(wavy, share) for share in np.linspace(0.03, 0.97, 6)]
    noisy = known(slices, taxels=True, deviation=4e-4)
    said = foretell(noisy, profile_of(noisy), unfelt_runs(noisy))
    assert not said.wants_average(0.99 * said.noise / 2.0, 6, 24)
    assert said.wants_average(1.01 * said.noise / 2.0, 6, 24)
    assert not said.wants_average(1.01 * said.noise, 6, 24)
