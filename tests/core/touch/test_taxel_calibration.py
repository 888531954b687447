from typing import NamedTuple

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.touch.pad import Calibration
from palpate.core.touch.taxel_calibration import DEAD_GAIN, CalibrationTouches, estimate_calibration

SHEET = Calibration("time", thickness=3e-3, sound_speed=1000.0, taxel_stiffness=200.0)
FORCE = Calibration("force", thickness=3e-3, sound_speed=1000.0, taxel_stiffness=200.0)
SIDE = 8
TAXELS = SIDE * SIDE
GRID = (np.arange(SIDE) - (SIDE - 1) / 2) * 1e-3
X, Y = (axis.ravel() for axis in np.meshgrid(GRID, GRID))


class Sensor(NamedTuple):
    """What is to be found."""

    gain: Floats
    offset: Floats
    noise: float
    pose: float
    speed: float = 1000.0

    def read(self, compression, rng):
        seen = self.gain * compression + self.offset
        received = 3e-3 - (1000.0 / self.speed) * (3e-3 - seen)
        noisy: Floats = received + self.noise * rng.standard_normal(received.shape)
        return noisy


def worn(rng, **changes):
    gain = 1 + 0.03 * rng.standard_normal(TAXELS)
    return Sensor(
        gain / gain.mean(),
        1e-5 * rng.standard_normal(TAXELS),
        **{"noise": 10e-6, "pose": 0.1e-3, **changes},
    )


def pressed(sensor, rng, touches=60):
    """Presses of a ball of 20 mm, its middle at random places, at three depths."""
    place = rng.uniform(-4e-3, 4e-3, (touches, 2, 1))
    depth = rng.choice([0.5e-3, 0.8e-3, 1.1e-3], (touches, 1))
    squared = (X - place[:, 0]) ** 2 + (Y - place[:, 1]) ** 2
    known = np.maximum(depth - squared / 0.04, 0.0)
    nuisance = sensor.pose * rng.standard_normal((touches, 1))
    true = np.where(known > 0.0, np.maximum(known + nuisance, 0.0), 0.0)
    free = sensor.read(np.zeros((40, TAXELS)), rng)
    return CalibrationTouches(known=known, read=sensor.read(true, rng), free=free)


def estimate(sensor, rng, sheet=SHEET):
    return estimate_calibration(pressed(sensor, rng), X, Y, sheet)


def test_an_ideal_sensor_needs_no_correction():
    rng = np.random.default_rng(0)
    found = estimate(Sensor(np.ones(TAXELS), np.zeros(TAXELS), 0.0, 0.0), rng)
    assert np.allclose(found.gain, 1.0, atol=1e-6)
    assert np.allclose(found.offset, 0.0, atol=1e-9)
    assert found.sound_speed == pytest.approx(1000.0, rel=1e-6)
    assert found.trusted.all() and found.reached.all()
    assert found.noise == 1e-7  # no array is taken to be quieter


def test_gains_offsets_speed_and_noise_come_out_within_their_errors():
    rng = np.random.default_rng(1)
    sensor = worn(rng, speed=1012.0)
    found = estimate(sensor, rng)
    # Standardised errors of 64 taxels: their mean square is 1 within five standard errors.
    spread = 5 * np.sqrt(2 / TAXELS)
    z = (found.gain - 1 / sensor.gain) / found.gain_error
    assert np.mean(z**2) == pytest.approx(1.0, abs=spread)
    assert abs(found.sound_speed - 1012.0) < 4 * found.sound_speed_error
    assert found.sound_speed_error < 10.0
    assert found.noise == pytest.approx(10e-6, rel=0.1)
    assert found.pose_error == pytest.approx(0.1e-3, rel=0.4)


def test_a_corrected_sensor_reads_ten_times_better():
    rng = np.random.default_rng(2)
    sensor = worn(rng, speed=1012.0)._replace(noise=2e-6)
    found = estimate(sensor, rng)
    true = np.full(TAXELS, 0.6e-3)
    raw = sensor._replace(noise=0.0).read(true, rng)
    subscriber = Calibration(
        "time", 3e-3, found.sound_speed, 200.0, gain=found.gain, offset=found.offset
    )
    corrected = subscriber.decode(SHEET.encode(raw))
    assert np.std(corrected - true) < 0.1 * np.std(raw - true)


def test_forces_say_nothing_of_the_speed_of_sound():
    rng = np.random.default_rng(3)
    found = estimate(worn(rng), rng, FORCE)
    assert (found.sound_speed, found.sound_speed_error) == (1000.0, 0.0)


def test_a_taxel_that_answers_weakly_is_trusted_down_to_a_limit():
    rng = np.random.default_rng(12)
    sensor = worn(rng, pose=0.0)
    sensor.gain[[27, 35]] = 0.9 * DEAD_GAIN, 1.1 * DEAD_GAIN
    assert np.flatnonzero(~estimate(sensor, rng).trusted).tolist() == [27]


