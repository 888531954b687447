from __future__ import annotations

import numpy as np
import pytest

from palpate.core.touch.calibration import Calibration

ECHO = Calibration("time", thickness=3e-3, sound_speed=1000.0, taxel_stiffness=200.0)
FORCE = Calibration("force", thickness=3e-3, sound_speed=1000.0, taxel_stiffness=200.0)


def test_an_untouched_pad_echoes_after_twice_its_thickness() -> None:
    assert np.allclose(ECHO.encode(np.zeros((2, 2))), 6e-6, rtol=1e-15)


def test_a_micrometre_of_compression_saves_two_nanoseconds() -> None:
    times = ECHO.encode(np.array([0.0, 1e-6]))
    assert np.isclose(times[0] - times[1], 2e-9, rtol=1e-6)


def test_the_difference_of_two_times_is_the_compression_of_1_1() -> None:
    t1, t2 = ECHO.encode(np.array([0.0, 0.7e-3]))
    assert 0.5 * 1000.0 * (t1 - t2) == pytest.approx(0.7e-3, rel=1e-12)


def test_force_is_stiffness_times_compression_as_in_1_2() -> None:
    assert FORCE.encode(np.array([0.7e-3]))[0] == pytest.approx(200.0 * 0.7e-3, rel=1e-15)


@pytest.mark.parametrize("sheet", [ECHO, FORCE])
def test_compression_survives_the_way_through_the_signal(sheet: Calibration) -> None:
    compression = np.random.default_rng(0).uniform(0.0, 2.4e-3, (16, 16))
    back = sheet.decode(sheet.encode(compression))
    assert np.allclose(back, compression, rtol=0, atol=2e-18)


def test_gain_and_offset_of_each_taxel_correct_what_it_says() -> None:
    gain, offset = np.array([[1.1, 0.9]]), np.array([[1e-5, -2e-5]])
    found = Calibration("time", 3e-3, 1000.0, 200.0, gain=gain, offset=offset)
    read = (np.array([[1e-3, 1e-3]]) - offset) / gain
    assert np.allclose(found.decode(ECHO.encode(read)), 1e-3, rtol=1e-12)


def test_a_wrong_speed_of_sound_is_an_error_of_thickness() -> None:
    slow = Calibration("time", 3e-3, 985.0, 200.0)
    seen = slow.decode(ECHO.encode(np.array([1e-3])))[0]
    assert seen == pytest.approx(3e-3 - 2e-3 * 985.0 / 1000.0, rel=1e-12)
