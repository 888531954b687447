import numpy as np
import pytest

from palpate.core.touch.effects.echoes import Crosstalk


@pytest.fixture
def mixed(make_finger, make_touch):
    def mix(field):
        touch = make_touch(field=field)
        Crosstalk(share=0.05).prepare(make_finger()).apply(touch, None)
        return touch.reading

    return mix


def test_a_single_taxel_spreads_over_its_four_neighbours(mixed):
    field = np.zeros((16, 16))
    field[5, 8] = 1e-3
    expected = np.zeros((16, 16))
    expected[5, 8] = 0.8e-3
    expected[[4, 6, 5, 5], [8, 8, 7, 9]] = 0.05e-3
    assert np.allclose(mixed(field), expected, atol=1e-19)


@pytest.mark.parametrize(("place", "kept"), [((0, 8), 0.85), ((15, 15), 0.90), ((7, 0), 0.85)])
def test_a_taxel_at_the_border_keeps_what_it_cannot_give(place, kept, mixed):
    field = np.zeros((16, 16))
    field[place] = 1e-3
    assert mixed(field)[place] == pytest.approx(kept * 1e-3, rel=1e-14)


def test_a_level_field_stays_and_nothing_is_lost(mixed, dent):
    assert np.allclose(mixed(np.full((16, 16), 1e-3)), 1e-3, rtol=1e-15)
    assert mixed(dent).sum() == pytest.approx(dent.sum(), rel=1e-14)


def test_a_wave_is_damped_by_its_closed_form(mixed):
    # Cosines that end level at the borders are the modes of the mixing.
    for number in (1, 4, 15):
        wave = np.cos(np.pi * number * (np.arange(16) + 0.5) / 16)[None, :].repeat(16, axis=0)
        damping = 1.0 - 2 * 0.05 * (1.0 - np.cos(np.pi * number / 16))
        assert np.allclose(mixed(wave), damping * wave, atol=1e-15)
