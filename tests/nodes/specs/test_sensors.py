from __future__ import annotations

import numpy as np
import pytest

from palpate.nodes.specs.sensors import (
    PadSpec,
    SensorSpec,
    calibration_of_info,
    data_sheet,
    info_of,
)


def test_a_taxel_is_as_stiff_as_the_pad_over_its_area():
    sensor = SensorSpec(pitch=0.0005)
    assert data_sheet(sensor).taxel_stiffness == pytest.approx(sensor.pad.stiffness * 0.25e-6)


@pytest.mark.parametrize("signal", ["time", "force"])
def test_without_a_calibration_subscribers_read_by_the_data_sheet(signal):
    """An echo goes there and back through what is left of the pad; a force is a spring's."""
    sensor = SensorSpec(signal=signal, pad=PadSpec(thickness=0.004, sound_speed=900.0))
    sheet, received = data_sheet(sensor), calibration_of_info(info_of(sensor, 0.0))
    pressed = np.linspace(0.0, 3e-3, 256).reshape(16, 16)
    stiffness = sensor.pad.stiffness * sensor.pitch**2
    sent = 2.0 * (0.004 - pressed) / 900.0 if signal == "time" else stiffness * pressed
    for calibration in (sheet, received):
        np.testing.assert_allclose(calibration.encode(pressed), sent, rtol=1e-12)
        np.testing.assert_allclose(calibration.decode(sent), pressed, atol=1e-15)
