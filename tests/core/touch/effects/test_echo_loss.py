import math

import numpy as np
import pytest

from palpate.core.touch.effects.echoes import EchoLoss


def plane(slope, direction):
    """A plane over the array, pressed by 1 mm in its middle, of this slope and direction, rad."""
    axis = (np.arange(16) - 7.5) * 1e-3
    along = math.cos(direction) * axis[None, :] + math.sin(direction) * axis[:, None]
    return 20e-3 + math.tan(slope) * along


@pytest.mark.parametrize("direction", np.linspace(0.0, 2 * math.pi, 7))
def test_a_plane_is_lost_when_its_amplitude_falls_below_the_threshold(
    direction, make_finger, make_touch
):
    stage = EchoLoss(angle=12.0, threshold=0.2).prepare(make_finger())
    steepest = math.radians(12.0) * math.sqrt(-math.log(0.2))
    assert math.exp(-((steepest / math.radians(12.0)) ** 2)) == pytest.approx(0.2)
    for slope, received in ((0.999 * steepest, True), (1.001 * steepest, False)):
        touch = make_touch(field=plane(slope, direction))
        stage.apply(touch, None)
        # Every taxel, at the border too, sees the slope of the plane.
        assert np.array_equal(touch.reading, touch.compression if received else np.zeros((16, 16)))


def test_the_steep_flank_of_a_ridge_is_lost_and_its_top_is_received(make_finger, make_touch):
    axis = (np.arange(16) - 7.5) * 1e-3
    field = np.maximum(1.5e-3 - axis**2 / (2 * 4e-3), 0.0)[None, :].repeat(16, axis=0)
    touch = make_touch(field=field)
    EchoLoss().prepare(make_finger()).apply(touch, None)
    slope = np.arctan(np.gradient(field, 1e-3, axis=1))
    lost = np.exp(-((slope / math.radians(15.0)) ** 2)) < 0.1
    assert lost.any() and not lost.all()
    assert np.array_equal(touch.reading == 0.0, lost | (field == 0.0))
    assert np.array_equal(touch.reading[~lost], field[~lost])


def test_the_slope_is_that_of_the_pad_and_not_of_what_array_reads(make_finger, make_touch):
    rough = np.random.default_rng(0).normal(1e-3, 1e-3, (16, 16))
    touch = make_touch(field=np.full((16, 16), 1e-3), reading=rough)
    EchoLoss().prepare(make_finger()).apply(touch, None)
    assert np.array_equal(touch.reading, rough)


def test_a_wide_lobe_loses_nothing(make_finger, make_touch):
    touch = make_touch(field=plane(1.57, 0.3))
    EchoLoss(angle=60.0, threshold=0.1).prepare(make_finger()).apply(touch, None)
    assert np.array_equal(touch.reading, touch.compression)


def test_an_array_of_forces_is_refused(make_finger):
    with pytest.raises(ValueError, match="signal is force; expected time"):
        EchoLoss().prepare(make_finger(signal="force"))
