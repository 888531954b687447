import numpy as np
import pytest

from palpate.core.touch.effects.electronics import SaltAndPepper

FULL_SCALE = 0.8 * 3e-3


@pytest.mark.parametrize("rate", [0.01, 0.2, 1.0])
def test_impulses_come_at_their_rate_half_of_them_each_way(rate, make_finger, readings):
    field = np.full((16, 16), 1e-3)
    found = readings(SaltAndPepper(rate=rate).prepare(make_finger()), field, 200)
    salt, pepper = np.isclose(found, FULL_SCALE, rtol=1e-14), found == 0.0
    assert ((found == 1e-3) | salt | pepper).all()
    error = 5 * np.sqrt(rate / 2 * (1 - rate / 2) / found.size)
    assert abs(salt.mean() - rate / 2) < error
    assert abs(pepper.mean() - rate / 2) < error


def test_impulses_of_neighbours_and_of_successive_touches_are_independent(make_finger, readings):
    rate = 0.2
    found = readings(SaltAndPepper(rate=rate).prepare(make_finger()), np.full((16, 16), 1e-3), 200)
    struck = (found != 1e-3) - rate
    for here, there in [(struck[1:], struck[:-1]), (struck[:, :, 1:], struck[:, :, :-1])]:
        # The product of two independent ones has the product of their variances.
        assert abs(np.mean(here * there)) < 5 * rate * (1 - rate) / np.sqrt(here.size)


def test_the_same_taxels_are_struck_whatever_was_touched(make_finger, readings, dent):
    stage = SaltAndPepper(rate=0.3).prepare(make_finger())
    low, high = (readings(stage, field, 3) for field in (dent + 1e-5, dent + 2e-5))
    untouched = np.isclose(high - low, 1e-5, rtol=1e-6)
    assert 0.6 < untouched.mean() < 0.8
    assert np.array_equal(high[~untouched], low[~untouched])
