from __future__ import annotations

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.rebuild.slices.height_sway import height_sway


def around(z: Floats) -> Floats:
    angle = 2 * np.pi * np.arange(len(z)) / len(z)
    return np.column_stack([5 + 2 * np.cos(angle), np.sin(angle), z])


def test_a_level_contour_does_not_sway() -> None:
    assert height_sway(around(np.full(30, 7.3))) == (0.0, 0.0)


@pytest.mark.parametrize("harmonic", [1, 2])
def test_a_tilt_and_a_saddle_are_shape(harmonic: int) -> None:
    z = 1e6 + 0.3 * np.cos(harmonic * 2 * np.pi * np.arange(30) / 30)
    sway = height_sway(around(z))
    assert sway.shape == pytest.approx(0.3 / np.sqrt(2), rel=1e-6)
    assert sway.noise < 1e-6


def test_noise_is_not_shape() -> None:
    rng = np.random.default_rng(0)
    sways = [height_sway(around(0.2 * rng.normal(size=60))) for _ in range(50)]
    assert np.mean([sway.noise for sway in sways]) == pytest.approx(0.2, rel=0.05)
    assert np.sqrt(np.mean([sway.shape**2 for sway in sways])) < 0.05


def test_of_few_points_all_is_shape() -> None:
    sway = height_sway(around(np.array([0.0, 1.0, 0.0, -1.0])))
    assert sway.shape == pytest.approx(np.sqrt(0.5))
    assert sway.noise == 0.0
