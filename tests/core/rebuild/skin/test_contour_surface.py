from __future__ import annotations

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.rebuild.skin.contour_skin import fit_contour_skin
from palpate.core.rebuild.skin.contour_surface import ContourSurface, SidePatch

TURNS = np.arange(40) / 40
RIM = np.stack([np.cos(2 * np.pi * TURNS), np.sin(2 * np.pi * TURNS)], axis=-1)


@pytest.fixture(scope="module")
def ball() -> ContourSurface:
    """Of radius 1 about (3, -2, 0), from its lower pole to the height 0.9."""
    heights = np.linspace(-0.9, 0.9, 19)
    grid = np.sqrt(1.0 - heights**2)[:, None, None] * RIM + np.array([3.0, -2.0])
    return fit_contour_skin(heights, grid, low=-1.0, high=1.0, pole=(True, False)).surface


def away(points: Floats) -> Floats:
    return np.linalg.norm(points - np.array([3.0, -2.0, 0.0]), axis=-1)


def test_places_lie_on_the_ball_from_its_pole_to_the_last_contour(ball: ContourSurface) -> None:
    low, high = ball.along.domain
    points = ball.places(np.linspace(low, high, 100), np.linspace(0.0, 3.0, 100))
    assert np.abs(away(points) - 1.0).max() < 1e-4
    assert np.allclose(ball.reach, (-1.0, 0.9))
    assert np.allclose(points[0], [3.0, -2.0, -1.0], atol=1e-12)


def test_heights_and_turns_are_broadcast(ball: ContourSurface) -> None:
    heights = np.linspace(-0.8, 0.8, 5)
    grid = ball.at(heights[:, None], TURNS)
    assert grid.shape == (5, 40, 2)
    assert np.array_equal(ball.at(heights[2], TURNS[7]), grid[2, 7])
    latitudes = ball.within(heights)
    assert np.allclose(ball.on_grid(latitudes, TURNS), grid, atol=1e-14)
    points = ball.places(np.repeat(latitudes, 40), np.tile(TURNS, 5))
    assert np.allclose(points[:, :2].reshape(5, 40, 2), grid, atol=1e-14)
    assert np.allclose(points[:, 2], np.repeat(heights, 40))


@pytest.mark.parametrize("by", [(1, 0), (0, 1), (1, 1), (0, 2)])
def test_derivatives_by_height_and_turn_are_those_of_differences(
    ball: ContourSurface, by: tuple[int, int]
) -> None:
    heights, turns = np.meshgrid([-0.7, 0.1, 0.6], [0.03, 0.41], indexing="ij")
    step = 1e-5
    lower = (by[0], by[1] - 1) if by[1] else (0, 0)
    h, t = (0.0, step) if by[1] else (step, 0.0)
    forth, back = ball.at(heights + h, turns + t, lower), ball.at(heights - h, turns - t, lower)
    wanted = (forth - back) / (2 * step)
    assert np.allclose(ball.at(heights, turns, by), wanted, rtol=1e-6, atol=1e-5)


@pytest.mark.parametrize("by", [(1, 0), (0, 1), (2, 0), (1, 1), (0, 2)])
def test_derivatives_by_latitude_are_smooth_up_to_the_pole(
    ball: ContourSurface, by: tuple[int, int]
) -> None:
    low, high = ball.along.domain
    latitudes, turns = np.array([low, low + 0.1, high]), np.full(3, 0.2)
    found = ball.places(latitudes, turns, by)
    assert np.isfinite(found).all()
    assert np.abs(found).max() < 50.0
    assert np.allclose(found[:, :2], ball.on_grid(latitudes, turns[:1], by)[:, 0], atol=1e-13)


def test_beyond_its_reach_the_section_is_carried_on(ball: ContourSurface) -> None:
    last = ball.at(0.9, TURNS)
    assert np.array_equal(ball.at(0.97, TURNS), last)
    assert np.array_equal(ball.at(0.97, TURNS, (1, 0)), np.zeros((40, 2)))


def test_a_side_patch_runs_from_0_to_1(ball: ContourSurface) -> None:
    side = SidePatch(ball)
    ends = side.at(np.array([0.0, 1.0]), np.array([0.3, 0.3]))
    assert np.allclose(ends[:, 2], [-1.0, 0.9])
    v, turns, step = np.array([0.2, 0.7]), np.array([0.1, 0.9]), 1e-5
    for order in (0, 1):
        wanted = (side.at(v + step, turns, (order, 0)) - side.at(v - step, turns, (order, 0))) / (
            2 * step
        )
        assert np.allclose(side.at(v, turns, (order + 1, 0)), wanted, rtol=1e-5, atol=1e-5)


def test_derivatives_that_are_not_offered_and_bad_numbers_are_refused(
    ball: ContourSurface,
) -> None:
    with pytest.raises(ValueError, match="by must be 0 or 1 in the height, got 2"):
        ball.at(0.0, 0.0, (2, 0))
    with pytest.raises(ValueError, match="heights must be finite"):
        ball.at(np.nan, 0.0)
    with pytest.raises(ValueError, match="turns must be finite"):
        ball.at(0.0, np.inf)
    with pytest.raises(ValueError, match="x must lie in the domain"):
        ball.places(np.array([99.0]), np.zeros(1))
