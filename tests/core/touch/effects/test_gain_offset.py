import numpy as np

from palpate.core.touch.effects.electronics import GainOffset


def test_gains_and_offsets_have_the_asked_deviations(make_finger, readings):
    gains, offsets = [], []
    for number in range(1, 21):
        stage = GainOffset(sigma_gain=0.05, sigma_offset=20e-6).prepare(make_finger(number=number))
        (offset,) = readings(stage, np.zeros((16, 16)), 1)
        (reading,) = readings(stage, np.full((16, 16), 1e-3), 1)
        gains.append((reading - offset) / 1e-3 - 1.0)
        offsets.append(offset)
    for drawn, sigma in ((np.array(gains), 0.05), (np.array(offsets), 20e-6)):
        assert abs(drawn.mean()) < 5 * sigma / np.sqrt(drawn.size)
        assert abs(drawn.var() / sigma**2 - 1.0) < 5 * np.sqrt(2 / drawn.size)
    together = np.mean(np.array(gains) / 0.05 * np.array(offsets) / 20e-6)
    assert abs(together) < 5 / np.sqrt(20 * 256)


def test_they_stay_the_same_in_every_touch(make_finger, readings, dent):
    found = readings(GainOffset().prepare(make_finger()), dent, 5)
    assert (found == found[0]).all()


def test_the_reading_is_linear_in_the_compression(make_finger, readings, dent):
    stage = GainOffset().prepare(make_finger())
    (one,), (two,), (none,) = (readings(stage, scale * dent, 1) for scale in (1.0, 2.0, 0.0))
    assert np.allclose(two - none, 2 * (one - none), rtol=1e-12, atol=1e-18)
