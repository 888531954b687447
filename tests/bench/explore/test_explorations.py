from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from palpate.bench.explore import explorations, harness, planners
from palpate.bench.explore.explorations import RunClaim, calibration_figures, run_claim
from palpate.bench.explore.harness import (
    EXACT,
    Demand,
    Explored,
    explore_object,
    first_within,
)
from palpate.bench.explore.planners import (
    WORST,
    ContourCounts,
    Side,
    at_end,
    contour_error,
    first_within_percent,
    taxel_error,
)
from palpate.bench.objects import EXPLORED_OBJECTS
from palpate.bench.table import WIDTH, Row
from palpate.core.explore.planners.predicted import COVERING
from palpate.core.explore.planners.trial import MOST_CONTOURS_PLANNED
from palpate.nodes.runtime.composed import Ending

COUNT = 2


@pytest.fixture(scope="module")
def explored():
    return explore_object(
        EXPLORED_OBJECTS["ellipsoid"], EXACT, Demand("uniform", settings={"count": COUNT})
    )


def changed(one: Explored, *, bound: float | None, within: bool = True) -> Explored:
    return one._replace(done=replace(one.done, rms_bound_95=bound, tolerance_met=within))


def named(rows: list[Row], part: str) -> Row:
    [found] = [row for row in rows if part in row.name]
    return found


def test_an_exploration_is_kept_with_all_that_was_published(explored):
    assert len(explored.contours) == explored.score.contours == COUNT
    assert explored.score.final
    assert explored.models[-1].final
    assert explored.touches >= sum(one.touches for one in explored.contours)
    assert 0.01 * explored.touches < explored.travel < 10.0
    assert 0.0 < explored.percent < 0.5
    assert explored.truth.height == pytest.approx(0.09)


def test_a_run_that_states_a_bound_holds_it_or_not(explored):
    assert explored.held is None
    size = explored.score.size
    assert changed(explored, bound=0.5 * size).held is True
    assert changed(explored, bound=1e-9 * size).held is False


def test_an_exploration_that_dies_is_told_with_its_reason(monkeypatch):
    ending = Ending(status="died", reason="the tracer: no way on")
    monkeypatch.setattr(harness, "run_composed", lambda *args, **kwargs: ending)
    with pytest.raises(RuntimeError, match="exploration died: the tracer: no way on"):
        explore_object(EXPLORED_OBJECTS["ellipsoid"], EXACT, Demand())


def test_the_side_is_good_from_contours_with_slopes_and_better_from_everything(explored):
    side = Side.of(explored.truth)
    share = side.points[:, 2] / side.height
    assert 0.03 <= share.min() <= share.max() <= 0.97
    slopes = contour_error(side, explored, COUNT)
    assert slopes < contour_error(side, explored, COUNT, slopes=False)
    assert taxel_error(side, explored, COUNT) < 0.5
    assert contour_error(side, explored, 1) == WORST


def test_contours_are_counted_until_the_side_is_good_enough(explored):
    side = Side.of(explored.truth)
    more = explored._replace(contours=2 * explored.contours)
    errors = {2: 1.0, 3: 0.2, 4: 0.1}
    assert first_within_percent(side, more, lambda side, one, count: errors[count]) == 3
    never = first_within_percent(side, explored, lambda side, one, count: 1.0)
    assert never == MOST_CONTOURS_PLANNED
    few = explored._replace(contours=explored.contours[:1])
    assert at_end(side, few) == MOST_CONTOURS_PLANNED


