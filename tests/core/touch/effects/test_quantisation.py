import numpy as np
import pytest

from palpate.core.touch.effects.electronics import Quantisation


@pytest.mark.parametrize(
    ("given", "step"),
    [({"clock": 20e6}, 25e-6), ({"clock": 1e9}, 0.5e-6), ({}, 5e-6), ({"bits": 8}, 3e-3 / 256)],
)
def test_the_error_is_uniform_over_one_step(given, step, make_finger, readings):
    field = np.random.default_rng(0).uniform(0.2e-3, 2e-3, (16, 16))
    stage = Quantisation(**given).prepare(make_finger())
    (found,) = readings(stage, field, 1)
    error = (found - field) / step
    assert np.abs(error).max() <= 0.5 + 1e-9
    # Uniform: mean 0, variance 1/12, whose own variance is 1/180.
    assert abs(error.mean()) < 5 * np.sqrt(1 / 12 / error.size)
    assert abs(error.var() - 1 / 12) < 5 * np.sqrt(1 / 180 / error.size)
    assert stage.noise == pytest.approx(step / np.sqrt(12))


def test_a_clock_counts_whole_ticks_of_the_time_that_is_sent(make_finger, readings, dent):
    finger = make_finger(thickness=3.01e-3)
    (found,) = readings(Quantisation(clock=30e6).prepare(finger), dent, 1)
    ticks = finger.calibration.encode(found) * 30e6
    assert np.allclose(ticks, np.rint(ticks), rtol=0.0, atol=1e-9)
    assert np.abs(ticks - finger.calibration.encode(dent) * 30e6).max() <= 0.5 + 1e-9


def test_a_converter_counts_from_no_compression(make_finger, readings, dent):
    finger = make_finger(signal="force")
    (found,) = readings(Quantisation(bits=6).prepare(finger), dent, 1)
    codes = found / (3e-3 / 64)
    assert np.allclose(codes, np.rint(codes), rtol=0.0, atol=1e-12)
    assert (found[dent == 0.0] == 0.0).all()


def test_readings_that_are_rounded_stay_when_they_are_rounded_again(make_finger, readings, dent):
    stage = Quantisation().prepare(make_finger())
    (once,) = readings(stage, dent, 1)
    (twice,) = readings(stage, once, 1)
    assert np.array_equal(once, twice)


def test_a_clock_and_a_converter_together_are_refused():
    with pytest.raises(ValueError, match=r"clock is 2e\+07 Hz and bits is 8; expected one"):
        Quantisation(clock=20e6, bits=8)


@pytest.mark.parametrize("given", [{}, {"clock": 20e6}])
def test_a_clock_that_would_count_forces_is_refused(given, make_finger):
    with pytest.raises(ValueError, match="signal is force; expected bits"):
        Quantisation(**given).prepare(make_finger(signal="force"))
