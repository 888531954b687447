from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from palpate.core.rebuild.skin.latitude import Latitude
from palpate.core.rebuild.skin.pace import pace_through

EVEN = np.array([0.0, 0.2, 0.21, 0.5, 0.9, 1.0])
LENGTHS = np.array([1.0, 4.0, 1.5, 2.0, 0.5])


def test_a_pace_passes_its_places_and_spans_what_the_values_do() -> None:
    pace = pace_through(EVEN, LENGTHS)
    assert np.allclose(pace.paced, np.append(0.0, np.cumsum(LENGTHS)) / LENGTHS.sum())
    assert np.abs(pace.of(EVEN) - pace.paced).max() < 1e-14
    assert np.abs(pace.value(pace.paced) - EVEN).max() < 1e-14


@given(
    steps=st.lists(st.tuples(st.floats(1e-4, 1.0), st.floats(1e-4, 1.0)), min_size=1, max_size=9)
)
@settings(derandomize=True, deadline=None, max_examples=50)
def test_a_pace_rises_and_is_undone_by_its_inverse(steps: list[tuple[float, float]]) -> None:
    rises, lengths = np.array(steps).T
    even = np.concatenate([[-1.0], -1.0 + np.cumsum(rises)])
    pace = pace_through(even, lengths)
    places = np.linspace(pace.paced[0], pace.paced[-1], 301)
    values = pace.value(places)
    assert (np.diff(values) > 0.0).all()
    assert np.abs(pace.value(pace.of(values)) - values).max() < 1e-10 * np.ptp(even)


def test_its_derivatives_are_those_of_its_values() -> None:
    pace, step = pace_through(EVEN, LENGTHS), 1e-5
    places = np.linspace(0.01, 0.99, 200)
    places = places[np.abs(places[:, None] - pace.paced).min(axis=1) > 2 * step]
    for derivative in (0, 1):
        slope = pace.value(places + step, derivative) - pace.value(places - step, derivative)
        wanted = pace.value(places, derivative + 1)
        assert np.abs(slope / (2 * step) - wanted).max() < 1e-5 * np.abs(wanted).max()


def test_steps_as_long_as_the_values_change_nothing() -> None:
    pace = pace_through(EVEN, np.diff(EVEN))
    places = np.linspace(0.0, 1.0, 101)
    assert np.abs(pace.value(places) - places).max() < 1e-14
    assert np.abs(pace.value(places, 2)).max() < 1e-9


@pytest.mark.parametrize("ends", [(False, False), (True, False), (False, True), (True, True)])
def test_a_paced_latitude_knows_its_heights(ends: tuple[bool, bool]) -> None:
    even = Latitude(-2.0, 3.0, ends)
    rows = even.of(np.array([-2.0, -1.0, 0.9, 1.0, 3.0]))
    paced = Latitude(-2.0, 3.0, ends, pace_through(rows, np.array([1.0, 2.0, 3.0, 1.0])))
    heights = np.linspace(-2.0, 3.0, 50)
    assert np.abs(paced.height(paced.of(heights)) - heights).max() < 1e-12
    places, step = paced.of(np.linspace(-1.9, 2.9, 40)), 1e-6
    for derivative in (0, 1):
        slope = paced.height(places + step, derivative) - paced.height(places - step, derivative)
        wanted = paced.height(places, derivative + 1)
        assert np.median(np.abs(slope / (2 * step) - wanted)) < 1e-5 * np.abs(wanted).max()