def test_dead_and_stuck_taxels_are_not_trusted_and_do_not_spoil_the_rest():
    rng = np.random.default_rng(4)
    sensor = worn(rng)
    presses = pressed(sensor, rng)
    presses.read[:, 27], presses.free[:, 27] = 0.0, 0.0
    presses.read[:, 35], presses.free[:, 35] = 1.1e-3, 1.1e-3
    found = estimate_calibration(presses, X, Y, SHEET)
    assert np.flatnonzero(~found.trusted).tolist() == [27, 35]
    assert found.gain[[27, 35]].tolist() == [0.0, 0.0]
    others = found.trusted
    assert np.abs(found.gain - 1 / sensor.gain)[others].max() < 6 * found.gain_error[others].max()


def test_impulses_are_left_out():
    rng = np.random.default_rng(5)
    sensor = worn(rng)
    presses = pressed(sensor, rng)
    hit = rng.random(presses.read.shape) < 0.03
    presses.read[hit] = 2.4e-3
    found = estimate_calibration(presses, X, Y, SHEET)
    z = (found.gain - 1 / sensor.gain) / found.gain_error
    assert np.mean(z**2) == pytest.approx(1.0, abs=5 * np.sqrt(2 / TAXELS))


def test_a_taxel_that_was_never_pressed_has_an_offset_and_the_common_gain():
    rng = np.random.default_rng(6)
    sensor = worn(rng, speed=1012.0)
    presses = pressed(sensor, rng)
    presses.known[:, 0] = 0.0
    presses.read[:, 0] = presses.free[0, 0]
    found = estimate_calibration(presses, X, Y, SHEET)
    assert found.trusted[0] and not found.reached[0]
    assert np.isnan(found.gain_error[0])
    assert found.gain[0] == pytest.approx(1.0, rel=1e-12)
    at_rest = 3e-3 - (found.sound_speed / 1000.0) * (3e-3 - np.mean(presses.free[:, 0]))
    assert found.gain[0] * at_rest + found.offset[0] == pytest.approx(0.0, abs=1e-9)


def test_too_few_presses_are_refused():
    rng = np.random.default_rng(7)
    presses = pressed(worn(rng), rng, touches=3)
    with pytest.raises(ValueError, match="only 0 taxels answer to being pressed 4 times"):
        estimate_calibration(presses, X, Y, SHEET)


def test_coarse_steps_are_noise_too():
    rng = np.random.default_rng(8)
    sensor = worn(rng, noise=6e-6)
    presses = pressed(sensor, rng)
    step = 25e-6
    counted = CalibrationTouches(
        presses.known, step * np.rint(presses.read / step), step * np.rint(presses.free / step)
    )
    assert np.median(np.abs(counted.free - np.median(counted.free, axis=0))) == 0.0
    found = estimate_calibration(counted, X, Y, SHEET)
    assert 3e-6 < found.noise < 15e-6
    assert np.std(found.gain - 1 / sensor.gain) < 0.5 * 0.03


def test_lost_taxels_do_not_quieten_the_others():
    rng = np.random.default_rng(9)
    presses = pressed(worn(rng), rng)
    presses.read[:, ::3], presses.free[:, ::3] = 0.0, 0.0
    found = estimate_calibration(presses, X, Y, SHEET)
    assert found.noise == pytest.approx(10e-6, rel=0.1)


def test_what_cannot_be_told_from_noise_is_left_at_nothing():
    rng = np.random.default_rng(10)
    even = Sensor(np.ones(TAXELS), np.zeros(TAXELS), 10e-6, 0.1e-3)
    found = estimate(even, rng)
    assert np.std(found.gain) < 0.003
    assert np.std(found.offset) < 1.5e-6


def test_a_speed_that_is_far_off_is_found():
    rng = np.random.default_rng(11)
    found = estimate(worn(rng, speed=900.0), rng)
    assert abs(found.sound_speed - 900.0) < 4 * found.sound_speed_error
    assert found.trusted.all()


def test_offsets_are_as_sure_as_they_are_stated_to_be():
    squares = []
    for seed in range(12, 18):
        rng = np.random.default_rng(seed)
        sensor = worn(rng)
        found = estimate(sensor, rng)
        ratio = found.sound_speed / 1000.0
        true = -(3e-3 * (1.0 - ratio) + ratio * sensor.offset) * found.gain
        squares.append(np.mean(((found.offset - true) / found.offset_error) ** 2))
    # The common offset is that of 40 free frames of all taxels: far surer than one taxel's.
    assert 0.6 < np.mean(squares) < 1.5


def test_a_taxel_with_one_impulse_among_few_presses_is_kept():
    rng = np.random.default_rng(19)
    presses = pressed(worn(rng), rng)
    often = np.flatnonzero(presses.known[:, 9] > 0.2e-3)
    presses.known[often[6:], 9] = 0.0
    presses.read[often[0], 9] = 2.4e-3
    found = estimate_calibration(presses, X, Y, SHEET)
    assert found.reached[9]
    assert abs(found.gain[9] - 1.0) < 0.1
