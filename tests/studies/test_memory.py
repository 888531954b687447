from __future__ import annotations

import os

import numpy as np
import pytest

from palpate.nodes.runtime.node import Finished
from tests.studies import memory
from tests.studies.memory import (
    NODE,
    FeederParams,
    MemoryWatcher,
    growth_per_1000,
    memory_rows,
    own_memory,
)


def test_the_growth_is_the_slope_once_caches_are_warm():
    touches = np.arange(0.0, 10_000.0, 50.0)
    taken = 40.0 + 2e-3 * touches + np.where(touches < 1900.0, -0.02 * (1900.0 - touches), 0.0)
    assert growth_per_1000(np.column_stack([touches, taken])) == pytest.approx(2.0)


def test_the_memory_of_a_process_is_seen_until_it_ends():
    before = own_memory(os.getpid())
    kept = np.ones(16_000_000)  # 122 MB
    assert own_memory(os.getpid()) - before == pytest.approx(kept.nbytes / memory.MB, rel=0.1)
    assert own_memory(2**30) == 0.0


def test_the_feeder_touches_as_often_as_it_is_told_and_numbers_what_it_touches():
    params, number = FeederParams(touches=2 * memory.EACH), 0
    asked = []
    for _ in range(params.touches):
        number, [(topic, goal)] = NODE.inputs["/touch/patch"][1](params, number, None)
        asked.append((topic, goal.goal, goal.touch))
    assert len(set(asked)) == params.touches
    assert asked[-1] == ("/finger/goal", 1, memory.EACH - 1)
    _, [end] = NODE.inputs["/touch/patch"][1](params, number, None)
    assert isinstance(end, Finished)
    assert NODE.inputs["/contour/goal"][1](params, 3, None) == (3, [])


def watched(slope: float) -> MemoryWatcher:
    """A node that grows by so many MB a touch, of 10 taxels each."""
    found = MemoryWatcher()
    found.taxels = 10 * memory.QUICK_TOUCHES
    touches = range(0, memory.QUICK_TOUCHES, 10)
    found.samples["filter"] = [(number, slope * number) for number in touches]
    return found


@pytest.mark.parametrize(("slope", "holds"), [(1e-3, True), (2e-3, False)])
def test_what_nobody_needs_is_held_against_the_demand(monkeypatch, slope, holds):
    monkeypatch.setattr(memory, "watch_memory", lambda touches: watched(slope))
    one, needed, total = memory_rows(quick=True)
    assert one.name == "memory of filter, MB per 1,000 touches"
    assert (needed.value, total.holds) == ("0.496 MB", holds)


def test_a_watcher_looks_at_no_node_before_the_first_touch():
    found = MemoryWatcher()
    found.tick({})
    assert not found.samples


@pytest.mark.graph
@pytest.mark.slow
def test_a_graph_is_fed_and_stays_small(monkeypatch):
    monkeypatch.setattr(memory, "QUICK_TOUCHES", 600)
    rows = list(memory_rows(quick=True))
    names = {row.name.split()[2].rstrip(",") for row in rows[:-2]}
    assert names == {
        *("curvature", "evaluator", "filter", "planner", "reconstructor", "recorder", "simulator")
    }
