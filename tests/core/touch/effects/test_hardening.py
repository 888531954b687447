import numpy as np
import pytest

from palpate.core.touch.effects.rubber import Hardening


def hardened(finger, touch, strength=1.0):
    Hardening(strength=strength).prepare(finger).apply(touch, None)
    return touch.pressure


def test_pressure_follows_the_formula(make_finger, make_touch):
    strain = np.linspace(0.0, 0.95, 256).reshape(16, 16)
    touch = make_touch(field=strain * 3e-3)
    before = touch.pressure
    expected = before * (1.0 + 0.7 * strain**2 / (1.0 - strain))
    assert np.allclose(hardened(make_finger(), touch, 0.7), expected, rtol=1e-13)
    assert np.array_equal(touch.compression, strain * 3e-3)


def test_half_strain_adds_half_the_pressure(make_finger, make_touch):
    touch = make_touch(field=np.full((16, 16), 1.5e-3))
    assert np.allclose(hardened(make_finger(), touch), 1.5 * 2e8 * 1.5e-3, rtol=1e-14)


def test_small_strains_are_linear_to_second_order(make_finger, make_touch):
    excess = []
    for strain in (1e-3, 2e-3):
        touch = make_touch(field=np.full((16, 16), strain * 3e-3))
        before = touch.pressure[0, 0]
        excess.append(hardened(make_finger(), touch)[0, 0] / before - 1.0)
    assert excess[1] / excess[0] == pytest.approx(4.0, rel=2e-3)


def test_pressure_stays_finite_where_nothing_of_the_pad_is_left(make_finger, make_touch):
    strain = np.linspace(0.9, 1.1, 256).reshape(16, 16)
    pressure = hardened(make_finger(), make_touch(field=strain * 3e-3)).ravel()
    assert np.isfinite(pressure).all()
    assert (np.diff(pressure) > 0.0).all()
