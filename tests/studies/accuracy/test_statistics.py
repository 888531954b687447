from __future__ import annotations

import math

import numpy as np
import pytest

from tests.studies.accuracy import statistics
from tests.studies.accuracy.conftest import point, run_of
from tests.studies.accuracy.statistics import (
    TARGETS,
    cost_to_reach,
    dominated_at,
    held_share,
    reached_share,
    run_for,
    stated_and_true,
    table_of,
    target_costs,
    work_precision,
)


def test_targets_fall_evenly_in_the_logarithm():
    assert (TARGETS[0], TARGETS[-1], len(TARGETS)) == (
        pytest.approx(0.01),
        pytest.approx(1e-4),
        15,
    )
    assert np.ptp(np.diff(np.log(TARGETS))) < 1e-12


def test_who_wants_a_target_asks_for_no_looser_one():
    runs = [run_of(share=share) for share in (0.01, 0.002, 0.0005)]
    for target, share in ((0.02, 0.01), (0.01, 0.01), (0.005, 0.002), (0.0001, 0.0005)):
        assert run_for(runs, target).tolerance_m == pytest.approx(share * 0.1)


def test_a_target_costs_what_the_first_model_within_it_took():
    runs = [run_of(curve=(point(10, 1e-3), point(20, 2e-4), point(30, 5e-4)))]
    assert cost_to_reach(runs, 0.01, "touches") == 10
    assert cost_to_reach(runs, 0.005, "robot") == 40.0
    assert cost_to_reach(runs, 0.002, "compute") == 2.0
    assert cost_to_reach(runs, 0.001, "touches") == math.inf
    assert cost_to_reach([run_of(curve=(), failed="died")], 0.01, "touches") == math.inf


def test_only_what_every_method_explored_is_compared():
    runs = [run_of(), run_of(object="box"), run_of(method="other"), run_of(method="other", seed=1)]
    table = table_of(runs)
    assert {name: list(entries) for name, entries in table.items()} == {
        "mine": [("egg", 0)],
        "other": [("egg", 0)],
    }
    assert table_of([]) == {}


def test_the_share_of_targets_and_its_band_over_objects():
    costs = {"a": np.array([[1.0, 4.0]]), "b": np.array([[2.0, math.inf]])}
    grid = np.array([0.5, 1.0, 2.0, 4.0])
    one, again = (reached_share(costs, grid) for _ in range(2))
    assert one.share.tolist() == [0.0, 0.25, 0.5, 0.75]
    assert (one.low[-1], one.high[-1]) == (0.5, 1.0)
    assert (one.low == again.low).all()
    alone = reached_share({"a": costs["a"]}, grid)
    assert (alone.low == alone.high).all()


def test_work_is_told_by_tolerance_and_without_one_by_model():
    entries = {
        ("egg", seed): [
            run_of(share=0.01, curve=(point(10 + seed, 9e-4),)),
            run_of(share=0.001, curve=(point(50, 8e-5),)),
        ]
        for seed in (0, 1, 2)
    }
    loose, strict = work_precision(entries, "touches")
    assert loose.cost.tolist() == [10.5, 11.0, 11.5]
    assert strict.error == pytest.approx([8e-4] * 3)
    curve = (point(10, 1e-3), point(20, 5e-4))
    free = {("egg", 0): [run_of(curve=curve)], ("box", 0): [run_of(curve=curve[:1])]}
    free["cube", 0] = [run_of(curve=curve[:1])]
    [only] = work_precision(free, "touches")  # the second model is of one run in three
    assert only.cost[1] == 10.0


def test_a_bound_is_held_against_the_last_model():
    entries = {
        ("egg", 0): [run_of(curve=(point(9, 1e-2, 1e-3), point(10, 1e-3, 2e-3)))],
        ("egg", 1): [run_of(curve=(point(10, 3e-3, 2e-3),))],
        ("egg", 2): [run_of()],
    }
    pairs = stated_and_true(entries)
    assert pairs.tolist() == [[0.02, 0.01], [0.02, 0.03]]
    assert held_share(pairs) == 0.5


@pytest.mark.parametrize(
    ("ours", "theirs", "dominates"),
    [
        ([1.0, 4.0], [2.0, 4.0], True),
        ([3.0, 4.0], [2.0, 9.0], False),
        ([1.0, math.inf], [2.0, math.inf], True),
        ([1.0, math.inf], [2.0, 5.0], False),
    ],
)
def test_to_dominate_is_to_have_reached_it_as_often_at_every_cost(ours, theirs, dominates):
    one, other = ({"egg": np.array(costs)[:, None]} for costs in (ours, theirs))
    assert dominated_at(one, other) is dominates


def test_costs_are_told_by_object_and_seed():
    entries = {("egg", 0): [run_of()], ("egg", 1): [run_of()], ("box", 0): [run_of()]}
    costs = target_costs(entries, "touches", np.array([0.01, 0.001]))
    assert {name: one.tolist() for name, one in costs.items()} == {
        "egg": [[10.0, 20.0], [10.0, 20.0]],
        "box": [[10.0, 20.0]],
    }
    assert statistics.DRAWS >= 1000
