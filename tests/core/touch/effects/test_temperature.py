import math

import numpy as np
import pytest

from palpate.core.touch.effects.echoes import Temperature


def warmed(effect, finger, touch):
    effect.prepare(finger).apply(touch, None)
    return touch.reading


def test_the_time_that_is_sent_is_that_of_the_slower_sound(make_finger, make_touch, dent):
    finger = make_finger()
    reading = warmed(Temperature(rise=10.0), finger, make_touch(field=dent))
    times = finger.calibration.encode(reading)
    assert np.allclose(times, 2 * (3e-3 - dent) / 970.0, rtol=1e-14)


def test_a_new_zero_leaves_only_the_scale(make_finger, make_touch, dent):
    effect = Temperature(rise=10.0, rezeroed=True)
    reading = warmed(effect, make_finger(), make_touch(field=dent))
    # (1.1) with both times at the true speed and the nominal speed in front.
    times = 2 * 3e-3 / 970.0, 2 * (3e-3 - dent) / 970.0
    assert np.allclose(reading, 1000.0 * (times[0] - times[1]) / 2, rtol=1e-12, atol=1e-18)


def test_five_kelvin_are_forty_six_micrometres_at_rest(make_finger, make_touch):
    reading = warmed(Temperature(), make_finger(), make_touch(field=np.zeros((16, 16))))
    assert np.allclose(reading, -3e-3 * (1000 / 985 - 1), rtol=1e-12)
    assert -reading[0, 0] == pytest.approx(46e-6, rel=0.01)


@pytest.mark.parametrize("time", [0.0, 30.0, 600.0, 1e9])
def test_the_pad_warms_up_exponentially(time, make_finger, make_touch, dent):
    finger = make_finger()
    effect = Temperature(rise=8.0, warm_up=300.0)
    reading = warmed(effect, finger, make_touch(field=dent, time=time))
    speed = 1000.0 - 3.0 * 8.0 * (1.0 - math.exp(-time / 300.0))
    times = finger.calibration.encode(reading)
    assert np.allclose(times, 2 * (3e-3 - dent) / speed, rtol=1e-13)


def test_an_array_of_forces_is_refused(make_finger):
    with pytest.raises(ValueError, match="signal is force; expected time"):
        Temperature().prepare(make_finger(signal="force"))


def test_sound_that_would_lose_half_its_speed_is_refused(make_finger):
    with pytest.raises(ValueError, match="rise times coefficient is -600 m/s; expected more than"):
        Temperature(rise=60.0, coefficient=-10.0).prepare(make_finger())
    with pytest.raises(ValueError, match="rise times coefficient is -500 m/s"):
        Temperature(rise=50.0, coefficient=-10.0).prepare(make_finger())
    Temperature(rise=49.9, coefficient=-10.0).prepare(make_finger())
