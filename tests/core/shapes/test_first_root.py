from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from palpate.core.arrays import Floats
from palpate.core.shapes.first_root import MOST_STEPS, Which, first_roots
from palpate.core.shapes.protocol import MISS

Curve = Callable[[Floats, Which], tuple[Floats, Floats]]


class Counted:
    """A function that counts how often it is asked."""

    def __init__(self, value: Callable[[Floats], Floats], slope: Callable[[Floats], Floats]):
        self._value, self._slope, self.calls = value, slope, 0

    def __call__(self, places: Floats, which: Which) -> tuple[Floats, Floats]:
        self.calls += 1
        return self._value(places), self._slope(places)


def parabola(roots: tuple[float, float]) -> Counted:
    a, b = roots
    return Counted(lambda t: (t - a) * (t - b), lambda t: 2 * t - a - b)


def find(function: Curve, end: float = 10.0, **bounds: float) -> float:
    zero = np.zeros(1)
    return float(first_roots(function, zero, zero + end, 1e-13, **bounds)[0])


def test_the_first_of_two_roots_is_found() -> None:
    assert find(parabola((2.0, 3.0))) == pytest.approx(2.0, abs=1e-14)
    assert find(parabola((2.0, 2.0 + 1e-7))) == pytest.approx(2.0, abs=1e-12)


def test_a_convex_function_that_has_turned_up_has_no_root() -> None:
    raised = Counted(lambda t: (t - 2.0) ** 2 + 1e-9, lambda t: 2 * (t - 2.0))
    assert find(raised) == MISS
    assert raised.calls < 30
    level = Counted(np.ones_like, np.zeros_like)
    assert find(level) == MISS
    assert level.calls == 1


def test_a_thin_dip_behind_a_hill_is_not_passed() -> None:
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
    def wave(t: Floats, which: Which) -> tuple[Floats, Floats]:
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


def test_a_start_that_touches_a_root_from_which_the_function_rises_is_left_safely() -> None:
    for touch in (1e-300, 1e-45, 1e-20, 1e-9):
        start = np.arcsin(touch)

        def wave(t: Floats, which: Which, start: float = start) -> tuple[Floats, Floats]:
            return np.sin(t + start), np.cos(t + start)

        assert find(wave, dip=1.0, rise=1.0) == pytest.approx(math.pi, abs=1e-8)


def test_a_known_rise_saves_the_last_look() -> None:
    blind, told = parabola((2.0, 9.0)), parabola((2.0, 9.0))
    assert find(blind) == pytest.approx(find(told, rise=2.0), abs=1e-13)
    assert told.calls == blind.calls - 1


def test_a_root_beyond_the_end_is_none() -> None:
    assert find(parabola((2.0, 3.0)), end=1.999) == MISS
    assert find(parabola((2.0, 3.0)), end=2.001) == pytest.approx(2.0)
    assert find(parabola((2.0, 3.0)), end=-1.0) == MISS


def test_what_is_not_positive_at_the_start_begins_there() -> None:
    starts = np.array([0.0, 2.5, 2.0])
    found = first_roots(parabola((2.0, 3.0)), starts, starts + 9, 1e-13)
    assert found[1:].tolist() == [2.5, 2.0]


def test_a_gap_is_jumped_and_a_step_does_not_go_past_its_end() -> None:
    def broken(t: Floats, which: Which) -> tuple[Floats, Floats]:
        assert not ((t > 1.0) & (t < 4.0)).any()
        return np.where(t <= 1.0, 0.5, 5.0 - t), np.where(t <= 1.0, 0.0, -1.0)

    gap = np.array([1.0, np.inf]), np.array([4.0, -np.inf])
    starts, ends = np.array([0.0, 4.5]), np.array([9.0, 9.0])
    assert first_roots(broken, starts, ends, 1e-13, dip=1.0, gaps=(gap,)).tolist() == [5.0, 5.0]
    within = first_roots(broken, np.array([2.0, 4.5]), ends, 1e-13, dip=1.0, gaps=(gap,))
    assert within.tolist() == [5.0, 5.0]


def test_functions_are_told_apart_when_others_are_done() -> None:
    roots = np.array([0.001, 1.0, 2.0, 30.0, 40.0, 50.0, np.inf])

    def each(t: Floats, which: Which) -> tuple[Floats, Floats]:
        return np.exp(np.minimum(roots[which], 99.0) - t) - 1.0, -np.exp(
            np.minimum(roots[which], 99.0) - t
        )

    found = first_roots(each, np.zeros(7), np.full(7, 60.0), 1e-13)
    assert np.allclose(found[:6], roots[:6], rtol=0, atol=1e-12)
    assert found[6] == MISS


def test_it_gives_up_after_some_steps() -> None:
    flat = Counted(lambda t: np.full_like(t, 1e-12), np.zeros_like)
    assert find(flat, dip=1.0) == MISS
    assert flat.calls == MOST_STEPS
