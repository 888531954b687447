from __future__ import annotations

import numpy as np

from palpate.core.arrays import Floats, Ints
from palpate.core.shapes.certain_march import Floor
from palpate.core.shapes.protocol import INSIDE
from palpate.core.shapes.spans import MOST_SPANS, convex_spans, marched_spans
from palpate.core.shapes.superquadric import Superquadric

BALL = Superquadric(np.full(3, 0.03), np.ones(2))
DOWN = np.array([0.0, 0.0, -1.0])


def wave(rate: float, depth: float) -> tuple[object, object]:
    """Bounds of cos(rate t) - depth, and of its negative."""

    def floor(sign: float, places: Floats, lengths: Floats) -> Floor:
        value = sign * (np.cos(rate * places) - depth)
        slope = -sign * rate * np.sin(rate * places)
        dip = np.full_like(places, rate * rate)
        return Floor(value, slope, dip, lengths, np.zeros_like(places))

    def entering(places: Floats, lengths: Floats, which: Ints) -> Floor:
        return floor(1.0, places, lengths)

    def leaving(places: Floats, lengths: Floats, which: Ints) -> Floor:
        return floor(-1.0, places, lengths)

    return entering, leaving


def test_a_ball_has_one_span_on_each_ray() -> None:
    origins = np.array([[0.018, 0, 0.1], [0, 0, 0.01], [0, 0, -0.1], [0.04, 0, 0.1], [0, 0, 50.0]])
    spans = convex_spans(BALL, origins, DOWN)
    wanted = [[0.076, 0.124], [INSIDE, 0.04], [np.inf] * 2, [np.inf] * 2, [49.97, 50.03]]
    assert np.allclose(spans[:, 0], wanted, rtol=0, atol=1e-14)


def test_each_hollow_of_a_wave_is_a_span() -> None:
    starts, ends = np.array([0.0, 2.0, 4.0, 7.0, 5.0]), np.array([14.0, 14.0, 5.0, 7.5, 4.0])
    spans = marched_spans(*wave(1.0, 0.0), starts, ends, 1e-12)  # type: ignore[arg-type]
    half = np.pi / 2
    first, second = [half, 3 * half], [5 * half, 7 * half]
    assert np.allclose(spans[0, :2], [first, second], rtol=0, atol=1e-11)
    assert np.allclose(spans[1, :2], [[2.0, 3 * half], second], rtol=0, atol=1e-11)
    assert np.allclose(spans[2, 0], [4.0, 3 * half], rtol=0, atol=1e-11)
    assert np.isinf(spans[3:]).all()


def test_a_start_inside_and_an_end_inside_are_told() -> None:
    starts, ends = np.zeros(1), np.full(1, 6.0)
    spans = marched_spans(*wave(1.0, 2.0), starts, ends, 1e-12)  # type: ignore[arg-type]
    assert spans[0, 0].tolist() == [INSIDE, 6.0]


def test_no_ray_has_more_spans_than_are_kept() -> None:
    starts, ends = np.zeros(1), np.full(1, 1000.0)
    spans = marched_spans(*wave(1.0, 0.0), starts, ends, 1e-12)  # type: ignore[arg-type]
    assert spans.shape == (1, MOST_SPANS, 2)
    assert (np.diff(spans[0].ravel()) > 0.0).all()
