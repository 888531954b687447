from __future__ import annotations

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.rebuild.skin.between_contours import (
    DECAY,
    FEW,
    LEAST_DECAY,
    LEAST_TRUST,
    MOST_DECAY,
    BetweenContours,
    between_contours,
)

TURNS = 32
ANGLE = 2 * np.pi * np.arange(TURNS) / TURNS
RIM = np.stack([np.cos(ANGLE), np.sin(ANGLE)], axis=-1)


def judged(sites: Floats, radius: Floats, sigma: float = 0.0) -> BetweenContours:
    """Of contours with radii (m,) or (m, TURNS)."""
    radius = np.broadcast_to(radius.reshape(len(sites), -1), (len(sites), TURNS))
    across = np.broadcast_to(RIM, (len(sites), TURNS, 2))
    return between_contours(sites, radius[..., None] * RIM, across, sigma)


def test_what_neighbours_foretell_exactly_leaves_no_doubt() -> None:
    sites = np.linspace(-1.0, 1.0, 12)
    found = judged(sites, 1.0 + sites - sites**2)
    doubt = found.variance(np.linspace(-1.5, 1.5, 50), np.arange(5) / 5)
    assert doubt.max() < 1e-24


def test_doubt_is_none_at_contours_and_most_midway() -> None:
    sites = np.linspace(0.0, 1.0, 11)
    found = judged(sites, 1.0 + 0.2 * np.sin(20.0 * sites))
    assert found.variance(sites, np.zeros(1)).max() < 1e-24
    steps = np.linspace(sites[4], sites[5], 21)
    doubt = found.variance(steps, np.zeros(1))[:, 0]
    assert np.argmax(doubt) == 10
    assert doubt[10] > 0.0


def test_doubt_grows_with_the_distance_beyond_the_outermost_contours() -> None:
    sites = np.linspace(0.0, 1.0, 11)
    found = judged(sites, 1.0 + 0.2 * np.sin(20.0 * sites))
    for away in (-1.0, 1.0):
        edge = 0.5 + 0.5 * away
        near, far = found.variance(edge + away * np.array([0.05, 0.1]), np.zeros(1))[:, 0]
        assert far == pytest.approx(4.0 * near)
        assert near > 0.0


def test_what_lies_at_one_side_leaves_no_doubt_about_the_other() -> None:
    sites = np.linspace(0.0, 1.0, 15)
    bump = np.exp(-np.square((sites[:, None] - 0.5) / 0.05) - np.square((ANGLE - np.pi) / 0.3))
    found = judged(sites, 1.0 + 0.1 * bump)
    doubt = found.variance(np.linspace(0.4, 0.6, 21), np.array([0.0, 0.5]))
    assert doubt[:, 0].max() < 1e-6 * doubt[:, 1].max()


def test_noise_alone_leaves_little_doubt() -> None:
    sites = np.linspace(0.0, 1.0, 20)
    noise = 0.01 * np.random.default_rng(0).normal(size=(20, TURNS))
    found = judged(sites, 1.0 + noise, sigma=0.01)
    without = judged(sites, 1.0 + noise, sigma=0.0)
    assert found.squares.mean() < 0.5 * without.squares.mean()


def test_the_decay_is_measured_within_limits() -> None:
    sites = np.linspace(0.0, 1.0, 30)
    trust = max(FEW / 30, LEAST_TRUST)
    smooth = judged(sites, 1.0 + np.sin(3.0 * sites))
    assert smooth.share == pytest.approx(trust * LEAST_DECAY)
    rough = judged(sites, 1.0 + np.random.default_rng(1).normal(size=30))
    assert trust * 0.3 < rough.share <= trust * MOST_DECAY
    few = judged(sites[:5], 1.0 + np.sin(9.0 * sites[:5]))
    assert few.share == pytest.approx(DECAY)


def test_three_two_and_one_contours_give_finite_doubts() -> None:
    places = np.linspace(-0.5, 2.5, 31)
    for count, doubts in ((3, True), (2, True), (1, False)):
        found = judged(np.arange(count, dtype=float), np.array([1.0, 1.5, 0.7])[:count])
        variance = found.variance(places, np.arange(4) / 4)
        assert np.isfinite(variance).all()
        assert bool(variance.max() > 0.0) is doubts
