import random

import pytest

from tests.studies.losses import LOSS_TRIALS, lost_over_plain

pytestmark = pytest.mark.graph


@pytest.mark.parametrize("trials", [3, pytest.param(10, marks=pytest.mark.slow)])
@pytest.mark.parametrize("name", LOSS_TRIALS)
def test_nothing_is_lost(name, trials):
    rng = random.Random(7)
    assert [LOSS_TRIALS[name](rng) for _ in range(trials)] == [0] * trials


def test_a_plain_socket_loses_what_the_bus_does_not():
    assert lost_over_plain(20_000, ((10, 0.8),)) > 0
