from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from palpate.bench.table import Row
from palpate.nodes.runtime.composed import Ending
from tests.studies import explorations, harness
from tests.studies.explored import EXPLORED_OBJECTS
from tests.studies.harness import EXACT, Demand, Explored, explore_object

COUNT = 2


@pytest.fixture(scope="module")
def explored():
    return explore_object(
        EXPLORED_OBJECTS["ellipsoid"], EXACT, Demand("uniform", settings={"count": COUNT})
    )


def changed(one: Explored, *, bound: float | None, within: bool = True) -> Explored:
    return one._replace(done=replace(one.done, rms_bound_95=bound, reached=within))


def named(rows: list[Row], part: str) -> Row:
    [found] = [row for row in rows if part in row.name]
    return found


def test_an_exploration_is_kept_with_all_that_was_published(explored):
    assert len(explored.contours) == explored.score.contours == COUNT
    assert explored.score.final
    assert explored.models[-1].final
    assert explored.touches >= sum(one.touches for one in explored.contours)
    assert 0.0 < explored.percent < 0.5
    assert explored.truth.height == pytest.approx(0.09)


def test_a_run_that_states_a_bound_holds_it_or_not(explored):
    assert changed(explored, bound=None).held is None
    size = explored.score.size
    assert changed(explored, bound=0.5 * size).held is True
    assert changed(explored, bound=1e-9 * size).held is False


def test_an_exploration_that_dies_is_told_with_its_reason(monkeypatch):
    ending = Ending(status="died", reason="the tracer: no way on")
    monkeypatch.setattr(harness, "run_composed", lambda *args, **kwargs: ending)
    with pytest.raises(RuntimeError, match="exploration died: the tracer: no way on"):
        explore_object(EXPLORED_OBJECTS["ellipsoid"], EXACT, Demand())


def test_an_object_that_leans_is_held_against_itself(explored, monkeypatch):
    poses: list[Any] = []

    def explore(target: Any, noise: Any, demand: Any, seed: int, moved: Any) -> Explored:
        poses.append(moved)
        return explored

    monkeypatch.setattr(explorations, "explore_object", explore)
    [row] = list(explorations.tilted_rows(True))
    assert (row.value, row.holds) == ("1.00 x", True)
    assert [pose is None for pose in poses] == [True, False]


@pytest.mark.parametrize(
    ("leaning", "value", "holds"), [(1.2, "1.20 x", True), (1.21, "1.21 x", False)]
)
def test_a_leaning_object_may_be_a_fifth_worse(monkeypatch, leaning, value, holds):
    monkeypatch.setattr(
        explorations,
        "mean_chamfer",
        lambda target, demand, quick, moved=None: 1.0 if moved is None else leaning,
    )
    [row] = list(explorations.tilted_rows(True))
    assert (row.value, row.holds) == (value, holds)


@pytest.mark.parametrize(
    ("times", "value", "holds"), [(0.9, "1.11 x", True), (0.8, "1.25 x", False)]
)
def test_a_direction_that_is_much_better_than_the_other_is_a_miss_too(
    monkeypatch: pytest.MonkeyPatch, times: float, value: str, holds: bool
):
    asked: list[Any] = []

    def mean(target: Any, demand: Any, quick: bool) -> float:
        asked.append(demand.axis)
        return 1.0 if demand.axis is None else times

    monkeypatch.setattr(explorations, "mean_chamfer", mean)
    [row] = list(explorations.direction_rows(True))
    assert (row.value, row.holds) == (value, holds)
    assert asked[0] is None
    assert np.linalg.norm(asked[1]) == pytest.approx(1.0)


def test_three_fingers_are_held_against_one(explored, monkeypatch):
    seconds = {1: 100.0, 3: 41.0}
    asked = iter([1, 3])

    def explore(target: Any, noise: Any, demand: Any, fingers: int = 1) -> Explored:
        assert fingers == next(asked)
        return explored._replace(wall=seconds[fingers])

    monkeypatch.setattr(explorations, "explore_object", explore)
    monkeypatch.setattr(explorations, "tracing_seconds", lambda one: one.wall)
    time, _, _, error = explorations.finger_rows(True)
    assert (time.value, time.holds) == ("0.41 x", True)
    assert (error.value, error.holds) == ("1.00 x", True)


def test_the_time_of_tracing_begins_with_the_end_of_the_first_contour(explored):
    times = [one.robot_time for one in explored.contours]
    assert explorations.tracing_seconds(explored) == max(times) - min(times)


def test_the_objects_of_the_figures_are_all_there():
    names = {
        *explorations.TILTED,
        *explorations.FINGER_OBJECTS,
    }
    assert names <= set(EXPLORED_OBJECTS)
    assert np.isfinite([degrees for _, degrees in explorations.TURNED.values()]).all()
