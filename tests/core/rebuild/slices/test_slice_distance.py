from __future__ import annotations

import numpy as np

from palpate.core.rebuild.slices.slice_distance import slice_distance

ANGLE = 2 * np.pi * np.arange(512) / 512
UNIT = np.column_stack([np.cos(ANGLE), np.sin(ANGLE)])


def test_points_are_as_far_as_from_the_true_circles_of_their_own_slices() -> None:
    rng = np.random.default_rng(0)
    radii, middles = np.array([1.0, 0.3, 2.0]), np.array([[0, 0], [40.0, 1], [-3, 9]])
    curves = radii[:, None, None] * UNIT + middles[:, None]
    points = rng.uniform(-3, 3, size=(2, 3, 50, 2)) + middles[:, None]
    wanted = np.abs(np.linalg.norm(points - middles[:, None], axis=-1) - radii[:, None])
    assert np.abs(slice_distance(curves, points) - wanted).max() < 2e-4


def test_distance_from_a_corner_is_that_of_the_corner() -> None:
    side = np.linspace(0, 1, 128, endpoint=False)
    one, nought = np.ones(128), np.zeros(128)
    square = np.column_stack(
        [
            np.concatenate([side, one, 1 - side, nought]),
            np.concatenate([nought, side, one, 1 - side]),
        ]
    )
    found = slice_distance(square[None], np.array([[[[2.0, 2.0], [0.5, 0.4]]]]))
    assert np.abs(found - [np.sqrt(2), 0.4]).max() < 0.01


def test_a_curve_in_one_place_is_a_point() -> None:
    found = slice_distance(np.zeros((1, 8, 2)), np.array([[[[3.0, 4.0]]]]))
    assert found.tolist() == [[[5.0]]]
