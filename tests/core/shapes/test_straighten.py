from __future__ import annotations

import math

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.shapes.bend import Bend
from palpate.core.shapes.straighten import Straightening
from palpate.core.shapes.taper import Taper

SIZE = np.array([0.03, 0.02, 0.05])
HALF = np.array([0.03, 0.03, 0.05])
"""Half edges of a box that holds the tapered solids below, however it is turned."""
CASES = [
    ((0.0, 0.0), 0.0, 0.0),
    ((0.4, 0.4), 0.0, 0.0),
    ((0.3, -0.2), 0.0, 0.0),
    ((0.0, 0.0), 12.0, 0.7),
    ((0.3, 0.3), -12.0, 2.0),
    ((0.4, -0.3), 20.0, -1.0),
]


def turned(azimuth: float) -> Floats:
    cosine, sine = math.cos(azimuth), math.sin(azimuth)
    return np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])


def places_within(bend: Bend, count: int) -> Floats:
    """Places (3, n) of the bent box, in the bend's own frame."""
    straight = np.random.default_rng(0).uniform(-HALF, HALF, (count, 3))
    return Bend(bend.curvature)(straight).T


@pytest.mark.parametrize(("taper", "curvature", "azimuth"), CASES)
def test_the_curve_is_the_straightened_place_times_the_width(
    taper: tuple[float, float], curvature: float, azimuth: float
) -> None:
    bend = Bend(curvature, azimuth)
    places = places_within(bend, 50)
    curve = Straightening(SIZE, np.array(taper), bend).along(places, np.ones(3))
    world = (turned(azimuth) @ places).T
    straight = Taper(*taper, SIZE[2]).inverse(bend.inverse(world)) / SIZE
    assert np.allclose(curve.place / curve.width, straight.T, rtol=0, atol=1e-13)


@pytest.mark.parametrize(("taper", "curvature", "azimuth"), CASES)
def test_slopes_are_right_and_values_slopes_and_curves_within_their_bounds(
    taper: tuple[float, float], curvature: float, azimuth: float
) -> None:
    straightening = Straightening(SIZE, np.array(taper), Bend(curvature, azimuth))
    places = places_within(straightening.bend, 3000)
    rng, step = np.random.default_rng(1), 1e-6
    for direction in [*np.eye(3), *rng.normal(size=(20, 3))]:
        direction = direction / np.linalg.norm(direction)
        ahead = straightening.along(places + step * direction[:, None], direction)
        back = straightening.along(places - step * direction[:, None], direction)
        here = straightening.along(places, direction)
        assert np.allclose((ahead.place - back.place) / (2 * step), here.slope, atol=1e-5)
        bound = straightening.bound(direction, HALF)
        curves = (ahead.slope - back.slope) / (2 * step)
        for value, slope, curve, most in zip(
            here.place, here.slope, curves, bound.place, strict=True
        ):
            for some, limit in zip((value, slope, curve), most, strict=True):
                assert np.abs(some).max() <= limit * (1 + 1e-9) + 1e-5
        width = np.broadcast_to(here.width, len(places.T))
        assert width.max() <= bound.width.value * (1 + 1e-12)
        assert width.min() >= bound.least_width * (1 - 1e-12)
