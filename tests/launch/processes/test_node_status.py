import json
import time
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest

from palpate.launch.processes.node_status import (
    RETRY,
    SILENCE,
    Edge,
    MessageCounts,
    NodeStatusTable,
    TerminationDetector,
)
from palpate.launch.processes.registry import Announcement, RunCard
from palpate.launch.processes.supervisor import ToolServer
from palpate.messages.codec import encode
from palpate.messages.types.catalogue import NodeStatus
from palpate.nodes.filter import Params
from palpate.nodes.runtime.node import describe_wirings, lone_wiring, recorded_nodes

STATUS = NodeStatus(
    node="filter",
    state="ending",
    messages=3,
    sent=3,
    gaps=0,
    duplicates=0,
    p50=1.0,
    p99=2.0,
    cpu=0.1,
)


def test_a_node_reports_that_it_is_ready_exits_or_has_failed():
    roll = NodeStatusTable(["filter"])
    assert roll.receive("filter", {"kind": "ready"}) == []
    assert roll.receive("filter", {"kind": "exiting", "status": encode(STATUS)}) == []
    assert roll.ready == roll.exiting == {"filter"}
    assert roll.statuses["filter"].messages == 3
    roll = NodeStatusTable(["filter"])
    lines = roll.receive("filter", {"kind": "failed", "text": "it broke", "trace": "T" * 99_999})
    assert roll.failed == {"filter": "it broke"}
    assert [line.level for line in lines] == ["error", *["debug"] * 25]
    assert sum(len(line.text) for line in lines) == 8 + 99_999
    for line in lines:
        encode(line)


def test_strangers_and_counters_that_cannot_be_read_are_refused():
    with pytest.raises(ValueError, match="'spy' reported, which is not in the graph"):
        NodeStatusTable(["filter"]).receive("spy", {"kind": "ready"})
    with pytest.raises(ValueError, match="not a NodeStatus"):
        NodeStatusTable(["filter"]).receive("filter", {"kind": "exiting", "status": b""})


def test_silence_is_mentioned_once_until_the_node_reports_again():
    roll = NodeStatusTable(["filter"])
    late = time.monotonic() + 2 * SILENCE
    [line] = roll.silent(late)
    assert line.text.startswith("filter is still starting, or hangs")
    assert roll.silent(late) == []
    roll.receive("filter", {"kind": "ready"})
    [line] = roll.silent(late)
    assert line.text.startswith("filter is still working, or hangs")


def test_a_node_that_declared_long_work_may_be_silent_for_as_long():
    roll = NodeStatusTable(["filter", "fit"], {"filter": 1.0, "fit": 120.0})
    for after, named in ((2 * SILENCE, ["filter"]), (119.0, []), (121.0, ["fit"])):
        assert [one.node for one in roll.silent(time.monotonic() + after)] == named


EDGE = Edge("hearer", "talker", "/talk")


def census():
    return TerminationDetector(["talker", "hearer"], [EDGE])


def answer(one, sent, consumed, now, waits=()):
    round_ = one.round
    one.answer("talker", round_, MessageCounts({"/talk": sent}, {}), now, 0.0)
    one.answer(
        "hearer", round_, MessageCounts({}, {("talker", "/talk"): consumed}, waits), now, 0.0
    )


def test_two_equal_rounds_with_everything_consumed_are_settled_and_no_others():
    one = census()
    answer(one, 3, 3, 0.0)
    assert not one.settled
    answer(one, 3, 3, 1.0)
    assert one.settled
    assert one.still_for(2.0) == 2.0
    one = census()
    answer(one, 3, 2, 0.0)
    answer(one, 3, 2, 1.0)
    assert not one.settled
    assert one.unconsumed() == [(EDGE, 3, 2)]
    one = census()
    answer(one, 3, 3, 0.0)
    answer(one, 3, 3, 1.0)
    answer(one, 4, 4, 2.0)
    assert not one.settled
    assert one.still_for(3.0) == 0.0
    one = census()
    answer(one, 3, 3, 0.0)
    one.forget()
    answer(one, 3, 3, 1.0)
    assert not one.settled


