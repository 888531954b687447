from __future__ import annotations

import pytest

from palpate.bench.table import Row
from tests.studies import starts as bench_start
from tests.studies.starts import Started, seconds_of_fresh, start_rows

MODULES = ("palpate.nodes.filter", "palpate.nodes.tracer")


def rows(monkeypatch: pytest.MonkeyPatch, *, ready: float, longer: float) -> list[Row]:
    """The table if fresh interpreters need 2 s."""

    def started(*, early: bool) -> Started:
        return Started(MODULES, 1.0 + (longer if early else 0.0), ready if early else 0.8)

    monkeypatch.setattr(bench_start, "_in_new_process", started)
    monkeypatch.setattr(bench_start, "seconds_of_fresh", lambda modules: 2.0)
    return list(start_rows(quick=True))


@pytest.mark.parametrize(
    ("ready", "longer", "shares", "holds"),
    [
        (0.1, 0.1, ["0.05", "0.10"], [True, True]),
        (0.1, 0.4, ["0.05", "0.25"], [True, False]),
        (0.5, -0.4, ["0.25", "0.25"], [False, False]),
    ],
)
def test_what_the_check_loses_to_the_server_counts_and_what_it_gains_does_not(
    monkeypatch: pytest.MonkeyPatch,
    ready: float,
    longer: float,
    shares: list[str],
    holds: list[bool],
):
    alone, both = rows(monkeypatch, ready=ready, longer=longer)[-2:]
    assert alone.name == "seven nodes ready, over seven fresh interpreters"
    assert [alone.value, both.value] == shares
    assert [alone.holds, both.holds] == holds


def test_an_interpreter_that_cannot_import_its_node_is_no_measurement():
    with pytest.raises(RuntimeError, match="could not import its node"):
        seconds_of_fresh(["palpate.nodes.nothing"])


@pytest.mark.graph
def test_a_launch_is_measured_up_to_the_moment_at_which_its_nodes_are_ready():
    done = bench_start._in_new_process(early=True)
    kinds = [module.rpartition(".")[2] for module in done.modules]
    assert kinds == [
        "simulator",
        "filter",
        "curvature",
        "tracer",
        "planner",
        "reconstructor",
        "evaluator",
    ]
    assert 0.0 < done.ready < 60.0 and 0.0 < done.checked < 60.0
