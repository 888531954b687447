from __future__ import annotations

import numpy as np

from palpate.core.touch.calibration import compression_from_times, flight_times


def test_an_untouched_pad_echoes_after_twice_its_thickness() -> None:
    assert np.allclose(flight_times(np.zeros((2, 2)), 3e-3, 1000.0), 6e-6, rtol=1e-15)


def test_a_micrometre_of_compression_saves_two_nanoseconds() -> None:
    times = flight_times(np.array([0.0, 1e-6]), 3e-3, 1000.0)
    assert np.isclose(times[0] - times[1], 2e-9, rtol=1e-6)


def test_compression_survives_the_way_through_times() -> None:
    compression = np.random.default_rng(0).uniform(0.0, 2.4e-3, (16, 16))
    for thickness, speed in ((3e-3, 1000.0), (5e-3, 1616.0)):
        times = flight_times(compression, thickness, speed)
        back = compression_from_times(times, thickness, speed)
        assert np.allclose(back, compression, rtol=0, atol=1e-17)
