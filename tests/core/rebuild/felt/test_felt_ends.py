from __future__ import annotations

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.rebuild.felt.felt_ends import on_end, touched_end
from palpate.core.rebuild.felt.felt_points import FeltPoints

LAST = 0.09
"""Height of the last contour, m, or of the first one below."""


def touches(heights: Floats, way: float = 1.0) -> FeltPoints:
    """Touches of an end at these heights, of three taxels each, two a little short of it."""
    lower = np.array([0.0, 5e-4, 1e-3])
    levels = (way * (np.asarray(heights)[:, None] - lower)).ravel()
    points = np.column_stack([np.zeros((len(levels), 2)), levels])
    normals = np.tile([0.0, 0.0, way], (len(levels), 1))
    return FeltPoints(points, normals, np.repeat(np.arange(len(heights), dtype=np.int32), 3))


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_touches_that_may_be_one_height_are_averaged(way: float) -> None:
    felt = touches(np.array([0.1, 0.1002, 0.0998, 0.0996, 0.097]), way)
    found = touched_end(felt, way * LAST, way, 1.5e-4, None)
    assert found == pytest.approx(way * 0.0999)


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_without_noise_the_farthest_is_the_truest(way: float) -> None:
    felt = touches(np.array([0.1, 0.0999]), way)
    assert touched_end(felt, way * LAST, way, None, way * 0.0999) == pytest.approx(way * 0.1)
    assert touched_end(felt, way * LAST, way, None, way * 0.1001) == pytest.approx(way * 0.1001)


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_an_end_that_is_known_to_lie_farther_is_not_pulled_in(way: float) -> None:
    felt = touches(np.array([0.097]), way)
    assert touched_end(felt, way * LAST, way, 1e-4, way * 0.1) == pytest.approx(way * 0.1)


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_what_is_no_touch_of_the_end_says_nothing_of_it(way: float) -> None:
    short = touches(np.array([0.08]), way)
    sideways = touches(np.array([0.1]), -way)._replace(points=touches(np.array([0.1]), way).points)
    for felt in (short, sideways, touches(np.array([0.1]), way)._replace(normals=None)):
        assert not on_end(felt, way * LAST, way).any()
        assert touched_end(felt, way * LAST, way, 1e-4, None) is None
        assert touched_end(felt, way * LAST, way, 1e-4, 0.1) == 0.1


def test_flat_flanks_do_not_outvote_the_tip_between_them() -> None:
    x, y = (1e-3 * part.ravel() for part in np.meshgrid(*2 * (np.arange(-3.0, 4.0),)))
    parts, normals = [], []
    for place in ((0.0, 0.0), (0.01, 0.0), (-0.01, 0.0), (0.0, 0.01), (0.0, -0.01)):
        at = np.column_stack([x, y]) + place
        steep = np.abs(at).argmax(axis=1)
        slope = np.zeros_like(at)
        slope[np.arange(len(at)), steep] = -0.3 * np.sign(at[np.arange(len(at)), steep])
        parts.append(np.column_stack([at, 0.1 + (slope * at).sum(axis=1)]))
        normals.append(np.column_stack([-slope, np.ones(len(at))]) / np.sqrt(1.09))
    felt = FeltPoints(
        np.concatenate([*parts, [[0.05, 0.0, 0.0]]]),
        np.concatenate([*normals, [[1.0, 0.0, 0.0]]]),
        np.append(np.repeat(np.arange(5), len(x)), 0).astype(np.int32),
    )
    assert touched_end(felt, 0.09, 1.0, None, 0.1) == pytest.approx(0.1, abs=1e-12)
