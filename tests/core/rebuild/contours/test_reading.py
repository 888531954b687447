from __future__ import annotations

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.rebuild.contours.reading import height_residual_of


def around(z: Floats) -> Floats:
    angle = 2 * np.pi * np.arange(len(z)) / len(z)
    return np.column_stack([5 + 2 * np.cos(angle), np.sin(angle), z])


def test_a_level_contour_does_not_sway() -> None:
    assert height_residual_of(around(np.full(30, 7.3))) == (0.0, 0.0)


@pytest.mark.parametrize("harmonic", [1, 2])
def test_a_tilt_and_a_saddle_are_shape(harmonic: int) -> None:
    z = 1e6 + 0.3 * np.cos(harmonic * 2 * np.pi * np.arange(30) / 30)
    height_residual = height_residual_of(around(z))
    assert height_residual.shape == pytest.approx(0.3 / np.sqrt(2), rel=1e-6)
    assert height_residual.noise < 1e-6


def test_noise_is_not_shape() -> None:
    rng = np.random.default_rng(0)
    sways = [height_residual_of(around(0.2 * rng.normal(size=60))) for _ in range(50)]
    assert np.mean([height_residual.noise for height_residual in sways]) == pytest.approx(
        0.2, rel=0.05
    )
    assert np.sqrt(np.mean([height_residual.shape**2 for height_residual in sways])) < 0.05


def test_of_few_points_all_is_shape() -> None:
    height_residual = height_residual_of(around(np.array([0.0, 1.0, 0.0, -1.0])))
    assert height_residual.shape == pytest.approx(np.sqrt(0.5))
    assert height_residual.noise == 0.0
