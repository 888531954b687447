from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from palpate.core.arrays import Floats
from palpate.core.shapes.protocol import INSIDE, MISS
from palpate.core.shapes.ray_casting import (
    MOST_MARCH_STEPS,
    MOST_NEWTON_STEPS,
    MOST_SPANS,
    Minorant,
    RaySelection,
    clip_to_box,
    convex_spans,
    first_roots,
    guaranteed_first_roots,
    marched_spans,
)
from palpate.core.shapes.superquadrics import Superquadric

BALL = Superquadric(np.full(3, 0.03), np.ones(2))
DOWN = np.array([0.0, 0.0, -1.0])


def wave(rate, depth):
    """Bounds of cos(rate t) - depth, and of its negative."""

    def floor(sign, places, lengths):
        value = sign * (np.cos(rate * places) - depth)
        slope = -sign * rate * np.sin(rate * places)
        dip = np.full_like(places, rate * rate)
        return Minorant(value, slope, dip, lengths, np.zeros_like(places))

    def entering(places, lengths, which):
        return floor(1.0, places, lengths)

    def leaving(places, lengths, which):
        return floor(-1.0, places, lengths)

    return entering, leaving


def test_a_ball_has_one_span_on_each_ray():
    origins = np.array([[0.018, 0, 0.1], [0, 0, 0.01], [0, 0, -0.1], [0.04, 0, 0.1], [0, 0, 50.0]])
    spans = convex_spans(BALL, origins, DOWN)
    wanted = [[0.076, 0.124], [INSIDE, 0.04], [np.inf] * 2, [np.inf] * 2, [49.97, 50.03]]
    assert np.allclose(spans[:, 0], wanted, rtol=0, atol=1e-14)


def test_each_hollow_of_a_wave_is_a_span():
    starts, ends = np.array([0.0, 2.0, 4.0, 7.0, 5.0]), np.array([14.0, 14.0, 5.0, 7.5, 4.0])
    spans = marched_spans(*wave(1.0, 0.0), starts, ends, 1e-12)  # type: ignore[arg-type]
    half = np.pi / 2
    first, second = [half, 3 * half], [5 * half, 7 * half]
    assert np.allclose(spans[0, :2], [first, second], rtol=0, atol=1e-11)
    assert np.allclose(spans[1, :2], [[2.0, 3 * half], second], rtol=0, atol=1e-11)
    assert np.allclose(spans[2, 0], [4.0, 3 * half], rtol=0, atol=1e-11)
    assert np.isinf(spans[3:]).all()


def test_a_start_inside_and_an_end_inside_are_told():
    starts, ends = np.zeros(1), np.full(1, 6.0)
    spans = marched_spans(*wave(1.0, 2.0), starts, ends, 1e-12)  # type: ignore[arg-type]
    assert spans[0, 0].tolist() == [INSIDE, 6.0]


def test_no_ray_has_more_spans_than_are_kept():
    starts, ends = np.zeros(1), np.full(1, 1000.0)
    spans = marched_spans(*wave(1.0, 0.0), starts, ends, 1e-12)  # type: ignore[arg-type]
    assert spans.shape == (1, MOST_SPANS, 2)
    assert (np.diff(spans[0].ravel()) > 0.0).all()


Curve = Callable[[Floats, RaySelection], tuple[Floats, Floats]]


class Counted:
    """A function that counts how often it is asked."""

    def __init__(self, value, slope):
        self._value, self._slope, self.calls = value, slope, 0

    def __call__(self, places, which):
        self.calls += 1
        return self._value(places), self._slope(places)


def parabola(roots):
    a, b = roots
    return Counted(lambda t: (t - a) * (t - b), lambda t: 2 * t - a - b)


def find(function, end=10.0, **bounds):
    zero = np.zeros(1)
    return float(first_roots(function, zero, zero + end, 1e-13, **bounds)[0])


def test_the_first_of_two_roots_is_found():
    assert find(parabola((2.0, 3.0))) == pytest.approx(2.0, abs=1e-14)
    assert find(parabola((2.0, 2.0 + 1e-7))) == pytest.approx(2.0, abs=1e-12)


