from __future__ import annotations

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.rebuild.slices.suspects import perhaps_features, suspicious

ANGLE = 2 * np.pi * np.arange(40) / 40
RIM = np.stack([np.cos(ANGLE), np.sin(ANGLE)], axis=-1)


def stack(radii: Floats) -> tuple[Floats, Floats]:
    return np.linspace(-40.0, 40.0, len(radii)), np.asarray(radii)[:, None, None] * RIM


@pytest.mark.parametrize("count", [4, 6, 8])
def test_one_contour_far_off_is_suspicious_and_says_by_how_much(count: int) -> None:
    for row in range(1, count - 1):
        radii = np.full(count, 30.0)
        radii[row] = 39.0
        off = suspicious(*stack(radii))
        assert np.flatnonzero(off).tolist() == [row]
        assert off[row] == pytest.approx(9.0, rel=0.3)


@pytest.mark.parametrize("count", [3, 4, 6, 9, 27])
def test_smooth_objects_are_not_suspicious(count: int) -> None:
    heights = np.linspace(-49.5, 49.5, count)
    ball = np.sqrt(50.0**2 - heights**2)
    vase = 30.0 + 8.0 * np.sin(heights / 25.0)
    leaning = 30.0 * RIM + 0.3 * heights[:, None, None] * [1.0, 0.0]
    for grid in (ball[:, None, None] * RIM, vase[:, None, None] * RIM, leaning):
        assert not suspicious(heights, grid).any()


def test_an_end_is_suspicious_if_it_is_wider_or_aside_but_not_if_it_rounds_off() -> None:
    for end in (0, -1):
        for radius, suspect in ((45.0, True), (5.0, False)):
            radii = np.full(9, 30.0)
            radii[end] = radius
            assert (suspicious(*stack(radii))[end] > 0.0) == suspect
        heights, grid = stack(np.full(9, 30.0))
        grid[end] += [20.0, 0.0]
        assert suspicious(heights, grid)[end] == pytest.approx(20.0)


def test_of_three_the_middle_one_is_suspicious_if_it_is_narrow_or_aside() -> None:
    assert suspicious(*stack(np.array([30.0, 20.0, 30.0]))).tolist() == [0.0, 10.0, 0.0]
    assert not suspicious(*stack(np.array([30.0, 45.0, 30.0]))).any()
    heights, grid = stack(np.full(3, 30.0))
    grid[1] += [0.0, 15.0]
    assert suspicious(heights, grid).tolist() == pytest.approx([0.0, 15.0, 0.0])
    assert not suspicious(*stack(np.array([30.0, 10.0]))).any()


def test_what_is_alike_but_for_its_size_may_be_a_feature() -> None:
    _, grid = stack(np.array([30.0, 30.0, 20.0, 30.0, 30.0]))
    grid[3] *= [1.4, 1.0]
    bad = np.array([False, False, True, True, False])
    star = np.ones(5, bool)
    assert perhaps_features(grid, star, bad).tolist() == [False, False, True, False, False]
    star[2] = False
    assert not perhaps_features(grid, star, bad).any()
