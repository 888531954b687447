from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from palpate.core.plane.inscribed_ellipse import ellipse_scale
from palpate.core.plane.winding import winding_number
from palpate.core.rebuild.thesis.rectangle import rectangle_scale

SQUARE = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1.0]])
DIAMOND = np.array([[1, 0], [0, 1], [-1, 0], [0, -1.0]])


def test_the_rectangles_of_a_square_and_a_diamond_are_the_known_ones() -> None:
    assert rectangle_scale(SQUARE, np.zeros(2), np.ones(2)) == 1.0
    assert rectangle_scale(SQUARE * [3, 2], np.zeros(2), np.array([3.0, 2.0])) == 1.0
    assert rectangle_scale(SQUARE, np.array([0.5, 0.0]), np.ones(2)) == 0.5
    assert rectangle_scale(DIAMOND, np.zeros(2), np.ones(2)) == pytest.approx(0.5)
    assert rectangle_scale(DIAMOND[::-1], np.zeros(2), np.ones(2)) == pytest.approx(0.5)


def test_the_rectangle_in_a_circle_has_its_corners_on_it() -> None:
    turn = 2 * np.pi * np.arange(720) / 720
    circle = np.column_stack([np.cos(turn), np.sin(turn)])
    assert rectangle_scale(circle, np.zeros(2), np.ones(2)) == pytest.approx(np.sqrt(0.5), abs=1e-4)


def test_there_is_none_about_a_middle_outside_or_in_what_encloses_nothing() -> None:
    assert rectangle_scale(SQUARE, np.array([2.0, 0.0]), np.ones(2)) == 0.0
    assert rectangle_scale(np.tile([0.0, 0.0], (5, 1)), np.zeros(2), np.ones(2)) == 0.0


@settings(derandomize=True, deadline=None, max_examples=25)
@given(st.integers(0, 10**6))
def test_the_rectangle_found_is_inside_touches_and_lies_between_two_ellipses(seed: int) -> None:
    rng = np.random.default_rng(seed)
    turn = np.sort(rng.uniform(0, 2 * np.pi, 15))
    polygon = rng.uniform(0.4, 1.5, (15, 1)) * np.column_stack([np.cos(turn), np.sin(turn)])
    half = rng.uniform(0.3, 2.0, 2)
    middle = rng.uniform(-0.2, 0.2, 2)
    scale = rectangle_scale(polygon, middle, half)
    along = np.linspace(-1, 1, 201)
    side = np.concatenate(
        [np.column_stack([along, s * np.ones(201)]) for s in (-1, 1)]
        + [np.column_stack([s * np.ones(201), along]) for s in (-1, 1)]
    )
    ellipse = ellipse_scale(polygon, middle, half)
    assert np.sqrt(0.5) * ellipse - 1e-12 <= scale <= ellipse + 1e-12
    if scale > 0.0:
        inside = winding_number(polygon, middle + 0.999 * scale * half * side) != 0
        assert inside.all()
        grown = middle + 1.02 * scale * half * side
        fine = np.concatenate(
            [
                a + along[:, None] * 0.5 * (b - a) + 0.5 * (b - a)
                for a, b in zip(polygon, np.roll(polygon, -1, axis=0), strict=True)
            ]
        )
        met = (np.abs(fine - middle) <= 1.02 * scale * half).all(axis=1).any()
        assert met or not (winding_number(polygon, grown) != 0).all()
