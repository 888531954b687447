from __future__ import annotations

import numpy as np
import pytest

from palpate.core.arrays import Bools, Floats
from palpate.core.touch.jet_fit import fit_jet
from palpate.core.touch.pad import Pad
from palpate.core.touch.strays import strays

NOISE = 10e-6
ALL = np.ones((16, 16), bool)


def find(pad: Pad, height: Floats) -> Bools | None:
    fit = fit_jet(pad, height, ALL)
    assert fit is not None
    return strays(pad, height, ALL, fit, NOISE)


def surface(pad: Pad) -> Floats:
    x, y = pad.grid()
    return 0.5 * (x**2 + y**2) / 0.03 + NOISE * np.random.default_rng(0).normal(size=x.shape)


@pytest.mark.parametrize("places", [[(4, 4)], [(0, 0), (9, 12)], [(2, 3), (2, 5), (15, 15)]])
def test_up_to_three_single_taxels_are_strays(places: list[tuple[int, int]], flat: Pad) -> None:
    height = surface(flat)
    for place in places:
        height[place] += 0.4e-3
    found = find(flat, height)
    assert found is not None
    assert [tuple(place) for place in np.argwhere(found).tolist()] == places


def test_taxels_that_lie_together_are_a_face(flat: Pad) -> None:
    for others in ((4, 5), (5, 5), (5, 3)):
        height = surface(flat)
        height[4, 4] += 0.4e-3
        height[others] += 0.4e-3
        assert find(flat, height) is None


def test_many_are_no_strays_and_neither_is_noise(flat: Pad) -> None:
    height = surface(flat)
    assert find(flat, height) is None
    height[::5, ::5] += 0.4e-3
    assert find(flat, height) is None
