from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from palpate.core.arrays import Floats, Ints
from palpate.core.shapes.certain_march import MOST_STEPS, Below, Floor, certain_first_roots
from palpate.core.shapes.protocol import MISS

TOLERANCE = 1e-13
NOTHING = np.zeros(1)


class Counted:
    """Bounds from one's own parabola, and how often they are asked."""

    def __init__(self, floor: Callable[[float, float], tuple[float, float, float, float, float]]):
        self._floor, self.calls = floor, 0

    def __call__(self, places: Floats, lengths: Floats, which: Ints) -> Floor:
        self.calls += 1
        rows = zip(places.tolist(), lengths.tolist(), strict=True)
        return Floor(*np.array([self._floor(*row) for row in rows]).T)


def find(below: Below, end: float = 10.0, start: float = 0.0) -> float:
    begin, stop = np.array([start]), np.array([end])
    return float(certain_first_roots(below, begin, stop, TOLERANCE)[0])


def wave(depth: float) -> Counted:
    """Cosine less a depth, known by its steepest slope over each stretch alone."""

    def floor(t: float, length: float) -> tuple[float, float, float, float, float]:
        down = length >= math.pi or math.sin(t) <= 0 <= math.sin(t + length)
        ends = min(-math.sin(t), -math.sin(t + length))
        crest = math.floor((t + length - math.pi / 2) / (2 * math.pi)) >= math.ceil(
            (t - math.pi / 2) / (2 * math.pi)
        )
        return math.cos(t) - depth, -1.0 if crest or down else ends, 0.0, length, 0.0

    return Counted(floor)


def test_the_first_of_many_roots_is_found_from_bounds_alone() -> None:
    for depth in (-0.9, 0.0, 0.5, 0.99):
        below = wave(depth)
        assert find(below, 30.0) == pytest.approx(math.acos(depth), abs=1e-12)
        assert below.calls < 40


def test_a_thin_dip_is_not_passed_and_a_near_miss_is_none() -> None:
    assert find(wave(-1.0 + 1e-10), 30.0) == pytest.approx(math.pi, abs=2e-5)
    assert find(wave(-1.0 - 1e-6), 30.0) == MISS


@given(phase=st.floats(0.0, 6.0), rate=st.floats(0.5, 5.0), depth=st.floats(-1.2, 0.95))
@settings(derandomize=True, deadline=None, max_examples=40)
def test_no_root_is_passed(phase: float, rate: float, depth: float) -> None:
    def floor(t: float, length: float) -> tuple[float, float, float, float, float]:
        value, slope = math.sin(rate * t + phase) - depth, rate * math.cos(rate * t + phase)
        return value, slope, rate * rate, length, 0.0

    found = find(Counted(floor), 9.0)
    places = np.linspace(0.0, 9.0, 4001)
    seen = np.flatnonzero(np.sin(rate * places + phase) <= depth)
    assert found <= (places[seen[0]] + 1e-12 if len(seen) else MISS)
    assert found == MISS or math.sin(rate * found + phase) - depth < 1e-11


def test_a_cusp_is_entered_and_left() -> None:
    def cusp(shift: float) -> Counted:
        def floor(t: float, length: float) -> tuple[float, float, float, float, float]:
            value, after = math.sqrt(abs(t - 2)) - shift, math.sqrt(abs(t + length - 2)) - shift
            if (t - 2) * (t + length - 2) < 0:
                return value, 0.0, 0.0, length, value + shift
            return value, (after - value) / length, 0.0, length, 0.0

        return Counted(floor)

    assert find(cusp(1e-3)) == pytest.approx(2.0 - 1e-6, abs=1e-12)
    assert find(cusp(-1e-3)) == MISS
    assert find(cusp(-1e-3)) == MISS


def test_a_floor_that_holds_less_far_than_asked_is_walked_piece_by_piece() -> None:
    def floor(t: float, length: float) -> tuple[float, float, float, float, float]:
        """A saw: 1 less the part of t, but its teeth end at 5 in a lower one."""
        piece = math.floor(t + TOLERANCE)
        value = 1.0 - (t - piece) - (0.5 if piece == 5 else -0.1)
        return value, -1.0, 0.0, min(length, piece + 1 - t), 0.0

    below = Counted(floor)
    assert find(below) == pytest.approx(5.5, abs=1e-12)
    assert below.calls < 20


def test_a_start_that_is_not_positive_is_returned_to_the_bit() -> None:
    level = Counted(lambda t, length: (-1.0, 0.0, 0.0, length, 0.0))
    assert find(level, start=math.pi / 7) == math.pi / 7
    assert level.calls == 1
    assert find(level, end=1.0, start=2.0) == MISS
    assert level.calls == 1


def test_an_end_that_is_reached_without_a_root_is_a_miss() -> None:
    line = Counted(lambda t, length: (5.0 - t, -1.0, 0.0, length, 0.0))
    assert find(line, end=4.0) == MISS
    assert line.calls == 1
    assert find(line, end=6.0) == pytest.approx(5.0, abs=1e-15)


def test_bounds_that_say_nothing_end_in_a_miss() -> None:
    blind = Counted(lambda t, length: (1.0, -1e9, 0.0, length, 0.0))
    assert find(blind) == MISS
    assert blind.calls == MOST_STEPS


def test_functions_are_told_by_number_when_others_are_done() -> None:
    roots = np.array([1.0, 20.0, 3.0, -1.0])

    def below(places: Floats, lengths: Floats, which: Ints) -> Floor:
        none = np.zeros_like(places)
        return Floor((roots[which] - places) * 0.7, none - 1.0, 0.0, lengths, none)

    found = certain_first_roots(below, np.zeros(4), np.full(4, 10.0), TOLERANCE)
    assert np.allclose(found, [1.0, MISS, 3.0, 0.0], rtol=0, atol=1e-12)
