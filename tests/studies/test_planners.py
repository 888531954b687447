from __future__ import annotations

import pytest

from palpate.core.explore.planners.trial import MOST_CONTOURS_PLANNED, TUNED, PlannerTrial
from palpate.core.explore.planners.uniform import Uniform
from tests.studies import planners
from tests.studies.planners import (
    MOST_MILLISECONDS,
    errors_of,
    first_counts,
    plan_claim,
    planner_rows,
)


@pytest.mark.slow
def test_every_demand_on_planners_that_needs_no_clock_is_met(monkeypatch):
    monkeypatch.setattr(planners, "DRAWN", 21)
    rows = list(planner_rows(True))
    assert len({row.name for row in rows}) == len(rows)
    timed = [row for row in rows if row.value.endswith("ms")]
    assert [row.target for row in timed] == [f"<= {MOST_MILLISECONDS:g} ms"]
    assert sum(bool(row.target) for row in rows) == 6
    assert [str(row) for row in rows if not row.holds and row not in timed] == []


def test_a_plan_whose_side_is_never_good_enough_counts_as_the_most():
    trials = {"vase": PlannerTrial(TUNED["vase"])}
    assert first_counts(Uniform(count=3), trials) == {"vase": MOST_CONTOURS_PLANNED}


def test_a_run_is_told_with_the_slice_at_which_it_was_good_enough():
    trial = PlannerTrial(TUNED["pear"])
    one = plan_claim(trial, 0.0025)
    assert one.first_true is not None
    assert one.first_bound is not None
    assert 3 <= one.first_true <= one.first_bound <= one.slices
    assert one.true <= one.bound <= 0.0025
    slices = [trial.slice_at(height) for height in (0.003, 0.04, 0.08)]
    assert errors_of(trial, slices)[0] == 1.0
