from __future__ import annotations

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.rebuild.ends.end_choice import choose_profile
from palpate.core.rebuild.ends.end_curve import curves_of
from palpate.core.rebuild.ends.end_profiles import Superellipse, shoulder
from palpate.core.rebuild.ends.rounded import Rounded, rounded

END, RADIUS, GAP = 0.09, 0.03, 1.2e-3
DEPTHS = np.linspace(END - GAP - 13e-3, END - GAP, 14)


def filleted(depths: Floats, arc: float, lean: float = 0.0) -> Floats:
    """Radii of a wall that leans, rounded off by an arc."""
    inside = np.clip(1.0 - (END - depths) / arc, 0.0, 1.0)
    return RADIUS + lean * (depths - END) - arc * (1.0 - np.sqrt(1.0 - inside**2))


@pytest.mark.parametrize("lean", [0.0, -0.3, 0.2])
@pytest.mark.parametrize("arc", [2e-3, 4e-3, 8e-3])
def test_an_edge_that_was_rounded_by_an_arc_is_found_again(arc: float, lean: float) -> None:
    found = rounded(DEPTHS, filleted(DEPTHS, arc, lean), END)
    assert found is not None
    assert found.arc * GAP == pytest.approx(arc, rel=0.03)
    beyond = np.linspace(END - GAP, END, 20)
    shares = found.shares((beyond - DEPTHS[-1]) / GAP)
    last = filleted(DEPTHS[-1:], arc, lean)[0]
    assert np.abs(last * shares - filleted(beyond, arc, lean)).max() < 0.02 * arc


def test_its_curve_is_the_profile_and_its_derivatives_are_those_of_the_curve() -> None:
    profile = Rounded(3.0, 0.13, (1.04, 0.02, 0.001))
    arc, disc = curves_of(profile, 1.0)
    way = np.linspace(0.0, 1.0, 41)
    points = arc.at(way)
    np.testing.assert_allclose(profile.shares(points[:, 0]), points[:, 1], atol=1e-12)
    assert points[0] == pytest.approx([0.0, float(profile.shares(np.zeros(1))[0])], abs=1e-12)
    assert points[-1] == pytest.approx(disc.at(np.zeros(1))[0], abs=1e-12)
    assert disc.at(np.ones(1))[0] == pytest.approx([1.0, 0.0])
    step = 1e-5
    middle = way[1:-1]
    for by in (1, 2):
        above, below = arc.at(middle + step, by - 1), arc.at(middle - step, by - 1)
        np.testing.assert_allclose(arc.at(middle, by), (above - below) / (2 * step), atol=1e-8)


def test_a_rounded_edge_is_told_from_a_superellipse_by_the_rows_before_it() -> None:
    made = choose_profile(DEPTHS, filleted(DEPTHS, 4e-3), END, 0.0, dense=True)
    assert made.kind == "rounded"
    zeta = np.clip((DEPTHS - 0.045) / 0.045, 0.0, 1.0)
    grown = choose_profile(DEPTHS, RADIUS * shoulder(zeta, 10.0, 10.0), END, 0.0, dense=True)
    assert grown.kind == "flared"
    assert isinstance(grown.profile, Superellipse)


@pytest.mark.parametrize("noise", [0.0, 5e-6])
def test_a_shoulder_takes_the_place_of_a_sharp_edge_that_misses_the_rows(noise: float) -> None:
    zeta = np.linspace(0.78, 0.93, 14)
    radii = 0.02 * shoulder(zeta, 16.0, 8.0) * (1.0 + 0.1 * zeta)
    radii += np.random.default_rng(0).normal(0.0, noise, 14)
    assert choose_profile(0.1 * zeta, radii, 0.1, noise, dense=True).kind == "flared"


@pytest.mark.parametrize("noise", [0.0, 1e-5])
@pytest.mark.parametrize("lean", [0.0, -0.2])
def test_a_sharp_edge_stays_sharp(noise: float, lean: float) -> None:
    wall = RADIUS + lean * (DEPTHS - END)
    wall += noise * np.sin(np.arange(14) / 3.0)  # rows of a smooth skin err together
    assert choose_profile(DEPTHS, wall, END, noise, dense=True).kind == "flat"


def test_a_ball_ends_as_a_ball() -> None:
    ball = np.sqrt(0.045**2 - (DEPTHS - 0.045) ** 2)
    assert choose_profile(DEPTHS, ball, END, 0.0, dense=True).kind == "conic"


def test_what_leaves_no_disc_is_no_rounded_edge() -> None:
    narrow = filleted(DEPTHS, 8e-3) - 0.0225
    assert narrow.min() > 0.0
    assert rounded(DEPTHS, narrow, END) is None


def test_an_edge_sharper_than_what_was_seen_is_none_either() -> None:
    wall = np.full(len(DEPTHS), RADIUS)
    assert rounded(DEPTHS, wall, END) is None