def test_whole_explorations_are_held_against_error_and_cost(explored, monkeypatch):
    demands: list[Demand] = []

    def explore(target: Any, noise: Any, demand: Demand) -> Explored:
        demands.append(demand)
        return changed(explored, bound=0.5, within=len(demands) > 1)

    monkeypatch.setattr(explorations, "explore_object", explore)
    monkeypatch.setattr(explorations, "QUICK_OBJECTS", ("sphere", "box"))
    rows = list(explorations.exploration_rows(True))
    assert len({row.name for row in rows}) == len(rows)
    assert max(len(row.name) for row in rows) < WIDTH
    assert [one.tolerance for one in demands] == pytest.approx([9e-5, 9e-5, 1.8e-4, 1.8e-4])
    good = explored.percent <= 0.2
    assert named(rows, "box, noise: rms").holds == good
    assert named(rows, "objects, noise: within").value == ("2 of 2" if good else "0 of 2")
    assert named(rows, "objects, exact: bound holds").value == "2 of 2"
    assert "held" in named(rows, "box, exact: stated bound").value
    assert named(rows, "ended, because").value == explored.done.reason
    monkeypatch.setattr(explorations, "MOST_TOUCHES", explored.touches - 1)
    rows = list(explorations.exploration_rows(True))
    assert not named(rows, "box, noise: contours, touches").holds


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


def test_a_run_is_near_if_it_ended_within_one_contour(explored):
    after = explored.scores[0].contours
    assert first_within(explored.scores, 100.0) == after
    assert first_within(explored.scores, 0.0) is None
    assert run_claim(explored, 0.0) == RunClaim(held=False, late=None, late_covered=None)
    told = run_claim(changed(explored, bound=1.0), 100.0)
    assert told == RunClaim(held=True, late=COUNT - after, late_covered=COUNT - after)
    covering = explored._replace(reasons=(COVERING,) * COUNT)
    assert run_claim(covering, 100.0).late_covered == 0


@pytest.mark.parametrize(("held", "holds"), [(89, False), (90, True), (98, True), (99, False)])
def test_a_bound_of_95_percent_may_hold_neither_too_seldom_nor_too_often(held, holds):
    told = [RunClaim(i < held, 0 if i < 80 else 5, 0) for i in range(100)]
    rows = list(calibration_figures(told))
    assert named(rows, "bound of 95 %").holds == holds
    assert named(rows, "first count within tolerance").holds
    assert named(rows, "first count and nothing untouched").holds
    fewer = list(calibration_figures([RunClaim(True, 5, 0 if i < 79 else 2) for i in range(100)]))
    assert not named(fewer, "first count within tolerance").holds
    assert not named(fewer, "first count and nothing untouched").holds
    assert len(list(calibration_figures([RunClaim(True, None, None)]))) == 2


def test_runs_of_the_calibration_tell_how_far_they_are(monkeypatch):
    monkeypatch.setattr(explorations, "calibration_run", lambda number: RunClaim(True, 0, 0))
    rows = list(explorations.calibration_rows(False))
    assert sum("runs so far" in row.name for row in rows) == 9
    assert named(rows, "200 runs").value == "100.0%"


def counts(**more: int) -> ContourCounts:
    given = {"positions": 8, "uniform": 6, "predicted": 5, "taxels": 4, **more}
    thesis = (given.pop("thesis", 7), 9)
    taxels = given.pop("taxels")
    return ContourCounts(**given, thesis=thesis, uniform_taxels=taxels, predicted_taxels=taxels)


@pytest.mark.parametrize(
    ("more", "missed"),
    [
        ({}, []),
        ({"uniform": 5}, ["predicted over uniform"]),
        ({"thesis": 5}, ["predicted over best thesis set"]),
        ({"positions": 7}, ["predicted over uniform, positions only"]),
    ],
)
def test_the_default_planner_is_held_against_each_rival(more, missed):
    rows = list(planners.count_sums({"a": counts(**more), "b": counts(**more)}))
    assert [row.name for row in rows if not row.holds] == missed


def test_no_object_may_take_two_contours_more_than_even_ones():
    found = {"a": counts(predicted=3), "b": counts(predicted=8)}
    rows = list(planners.count_sums(found))
    assert not named(rows, "on the worst object").holds


def test_the_objects_of_the_figures_are_all_there():
    names = {
        *explorations.QUICK_OBJECTS,
        *explorations.TILTED,
        *explorations.FINGER_OBJECTS,
        *planners.QUICK,
    }
    assert names <= set(EXPLORED_OBJECTS)
    assert np.isfinite([degrees for _, degrees in explorations.TURNED.values()]).all()
