"""Electronics and line: patterns of taxels, noise, impulses, steps, and late frames."""

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.touch import Fingertip, KeyedRandom
from tests.core.touch.touches import DENT, finger, readings, stage, touch

FULL_SCALE = 0.8 * 3e-3
LEVEL: Floats = np.full((16, 16), 1e-3)


def is_share(result: Floats, share: float) -> bool:
    """Whether events come at a rate, within five standard errors."""
    return bool(abs(result.mean() - share) < 5 * np.sqrt(share * (1 - share) / result.size) + 1e-15)


def assert_white(noise: Floats) -> None:
    """Zero mean, unit variance, and no correlation of (touches, rows, cols) along any axis."""
    assert abs(noise.mean()) < 5 / np.sqrt(noise.size)
    # The variance of a normal sample has a relative standard error of sqrt(2 / n).
    assert abs(noise.var() - 1.0) < 5 * np.sqrt(2 / noise.size)
    for axis in range(noise.ndim):
        along = np.moveaxis(noise, axis, 0)
        assert abs(np.mean(along[1:] * along[:-1])) < 5 / np.sqrt(along[1:].size)


def test_gains_and_offsets_are_a_white_pattern_that_stays():
    gains, offsets = [], []
    for number in range(1, 21):
        made = stage("gain_offset", finger(number=number), sigma_gain=0.05, sigma_offset=20e-6)
        (offset,), result = readings(made, 0.0 * LEVEL, 1), readings(made, LEVEL, 3)
        assert (result == result[0]).all()
        gain = (result[0] - offset) / 1e-3  # and what is read is linear in the compression
        assert np.allclose(readings(made, DENT, 1)[0], gain * DENT + offset, rtol=1e-12)
        gains.append((gain - 1.0) / 0.05)
        offsets.append(offset / 20e-6)
    assert_white(np.array(gains))
    assert_white(np.array(offsets))
    assert abs(np.mean(np.array(gains) * offsets)) < 5 / np.sqrt(20 * 256)


def test_gaussian_noise_is_white_and_normal():
    made = stage("gaussian_noise", sigma=20e-6)
    noise = (readings(made, DENT, 200) - DENT) / 20e-6
    assert_white(noise)
    # Skewness and kurtosis of a normal sample have variances of 6 / n and 24 / n.
    assert abs(np.mean(noise**3)) < 5 * np.sqrt(15 / noise.size)
    assert abs(np.mean(noise**4) - 3.0) < 5 * np.sqrt(96 / noise.size)
    assert made.noise == 20e-6  # a calibration finds it as it is


def walked(tip: Fingertip, times: Floats) -> Floats:
    """Zeros of the taxels after each of these times, (touches, rows, cols)."""
    return readings(stage("drift", tip, rate=2e-6), 0.0 * LEVEL, len(times), times)


def test_drift_is_a_random_walk_in_robot_time():
    waits = np.tile([0.5, 2.0, 1.0], 60)
    zeros = walked(finger(), np.cumsum(waits))
    assert_white(np.diff(zeros, axis=0, prepend=0.0) / (2e-6 * np.sqrt(waits)[:, None, None]))
    draws = KeyedRandom(finger(), "drift")
    drawn = [draws.of_touch(number).standard_normal((16, 16)) for number in range(3)]
    steps = 2e-6 * np.sqrt(waits[:3])[:, None, None] * drawn
    np.testing.assert_allclose(zeros[:3], np.cumsum(steps, axis=0), rtol=1e-12, atol=0.0)
    assert (walked(finger(), np.zeros(3)) == 0.0).all()
    # From 0 on: the variance after t is rate^2 t.
    last = np.array([walked(finger(number=n), np.array([3.0, 100.0]))[1] for n in range(1, 9)])
    assert abs(last.var() / (4e-12 * 100.0) - 1.0) < 5 * np.sqrt(2 / last.size)


@pytest.mark.parametrize("rate", [0.01, 0.2, 1.0])
def test_impulses_have_their_rate_and_both_signs(rate):
    result = readings(stage("salt_and_pepper", rate=rate), LEVEL, 200)
    salt, pepper = np.isclose(result, FULL_SCALE, rtol=1e-14), result == 0.0
    assert ((result == 1e-3) | salt | pepper).all()
    assert is_share(salt, rate / 2) and is_share(pepper, rate / 2)
    if rate == 0.2:
        assert_white((result != 1e-3) / 0.4 - 0.5)  # unit variance: 0.2 of 0.8 is 0.4 squared