def test_a_convex_function_that_has_turned_up_has_no_root():
    raised = Counted(lambda t: (t - 2.0) ** 2 + 1e-9, lambda t: 2 * (t - 2.0))
    assert find(raised) == MISS
    assert raised.calls < 30
    level = Counted(np.ones_like, np.zeros_like)
    assert find(level) == MISS
    assert level.calls == 1


def test_a_thin_dip_behind_a_hill_is_not_passed():
    dips = Counted(lambda t: np.cos(t) + 1.0 - 1e-10, lambda t: -np.sin(t))
    assert find(dips, dip=1.0) == pytest.approx(math.pi - math.sqrt(2e-10), abs=1e-9)
    assert dips.calls < 60
    clear = Counted(lambda t: np.cos(t) + 1.0 + 1e-10, lambda t: -np.sin(t))
    assert find(clear, dip=1.0) == MISS
    assert clear.calls < 150


@given(
    phase=st.floats(0.0, 6.0),
    rate=st.floats(0.3, 4.0),
    depth=st.floats(-1.5, 0.999),
    end=st.floats(0.0, 9.0),
)
def test_sines_are_entered_where_they_first_are_not_positive(
    phase: float, rate: float, depth: float, end: float
) -> None:
    def wave(t: Floats, which: RaySelection) -> tuple[Floats, Floats]:
        return np.sin(rate * t + phase) - depth, rate * np.cos(rate * t + phase)

    found = find(wave, end=end, dip=rate * rate, rise=rate * rate)
    places = np.linspace(0.0, end, 5001)
    negative = np.sin(rate * places + phase) <= depth
    if not negative.any():
        assert found == MISS or abs(np.sin(rate * found + phase) - depth) < 1e-12
        return
    first = places[negative.argmax()]
    assert found <= first + 1e-12
    assert found >= first - end / 5000 - 1e-12 or abs(np.sin(rate * found + phase) - depth) < 1e-12


def test_a_start_that_touches_a_root_from_which_the_function_rises_is_left_safely():
    for touch in (1e-300, 1e-45, 1e-20, 1e-9):
        start = np.arcsin(touch)

        def wave(t, which, start=start):
            return np.sin(t + start), np.cos(t + start)

        assert find(wave, dip=1.0, rise=1.0) == pytest.approx(math.pi, abs=1e-8)


def test_a_known_rise_saves_the_last_look():
    blind, told = parabola((2.0, 9.0)), parabola((2.0, 9.0))
    assert find(blind) == pytest.approx(find(told, rise=2.0), abs=1e-13)
    assert told.calls == blind.calls - 1


def test_a_root_beyond_the_end_is_none():
    assert find(parabola((2.0, 3.0)), end=1.999) == MISS
    assert find(parabola((2.0, 3.0)), end=2.001) == pytest.approx(2.0)
    assert find(parabola((2.0, 3.0)), end=-1.0) == MISS


def test_what_is_not_positive_at_the_start_begins_there():
    starts = np.array([0.0, 2.5, 2.0])
    found = first_roots(parabola((2.0, 3.0)), starts, starts + 9, 1e-13)
    assert found[1:].tolist() == [2.5, 2.0]


def test_a_gap_is_jumped_and_a_step_does_not_go_past_its_end():
    def broken(t, which):
        assert not ((t > 1.0) & (t < 4.0)).any()
        return np.where(t <= 1.0, 0.5, 5.0 - t), np.where(t <= 1.0, 0.0, -1.0)

    gap = np.array([1.0, np.inf]), np.array([4.0, -np.inf])
    starts, ends = np.array([0.0, 4.5]), np.array([9.0, 9.0])
    assert first_roots(broken, starts, ends, 1e-13, dip=1.0, gaps=(gap,)).tolist() == [5.0, 5.0]
    within = first_roots(broken, np.array([2.0, 4.5]), ends, 1e-13, dip=1.0, gaps=(gap,))
    assert within.tolist() == [5.0, 5.0]


