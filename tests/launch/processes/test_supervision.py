"""Who is started again, who hangs, when a graph is done, and what tools may set."""

import json
import time
from types import SimpleNamespace
from typing import Any

import pytest

from palpate.launch.processes import process_table
from palpate.launch.processes.node_status import (
    Edge,
    MessageCounts,
    NodeStatusTable,
    TerminationDetector,
)
from palpate.launch.processes.registry import Announcement, RunCard
from palpate.launch.processes.supervisor import ToolServer
from palpate.messages import encode
from palpate.messages.types import NodeStatus
from palpate.nodes.filter import Params
from palpate.nodes.runtime.node import Wiring, describe_wirings, recorded_nodes
from palpate.testing import example

KILLED = "was killed by SIGKILL"


def test_node_is_restarted_but_not_in_a_storm_or_twice_for_one_failure():
    restarts = process_table.RestartPolicy({"a": "restart", "b": "restart", "c": "stop"})
    answers = [restarts.refusal("a", KILLED, False, now) for now in (0.0, 1.0, 2.0, 9.0, 10.5)]
    storm = f"a {KILLED}, after it had been started again 3 times in 10 s"
    assert answers == [None, None, None, storm, None]
    assert restarts.refusal("b", KILLED, False, 3.0) is None
    assert restarts.refusal("c", "hung", False, 0.0) == "c hung"
    assert restarts.counts == {"a": 4, "b": 1, "c": 0}
    restarts = process_table.RestartPolicy({"a": "restart"})
    failure = "failed while handling /in {} from b: ValueError: no"
    answers = [restarts.refusal("a", failure.format(n), True, 40.0 * n) for n in (7, 8)]
    assert answers == [None, None]
    again = restarts.refusal("a", failure.format(8), True, 400.0)
    assert again == f"a {failure.format(8)}; so it did when it was started again"


@pytest.mark.parametrize(
    ("counts", "journal", "deaths"),
    [((0, 1, 2), 8, [1, 1]), ((0, 0, 0, 0), 8, [0, 1, 1]), ((0,) * 6, None, [0] * 5)],
)
def test_death_for_memory_is_counted_or_repeated_at_one_place(
    counts, journal, deaths, tmp_path, monkeypatch
):
    system = iter(counts)
    monkeypatch.setattr(process_table, "memory_kills", lambda: next(system))
    path = tmp_path / "journal"
    kills, for_memory = process_table.KilledNodes({"a": str(path)}), []
    for death in range(len(deaths)):
        kills.begun("a", 100.0 * death)
        path.write_bytes(bytes(journal or death))  # it has come further, or no further
        for_memory.append(int(kills.for_memory("a", 100.0 * death + 50.0)))
    assert for_memory == deaths


def hung_at(monkeypatch, state, used, timeout, *, signs=True, ticks=range(1, 51)):
    """When a node is found to hang [s after its last sign], at which it had used 2 s."""
    does = None if state is None else process_table.ProcessState(state, used)
    monkeypatch.setattr(process_table, "process_state", lambda pid: does)
    watchdog = process_table.Watchdog({"node": timeout})
    watchdog.hung(10.0, {"node": 1})
    watchdog.sign("node", 10.0, 2.0)
    if not signs:
        watchdog.begin("node", 10.0)
    for tick in ticks:
        if watchdog.hung(10.0 + 0.1 * tick, {"node": 1}):
            return pytest.approx(0.1 * tick)
    watchdog.forget("node")
    assert not watchdog.hung(10.0 + 0.1 * tick, {"node": 1})
    return None


