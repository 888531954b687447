"""Gains, offsets and speed of sound, estimated from touches of known shapes."""

from typing import Any, NamedTuple

import numpy as np
import pytest

from palpate.core import touch
from palpate.core.arrays import Floats
from palpate.core.touch import Calibration, CalibrationTouches, estimate_calibration
from tests.core.touch.touches import finger

SHEET, FORCE = (finger(signal).calibration for signal in ("time", "force"))
GRID = (np.arange(8) - 3.5) * 1e-3
X, Y = (axis.ravel() for axis in np.meshgrid(GRID, GRID))


class Sensor(NamedTuple):
    """What is to be found, and touches of it."""

    gain: Floats
    offset: Floats
    noise: float
    speed: float
    touches: CalibrationTouches

    def estimate(self, sheet: Calibration = SHEET) -> touch.CalibrationEstimate:
        return estimate_calibration(self.touches, X, Y, sheet)

    def errors(self, result: touch.CalibrationEstimate) -> Floats:
        """Errors of the gains over their standard errors."""
        with np.errstate(divide="ignore"):  # of taxels that are not trusted
            return (result.gain - 1 / self.gain) / result.gain_error

    def received(self, compression: Floats) -> Floats:
        """What the data sheet makes of the signal, without noise."""
        return 3e-3 - (1000.0 / self.speed) * (3e-3 - self.gain * compression - self.offset)


def worn(
    seed: int, noise: float = 10e-6, pose: float = 0.1e-3, speed: float = 1000.0,
    spread: float = 1.0, weak: Any = None, count: int = 60,
) -> Sensor:  # fmt: skip
    """Presses of a ball of 20 mm, its middle at random places, at three depths.

    `pose`: deviation of the arm along the normal [m]. `spread`: of gains by 3 % and offsets by
    10 um. `weak`: gains of single taxels.
    """
    rng = np.random.default_rng(seed)
    gain = 1 + 0.03 * spread * rng.standard_normal(64)
    gain /= gain.mean()
    for taxel, share in (weak or {}).items():
        gain[taxel] = share
    offset, nothing = 1e-5 * spread * rng.standard_normal(64), np.zeros((0, 64))
    untouched = CalibrationTouches(known=nothing, read=nothing, free=nothing)
    sensor = Sensor(gain, offset, noise, speed, untouched)
    place = rng.uniform(-4e-3, 4e-3, (count, 2, 1))
    squared = (X - place[:, 0]) ** 2 + (Y - place[:, 1]) ** 2
    known = np.maximum(rng.choice([0.5e-3, 0.8e-3, 1.1e-3], (count, 1)) - squared / 0.04, 0.0)
    moved = np.maximum(known + pose * rng.standard_normal((count, 1)), 0.0)
    exact = [
        sensor.received(np.where(known > 0.0, moved, 0.0)),
        sensor.received(np.zeros((40, 64))),
    ]
    read, free = (one + noise * rng.standard_normal(one.shape) for one in exact)
    return sensor._replace(touches=CalibrationTouches(known=known, read=read, free=free))


def is_standard(errors: Floats) -> bool:
    """Whether the mean square of errors is 1 within five standard errors."""
    return bool(abs(np.mean(errors**2) - 1.0) < 5 * np.sqrt(2 / errors.size))


def test_ideal_sensor_needs_no_correction():
    result = worn(0, noise=0.0, pose=0.0, spread=0.0).estimate()
    assert np.allclose(result.gain, 1.0, atol=1e-6) and np.allclose(result.offset, 0.0, atol=1e-9)
    assert result.sound_speed == pytest.approx(1000.0, rel=1e-6)
    assert result.trusted.all() and result.reached.all()
    assert result.noise == 1e-7  # no array is taken to be quieter
    even = worn(10, spread=0.0).estimate()  # what noise explains stays at nothing
    assert np.std(even.gain) < 0.003 and np.std(even.offset) < 1.5e-6


