import numpy as np
import pytest

from palpate.core.touch.effects.electronics import Transport

TOUCHES = 5000


@pytest.fixture
def sent(make_finger, make_touch, dent):
    """Delay, s, and number of copies of each of many touches."""

    def send(effect, touches=TOUCHES):
        stage, delays, copies = effect.prepare(make_finger()), [], []
        for number in range(touches):
            touch = make_touch(number, dent, time=2.0)
            stage.apply(touch, None)
            assert touch.reading is dent
            delays.append(touch.time - 2.0)
            copies.append(touch.copies)
        return np.array(delays), np.array(copies)

    return send


def test_without_losses_every_frame_takes_the_latency(sent):
    delays, copies = sent(Transport(latency=0.02, drop=0.0, duplicate=0.0), 50)
    assert np.allclose(delays, 0.02, rtol=1e-12)
    assert (copies == 1).all()


@pytest.mark.parametrize("drop", [0.05, 0.5, 0.9])
def test_the_number_of_losses_is_geometric(drop, sent):
    delays, _ = sent(Transport(latency=0.01, drop=drop, timeout=0.25))
    losses = (delays - 0.01) / 0.25
    assert np.allclose(losses, np.rint(losses), atol=1e-9)
    for count in range(4):
        chance = drop**count * (1 - drop)
        share = (np.rint(losses) == count).mean()
        assert abs(share - chance) < 5 * np.sqrt(chance * (1 - chance) / TOUCHES)
    mean, variance = drop / (1 - drop), drop / (1 - drop) ** 2
    assert abs(losses.mean() - mean) < 5 * np.sqrt(variance / TOUCHES)


def test_frames_arrive_twice_at_their_rate_and_independently_of_losses(sent):
    delays, copies = sent(Transport(latency=0.0, drop=0.5, timeout=1.0, duplicate=0.2))
    assert set(copies.tolist()) == {1, 2}
    twice, late = copies == 2, delays > 0.5
    assert abs(twice.mean() - 0.2) < 5 * np.sqrt(0.2 * 0.8 / TOUCHES)
    both = np.mean((twice - 0.2) * (late - 0.5))
    assert abs(both) < 5 * np.sqrt(0.2 * 0.8 * 0.5 * 0.5 / TOUCHES)


def test_losses_do_not_change_which_frames_arrive_twice(sent):
    lossy, sound = Transport(drop=0.9, duplicate=0.3), Transport(drop=0.0, duplicate=0.3)
    assert np.array_equal(sent(lossy, 100)[1], sent(sound, 100)[1])