@pytest.mark.parametrize(("state", "used", "timeout", "signs", "silence"), [
    ("T", 2.0, 60.0, True, 1.3),  # stopped
    ("S", 2.0, 1.0, True, 1.3),  # blocked
    ("S", 2.0, 3.0, True, 3.1),
    ("R", 3.5, 1.0, True, 1.3),  # in an endless loop
    ("R", 2.1, 1.0, True, None),  # starved by others
    ("R", 3.5, 60.0, True, None),  # at work
    (None, 0.0, 1.0, True, 1.3),  # where the system does not tell
    (None, 0.0, 3.0, True, 3.1),
    ("T", 2.0, 1.0, False, 1.3),  # a node that begins may take its time, but not be stopped
    ("S", 2.0, 1.0, False, None),
    ("R", 9.0, 1.0, False, None),
])  # fmt: skip
def test_node_hangs_that_neither_works_nor_waits_for_the_processor(
    monkeypatch, state, used, timeout, signs, silence
):
    assert hung_at(monkeypatch, state, used, timeout, signs=signs) == silence


def test_silence_while_the_launcher_did_not_run_is_forgiven(monkeypatch):
    ticks = (500, 504, 508, 513)
    assert hung_at(monkeypatch, "T", 2.0, 1.0, ticks=ticks[:3]) is None
    assert hung_at(monkeypatch, "T", 2.0, 1.0, ticks=ticks) == 51.3


@pytest.mark.parametrize(("code", "words"), [
    (-9, KILLED), (-11, "was killed by SIGSEGV"), (3, "ended by itself with exit code 3"),
])  # fmt: skip
def test_exit_code_is_put_into_words(code, words):
    assert process_table.exit_text(code) == words


STATUS = example(NodeStatus, node="filter", messages=3, state="ending")


def test_node_reports_ready_exiting_and_failed_and_long_silence_is_mentioned_once():
    table = NodeStatusTable(["filter"])
    assert table.receive("filter", {"kind": "ready"}) == []
    assert table.receive("filter", {"kind": "exiting", "status": encode(STATUS)}) == []
    assert table.ready == table.exiting == {"filter"}
    assert table.statuses["filter"].messages == 3
    table = NodeStatusTable(["filter"])
    word = {"kind": "failed", "text": "it broke", "trace": "T" * 99_999}
    lines = table.receive("filter", word)
    assert table.failed == {"filter": "it broke"}
    assert [line.level for line in lines] == ["error", *["debug"] * 25]
    assert sum(len(line.text) for line in lines) == 8 + 99_999
    assert all(encode(line) for line in lines)
    with pytest.raises(ValueError, match="'spy' reported, which is not in the graph"):
        table.receive("spy", {"kind": "ready"})
    with pytest.raises(ValueError, match="not a NodeStatus"):
        table.receive("filter", {"kind": "exiting", "status": b""})
    table = NodeStatusTable(["filter", "fit"], {"filter": 1.0, "fit": 120.0}, silence_limit=5.0)
    now, named = time.monotonic(), []
    for after in (0.0, 10.0, 10.0, 119.0, 121.0):
        named.append([one.text.partition(",")[0] for one in table.silent(now + after)])
    starting = "is still starting"
    assert named == [[], [f"filter {starting}"], [], [], [f"fit {starting}"]]
    table.receive("filter", {"kind": "ready"})
    [line] = table.silent(now + 122.0)
    assert line.text.startswith("filter is still working, or hangs")


EDGE = Edge("hearer", "talker", "/talk")


def detector(*rounds, forget=-1):
    """After rounds of answers: messages sent and consumed."""
    made = TerminationDetector(["talker", "hearer"], [EDGE])
    for now, (sent, consumed) in enumerate(rounds):
        if now == forget:
            made.forget()
        answer(made, sent, consumed, now)
    return made


def answer(made, sent, consumed, now, waits=()):
    number, received = made.round, {("talker", "/talk"): consumed}
    made.answer("talker", number, MessageCounts({"/talk": sent}, {}), now, 0.0)
    made.answer("hearer", number, MessageCounts({}, received, waits), now, 0.0)


