from __future__ import annotations

import random

import pytest

from palpate.launch.bench_bus import TRIALS

pytestmark = pytest.mark.graph


@pytest.mark.parametrize("name", TRIALS)
def test_nothing_is_lost(name: str) -> None:
    rng = random.Random(7)
    assert [TRIALS[name](rng) for _ in range(10)] == [0] * 10
