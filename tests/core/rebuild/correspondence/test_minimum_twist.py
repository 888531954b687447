from __future__ import annotations

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.rebuild.correspondence.minimum_twist import begin_turns, minimum_twist

TURNS = np.arange(256) / 256


def ellipse(turns: Floats) -> Floats:
    angle = 2 * np.pi * turns
    return np.column_stack([2 * np.cos(angle) + 0.2 * np.cos(2 * angle), np.sin(angle)])


def test_curves_that_begin_elsewhere_are_brought_to_one_beginning() -> None:
    begins = np.array([0.0, 0.31, 0.87, 0.502])
    sizes = np.array([1.0, 1.3, 0.2, 5.0])
    shapes = np.stack([s * ellipse(TURNS - b) for s, b in zip(sizes, begins, strict=True)])
    turns = begin_turns(minimum_twist(shapes), 1, 0.31)
    off = turns - begins
    assert np.abs(off - np.round(off)).max() < 1e-4
    assert (np.abs(minimum_twist(shapes)) <= 0.5).all()


def test_the_sum_of_squared_distances_is_least_there() -> None:
    first = ellipse(TURNS) + 0.3 * ellipse(3 * TURNS)
    second = ellipse(1.7 - TURNS[::-1]) @ np.array([[0.6, 0.8], [-0.8, 0.6]])
    step = minimum_twist(np.stack([first, second]))[0]
    costs = [((first - np.roll(second, -k, axis=0)) ** 2).sum() for k in range(256)]
    best = int(np.argmin(costs)) / 256
    off = step - best
    assert abs(off - np.round(off)) <= 0.5 / 256 + 1e-12


def test_one_curve_begins_where_it_is_told() -> None:
    assert len(minimum_twist(ellipse(TURNS)[None])) == 0
    assert begin_turns(np.zeros(0), 0, 0.25).tolist() == [0.25]
