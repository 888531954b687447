import numpy as np
import pytest

from palpate.core.touch.effects.rubber import Saturation


def test_compression_and_pressure_are_clipped_where_they_are_too_large(
    make_finger, make_touch, dent
):
    touch = make_touch(field=dent)
    Saturation(share=0.2).prepare(make_finger()).apply(touch, None)
    assert np.allclose(touch.compression, np.minimum(dent, 0.6e-3), rtol=1e-15, atol=0.0)
    assert np.allclose(touch.pressure, 2e8 * touch.compression, rtol=1e-14)
    assert touch.compression.max() == pytest.approx(0.6e-3)


def test_a_hit_that_was_clipped_has_bottomed(make_finger, make_touch, dent):
    stage = Saturation(share=0.3).prepare(make_finger())
    for deepest, before, after in [
        (0.89e-3, "hit", "hit"),
        (0.91e-3, "hit", "bottomed"),
        (0.91e-3, "bottomed", "bottomed"),
        (0.0, "miss", "miss"),
        (0.0, "inside", "inside"),
    ]:
        touch = make_touch(field=dent / dent.max() * deepest, outcome=before)
        stage.apply(touch, None)
        assert touch.outcome == after


def test_a_hardened_pressure_falls_in_proportion(make_finger, make_touch, dent):
    touch = make_touch(field=dent, pressure=7e8 * dent**2)
    Saturation(share=0.2).prepare(make_finger()).apply(touch, None)
    expected = (
        7e8
        * dent**2
        * np.divide(np.minimum(dent, 0.6e-3), dent, out=np.ones_like(dent), where=dent > 0)
    )
    assert np.allclose(touch.pressure, expected, rtol=1e-14)
