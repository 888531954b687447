from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.rebuild.correspondence.correspondence import match_slices
from palpate.core.rebuild.slices.bad_contours import BadContours, bad_contours
from palpate.core.rebuild.slices.slices import slices_of

HEIGHTS = np.linspace(-0.98, 0.98, 27)
ANGLE = 2 * np.pi * np.arange(60) / 60
NOISE = 0.01
"""Half a percent of the height."""
Sections = dict[str, Callable[[Floats, float], Floats]]

PROFILES: dict[str, Callable[[Floats], Any]] = {
    "lobed": lambda z: np.sqrt(1.04 - z * z) * (0.75 + 0.18 * np.sin(9 * z)),
    "ball": lambda z: np.sqrt(1.0004 - z * z),
    "cylinder": lambda z: 0.6 + 0 * z,
    "cone": lambda z: 0.1 + 0.3 * (1 - z),
    "edge": lambda z: 0.2 + 0.6 * (1 - np.abs(z)),
    "step": lambda z: 0.4 + 0.3 * (z > 0.1),
    "two steps": lambda z: 0.4 + 0.3 * (z > 0.13) - 0.2 * (z > 0.62),
    "neck": lambda z: 0.7 - 0.4 * np.exp(-(((z - 0.1) / 0.08) ** 2)),
    "groove": lambda z: 0.7 - 0.2 * (np.abs(z - 0.1) < 0.085),
    "flange": lambda z: 0.5 + 0.3 * (np.abs(z - 0.1) < 0.085),
    "capsule": lambda z: np.sqrt(np.maximum(0.36 - np.maximum(np.abs(z) - 0.4, 0) ** 2, 1e-4)),
    "bottle": lambda z: 0.25 + 0.4 * np.clip((0.5 - z) / 0.3, 0, 1),
    "zigzag": lambda z: 0.6 + 0.1 * np.arcsin(np.sin(4 * np.pi * z)),
    "fine zigzag": lambda z: 0.6 + 0.1 * np.arcsin(np.sin(12 * np.pi * z)),
}


def grid_of(name: str, heights: Floats = HEIGHTS) -> Floats:
    around = (1 + 0.1 * np.cos(2 * ANGLE))[:, None] * np.column_stack(
        [np.cos(ANGLE), np.sin(ANGLE)]
    )
    return np.asarray(PROFILES[name](heights)[:, None, None] * around)


def rows(found: BadContours) -> list[int]:
    return np.flatnonzero(found.bad).tolist()


def shaken(grid: Floats, noise: float, seed: int = 0) -> Floats:
    return grid + noise * np.random.default_rng(seed).normal(size=grid.shape)


@pytest.mark.parametrize("noise", [0.0, 0.4 * NOISE, NOISE])
@pytest.mark.parametrize("name", PROFILES)
def test_of_clean_contours_none_is_bad(name: str, noise: float) -> None:
    """Hard case 47: necks, steps, edges and zigzags are the object's own."""
    rng = np.random.default_rng(0)
    uneven = HEIGHTS.copy()
    uneven[1:-1] += 0.3 * (HEIGHTS[1] - HEIGHTS[0]) * rng.uniform(-1, 1, 25)
    for heights in (HEIGHTS, uneven):
        found = bad_contours(heights, shaken(grid_of(name, heights), noise))
        assert rows(found) == []
        assert not found.off.any()


@pytest.mark.parametrize("factor", [1.3, 0.7])
@pytest.mark.parametrize("noise", [0.0, NOISE])
@pytest.mark.parametrize("name", ["lobed", "ball", "cylinder", "edge", "bottle"])
def test_one_contour_of_another_size_is_found(name: str, noise: float, factor: float) -> None:
    """Hard case 47."""
    for row in (3, 9, 12):
        grid = shaken(grid_of(name), noise)
        size = np.sqrt((grid[row] ** 2).sum(axis=1).mean())
        grid[row] *= factor
        found = bad_contours(HEIGHTS, grid)
        assert rows(found) == [row]
        assert found.off[row] == pytest.approx(abs(factor - 1) * size, rel=0.25)