def test_functions_are_told_apart_when_others_are_done():
    roots = np.array([0.001, 1.0, 2.0, 30.0, 40.0, 50.0, np.inf])

    def each(t, which):
        return np.exp(np.minimum(roots[which], 99.0) - t) - 1.0, -np.exp(
            np.minimum(roots[which], 99.0) - t
        )

    found = first_roots(each, np.zeros(7), np.full(7, 60.0), 1e-13)
    assert np.allclose(found[:6], roots[:6], rtol=0, atol=1e-12)
    assert found[6] == MISS


def test_it_gives_up_after_some_steps():
    flat = Counted(lambda t: np.full_like(t, 1e-12), np.zeros_like)
    assert find(flat, dip=1.0) == MISS
    assert flat.calls == MOST_NEWTON_STEPS


TOLERANCE = 1e-13
NOTHING = np.zeros(1)


class CountedMinorant:
    """Bounds from one's own parabola, and how often they are asked."""

    def __init__(self, floor):
        self._floor, self.calls = floor, 0

    def __call__(self, places, lengths, which):
        self.calls += 1
        rows = zip(places.tolist(), lengths.tolist(), strict=True)
        return Minorant(*np.array([self._floor(*row) for row in rows]).T)


def find_guaranteed(below, end=10.0, start=0.0):
    begin, stop = np.array([start]), np.array([end])
    return float(guaranteed_first_roots(below, begin, stop, TOLERANCE)[0])


def counted_wave(depth):
    """Cosine less a depth, known by its steepest slope over each stretch alone."""

    def floor(t, length):
        down = length >= math.pi or math.sin(t) <= 0 <= math.sin(t + length)
        ends = min(-math.sin(t), -math.sin(t + length))
        crest = math.floor((t + length - math.pi / 2) / (2 * math.pi)) >= math.ceil(
            (t - math.pi / 2) / (2 * math.pi)
        )
        return math.cos(t) - depth, -1.0 if crest or down else ends, 0.0, length, 0.0

    return CountedMinorant(floor)


def test_the_first_of_many_roots_is_found_from_bounds_alone():
    for depth in (-0.9, 0.0, 0.5, 0.99):
        below = counted_wave(depth)
        assert find_guaranteed(below, 30.0) == pytest.approx(math.acos(depth), abs=1e-12)
        assert below.calls < 40


def test_a_thin_dip_is_not_passed_and_a_near_miss_is_none():
    assert find_guaranteed(counted_wave(-1.0 + 1e-10), 30.0) == pytest.approx(math.pi, abs=2e-5)
    assert find_guaranteed(counted_wave(-1.0 - 1e-6), 30.0) == MISS


@given(phase=st.floats(0.0, 6.0), rate=st.floats(0.5, 5.0), depth=st.floats(-1.2, 0.95))
@settings(derandomize=True, deadline=None, max_examples=40)
def test_no_root_is_passed(phase: float, rate: float, depth: float) -> None:
    def floor(t: float, length: float) -> tuple[float, float, float, float, float]:
        value, slope = math.sin(rate * t + phase) - depth, rate * math.cos(rate * t + phase)
        return value, slope, rate * rate, length, 0.0

    found = find_guaranteed(CountedMinorant(floor), 9.0)
    places = np.linspace(0.0, 9.0, 4001)
    seen = np.flatnonzero(np.sin(rate * places + phase) <= depth)
    assert found <= (places[seen[0]] + 1e-12 if len(seen) else MISS)
    assert found == MISS or math.sin(rate * found + phase) - depth < 1e-11


def test_a_cusp_is_entered_and_left():
    def cusp(shift):
        def floor(t, length):
            value, after = math.sqrt(abs(t - 2)) - shift, math.sqrt(abs(t + length - 2)) - shift
            if (t - 2) * (t + length - 2) < 0:
                return value, 0.0, 0.0, length, value + shift
            return value, (after - value) / length, 0.0, length, 0.0

        return CountedMinorant(floor)

    assert find_guaranteed(cusp(1e-3)) == pytest.approx(2.0 - 1e-6, abs=1e-12)
    assert find_guaranteed(cusp(-1e-3)) == MISS
    assert find_guaranteed(cusp(-1e-3)) == MISS