@pytest.mark.parametrize("speed", [1012.0, 900.0])
def test_gains_offsets_speed_and_noise_lie_within_their_errors(speed):
    offsets = []
    for seed in range(4):
        sensor = worn(seed, speed=speed)
        result = sensor.estimate()
        assert is_standard(sensor.errors(result)) and result.trusted.all()
        assert abs(result.sound_speed - speed) < 4 * result.sound_speed_error < 40.0
        assert result.noise == pytest.approx(10e-6, rel=0.1)
        assert result.pose_error == pytest.approx(0.1e-3, rel=0.4)
        ratio = result.sound_speed / 1000.0
        read = 3e-3 - (1000.0 / speed) * (3e-3 - sensor.offset)  # of a taxel at rest
        true = -(3e-3 * (1.0 - ratio) + ratio * read) * result.gain
        offsets.append(np.mean(((result.offset - true) / result.offset_error) ** 2))
    # The common offset is that of 40 free frames of all taxels: far surer than one taxel's. In a
    # slow pad noise counts for less.
    assert 0.6 * (speed / 1000.0) ** 4 < np.mean(offsets) < 1.5


def test_forces_do_not_change_speed_of_sound():
    result = worn(3).estimate(FORCE)
    assert (result.sound_speed, result.sound_speed_error) == (1000.0, 0.0)


def test_dead_stuck_and_weak_taxels_are_not_trusted():
    sensor = worn(4, weak={11: 0.25, 12: 0.35})  # one answers by less than 0.3, one by more
    sensor.touches.read[:, 27], sensor.touches.free[:, 27] = 0.0, 0.0
    sensor.touches.read[:, 35], sensor.touches.free[:, 35] = 1.1e-3, 1.1e-3
    result = sensor.estimate()
    assert np.flatnonzero(~result.trusted).tolist() == [11, 27, 35]
    assert (result.gain[~result.trusted] == 0.0).all()
    assert (result.gain_error[~result.trusted] == 0.0).all()
    rest = result.trusted & (np.arange(64) != 12)
    assert np.abs(sensor.errors(result)[rest]).max() < 6.0
    lost = worn(9)
    lost.touches.read[:, ::3], lost.touches.free[:, ::3] = 0.0, 0.0
    assert lost.estimate().noise == pytest.approx(10e-6, rel=0.1)


def test_impulses_are_left_out():
    sensor = worn(5)
    sensor.touches.read[np.random.default_rng(5).random(sensor.touches.read.shape) < 0.03] = 2.4e-3
    assert is_standard(sensor.errors(sensor.estimate()))
    few = worn(19)
    often = np.flatnonzero(few.touches.known[:, 9] > 0.2e-3)
    few.touches.known[often[6:], 9], few.touches.read[often[0], 9] = 0.0, 2.4e-3
    result = few.estimate()
    assert result.reached[9] and abs(result.gain[9] - 1.0) < 0.1


def test_unpressed_taxel_has_the_common_gain():
    touches = worn(6, speed=1012.0).touches
    touches.known[:, 0] = 0.0
    touches.read[:, 0] = touches.free[0, 0]
    result = estimate_calibration(touches, X, Y, SHEET)
    assert result.trusted[0] and not result.reached[0] and np.isnan(result.gain_error[0])
    assert result.gain[0] == pytest.approx(1.0, rel=1e-12)
    at_rest = 3e-3 - (result.sound_speed / 1000.0) * (3e-3 - np.mean(touches.free[:, 0]))
    assert result.gain[0] * at_rest + result.offset[0] == pytest.approx(0.0, abs=1e-9)


def test_too_few_presses_are_refused():
    with pytest.raises(ValueError, match="only 0 taxels respond to 4 presses"):
        worn(7, count=3).estimate()


def test_noise_includes_coarse_quantisation():
    sensor, step = worn(8, noise=6e-6), 25e-6
    known, read, free = sensor.touches
    counted = CalibrationTouches(known, step * np.rint(read / step), step * np.rint(free / step))
    assert np.median(np.abs(counted.free - np.median(counted.free, axis=0))) == 0.0
    result = estimate_calibration(counted, X, Y, SHEET)
    assert 3e-6 < result.noise < 15e-6 and np.std(result.gain - 1 / sensor.gain) < 0.5 * 0.03
