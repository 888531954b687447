from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.rebuild.skin.contour_rows import contour_rows

ANGLE = 2 * np.pi * np.arange(12) / 12
RIM = np.stack([np.cos(ANGLE), np.sin(ANGLE)], axis=-1)


def rings(radii: Floats, middles: Floats | None = None) -> Floats:
    grid = np.asarray(radii)[:, None, None] * RIM
    return grid if middles is None else grid + middles[:, None]


def test_rows_rise_in_a_unit_of_their_own() -> None:
    grid = rings(np.array([3.0, 1.0, 2.0])) + np.array([100.0, -7.0])
    rows = contour_rows(np.array([0.3, 0.1, 0.2]), grid, 0.0, 1.0, (False, False))
    assert rows.heights.tolist() == [0.1, 0.2, 0.3]
    assert rows.owner.tolist() == [2, 0, 1]
    assert np.allclose(rows.middle, [100.0, -7.0])
    assert rows.size == pytest.approx(3.0)
    assert np.abs(rows.grid).max() == pytest.approx(1.0)
    assert np.allclose(rows.grid[0] * rows.size + rows.middle, grid[1])
    assert rows.spacing == pytest.approx(0.1)


def test_contours_at_one_height_are_averaged_and_count_as_many() -> None:
    heights = np.array([0.0, 0.5, 0.5 + 1e-6, 1.0, 0.5])
    rows = contour_rows(heights, rings(np.array([1, 1, 2, 1, 3.0])), 0.0, 1.0, (False, False))
    assert rows.weights.tolist() == [1.0, 3.0, 1.0]
    assert rows.owner.tolist() == [0, 1, 1, 2, 1]
    assert np.allclose(rows.grid[1] * rows.size, 2.0 * RIM)


def test_a_pole_lies_where_the_middles_lead_or_where_it_is_put() -> None:
    heights = np.linspace(0.0, 1.0, 6)
    lean = np.column_stack([0.2 * heights, -0.1 * heights])
    grid = rings(np.ones(6), lean)
    rows = contour_rows(heights, grid, -0.5, 2.0, (np.array([1.0, 1.0]), True))
    below, above = rows.poles
    assert below is not None
    assert above is not None
    assert np.allclose(below * rows.size + rows.middle, [1.0, 1.0])
    assert np.allclose(above * rows.size + rows.middle, [0.4, -0.2])
    assert rows.with_poles.shape == (8, 12, 2)
    assert np.allclose(rows.with_poles[-1], above)


def test_points_in_one_place_have_a_size_of_1() -> None:
    rows = contour_rows([0.0], np.full((1, 5, 2), 3.0), -1.0, 1.0, (True, False))
    assert rows.size == 1.0
    assert rows.spacing == 0.0
    assert np.array_equal(rows.with_poles, np.zeros((2, 5, 2)))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"heights": []}, "heights must be at least one, got none"),
        ({"heights": [0.0, np.inf]}, "heights must be finite"),
        ({"grid": np.ones((3, 12, 2))}, r"grid must have shape \(2, any, 2\), got \(3, 12, 2\)"),
        ({"grid": np.ones((2, 3, 2))}, "grid must have 4 points around or more, got 3"),
        ({"low": 2.0}, "low must be below high and both finite, got 2 and 1 m"),
        ({"high": np.inf}, "low must be below high and both finite, got 0 and inf m"),
        ({"low": 0.3}, "heights must lie from low 0.3 to high 1 m, got 0.25 to 0.75"),
        ({"high": 0.75, "pole": (False, True)}, "a pole must lie beyond the last contour"),
        ({"pole": (np.ones(3), False)}, r"pole must have shape \(2\), got \(3,\)"),
    ],
)
def test_what_is_no_stack_of_contours_is_refused(change: dict[str, Any], words: str) -> None:
    given = {"heights": [0.25, 0.75], "low": 0.0, "high": 1.0, "pole": (False, False)} | change
    grid = given.pop("grid", np.ones((len(given["heights"]), 12, 2)))
    with pytest.raises(ValueError, match=words):
        contour_rows(grid=grid, **given)
