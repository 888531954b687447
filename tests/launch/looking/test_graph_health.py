from __future__ import annotations

from typing import Any

import pytest

from palpate.launch.looking.beats import Beats
from palpate.launch.looking.graph_health import graph_findings, graphs_findings
from palpate.launch.processes.register import Card
from palpate.messages.types import NodeStatus


def beats(gaps: int = 0) -> dict[str, Beats]:
    status = NodeStatus(
        node="talker",
        state="running",
        messages=5,
        sent=7,
        gaps=gaps,
        duplicates=0,
        p50=1.0,
        p99=2.0,
        cpu=0.1,
    )
    return {"talker": Beats(status, 0.5)}


def answer(**more: Any) -> dict[str, Any]:
    return {"for_s": 3.0, "nodes": {"talker": {"pid": 9, "restarts": 0, "silent_s": 0.1, **more}}}


def test_a_graph_that_is_well_takes_one_line(card: Card) -> None:
    (found,) = graph_findings(card, answer(), beats())
    assert str(found) == (
        "ok   ab12cd (vase) runs for 3 s: 1 nodes, 5 messages handled, none missing"
    )


@pytest.mark.parametrize(
    ("more", "gaps", "level", "words"),
    [
        ({"pid": 0}, 0, "WARN", "talker does not run"),
        ({"restarts": 2}, 0, "WARN", "talker was started again 2 times"),
        ({"silent_s": 9.0}, 0, "WARN", "talker has been silent for 9 s"),
        ({}, 4, "FAIL", "talker misses 4 messages"),
    ],
)
def test_each_fault_is_said(
    card: Card, more: dict[str, Any], gaps: int, level: str, words: str
) -> None:
    (found,) = graph_findings(card, answer(**more), beats(gaps))
    assert found.level == level
    assert words in found.text


def test_that_no_graph_runs_is_no_fault() -> None:
    assert [one.level for one in graphs_findings([])] == ["ok"]
