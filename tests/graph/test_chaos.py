from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import pytest

from palpate.launch.chaos.aftermath import look
from palpate.launch.chaos.campaign import campaign
from palpate.launch.chaos.injector import Injected
from palpate.launch.chaos.subject import Subject, undisturbed

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


def test_another_result_and_what_is_left_behind_are_found(toys: Subject, tmp_path: Path) -> None:
    before = undisturbed(toys, tmp_path / "run")
    wanted = replace(before, code=7, mesh="0", said={**before.said, "/world": (2, "0")})
    (tmp_path / "run" / ".said").mkdir()
    (tmp_path / "palpate-left").mkdir()
    found = look(toys, wanted, Injected(), before.code, tmp_path / "run")
    assert found.wrong == (
        "what nodes had said is left in the run directory",
        f"the private folder {tmp_path / 'palpate-left'} is left",
        f"exit code {before.code} instead of 7: it said nothing",
        "the mesh is None instead of 0",
        "/world is not what it is undisturbed",
    )
    assert (found.lost, found.duplicated) == (1, 0)
