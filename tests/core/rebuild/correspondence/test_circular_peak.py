from __future__ import annotations

import numpy as np
import pytest

from palpate.core.rebuild.correspondence.circular_peak import circular_peak


def test_peaks_are_found_between_samples_and_across_the_seam() -> None:
    peaks = np.array([0.3, 0.7012, 0.0, 0.9995])
    turns = np.arange(128) / 128
    values = np.cos(2 * np.pi * (turns - peaks[:, None]))
    off = circular_peak(values) - peaks
    assert np.abs(off - np.round(off)).max() < 1e-5


def test_a_peak_is_sought_at_the_sample_that_is_named() -> None:
    values = np.zeros((1, 16))
    values[0, [3, 9, 10]] = [5.0, 2.0, 1.0]
    assert circular_peak(values)[0] == 3 / 16
    assert 9 / 16 < circular_peak(values, np.array([9]))[0] < 10 / 16


def test_a_function_without_a_peak_gives_a_sample() -> None:
    assert circular_peak(np.ones((1, 8)))[0] == pytest.approx(0.0)
