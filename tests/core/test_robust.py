"""Tests of robust statistics."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import ArrayLike

from palpate.core.robust import probable_error_sigma, scaled_mad


@pytest.mark.parametrize("sigma_of", [scaled_mad, probable_error_sigma])
def test_normal_noise_has_its_standard_deviation_though_a_few_errors_are_gross(
    sigma_of: Callable[[ArrayLike], float],
) -> None:
    errors = np.random.default_rng(1).normal(0.0, 2.5, 200_001)
    assert sigma_of(errors) == pytest.approx(2.5, rel=0.01)
    errors[:200] = 1e9
    assert sigma_of(errors) == pytest.approx(2.5, rel=0.01)
    assert sigma_of(-errors) == sigma_of(errors)
