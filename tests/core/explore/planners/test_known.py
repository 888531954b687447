from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from palpate.core.explore.planners.known import Budget, Known, Slice


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"high": -1.0}, "high must lie above low 0.0 m, got -1.0 m"),
        ({"high": math.inf}, "high must lie above low"),
        ({"tolerance": 0.0}, "tolerance must be positive"),
        ({"tolerance": math.nan}, "tolerance must be positive"),
        ({"tolerance": 5e-6}, "at least the sensor's resolution 1e-05 m, got 5e-06 m"),
        ({"resolution": -1.0}, "resolution must be positive"),
        ({"feature": 0.0}, "feature must be positive"),
        ({"low_deviation": -1e-3}, "low_deviation must be 0 or more"),
        ({"high_deviation": math.nan}, "high_deviation must be 0 or more"),
        ({"apart": -1.0}, "apart must be 0 or more"),
    ],
)
def test_what_no_planner_can_work_with_is_refused(
    known: Callable[..., Known], changes: dict[str, float], words: str
) -> None:
    with pytest.raises(ValueError, match=words):
        known(**changes)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"most_touches": 0}, "most_touches must be positive, got 0 touches"),
        ({"most_seconds": 0.0}, "most_seconds must be positive, got 0.0 s"),
        ({"most_seconds": math.nan}, "most_seconds must be positive"),
        ({"touches": -1}, "touches must be 0 or more"),
        ({"seconds": math.inf}, "seconds must be 0 or more and finite"),
    ],
)
def test_a_budget_of_nothing_is_refused(changes: dict[str, Any], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        Budget(**changes)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"height": math.nan}, "height must be finite"),
        ({"deviation": -1.0}, "deviation must be 0 or more"),
        ({"touches": -1}, "touches must be 0 or more and finite, got -1 touches"),
        ({"seconds": math.nan}, "seconds must be 0 or more"),
        ({"radii": np.full(16, -0.01)}, "radii must be at least 4 positive lengths"),
        ({"radii": np.full(16, math.nan)}, "radii must be finite"),
        ({"slopes": np.zeros(3)}, r"slopes must have shape \(16\)"),
    ],
)
def test_a_slice_that_cannot_be_is_refused(
    slice_of: Callable[..., Slice], changes: dict[str, Any], words: str
) -> None:
    with pytest.raises(ValueError, match=words):
        slice_of(lambda z: 0.3, 0.5, **changes)


def test_slices_of_other_azimuths_are_refused(
    slice_of: Callable[..., Slice], known: Callable[..., Known]
) -> None:
    few = {
        name: np.full(8, 0.02)
        for name in ("radii", "slopes", "curvatures", "felt_low", "felt_high")
    }
    both = [slice_of(lambda z: 0.3, 0.5), slice_of(lambda z: 0.3, 0.6, **few)]
    with pytest.raises(ValueError, match=r"as many azimuths, got \[8, 16\]"):
        known(both)
