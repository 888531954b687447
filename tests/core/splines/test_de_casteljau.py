from __future__ import annotations

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.splines.de_casteljau import de_casteljau


def test_a_parabola_is_its_control_polygon_cut_twice() -> None:
    control = np.array([[0.0, 0.0], [1.0, 2.0], [2.0, 0.0]])
    found = de_casteljau(control, np.array([[0.0], [0.5], [1.0]]))
    assert found.tolist() == [[0.0, 0.0], [1.0, 1.0], [2.0, 0.0]]


def test_a_solid_of_two_points_along_each_axis_is_their_trilinear_mean() -> None:
    corners = np.stack(np.meshgrid([0.0, 1.0], [0.0, 2.0], [0.0, 3.0], indexing="ij"), axis=-1)
    at = np.random.default_rng(0).random((20, 3))
    assert np.allclose(de_casteljau(corners, at), at * [1, 2, 3], rtol=0, atol=1e-15)


@pytest.mark.parametrize(
    ("at", "words"),
    [
        (np.array([[0.5, 0.5]]), r"at must have shape \(any, 1\)"),
        (np.array([[-0.1]]), "at must lie between 0 and 1, got -0.1"),
        (np.array([[1.1]]), "at must lie between 0 and 1, got 1.1 to 1.1"),
        (np.array([[np.nan]]), "at must be finite"),
    ],
)
def test_parameters_that_are_none_are_refused(at: Floats, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        de_casteljau(np.zeros((3, 2)), at)


def test_control_points_that_are_not_finite_are_refused() -> None:
    with pytest.raises(ValueError, match="control must be finite"):
        de_casteljau(np.array([[0.0], [np.nan]]), np.array([[0.5]]))


@pytest.mark.parametrize("shape", [(0, 3), ()])
def test_no_control_points_are_refused(shape: tuple[int, ...]) -> None:
    with pytest.raises(ValueError, match=r"control must have shape \(n_1, ..., n_d, c\), got"):
        de_casteljau(np.zeros(shape), np.array([[0.5]]))