def test_dead_and_stuck_taxels_come_at_their_rates():
    tips = [finger(number=number) for number in range(1, 41)]
    options = {"rate": 0.1, "stuck": 0.05}
    stages = [stage("dead_taxels", tip, **options) for tip in tips]
    result = np.array([readings(made, -LEVEL, 1)[0] for made in stages])
    dead, stuck = result == 0.0, result > 0.0
    assert is_share(dead, 0.1) and is_share(stuck, 0.05)
    # Uniform from 0 to full scale: the mean is the half, the variance a twelfth.
    level = result[stuck] / FULL_SCALE
    assert level.max() < 1.0 and abs(level.mean() - 0.5) < 5 * np.sqrt(1 / 12 / level.size)
    assert abs(level.var() - 1 / 12) < 5 * np.sqrt(1 / 180 / level.size)
    alone = [readings(stage("dead_taxels", tip, rate=0.1), -LEVEL, 1)[0] for tip in tips]
    assert np.array_equal(np.array(alone) == 0.0, dead)  # the dead are the same without stuck ones
    later = readings(stage("dead_taxels", tips[0], **options), DENT + 1e-5, 3)  # and stay alike
    broken = dead[0] | stuck[0]
    assert (later == np.where(broken, result[0], DENT + 1e-5)).all()


@pytest.mark.parametrize(
    ("options", "signal", "step"),
    [
        ({"clock": 20e6}, "time", 25e-6),
        ({"clock": 1e9}, "time", 0.5e-6),
        ({"clock": 30e6}, "time", 1e-3 / 60),
        ({}, "time", 5e-6),
        ({"bits": 8}, "time", 3.01e-3 / 256),
        ({"bits": 6}, "force", 3.01e-3 / 64),
    ],
)
def test_quantisation_rounds_to_the_nearest_tick_or_step(options, signal, step):
    field = np.random.default_rng(0).uniform(0.2e-3, 2e-3, (16, 16))
    tip = finger(signal, thickness=3.01e-3)
    made = stage("quantisation", tip, **options)
    (result,) = readings(made, field, 1)
    error = (result - field) / step
    assert np.abs(error).max() <= 0.5 + 1e-9
    # Uniform: mean 0, variance 1/12, whose own variance is 1/180.
    assert abs(error.mean()) < 5 * np.sqrt(1 / 12 / error.size)
    assert abs(error.var() - 1 / 12) < 5 * np.sqrt(1 / 180 / error.size)
    assert made.noise == pytest.approx(step / np.sqrt(12))
    assert np.array_equal(readings(made, result, 1)[0], result)  # and rounded again it stays
    # Clocks count ticks, and converters steps.
    codes = result / step if "bits" in options else tip.calibration.encode(result) * 500.0 / step
    assert np.allclose(codes, np.rint(codes), rtol=0.0, atol=1e-9)


def sent(touches: int = 5000, **parameters: float) -> tuple[Floats, Floats]:
    """Delay [s] and number of copies of each of many touches."""
    made, result = stage("transport", **parameters), []
    for number in range(touches):
        contact = touch(number, DENT, time=2.0)
        made.apply(contact, None)
        assert contact.reading is DENT
        result.append((contact.time - 2.0, contact.copies))
    delays, copies = np.array(result).T
    return delays, copies


@pytest.mark.parametrize("drop", [0.05, 0.5, 0.9])
def test_losses_are_geometric(drop):
    losses = (sent(latency=0.01, drop=drop, timeout=0.25)[0] - 0.01) / 0.25
    assert np.allclose(losses, np.rint(losses), atol=1e-9)
    for count in range(4):
        assert is_share(np.rint(losses) == count, drop**count * (1 - drop))
    mean, variance = drop / (1 - drop), drop / (1 - drop) ** 2
    assert abs(losses.mean() - mean) < 5 * np.sqrt(variance / losses.size)


def test_copies_come_at_their_rate_independently_of_losses():
    delays, copies = sent(latency=0.0, drop=0.5, timeout=1.0, duplicate=0.2)
    twice, late = copies == 2, delays > 0.5
    assert set(copies) == {1, 2} and is_share(twice, 0.2)
    both = np.mean((twice - 0.2) * (late - 0.5))
    assert abs(both) < 5 * np.sqrt(0.2 * 0.8 * 0.5 * 0.5 / len(copies))
    lossy, sound = sent(100, drop=0.9, duplicate=0.3), sent(100, drop=0.0, duplicate=0.3)
    assert np.array_equal(lossy[1], sound[1])
