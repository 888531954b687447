from __future__ import annotations

import numpy as np
import pytest

from palpate.core.rebuild.felt.coverage import SECTORS, coverage_of

TURNS = (np.arange(SECTORS) + 0.5) / SECTORS


def test_the_side_reaches_as_far_as_every_sector_was_felt() -> None:
    heights = np.concatenate([np.zeros(SECTORS), np.full(SECTORS, 0.04)])
    turns = np.tile(TURNS, 2)
    heights[3], heights[SECTORS + 5] = 0.01, 0.03
    seen = coverage_of(heights, turns)
    assert seen is not None
    assert (seen.low, seen.high, seen.gap) == pytest.approx((0.01, 0.03, 0.04))
    assert (seen.lows[3], seen.highs[5]) == pytest.approx((0.01, 0.03))
    assert np.count_nonzero(seen.lows) == 1


def test_every_stretch_without_a_point_is_listed() -> None:
    levels = np.array([0.0, 0.01, 0.0101, 0.03])
    seen = coverage_of(np.repeat(levels, SECTORS), np.tile(TURNS, 4))
    assert seen is not None
    assert np.sort(seen.gaps) == pytest.approx(np.repeat([0.01, 0.0199], SECTORS))


def test_the_gap_is_the_highest_stretch_that_a_sector_misses() -> None:
    levels = np.array([0.0, 0.01, 0.02, 0.03])
    heights, turns = np.repeat(levels, SECTORS), np.tile(TURNS, 4)
    kept = ~((heights == 0.02) & (turns == TURNS[7]))
    seen = coverage_of(heights[kept], turns[kept] + 3.0)
    assert seen is not None
    assert seen.gap == pytest.approx(0.02)


def test_a_side_that_was_not_felt_all_around_has_no_coverage() -> None:
    assert coverage_of(np.zeros(SECTORS - 1), TURNS[1:]) is None
    assert coverage_of(np.zeros(0), np.zeros(0)) is None
