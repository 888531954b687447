from __future__ import annotations

import random

import pytest

from palpate.bench.bus.losses import LOSS_TRIALS, lost_over_plain

pytestmark = pytest.mark.graph


@pytest.mark.parametrize("name", LOSS_TRIALS)
def test_nothing_is_lost(name):
    rng = random.Random(7)
    assert [LOSS_TRIALS[name](rng) for _ in range(10)] == [0] * 10


def test_a_plain_socket_loses_what_the_bus_does_not():
    assert lost_over_plain(20_000, ((10, 1.5),)) > 0
