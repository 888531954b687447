from __future__ import annotations

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.plane.area_centroid import area_centroid


def polygon(azimuth: Floats, radius: Floats | float, middle: tuple[float, float]) -> Floats:
    away = np.column_stack([np.cos(azimuth), np.sin(azimuth)]) * np.reshape(radius, (-1, 1))
    return np.column_stack([away + middle, np.full(len(azimuth), 0.05)])


def test_the_middle_of_an_unevenly_felt_circle_is_its_centre() -> None:
    rng = np.random.default_rng(0)
    azimuth = np.sort(np.concatenate([rng.uniform(0, 2 * np.pi, 60), rng.uniform(0, 0.5, 300)]))
    contour = polygon(azimuth, 0.03, (0.1, -0.2))
    assert np.linalg.norm(area_centroid(contour) - [0.1, -0.2]) < 0.01 * 0.03
    assert np.linalg.norm(contour[:, :2].mean(axis=0) - [0.1, -0.2]) > 0.5 * 0.03


def test_the_middle_does_not_depend_on_direction_or_start_or_a_repeated_end() -> None:
    azimuth = np.sort(np.random.default_rng(1).uniform(0, 2 * np.pi, 40))
    contour = polygon(azimuth, 0.03 + 0.01 * np.cos(3 * azimuth), (1.0, 2.0))
    middle = area_centroid(contour)
    for other in (
        contour[::-1],
        np.roll(contour, 13, axis=0),
        np.concatenate([contour, contour[:1]]),
    ):
        assert np.allclose(area_centroid(other), middle, rtol=0, atol=1e-15)


def test_the_middle_of_a_small_ring_far_away_keeps_its_digits() -> None:
    azimuth = np.linspace(0, 2 * np.pi, 50, endpoint=False)
    contour = polygon(azimuth, 1e-6, (1e3, -1e3))
    assert np.linalg.norm(area_centroid(contour) - [1e3, -1e3]) < 1e-11


@pytest.mark.parametrize("count", [1, 2, 40])
def test_points_that_enclose_nothing_have_the_middle_of_the_points(count: int) -> None:
    on_a_line = np.outer(np.linspace(1.0, 2.0, count), [0.01, 0.02, 0.0])
    assert np.allclose(area_centroid(on_a_line), on_a_line.mean(axis=0)[:2], atol=1e-15)
