import os
from dataclasses import replace
from pathlib import Path

import pytest

from palpate.tools.chaos.fault_injection import Fault, InjectionLog
from palpate.tools.chaos.trials import Exploration, examine_run, run_baseline, run_trials

pytestmark = pytest.mark.graph
HERE = Path(__file__).parent


@pytest.fixture
def toys(monkeypatch):
    kept = [str(HERE), os.environ.get("PYTHONPATH", "")]
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(one for one in kept if one))
    return Exploration(str(HERE / "toys" / "fingers.yaml"), ("fingers:=2",), ("planner",))


def at(touch, kind, *whom):
    return Fault(kind, whom, "tracing", "/finger_1/finger/goal", touch, 0.0)


SEVERAL = [
    at(3, "kill", "tracer_1"),
    at(10, "neighbours", "filter_1", "simulator_1"),
    at(20, "recorder", "recorder"),
]
EACH = [at(5, "stop", "filter_1"), at(5, "full", "recorder"), at(5, "launcher")]


@pytest.mark.parametrize("faults", [
    pytest.param(SEVERAL, id="several"),
    *(pytest.param([one], id=one.kind, marks=pytest.mark.slow) for one in EACH),
])  # fmt: skip
def test_explorations_survive_what_is_done_to_them(faults, toys, monkeypatch):
    monkeypatch.setattr("palpate.tools.chaos.trials.draw_faults", lambda *_: tuple(faults))
    told: list[str] = []
    for _ in range(5):  # a fault that a short run has outrun hits nobody
        tally = run_trials(toys, seed=1, minutes=0, kinds=(), echo=told.append)
        assert tally.failed == [], told
        assert (tally.runs, tally.lost, tally.duplicated) == (1, 0, 0)
        assert tally.survived == sum(tally.injected.values())
        if tally.survived == len(faults):
            return
    raise AssertionError(told)


def test_another_result_and_what_is_left_behind_are_found(toys, tmp_path):
    toys = replace(toys, arguments=("fingers:=1",))
    before = run_baseline(toys, tmp_path / "run")
    wanted = replace(before, code=7, mesh="0", messages={**before.messages, "/world": (2, "0")})
    (tmp_path / "run" / ".published").mkdir()
    (tmp_path / "palpate-run-left").mkdir()
    found = examine_run(toys, wanted, InjectionLog(), before.code, tmp_path / "run")
    assert found.wrong == (
        "what nodes had published is left in the run directory",
        f"the private folder {tmp_path / 'palpate-run-left'} is left",
        f"exit code {before.code} instead of 7: it printed nothing",
        "the mesh is None instead of 0",
        "/world is not what it is undisturbed",
    )
    assert (found.lost, found.duplicated) == (1, 0)
