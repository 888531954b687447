from __future__ import annotations

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.rebuild.felt.contour_normals import STEP, normals_as_points

TURN = 2 * np.pi * np.arange(12) / 12
OUT = np.column_stack([np.cos(TURN), np.sin(TURN)])


def cone(height: float) -> tuple[Floats, Floats]:
    """A contour of a cone that narrows upwards at 45 degrees, and its normals, not of length 1."""
    points = np.column_stack([(0.1 - height) * OUT, np.full(12, height)])
    return points, np.column_stack([OUT, np.ones(12)])


def test_a_point_with_a_normal_is_three_on_the_surface() -> None:
    contours, normals = zip(*(cone(z) for z in (0.0, 0.02, 0.04)), strict=True)
    felt = normals_as_points(contours, normals)
    assert felt.normals is not None
    assert len(felt.points) == 3 * 36
    assert np.allclose(np.hypot(*felt.points[:, :2].T), 0.1 - felt.points[:, 2], atol=1e-15)
    apart = np.linalg.norm(felt.points[2] - felt.points[0])
    assert apart == pytest.approx(2 * STEP * 0.02)
    assert np.allclose(np.linalg.norm(felt.normals, axis=1), 1.0)
    assert np.bincount(felt.touch).tolist() == [3] * 36


def test_points_without_a_use_are_left_out() -> None:
    points, normals = cone(0.01)
    normals[0] = 0.0
    normals[1] = [0.0, 0.0, 1.0]
    points[2, 0] = np.nan
    assert len(normals_as_points([points], [normals]).points) == 3 * 9


def test_plane_contours_get_their_heights() -> None:
    points, normals = cone(0.01)
    felt = normals_as_points([points[:, :2]], [normals], [0.01])
    assert np.allclose(felt.points[1::3], points)


def test_normals_that_do_not_fit_their_contours_are_refused() -> None:
    points, normals = cone(0.01)
    with pytest.raises(ValueError, match="normals must be as many as the 2 contours, got 1"):
        normals_as_points([points, points], [normals])
    with pytest.raises(ValueError, match=r"normals of contour 0 must have shape \(12, 3\), got"):
        normals_as_points([points], [normals[:5]])
