from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from palpate.core.arrays import Floats
from palpate.core.plane.edge_distance import edge_distance
from palpate.core.plane.inscribed_circle import inscribed_circle
from palpate.core.plane.inscribed_ellipse import ellipse_scale
from palpate.core.plane.winding import winding_number

SQUARE = np.array([[0, 0], [1, 0], [1, 1], [0, 1.0]])


def test_the_circle_in_a_square_a_rectangle_and_a_triangle_is_the_known_one() -> None:
    for scale, shift in ((1.0, 0.0), (1e-9, 1e-3), (1e9, 0.0)):
        middle, radius = inscribed_circle(scale * SQUARE + shift)
        assert radius == pytest.approx(0.5 * scale, rel=1e-6)
        assert np.allclose(middle, 0.5 * scale + shift, rtol=1e-6)
    flat = inscribed_circle(SQUARE * [10, 1])
    assert flat.radius == pytest.approx(0.5, rel=1e-6)
    triangle = inscribed_circle(np.array([[0, 0], [4, 0], [0, 3.0]]))
    assert triangle.radius == pytest.approx(1.0, rel=1e-4)
    assert np.allclose(triangle.middle, [1, 1], atol=1e-3)


@settings(derandomize=True, deadline=None, max_examples=15)
@given(st.integers(0, 10**6))
def test_no_sampled_place_holds_a_larger_circle(seed: int) -> None:
    rng = np.random.default_rng(seed)
    turn = np.sort(rng.uniform(0, 2 * np.pi, 20))
    polygon = rng.uniform(0.3, 1.5, (20, 1)) * np.column_stack([np.cos(turn), np.sin(turn)])
    middle, radius = inscribed_circle(polygon)
    places = rng.uniform(polygon.min(axis=0), polygon.max(axis=0), (3000, 2))
    places = places[winding_number(polygon, places) != 0]
    assert radius >= edge_distance(polygon, places).max() - 1e-3 * np.ptp(polygon, axis=0).max()
    assert edge_distance(polygon, middle[None])[0] == pytest.approx(radius)
    assert winding_number(polygon, middle[None])[0] != 0


def test_a_polygon_that_encloses_nothing_holds_no_circle() -> None:
    assert inscribed_circle(np.tile([1.0, 2.0], (5, 1))).radius == 0.0
    assert inscribed_circle(np.array([[0, 0], [1, 1], [2, 2.0]])).radius == 0.0


def test_an_ellipse_touches_the_box_around_it() -> None:
    box = np.array([[-2, -1], [2, -1], [2, 1], [-2, 1.0]])
    assert ellipse_scale(box, np.zeros(2), np.array([2.0, 1.0])) == 1.0
    assert ellipse_scale(box, np.zeros(2), np.array([1.0, 1.0])) == 1.0
    assert ellipse_scale(box, np.array([1.0, 0.0]), np.array([2.0, 1.0])) == 0.5
    assert ellipse_scale(box[::-1], np.zeros(2), np.array([4.0, 2.0])) == 0.5


@settings(derandomize=True, deadline=None, max_examples=20)
@given(st.integers(0, 10**6))
def test_the_ellipse_of_the_scale_found_stays_inside_and_a_larger_one_does_not(seed: int) -> None:
    rng = np.random.default_rng(seed)
    turn = np.linspace(0, 2 * np.pi, 15, endpoint=False)
    polygon = rng.uniform(0.5, 1.5, (15, 1)) * np.column_stack([np.cos(turn), np.sin(turn)])
    axes, around = rng.uniform(0.3, 2.0, 2), np.linspace(0, 2 * np.pi, 5000)
    circle = axes * np.column_stack([np.cos(around), np.sin(around)])
    scale = ellipse_scale(polygon, np.zeros(2), axes)
    assert (winding_number(polygon, (1 - 1e-9) * scale * circle) == 1).all()
    assert (winding_number(polygon, (1 + 1e-3) * scale * circle) == 0).any()


def test_what_encloses_nothing_or_is_no_ellipse_is_refused(
    three_lobes: Callable[..., Floats],
) -> None:
    with pytest.raises(ValueError, match="polygon must have at least 3 vertices, got 2"):
        inscribed_circle(np.zeros((2, 2)))
    with pytest.raises(ValueError, match="polygon must be finite"):
        inscribed_circle(np.full((3, 2), np.nan))
    with pytest.raises(ValueError, match=r"semi_axes must be positive, got \[1\.0, 0\.0\] m"):
        ellipse_scale(three_lobes(0.3), np.zeros(2), np.array([1.0, 0.0]))
