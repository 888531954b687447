from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from palpate.core.explore.probing.face import FOOT
from palpate.core.explore.probing.known import Wall
from palpate.core.explore.probing.places import covers, heart, inner_outline, largest_gap
from palpate.core.plane.winding import winding_number

WIDTH = 0.015


def test_the_band_of_a_steep_wall_ends_on_the_contour(ring: Callable[..., Wall]) -> None:
    wall = ring(0.025, 0.03, above=5e-3)
    np.testing.assert_allclose(inner_outline(wall), wall.points[:, :2], atol=1e-15)


def test_the_band_of_a_leaning_wall_ends_farther_in(ring: Callable[..., Wall]) -> None:
    wall = ring(0.025, 0.03, lean=math.radians(45.0), above=5e-3)
    np.testing.assert_allclose(np.linalg.norm(inner_outline(wall), axis=1), 0.02, atol=1e-12)


def test_of_a_horseshoe_the_heart_lies_within() -> None:
    turn = np.linspace(-0.4 * math.pi, 1.4 * math.pi, 80)
    out = np.column_stack([np.cos(turn), np.sin(turn), 0.0 * turn])
    points = np.concatenate([0.03 * out, 0.02 * out[::-1]])
    count = np.zeros(len(points))
    place = heart(Wall(points, points, count, count))
    assert winding_number(points[:, :2], place[None])[0] != 0


def test_on_a_disc_the_gap_lies_between_touch_and_rim(ring: Callable[..., Wall]) -> None:
    gap = largest_gap(ring(0.025, 0.0).points[:, :2], np.zeros((1, 2)), WIDTH)
    wanted = 0.5 * (0.025 - FOOT * WIDTH)
    assert gap.radius == pytest.approx(wanted, abs=1e-3)
    assert np.linalg.norm(gap.place) == pytest.approx(0.025 - wanted, abs=1.5e-3)


def test_where_a_foot_covers_all_there_is_no_gap(ring: Callable[..., Wall]) -> None:
    assert largest_gap(ring(0.004, 0.0).points[:, :2], np.zeros((1, 2)), WIDTH).radius <= 0.0
    tiny = 1e-9 * ring(1.0, 0.0).points[:, :2] + 5e-5
    assert largest_gap(tiny, np.zeros((1, 2)), WIDTH).radius <= 0.0


@settings(derandomize=True, deadline=None, max_examples=30)
@given(st.integers(0, 10_000), st.integers(1, 6))
def test_a_gap_is_empty_and_inside(seed: int, count: int) -> None:
    rng = np.random.default_rng(seed)
    turn = 2.0 * np.pi * np.arange(40) / 40
    radius = 0.03 * (1.0 + 0.3 * np.cos(rng.integers(2, 5) * turn + rng.uniform(0.0, 6.0)))
    outline = np.column_stack([radius * np.cos(turn), radius * np.sin(turn)])
    tried = rng.uniform(-0.03, 0.03, (count, 2))
    gap = largest_gap(outline, tried, WIDTH)
    if gap.radius > 0.0:
        assert winding_number(outline, gap.place[None])[0] != 0
        reach = FOOT * WIDTH + gap.radius
        assert np.linalg.norm(tried - gap.place, axis=1).min() >= reach - 1e-12


def test_a_contour_covers_what_lies_inside_or_close_beside_it(ring: Callable[..., Wall]) -> None:
    places = np.array([[0.0, 0.0], [0.024, 0.0], [0.029, 0.0], [0.031, 0.0]])
    assert covers(ring(0.025, 0.03), places, 5e-3).tolist() == [True, True, True, False]
