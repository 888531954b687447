import pytest

from palpate.tools.chaos.fault_injection import (
    ENDING,
    FAULT_KINDS,
    MAX_PER_NODE,
    PHASES,
    GraphFacts,
    draw_faults,
)

KNOWN = GraphFacts(
    ("planner", "tracer", "simulator", "recorder"),
    (("recorder", "tracer"), ("simulator", "tracer"), ("tracer", "planner")),
    {"/hand/goal": 3, "/finger/goal": 40, "/model/goal": 5, "/plan/done": 1},
)
LASTING = tuple(kind for kind in FAULT_KINDS if kind not in ENDING)


def test_all_follows_from_the_seed():
    assert draw_faults(7, KNOWN, FAULT_KINDS, 8) == draw_faults(7, KNOWN, FAULT_KINDS, 8)
    assert draw_faults(7, KNOWN, LASTING, 8) != draw_faults(8, KNOWN, LASTING, 8)


def test_runs_that_follow_each_other_go_through_every_node_in_every_phase():
    faults = [fault for seed in range(20) for fault in draw_faults(seed, KNOWN, ("kill",), 4)]
    hit = {(fault.whom[0], fault.phase) for fault in faults}
    assert hit == {(node, phase) for node in KNOWN.nodes for phase in PHASES}


@pytest.mark.parametrize("seed", range(30))
def test_no_node_meets_a_storm_and_every_moment_comes(seed):
    faults = draw_faults(seed, KNOWN, LASTING, 8)
    hit = [name for fault in faults for name in fault.whom]
    assert max(hit.count(name) for name in KNOWN.nodes) <= MAX_PER_NODE
    assert all(one.seq < KNOWN.counts.get(one.topic, 1) for one in faults)


def test_each_kind_is_drawn_and_what_ends_a_run_is_alone():
    runs = [draw_faults(seed, KNOWN, FAULT_KINDS, 8) for seed in range(60)]
    assert {fault.kind for faults in runs for fault in faults} == set(FAULT_KINDS)
    assert all(len(faults) == 1 for faults in runs if faults[0].kind in ENDING)
