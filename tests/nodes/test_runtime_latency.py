from __future__ import annotations

import numpy as np
import pytest

from palpate.nodes.runtime_latency import Latency


def test_without_durations_every_quantile_is_zero() -> None:
    assert Latency().quantile(0.5) == 0.0


@pytest.mark.parametrize("share", [0.5, 0.9, 0.99])
def test_quantiles_are_right_to_the_width_of_a_bin(share: float) -> None:
    micro = np.random.default_rng(1).lognormal(3.0, 1.0, 20_000) + 1.0
    latency = Latency()
    for value in micro:
        latency.add(int(value * 1000))
    assert latency.count == 20_000
    assert latency.quantile(share) == pytest.approx(np.quantile(micro, share), rel=0.03)


def test_the_longest_durations_share_the_last_bin() -> None:
    latency = Latency()
    latency.add(10**18)
    assert latency.quantile(0.5) > 1e9
