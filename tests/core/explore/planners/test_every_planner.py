"""Whatever comes back, a plan ends, and no height is asked for twice."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from palpate.core.explore.planners.protocol import (
    PLANNER_NAMES,
    Height,
    ObservedSlice,
    SliceOutcome,
    Stop,
    make_planner,
)


@pytest.mark.parametrize("name", PLANNER_NAMES)
@settings(
    derandomize=True,
    deadline=None,
    max_examples=15,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
@given(seed=st.integers(0, 10**6), trouble=st.sampled_from([0.0, 0.2, 0.6, 1.0]))
def test_plan_ends_and_asks_for_no_height_twice(name, seed, trouble, slice_of, observation) -> None:
    rng = np.random.default_rng(seed)
    planner, slices = make_planner(name, {}), list[ObservedSlice]()
    while isinstance(choice := planner.next(observation(slices)), Height):
        assert 0.0 < choice.height < 0.09
        assert choice.height not in [one.height for one in slices]
        slices.append(answer(rng, choice.height, trouble, slice_of))
        assert len(slices) <= 120
    assert isinstance(choice, Stop)


def answer(
    rng: np.random.Generator, height: float, trouble: float, slice_of: Callable[..., ObservedSlice]
) -> ObservedSlice:
    """Nonsense: radii, slopes and curvatures that have nothing to do with each other."""
    if rng.random() < trouble:
        none = np.zeros(0)
        fields: dict[str, Any] = {"outcome": rng.choice([SliceOutcome.FAILED, SliceOutcome.LOST])}
        for field in ("radii", "slopes", "curvatures", "contact_low", "contact_high"):
            fields[field] = none
        return slice_of(lambda z: 0.3, height / 0.09, **fields | {"height": height})
    return slice_of(
        lambda z: 0.3,
        height / 0.09,
        height=height,
        radii=0.02 * np.exp(rng.normal(size=16)),
        slopes=rng.standard_cauchy(size=16),
        curvatures=1e3 * rng.standard_cauchy(size=16),
        deviation=float(rng.choice([0.0, 1e-4])),
    )
