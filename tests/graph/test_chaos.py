from __future__ import annotations

import os
from pathlib import Path

import pytest

from palpate.launch.chaos.campaign import campaign
from palpate.launch.chaos.subject import Subject

pytestmark = pytest.mark.graph

HERE = Path(__file__).parent


@pytest.fixture
def toys(monkeypatch: pytest.MonkeyPatch) -> Subject:
    kept = [str(HERE), os.environ.get("PYTHONPATH", "")]
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(one for one in kept if one))
    return Subject(str(HERE / "toys" / "fingers.yaml"), ("fingers:=2",), ("planner",))


@pytest.mark.parametrize("kinds", [("kill", "recorder", "neighbours"), ("ctrl_c",)])
def test_explorations_survive_what_is_done_to_them(kinds: tuple[str, ...], toys: Subject) -> None:
    said: list[str] = []
    tally = campaign(toys, seed=1, minutes=0, kinds=kinds, echo=said.append, faults=3)
    assert tally.failed == [], said
    assert (tally.runs, tally.lost, tally.duplicated) == (1, 0, 0)
    assert tally.survived == sum(tally.injected.values()) >= 1


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["stop", "full", "flood", "late", "launcher"])
def test_explorations_survive_each_kind_of_fault(kind: str, toys: Subject) -> None:
    said: list[str] = []
    tally = campaign(toys, seed=2, minutes=0, kinds=(kind,), echo=said.append, faults=1)
    assert tally.failed == [], said
    assert tally.injected == {kind: 1}


def test_a_run_that_says_something_else_has_not_survived(toys: Subject, tmp_path: Path) -> None:
    from palpate.launch.chaos.aftermath import look
    from palpate.launch.chaos.injector import Injected
    from palpate.launch.chaos.subject import undisturbed

    before = undisturbed(toys, tmp_path / "two")
    other = toys.start(tmp_path / "other", flooded=True)
    code = other.wait()
    assert look(toys, before, Injected(session=other.pid), code, tmp_path / "other").wrong == ()