def test_graph_is_settled_by_two_equal_rounds_or_asks_and_complains():
    assert not detector((3, 3)).settled
    assert detector((3, 3), (3, 3)).settled
    assert detector((3, 3), (3, 3)).still_for(2.0) == 2.0
    assert not detector((3, 2), (3, 2)).settled
    assert detector((3, 2), (3, 2)).unconsumed() == [(EDGE, 3, 2)]
    moved = detector((3, 3), (3, 3), (4, 4))
    assert not moved.settled and moved.still_for(3.0) == 0.0
    assert not detector((3, 3), (3, 3), forget=1).settled
    made = detector()
    answer(made, 3, 1, 0.0, waits=("/world",))
    assert made.complaints() == [
        "hearer needs /world before anything else",
        "hearer has consumed 1 of 3 on /talk from talker",
    ]
    answer(made, 0, 0, 1.0)
    assert made.complaints() == ["hearer has received nothing on /talk (talker)"]
    made, counts = detector(), MessageCounts({"/talk": 3}, {})
    assert made.to_ask(0.0) == ["talker", "hearer"]
    made.answer("talker", 0, counts, 0.0, 0.0)
    made.answer("stranger", 0, counts, 0.0, 0.0)
    assert made.to_ask(0.0) == [] and made.to_ask(60.0) == ["hearer"]
    made = detector((3, 3))
    made.answer("talker", 0, counts, 1.0, 0.0)  # of an earlier round
    assert made.to_ask(1.0) == ["talker", "hearer"]
    made = TerminationDetector(["talker", "hearer"], [EDGE, Edge("late", "talker", "/talk")])
    made.drop("hearer")
    assert made.to_ask(1.0) == ["talker"]
    for now in (1.0, 2.0):
        made.answer("talker", made.round, counts, now, 0.0)
    assert made.settled


def served(processes, *asked, announcement=None):
    """What a tool server answers and what it sends to nodes."""
    words: list[Any] = [("tool", one) for one in asked]
    answers: list[dict[str, Any]] = []
    sent: list[dict[str, Any]] = []
    line: Any = SimpleNamespace(
        receive=lambda: words.pop(0) if words else None,
        send=lambda tool, *_, **word: answers.append(word),
    )
    nodes: Any = SimpleNamespace(send=lambda _, kind, **fields: not sent.append(fields))
    server = ToolServer(line, nodes, processes, NodeStatusTable(["a", "b"]), announcement)
    for _ in asked:
        server.serve()
    return server, answers, sent


def test_tool_sets_only_what_a_node_declares_settable(tmp_path):
    module = "palpate.nodes.filter"
    edges: dict[str, Any] = {"inputs": (), "outputs": {}, "subscribers": {}}
    node = Wiring(name="filter", module=module, params=Params(), **edges)
    about = recorded_nodes(describe_wirings([node]))
    texts = {"run": "ab01", "name": "vase", "began": "", "folder": "", "tools": ""}
    card = RunCard(pid=1, ends="filter", nodes=about, taps={}, **texts)
    processes: Any = SimpleNamespace(wirings={"filter": node})
    wrong = [("path", "1"), ("order", "1"), ("contact", "5"), ("contact", '"' + "1" * 2000 + '"')]
    asked = [
        {"kind": "set", "node": "filter", "param": param, "value": value}
        for param, value in (*wrong, ("contact", "1e-4"))
    ]
    announcement = Announcement(tmp_path, card)
    server, told, sent = served(processes, *asked, announcement=announcement)
    assert [word["text"].partition(":")[0] for word in told if word] == [
        "filter.path cannot be set while it runs; of filter can",
        "order cannot be 1",
        "contact cannot be 5",
        "contact",
    ]
    assert sent == [{"param": "contact", "value": "1e-4", "ticket": 4}]
    server.done(4)
    [kept] = json.loads((tmp_path / "run.json").read_text())["nodes"]
    assert kept["params"] == {"order": "auto", "contact": 1e-4}


def test_status_has_every_node_and_the_processes_that_live():
    processes: Any = SimpleNamespace(
        wirings={"a": None, "b": None}, living=["b"], pid=lambda name: 7,
        restarts=SimpleNamespace(counts={"a": 2, "b": 0}),
    )  # fmt: skip
    _, [status], _ = served(processes, {"kind": "status"})
    assert status["kind"] == "status" and status["for_s"] >= 0.0
    nodes = {name: (one["pid"], one["restarts"]) for name, one in status["nodes"].items()}
    assert nodes == {"a": (0, 2), "b": (7, 0)}