@pytest.mark.parametrize("noise", [0.0, NOISE])
@pytest.mark.parametrize("bad", [[5, 13, 20], [5, 8, 20], [9, 11, 18], [2, 12, 24]])
@pytest.mark.parametrize("name", ["lobed", "cylinder", "ball"])
def test_three_of_27_are_found(name: str, bad: list[int], noise: float) -> None:
    grid = shaken(grid_of(name), noise)
    grid[bad] *= 1.3
    assert rows(bad_contours(HEIGHTS, grid)) == bad


def test_a_contour_that_was_moved_or_turned_is_found() -> None:
    moved, turned = grid_of("bottle"), grid_of("bottle")
    moved[7] += [0.1, -0.05]
    turned[7] = turned[7] @ np.array([[0.9, 0.436], [-0.436, 0.9]])
    assert rows(bad_contours(HEIGHTS, moved)) == rows(bad_contours(HEIGHTS, turned)) == [7]


def test_a_contour_next_to_an_end_is_bad_only_where_the_object_goes_on_evenly() -> None:
    for name, wanted in (("cylinder", [25]), ("ball", [])):
        grid = grid_of(name)
        grid[25] *= 1.05
        assert rows(bad_contours(HEIGHTS, grid)) == wanted
    for end in (0, 26):
        grid = grid_of("cylinder")
        grid[end] *= 1.3
        assert rows(bad_contours(HEIGHTS, grid)) == []


def test_next_to_sharp_edges_of_the_object_a_bad_contour_stays() -> None:
    grid = grid_of("zigzag")
    grid[9] *= 1.3
    assert rows(bad_contours(HEIGHTS, grid)) == []


def test_one_in_five_is_found_and_of_every_other_one_none_is_singled_out() -> None:
    for every, wanted in ((slice(2, None, 5), [2, 7, 12, 17, 22]), (slice(0, None, 2), [])):
        grid = grid_of("cylinder")
        grid[every] *= 1.3
        assert rows(bad_contours(HEIGHTS, grid)) == wanted


def test_of_nine_contours_one_is_found_and_fewer_are_not_judged() -> None:
    for count, wanted in ((9, [4]), (8, [])):
        grid = grid_of("cylinder", HEIGHTS[:count])
        grid[4] *= 1.3
        assert rows(bad_contours(HEIGHTS[:count], grid)) == wanted


def test_unit_and_place_change_nothing() -> None:
    grid = shaken(grid_of("lobed"), NOISE)
    grid[13] *= 1.3
    wanted = bad_contours(HEIGHTS, grid)
    found = bad_contours(1e-3 * HEIGHTS + 4.0, 1e-3 * grid + [7.0, -3.0])
    assert rows(found) == rows(wanted) == [13]
    assert found.off[13] == pytest.approx(1e-3 * wanted.off[13], rel=1e-6)
    assert found.usual == pytest.approx(1e-3 * wanted.usual, rel=1e-6)


def test_traced_contours_are_cleaned_of_a_bad_one_by_all_steps_together(
    traced: Callable[..., Any], sections: Sections
) -> None:
    """Hard case 47: matched, judged, left out, matched again."""
    contours = traced(sections["lobed"]).contours(HEIGHTS, 81, noise=NOISE)
    contours[11][:, :2] *= 1.3
    slices = slices_of(contours)
    found = bad_contours(slices.heights, match_slices(slices, 60).grid)
    left = slices.without(found.bad, "unlike its neighbours", found.off)
    (dropped,) = left.dropped
    assert dropped[:2] == (11, "unlike its neighbours")
    assert dropped.height == slices.heights[11] and dropped.off == found.off[11] > 0.1
    again = bad_contours(left.heights, match_slices(left, 60).grid)
    assert rows(again) == []


@pytest.mark.parametrize(
    ("heights", "grid", "words"),
    [
        (np.zeros((3, 2)), np.zeros((3, 4, 2)), r"heights must have shape \(any\)"),
        (np.arange(3.0), np.zeros((4, 4, 2)), r"grid must have shape \(3, any, 2\)"),
        (np.arange(3.0), np.full((3, 4, 2), np.nan), "grid must be finite"),
        (np.array([0.0, 1.0, 1.0]), np.zeros((3, 4, 2)), "heights must rise, got"),
    ],
)
def test_what_is_no_stack_is_refused(heights: Floats, grid: Floats, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        bad_contours(heights, grid)
