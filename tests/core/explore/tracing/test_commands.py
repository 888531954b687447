from __future__ import annotations

import math

import numpy as np
import pytest

from palpate.core.explore.tracing.contour_path import (
    UPRIGHT,
    Procedure,
    ProcedureResult,
    SliceArc,
    TouchCommand,
    resume,
)


def felt(slope: float) -> SliceArc:
    empty = np.zeros((0, 3))
    none = np.zeros(0)
    return SliceArc(empty, empty, none, none, none, slope, np.zeros(3), np.zeros(3), 1, 1)


def count_hits(most: int) -> Procedure[int]:
    """Touch at 0, 1, 2, ... until `most` hits; a miss costs two steps ahead."""
    place, hits = 0.0, 0
    while hits < most:
        found = yield TouchCommand(np.array([place, 0.0]), 0.0, 0.01, 0.01, UPRIGHT)
        place += 2.0 if found is None else 1.0
        hits += found is not None
    return hits


def place_of(aim: TouchCommand | ProcedureResult[int]) -> float:
    assert isinstance(aim, TouchCommand)
    return float(aim.place[0])


def test_a_routine_starts_with_its_first_aim() -> None:
    assert place_of(resume(lambda: count_hits(2), ())) == 0.0


def test_what_was_felt_leads_to_the_next_aim() -> None:
    assert place_of(resume(lambda: count_hits(3), (felt(0.0),))) == 1.0
    assert place_of(resume(lambda: count_hits(3), (None,))) == 2.0
    assert place_of(resume(lambda: count_hits(3), (None, felt(0.0), None))) == 5.0


def test_the_end_of_a_routine_is_its_result() -> None:
    assert resume(lambda: count_hits(2), (felt(0.0), None, felt(0.0))) == ProcedureResult(2)
    assert resume(lambda: count_hits(0), ()) == ProcedureResult(0)


def test_resuming_twice_is_resuming_once() -> None:
    known = (felt(0.0), None)
    first, second = (resume(lambda: count_hits(9), known) for _ in range(2))
    assert place_of(first) == place_of(second) == 3.0


def test_a_routine_may_call_another() -> None:
    def both() -> Procedure[int]:
        return (yield from count_hits(1)) + (yield from count_hits(1))

    assert place_of(resume(both, (felt(0.0),))) == 0.0
    assert resume(both, (felt(0.0), felt(0.0))) == ProcedureResult(2)


def test_an_aim_starts_its_standoff_before_the_place_and_travels_past_it() -> None:
    aim = TouchCommand(np.array([0.03, 0.0]), 0.0, 0.012, 0.014, UPRIGHT)
    assert np.allclose(aim.start(0.05)[:3], [0.042, 0.0, 0.05])
    assert aim.travel == pytest.approx(0.026)
    shifted = aim._replace(posture=UPRIGHT._replace(shift=0.006))
    assert np.allclose(shifted.start(0.05)[:3], [0.042, 0.0, 0.044])
    tilted = aim._replace(posture=UPRIGHT._replace(tilt=math.pi / 2))
    assert np.allclose(tilted.start(0.05)[:3], [0.03, 0.0, 0.062])
