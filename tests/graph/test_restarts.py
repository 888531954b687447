"""Nodes that are killed, stopped or broken while a graph runs: it ends as if nothing had been."""

from __future__ import annotations

import re
import signal
from dataclasses import replace

import pytest
from palpate_toy import toy, wiring

from palpate.messages.recording import open_recording, parts_of
from palpate.nodes import recorder
from palpate.nodes.runtime.node import Input, with_description
from tests.graph.conftest import Harm, broken

pytestmark = pytest.mark.graph
FRAMES = 500


def line(folder, **options):
    """A source, one node that passes on, a recorder and one node that counts."""
    inputs = tuple(Input(one, f"/{one}", f"/{one}", "TactileFrame") for one in ("source", "relay"))
    params = recorder.Params(path=str(folder / "topics.mcap"), **options)
    wirings = [
        toy("source", burst=FRAMES),
        toy("relay", upstream="source", relay=True, work=1e-3),
        wiring("recorder", "palpate.nodes.recorder", params, inputs=inputs, outputs={}),
        toy("counter", upstream="relay", expects=FRAMES, work=1e-3),
    ]
    return list(with_description(wirings, {}))


def assert_all_recorded(folder):
    recording = open_recording(folder / "topics.mcap")
    assert recording.closed
    kept = sorted((one.topic, one.seq) for one in recording.messages())
    assert kept == sorted((topic, n) for topic in ("/source", "/relay") for n in range(FRAMES))


ORDERS = [
    "counter relay recorder source",
    *(
        pytest.param(order, marks=pytest.mark.slow)
        for order in ("source recorder counter relay", "recorder relay source counter")
    ),
]


@pytest.mark.parametrize("order", ORDERS)
def test_killed_nodes_go_on_where_they_were(order, run, watcher, tmp_path):
    harm = Harm(order.split(), seed=len(order.split()[0]))
    ending = run(line(tmp_path), watch=["/relay"])
    assert (ending.status, ending.reason) == ("finished", f"{FRAMES} received")
    assert sum(ending.restarts.values()) == harm.count > 0
    assert (ending.gaps, watcher.touches()) == (0, list(range(FRAMES)))
    assert_all_recorded(tmp_path)
    # A recorder that dies before it has begun its file leaves none.
    assert len(parts_of(tmp_path / "topics.mcap")) <= 1 + ending.restarts.get("recorder", 0)
    warned = watcher.warnings()
    assert all("was killed by SIGKILL; it is started again" in text for text in warned) and warned


def test_neighbours_that_die_at_once_rebuild_each_other(run):
    class Both(Harm):
        def run(self):
            for _ in range(2):
                self._rng.seed(0)  # twice after the same pause
                super().run()

    harms = [Both([name]) for name in "ab"]
    a = toy("a", upstream="b", laps=2500, burst=1)
    b = toy("b", upstream="a", relay=True, expects=2500)
    ending = run([a, b])
    assert (ending.status, ending.reason, ending.gaps) == ("finished", "2500 received", 0)
    assert ending.restarts == {"a": 2, "b": 2} and [harm.count for harm in harms] == [2, 2]


@pytest.mark.slow
def test_stopped_node_is_found_and_started_again(run, watcher, tmp_path):
    Harm(["relay"], signal.SIGSTOP, seed=1)
    ending = run(line(tmp_path))
    assert (ending.status, ending.restarts) == ("finished", {"relay": 1})
    [warned] = watcher.warnings()
    assert warned.startswith("relay hung: it gave no sign of life for 1.")
    assert_all_recorded(tmp_path)


@pytest.mark.slow
def test_sender_that_waits_for_a_busy_subscriber_does_not_hang(run):
    busy = toy("busy", upstream="source", expects=3000, stall=(500, 1.8))
    ending = run([toy("source", burst=3000), replace(busy, handler_timeout=5.0)], depth=1)
    assert (ending.reason, ending.restarts) == ("3000 received", {})


@pytest.mark.parametrize(("how", "restarts", "words"), [
    ("raise", 1, r"broken failed while handling /source 2 from source: ZeroDivisionError: .*\("
     r".*palpate_toy_broken\.py:\d+ in \w+\); so it did when it was started again"),
    ("kill", 3, r"broken was killed by SIGKILL, after it had been started again 3 times in 10 s"),
])  # fmt: skip
def test_node_that_breaks_again_at_one_message_or_often_ends_the_run(how, restarts, words, run):
    ending = run([toy("source", burst=5), broken(how, on_exit="restart")], ends="source")
    assert (ending.status, ending.restarts) == ("died", {"broken": restarts})
    assert re.fullmatch(words, ending.reason)


def test_acting_node_repeats_only_what_was_under_way(run, watcher, tmp_path):
    path = tmp_path / "dents.txt"
    params = {"path": str(path), "expects": FRAMES}
    wirings = [
        toy("source", burst=FRAMES),
        toy("relay", upstream="source", relay=True, work=1e-3),
        wiring("actor", "palpate_toy_actor", params, "relay", persistent=True),
    ]
    Harm(["actor", "relay", "actor"], seed=5)
    ending = run(wirings, watch=["/actor"])
    assert (ending.status, ending.reason) == ("finished", f"{FRAMES} done")
    assert ending.restarts["actor"] == 2
    dents, received = [int(one) for one in path.read_text().split()], watcher.touches()
    assert sorted(set(dents)) == sorted(set(received)) == list(range(FRAMES))
    assert len(dents) <= FRAMES + 2 and len(received) <= FRAMES + 2
    assert received == sorted(received)


@pytest.mark.parametrize("on_exit", ["ignore", "restart"])
def test_full_disk_ends_recording_and_run_as_declared(on_exit, run, watcher, tmp_path):
    graph = [
        replace(one, on_exit=on_exit) if one.name == "recorder" else one
        for one in line(tmp_path, spare=1 << 60)
    ]
    ending = run(graph)
    warned = " ".join(watcher.warnings()) + ending.reason
    assert "MiB are free on the disk" in warned
    if on_exit == "ignore":
        assert (ending.status, ending.reason) == ("finished", f"{FRAMES} received")
        assert "the run goes on without it" in warned
    else:
        assert ending.status == "died"
    assert all(open_recording(part).closed for part in parts_of(tmp_path / "topics.mcap")[:1])