def test_who_has_not_answered_this_round_is_asked_again_but_not_who_is_dropped():
    one = census()
    answer(one, 3, 3, 0.0)
    one.answer("talker", 0, MessageCounts({"/talk": 3}, {}), 1.0, 0.0)
    one.answer("stranger", 1, MessageCounts({"/talk": 3}, {}), 1.0, 0.0)
    assert one.to_ask(1.0) == ["talker", "hearer"]
    one = census()
    assert one.to_ask(0.0) == ["talker", "hearer"]
    one.answer("talker", 0, MessageCounts({}, {}), 0.0, 0.0)
    assert one.to_ask(RETRY / 2) == []
    assert one.to_ask(RETRY) == ["hearer"]
    one = TerminationDetector(["talker", "hearer"], [EDGE, Edge("late", "talker", "/talk")])
    one.drop("hearer")
    assert one.to_ask(1.0) == ["talker"]
    for now in (1.0, 2.0):
        one.answer("talker", one.round, MessageCounts({"/talk": 3}, {}), now, 0.0)
    assert one.settled


def test_complaints_name_who_waits_for_what():
    one = census()
    answer(one, 3, 1, 0.0, waits=("/world",))
    assert one.complaints() == [
        "hearer needs /world before anything else",
        "hearer has consumed 1 of 3 on /talk from talker",
    ]
    answer(one, 0, 0, 1.0)
    assert one.complaints() == ["hearer has received nothing on /talk (talker)"]


def test_a_tool_sets_what_a_node_calls_settable_and_no_more(tmp_path):
    filter_ = lone_wiring(Params(), (), ())
    wirings = {"filter": replace(filter_, module="palpate.nodes.filter")}
    card = RunCard(
        run="ab01",
        name="vase",
        pid=1,
        began="",
        folder="",
        ends="filter",
        nodes=recorded_nodes(describe_wirings([replace(wirings["filter"], name="filter")])),
        taps={},
        tools="",
    )
    told: list[dict[str, Any]] = []
    sent: list[dict[str, Any]] = []
    line = SimpleNamespace(receive=lambda: asked.pop(0), send=lambda _, *a, **w: told.append(w))
    nodes = SimpleNamespace(send=lambda _, kind, **fields: not sent.append(fields))
    server: Any = ToolServer
    processes = SimpleNamespace(wirings=wirings)
    served = server(line, nodes, processes, None, Announcement(tmp_path, card))

    def ask(param, value):
        asked.append(("tool", {"kind": "set", "node": "filter", "param": param, "value": value}))
        served.serve()

    asked: list[Any] = []
    line.receive = lambda: asked.pop(0) if asked else None
    ask("path", "1")
    ask("order", "1")
    ask("contact", "5")
    ask("contact", '"' + "1" * 2000 + '"')
    assert [word["text"].partition(":")[0] for word in told] == [
        "filter.path cannot be set while it runs; of filter can",
        "order cannot be 1",
        "contact cannot be 5",
        "contact",
    ]
    assert not sent
    ask("contact", "1e-4")
    assert sent == [{"param": "contact", "value": "1e-4", "ticket": 4}]
    served.done(4)
    [node] = json.loads((tmp_path / "run.json").read_text())["nodes"]
    assert node["params"] == {"order": "auto", "contact": 1e-4}


def test_a_tool_is_told_of_every_node_and_of_the_process_of_those_that_live():
    asked: list[Any] = [("tool", {"kind": "status"}), None]
    told: list[dict[str, Any]] = []
    line = SimpleNamespace(receive=lambda: asked.pop(0), send=lambda _, **word: told.append(word))
    processes = SimpleNamespace(
        wirings={"a": None, "b": None},
        living=["b"],
        pid=lambda name: 7,
        restarts=SimpleNamespace(counts={"a": 2, "b": 0}),
    )
    server: Any = ToolServer
    server(line, None, processes, NodeStatusTable(["a", "b"]), None).serve()
    [status] = told
    assert status["kind"] == "status" and status["for_s"] >= 0.0
    assert {name: (one["pid"], one["restarts"]) for name, one in status["nodes"].items()} == {
        "a": (0, 2),
        "b": (7, 0),
    }
