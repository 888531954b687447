from __future__ import annotations

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.touch.keyed_random import KeyedRandom
from palpate.core.touch.pipeline import Fingertip


def drawn(finger: Fingertip, name: str, number: int) -> Floats:
    return KeyedRandom(finger, name).of_touch(number).standard_normal(4096)


def test_a_touch_can_be_drawn_again_after_any_other(make_finger) -> None:
    draws = KeyedRandom(make_finger(), "drift")
    first = draws.of_touch(5).standard_normal(100)
    draws.once().random(7)
    draws.of_touch(6).integers(0, 9, size=3, dtype=np.uint32)  # leaves half a word over
    assert np.array_equal(draws.of_touch(5).standard_normal(100), first)
    assert np.array_equal(drawn(make_finger(), "drift", 5)[:100], first)


def test_what_is_drawn_once_is_apart_from_every_touch(make_finger) -> None:
    draws = KeyedRandom(make_finger(), "drift")
    once = draws.once().random(10_000)
    again = draws.once().random(10_000)
    first = draws.of_touch(0).random(10_000)
    assert np.array_equal(once, again)
    assert not np.intersect1d(once, first).size


def test_seed_finger_effect_and_touch_each_give_other_numbers(make_finger) -> None:
    samples = [
        drawn(make_finger(), "drift", 3),
        drawn(make_finger(seed=8), "drift", 3),
        drawn(make_finger(number=2), "drift", 3),
        drawn(make_finger(), "gaussian_noise", 3),
        drawn(make_finger(), "drift", 4),
    ]
    # The correlation of independent samples has a standard error of 1 / sqrt(n).
    correlations = np.corrcoef(samples) - np.eye(len(samples))
    assert np.abs(correlations).max() < 5 / np.sqrt(4096)


def test_numbers_of_successive_touches_are_independent(make_finger) -> None:
    draws = KeyedRandom(make_finger(), "drift")
    series = np.array([draws.of_touch(number).standard_normal() for number in range(4096)])
    for lag in (1, 2, 3):
        assert abs(np.mean(series[lag:] * series[:-lag])) < 5 / np.sqrt(4096)
    assert abs(series.mean()) < 5 / np.sqrt(4096)
    assert abs(series.var() - 1.0) < 5 * np.sqrt(2 / 4096)