def test_a_floor_that_holds_less_far_than_asked_is_walked_piece_by_piece():
    def floor(t, length):
        """A saw: 1 less the part of t, but its teeth end at 5 in a lower one."""
        piece = math.floor(t + TOLERANCE)
        value = 1.0 - (t - piece) - (0.5 if piece == 5 else -0.1)
        return value, -1.0, 0.0, min(length, piece + 1 - t), 0.0

    below = CountedMinorant(floor)
    assert find_guaranteed(below) == pytest.approx(5.5, abs=1e-12)
    assert below.calls < 20


def test_a_start_that_is_not_positive_is_returned_to_the_bit():
    level = CountedMinorant(lambda t, length: (-1.0, 0.0, 0.0, length, 0.0))
    assert find_guaranteed(level, start=math.pi / 7) == math.pi / 7
    assert level.calls == 1
    assert find_guaranteed(level, end=1.0, start=2.0) == MISS
    assert level.calls == 1


def test_an_end_that_is_reached_without_a_root_is_a_miss():
    line = CountedMinorant(lambda t, length: (5.0 - t, -1.0, 0.0, length, 0.0))
    assert find_guaranteed(line, end=4.0) == MISS
    assert line.calls == 1
    assert find_guaranteed(line, end=6.0) == pytest.approx(5.0, abs=1e-15)


def test_bounds_that_say_nothing_end_in_a_miss():
    blind = CountedMinorant(lambda t, length: (1.0, -1e9, 0.0, length, 0.0))
    assert find_guaranteed(blind) == MISS
    assert blind.calls == MOST_MARCH_STEPS


def test_functions_are_told_by_number_when_others_are_done():
    roots = np.array([1.0, 20.0, 3.0, -1.0])

    def below(places, lengths, which):
        none = np.zeros_like(places)
        return Minorant((roots[which] - places) * 0.7, none - 1.0, 0.0, lengths, none)

    found = guaranteed_first_roots(below, np.zeros(4), np.full(4, 10.0), TOLERANCE)
    assert np.allclose(found, [1.0, MISS, 3.0, 0.0], rtol=0, atol=1e-12)


HALF = np.array([1.0, 2.0, 3.0])


def test_a_ray_enters_at_the_last_face_and_leaves_at_the_first():
    origins = np.array([[-5.0, 0.0, 0.0], [-5.0, 1.9, 0.0], [0.5, 0.0, 0.0], [5.0, 0.0, 0.0]]).T
    starts, ends = clip_to_box(origins, np.array([1.0, 0.0, 0.0]), HALF)
    assert np.allclose(starts[:3], [4.0, 4.0, 0.0], atol=1e-11)
    assert np.allclose(ends[:3], [6.0, 6.0, 0.5], atol=1e-11)
    assert starts[3] > ends[3]


def test_it_agrees_with_points_along_the_ray():
    rng = np.random.default_rng(0)
    for direction in rng.normal(size=(50, 3)):
        direction[rng.random(3) < 0.2] = 0.0
        origins = rng.uniform(-5, 5, (3, 40))
        starts, ends = clip_to_box(origins, direction, HALF)
        ways = np.linspace(0.0, 20.0, 400)
        places = origins[:, :, None] + direction[:, None, None] * ways
        within = (np.abs(places) <= HALF[:, None, None]).all(axis=0)
        told = (starts[:, None] <= ways) & (ways <= ends[:, None])
        assert np.array_equal(within, told)


def test_rays_in_a_face_are_in_the_box_and_rays_beside_it_are_not():
    origins = np.array([[1.0, -9.0, 0.0], [1.0 + 1e-9, -9.0, 0.0], [-1.0, -9.0, 3.0]]).T
    for tiny in (0.0, 1e-250, -1e-250):
        starts, ends = clip_to_box(origins, np.array([tiny, 1.0, 0.0]), HALF)
        assert (starts <= ends).tolist() == [True, False, True]
