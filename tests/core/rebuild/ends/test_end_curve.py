from __future__ import annotations

import numpy as np
import pytest

from palpate.core.rebuild.ends.end_curve import curves_of
from palpate.core.rebuild.ends.end_profiles import Conic, Flat, Profile, Superellipse

PROFILES = [
    Conic(0.0),
    Conic(-0.5),
    Conic(-0.99),
    Superellipse(0.3, 2.0, 2.0),
    Superellipse(0.1, 1.0, 1.0),
    Superellipse(0.6, 30.0, 12.0),
    Superellipse(0.4, 5.0, 1.5),
    Superellipse(0.4, 5.0, 2.5, 0.6),
    Superellipse(0.8, 3.0, 4.0, -0.3),
    Flat(0.2),
    Flat(-1.0),
]
WAY = np.linspace(0.0, 1.0, 33)


@pytest.mark.parametrize("profile", PROFILES)
def test_curves_run_from_the_rim_to_the_middle_without_a_gap(profile: Profile) -> None:
    curves = curves_of(profile, 1.0)
    ends = np.array([curve.at(np.array([0.0, 1.0])) for curve in curves])

    np.testing.assert_allclose(ends[0, 0], [0.0, 1.0], atol=1e-12)
    np.testing.assert_allclose(ends[-1, 1], [1.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(ends[1:, 0], ends[:-1, 1], atol=1e-12)


@pytest.mark.parametrize("profile", PROFILES)
def test_curves_tell_the_radius_that_the_profile_tells(profile: Profile) -> None:
    height, radius = curves_of(profile, 1.0)[0].at(WAY[:-1]).T

    wide = radius > 0.3  # nearer to the middle a square end's height has no digits left
    np.testing.assert_allclose(profile.shares(height)[wide], radius[wide], atol=1e-9)


@pytest.mark.parametrize("profile", PROFILES)
@pytest.mark.parametrize("by", [1, 2])
def test_derivatives_are_those_of_central_differences(profile: Profile, by: int) -> None:
    way, step = np.linspace(0.01, 0.97, 25), 1e-5
    for curve in curves_of(profile, 1.0):
        told = curve.at(way, by)
        seen = (curve.at(way + step, by - 1) - curve.at(way - step, by - 1)) / (2.0 * step)
        scale = max(float(np.abs(told).max()), 1.0)
        np.testing.assert_allclose(told, seen, atol=1e-6 * scale)


@pytest.mark.parametrize("profile", PROFILES)
def test_derivatives_are_finite_at_both_ends(profile: Profile) -> None:
    for curve in curves_of(profile, 1.0):
        for by in (1, 2):
            assert np.isfinite(curve.at(np.array([0.0, 1.0]), by)).all()


def test_without_a_gap_there_is_only_a_disc() -> None:
    (disc,) = curves_of(Flat(0.0), 0.0)

    np.testing.assert_array_equal(disc.at(np.array([0.0, 0.5, 1.0])), [[0, 1], [0, 0.5], [0, 0]])


def test_a_flat_end_has_a_wall_and_a_disc() -> None:
    wall, disc = curves_of(Flat(-0.2), 1.0)

    np.testing.assert_allclose(wall.at(np.array([1.0])), [[1.0, 0.8]])
    np.testing.assert_allclose(disc.at(np.array([0.5])), [[1.0, 0.4]])
