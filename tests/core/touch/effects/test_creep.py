import math
from itertools import pairwise

import numpy as np
import pytest

from palpate.core.touch.effects.rubber import Creep
from palpate.core.touch.pipeline import assemble

SHARE, TAU = 0.2, 0.5


def press(
    make_touch,
    field,
    rest=1.0,
    loading=0.1,
    dwell=0.3,
    way_back=0.0,
):
    """A touch with these times, which begins at 0."""
    time = rest + loading + dwell + way_back
    return make_touch(
        0, field, rest=rest, loading=loading, dwell=dwell, time=time, previous=0.0, begun=0.0
    )


@pytest.fixture
def feel(make_finger):
    """What is measured in each of these touches, one after the other."""

    def follow(touches):
        stage = Creep(share=SHARE, tau=TAU).prepare(make_finger())
        state = stage.state
        for touch in touches:
            state = stage.apply(touch, state)
        return [touch.compression for touch in touches]

    return follow


def integrated(touches, depths, taus=TAU):
    """What is measured by small steps of the equation, q' = -q / tau + c'."""
    found, q, step = [], 0.0, 1e-4
    for touch, depth in zip(touches, depths, strict=True):
        back = touch.time - touch.previous - touch.rest - touch.loading - touch.dwell
        for kind, duration in enumerate((touch.rest, touch.loading, touch.dwell, back)):
            if kind == 3:
                found.append((1 - SHARE) * depth + SHARE * q)
                q -= depth  # let go at once
            rate = depth / touch.loading if kind == 1 else 0.0
            for _ in range(round(duration / step)):  # midpoint rule
                middle = q + 0.5 * step * (rate - q / taus)
                q += step * (rate - middle / taus)
    return found


def test_a_series_of_touches_follows_the_equation(make_touch, feel):
    times = [
        (1.0, 0.1, 0.3, 0.2),
        (0.2, 0.05, 0.1, 0.1),
        (0.3, 0.2, 0.0, 0.4),
        (0.1, 0.1, 1.0, 0.0),
    ]
    depths = [1e-3, 0.4e-3, 2e-3, 1.5e-3]
    touches = [
        press(make_touch, np.full((16, 16), depth), *durations)
        for depth, durations in zip(depths, times, strict=True)
    ]
    expected = integrated(touches, depths)
    found = [field[0, 0] for field in feel(touches)]
    assert np.allclose(found, expected, rtol=1e-6)


def test_a_first_touch_is_the_closed_form_of_ramp_and_hold(make_touch, feel, dent):
    (found,) = feel([press(make_touch, dent, loading=0.25, dwell=0.4)])
    branch = TAU / 0.25 * (1 - math.exp(-0.25 / TAU)) * math.exp(-0.4 / TAU)
    assert np.allclose(found, dent * (1 - SHARE + SHARE * branch), rtol=1e-14)


def test_a_sudden_press_is_touched_wholly_and_a_long_one_less_by_share(make_touch, feel, dent):
    (sudden,) = feel([press(make_touch, dent, loading=0.0, dwell=0.0)])
    (nearly,) = feel([press(make_touch, dent, loading=1e-12, dwell=0.0)])
    (long,) = feel([press(make_touch, dent, dwell=50 * TAU)])
    assert np.allclose(sudden, dent, rtol=1e-15)
    assert np.allclose(nearly, dent, rtol=1e-11)
    assert np.allclose(long, (1 - SHARE) * dent, rtol=1e-14)


def test_a_rest_in_two_parts_is_a_rest(make_touch, feel, dent):
    nothing = 0.0 * dent
    first = press(make_touch, dent, way_back=0.05)
    parted = [
        first,
        press(make_touch, nothing, rest=0.1, loading=0.0, dwell=0.0, way_back=0.07),
        press(make_touch, dent, rest=0.13),
    ]
    whole = [press(make_touch, dent, way_back=0.05), press(make_touch, dent, rest=0.3)]
    assert np.allclose(feel(parted)[-1], feel(whole)[-1], rtol=1e-13)


def test_a_pad_that_rested_long_has_recovered(make_touch, feel, dent):
    again = feel([press(make_touch, dent), press(make_touch, dent, rest=40 * TAU)])
    assert np.allclose(again[1], again[0], rtol=1e-14)


def test_pad_that_rested_briefly_feels_less_and_converges_to_cycle(make_touch, feel, dent):
    series = feel([press(make_touch, dent, rest=0.1) for _ in range(30)])
    deepest = [field.max() for field in series]
    assert all(later < earlier for earlier, later in pairwise(deepest[:8]))
    assert deepest[-1] == pytest.approx(deepest[-2], rel=1e-9)
    # The fixed point of q -> (q d + c r - c) with decay d over the cycle and r by the ramp.
    ramp = TAU / 0.1 * (1 - math.exp(-0.1 / TAU)) * math.exp(-0.3 / TAU)
    decay = math.exp(-0.5 / TAU)
    branch = (ramp - decay) / (1 - decay)
    assert deepest[-1] == pytest.approx(dent.max() * (1 - SHARE + SHARE * branch), rel=1e-9)


def test_a_free_face_feels_nothing_and_never_less(make_touch, feel, dent):
    deep, shallow = press(make_touch, dent), press(make_touch, 0.01 * dent, rest=0.01)
    _, found = feel([deep, shallow])
    assert (found >= 0.0).all()
    assert (found[dent > 0.0] == 0.0).any()
    assert (found[dent == 0.0] == 0.0).all()
    assert (shallow.pressure >= 0.0).all()


def test_pressure_falls_in_the_same_proportion(make_touch, feel, dent):
    touch = press(make_touch, dent)
    touch.pressure = 3e9 * dent**2
    (found,) = feel([touch])
    touched = dent > 0.0
    ratio = found[touched] / dent[touched]
    assert np.allclose(touch.pressure[touched], (3e9 * dent**2)[touched] * ratio, rtol=1e-14)
    assert (touch.pressure[~touched] == 0.0).all()


def test_it_knows_the_times_of_a_whole_touch(make_finger, make_touch):
    finger = make_finger()
    pipeline = assemble(finger, [Creep(share=SHARE, tau=TAU)])
    states, depths = pipeline.begin(), (1e-3, 0.5e-3, 1e-3)
    touches, clock = [], 0.0
    for number, depth in enumerate(depths):
        touch = make_touch(number, depth=depth, previous=clock, begun=clock + 0.1)
        states = pipeline.simulate(touch, states)
        clock = touch.time
        touches.append(touch)
    expected = integrated(touches, list(depths))
    assert np.allclose([touch.reading.max() for touch in touches], expected, rtol=1e-3)
