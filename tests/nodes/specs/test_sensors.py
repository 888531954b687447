from __future__ import annotations

import pytest

from palpate.nodes.specs.sensors import SensorSpec, data_sheet


def test_a_taxel_is_as_stiff_as_the_pad_over_its_area():
    sensor = SensorSpec(pitch=0.0005)
    assert data_sheet(sensor).taxel_stiffness == pytest.approx(sensor.pad.stiffness * 0.25e-6)
