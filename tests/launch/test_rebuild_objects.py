from __future__ import annotations

import numpy as np
import pytest

from palpate.launch.rebuild_objects import OBJECTS, WAVY, RoundObject

EVERY = [*OBJECTS.values(), WAVY]
NAMES = [*OBJECTS, "wavy"]


@pytest.mark.parametrize("thing", EVERY, ids=NAMES)
def test_contours_lie_on_their_object_counter_clockwise(thing: RoundObject) -> None:
    heights = np.linspace(-1.0, 1.0, 7)
    grid = thing.contours(heights, 48)
    assert np.abs(thing.distances(grid, heights)[0]).max() < 1e-13
    x, y = grid.transpose(2, 0, 1)
    assert ((x * np.roll(y, -1, 1) - np.roll(x, -1, 1) * y).sum(axis=1) > 0.0).all()


@pytest.mark.parametrize("thing", EVERY, ids=NAMES)
def test_a_place_moved_along_the_normal_is_so_far_off(thing: RoundObject) -> None:
    heights = np.linspace(-0.8, 0.8, 5)
    grid, step = thing.contours(heights, 16), 1e-4
    out = grid - thing.axis(heights)[:, None]
    out /= np.linalg.norm(out, axis=-1, keepdims=True)
    off, area = thing.distances(grid + step * out, heights)
    assert (off > 0.0).all()
    assert (off <= step * (1 + 1e-3)).all()
    assert (area > 0.0).all()


def test_objects_have_the_height_of_2_and_differ() -> None:
    radii = [thing.radius(np.array(0.3), np.array(0.7)) for thing in OBJECTS.values()]
    assert len(set(np.round(radii, 6))) == len(OBJECTS)
