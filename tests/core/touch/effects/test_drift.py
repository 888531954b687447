import numpy as np

from palpate.core.touch.effects.electronics import Drift
from palpate.core.touch.pipeline import KeyedRandom


def walked(finger, make_touch, times, rate=2e-6):
    """Zeros after each of these times, (touches, rows * cols)."""
    stage = Drift(rate=rate).prepare(finger)
    state, found = stage.state, []
    for number, time in enumerate(times.tolist()):
        touch = make_touch(number, np.zeros((finger.pad.rows, finger.pad.cols)), time=time)
        state = stage.apply(touch, state)
        found.append(touch.reading.ravel())
    return np.array(found)


def test_the_variance_grows_as_time_does(make_finger, make_touch):
    times = np.array([1.0, 4.0, 20.0, 100.0, 300.0])
    zeros = np.concatenate(
        [walked(make_finger(number=number), make_touch, times) for number in range(1, 9)], axis=1
    )
    ratio = zeros.var(axis=1) / (2e-6**2 * times)
    assert (np.abs(ratio - 1.0) < 5 * np.sqrt(2 / zeros.shape[1])).all()


def test_steps_are_independent_and_as_long_as_their_time(make_finger, make_touch):
    waits = np.tile([0.5, 2.0, 1.0], 60)
    zeros = walked(make_finger(), make_touch, np.cumsum(waits))
    steps = np.diff(zeros, axis=0, prepend=0.0) / (2e-6 * np.sqrt(waits)[:, None])
    assert abs(steps.var() - 1.0) < 5 * np.sqrt(2 / steps.size)
    for lag in (1, 2, 3):
        assert abs(np.mean(steps[lag:] * steps[:-lag])) < 5 / np.sqrt(steps[lag:].size)
    neighbours = steps.reshape(-1, 16, 16)
    assert abs(np.mean(neighbours[:, :, 1:] * neighbours[:, :, :-1])) < 5 / np.sqrt(steps.size)


def test_no_time_no_drift(make_finger, make_touch):
    assert (walked(make_finger(), make_touch, np.zeros(3)) == 0.0).all()


def test_a_step_does_not_depend_on_what_was_touched(make_finger, make_touch, dent):
    stage = Drift().prepare(make_finger())
    hit, miss = make_touch(3, dent, time=5.0), make_touch(3, 0.0 * dent, outcome="miss", time=5.0)
    assert np.array_equal(stage.apply(hit, stage.state)[1], stage.apply(miss, stage.state)[1])


def test_a_zero_goes_on_by_what_is_drawn_for_the_touch(make_finger, make_touch):
    finger, times = make_finger(), np.array([4.0, 5.0, 14.0])
    draws = KeyedRandom(finger, "drift")
    drawn = [draws.of_touch(number).standard_normal(256) for number in range(3)]
    steps = 2e-6 * np.array([[2.0], [1.0], [3.0]]) * drawn
    found = walked(finger, make_touch, times)
    np.testing.assert_allclose(found, np.cumsum(steps, axis=0), rtol=1e-12, atol=0.0)
