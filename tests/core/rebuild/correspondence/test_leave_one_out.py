from __future__ import annotations

import numpy as np
import pytest

from palpate.core.rebuild.correspondence.leave_one_out import neighbour_weights

HEIGHTS = np.array([0.0, 0.4, 1.0, 1.7, 2.0, 3.1, 3.5])


def test_cubics_are_predicted_inside_and_parabolas_at_the_ends() -> None:
    weights = neighbour_weights(HEIGHTS)
    assert np.allclose(weights @ HEIGHTS**2, HEIGHTS**2)
    inner = slice(2, -2)
    assert np.allclose((weights @ HEIGHTS**3)[inner], HEIGHTS[inner] ** 3)
    assert np.allclose(weights.sum(axis=1), 1.0)


def test_no_contour_predicts_itself_and_only_neighbours_count() -> None:
    weights = neighbour_weights(HEIGHTS)
    away = np.abs(np.arange(7)[:, None] - np.arange(7))
    assert (weights[away == 0] == 0.0).all()
    assert (weights[away > 3] == 0.0).all()
    assert np.count_nonzero(weights[3]) == 4


@pytest.mark.parametrize("count", [1, 2])
def test_too_few_contours_predict_nothing(count: int) -> None:
    assert not neighbour_weights(HEIGHTS[:count]).any()


def test_three_contours_predict_each_other_linearly() -> None:
    weights = neighbour_weights(HEIGHTS[:3])
    assert np.allclose(weights @ HEIGHTS[:3], HEIGHTS[:3])
    assert (np.count_nonzero(weights, axis=1) == 2).all()
