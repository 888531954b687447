import numpy as np
import pytest

from palpate.core.touch.effects.electronics import DeadTaxels


def test_dead_and_stuck_taxels_come_at_their_rates(make_finger, readings):
    effect, field = DeadTaxels(rate=0.1, stuck=0.05), np.full((16, 16), -1.0)
    found = np.array(
        [readings(effect.prepare(make_finger(number=n)), field, 1)[0] for n in range(1, 41)]
    )
    dead, stuck = found == 0.0, found > 0.0
    for share, rate in ((dead.mean(), 0.1), (stuck.mean(), 0.05)):
        assert abs(share - rate) < 5 * np.sqrt(rate * (1 - rate) / found.size)
    # Uniform from 0 to full scale: the mean is the half, the variance a twelfth.
    level = found[stuck] / (0.8 * 3e-3)
    assert level.max() < 1.0
    assert abs(level.mean() - 0.5) < 5 * np.sqrt(1 / 12 / level.size)
    assert abs(level.var() - 1 / 12) < 5 * np.sqrt(1 / 180 / level.size)


def test_the_same_taxels_stay_broken_in_the_same_way(make_finger, readings, dent):
    stage = DeadTaxels(rate=0.1, stuck=0.1).prepare(make_finger())
    first, other = readings(stage, dent + 1e-5, 3), readings(stage, dent + 2e-5, 3)
    assert (first == first[0]).all()
    broken = first[0] == other[0]
    assert np.array_equal(first[0][~broken], (dent + 1e-5)[~broken])
    assert 20 < broken.sum() < 90


def test_taxels_that_are_dead_stay_dead_when_others_are_stuck(make_finger, readings):
    field = np.full((16, 16), -1.0)
    (some,) = readings(DeadTaxels(rate=0.1).prepare(make_finger()), field, 1)
    (more,) = readings(DeadTaxels(rate=0.1, stuck=0.2).prepare(make_finger()), field, 1)
    assert np.array_equal(some == 0.0, more == 0.0)


def test_more_than_all_taxels_are_refused():
    with pytest.raises(ValueError, match=r"rate and stuck are 1\.1 together; expected 0 to 1"):
        DeadTaxels(rate=0.6, stuck=0.5)
    assert DeadTaxels(rate=0.5, stuck=0.5).rate == 0.5
