from __future__ import annotations

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.rebuild.correspondence.minimum_twist import minimum_twist
from palpate.core.rebuild.correspondence.signature import follow_signatures

TURNS = np.arange(512) / 512


def lobes(count: int, depth: float, turn: float) -> Floats:
    """Lobes that have turned by so much, begun at azimuth 0."""
    radius = 1 + depth * np.cos(2 * np.pi * count * (TURNS - turn))
    angle = 2 * np.pi * TURNS
    return np.asarray(radius[:, None] * np.column_stack([np.cos(angle), np.sin(angle)]))


def stack(count: int, depth: float, turn: float) -> Floats:
    return np.stack([lobes(count, depth, turn * level) for level in range(8)])


def test_lobes_are_followed_where_the_least_twist_follows_the_circle() -> None:
    shapes = stack(3, 0.1, 0.06)
    steps = minimum_twist(shapes)
    assert np.abs(steps).max() < 0.02
    assert np.abs(follow_signatures(shapes, steps) - 0.06).max() < 0.002
    assert np.abs(follow_signatures(shapes[::-1], minimum_twist(shapes[::-1])) + 0.06).max() < 0.002


def test_what_turns_on_evenly_is_followed_to_nearly_half_a_lobe() -> None:
    shapes = stack(4, 0.1, 0.11)
    assert np.abs(follow_signatures(shapes, minimum_twist(shapes)) - 0.11).max() < 0.002


def test_one_pair_that_looks_like_a_lobe_back_follows_the_others() -> None:
    turned = 0.1 * np.arange(8)
    turned[4:] += 0.05
    shapes = np.stack([lobes(4, 0.1, turn) for turn in turned])
    found = follow_signatures(shapes, minimum_twist(shapes))
    assert np.abs(found - np.diff(turned)).max() < 0.006


def test_round_contours_and_unlike_ones_stay_with_the_least_twist() -> None:
    for shapes in (
        stack(3, 0.005, 0.06),
        np.stack([lobes(3, 0.2, 0.0), lobes(5, 0.2, 0.0), lobes(3, 0.2, 0.0)]),
        np.repeat(lobes(3, 0.0, 0.0)[None], 3, axis=0),
    ):
        steps = minimum_twist(shapes)
        assert np.abs(follow_signatures(shapes, steps) - steps).max() < 1e-12


def test_a_single_contour_has_no_steps() -> None:
    assert follow_signatures(lobes(3, 0.1, 0.0)[None], np.zeros(0)).shape == (0,)
