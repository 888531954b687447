from __future__ import annotations

import random

import pytest

from palpate.launch.bench_bus import TRIALS
from palpate.launch.bench_reliability import plain

pytestmark = pytest.mark.graph


@pytest.mark.parametrize("name", TRIALS)
def test_nothing_is_lost(name: str) -> None:
    rng = random.Random(7)
    assert [TRIALS[name](rng) for _ in range(10)] == [0] * 10


def test_a_plain_socket_loses_what_the_bus_does_not() -> None:
    assert plain(20_000, ((10, 1.5),)) > 0
