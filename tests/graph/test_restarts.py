"""Nodes that are killed, stopped or broken while a graph runs: it must end as if nothing was."""

import multiprocessing
import os
import random
import re
import signal
import threading
import time
from dataclasses import replace

import msgspec
import pytest

from palpate.launch.launcher import launch
from palpate.messages.recording.reader import open_recording, parts_of
from palpate.nodes import recorder
from palpate.nodes.runtime.node import Input, Wiring, with_description
from tests.studies.stalling_node import StallingParams, subscriber
from tests.studies.toy_node import ToyParams, toy

pytestmark = pytest.mark.graph
FRAMES = 600


class Harm(threading.Thread):
    """Sends signals to the processes of nodes, one after the other."""

    def __init__(self, names, signal_, seed):
        super().__init__(daemon=True)
        self._names, self._signal = list(names), signal_
        self._rng = random.Random(seed)
        self.when: list[float] = []

    def run(self):
        for name in self._names:
            time.sleep(self._rng.uniform(0.05, 0.4))
            while not (
                found := [one for one in multiprocessing.active_children() if one.name == name]
            ):
                time.sleep(0.01)
            os.kill(found[0].pid or 0, self._signal)
            self.when.append(time.monotonic())


def line(folder):
    """A source, one who passes on, one who counts, and a recorder."""
    wirings = [
        toy("source", ToyParams(burst=FRAMES)),
        toy("relay", ToyParams(relay=True, work=1e-3), upstream="source"),
        toy("counter", ToyParams(expects=FRAMES, work=1e-3), upstream="relay"),
    ]
    kept = Wiring(
        name="recorder",
        module="palpate.nodes.recorder",
        params=recorder.Params(path=str(folder / "topics.mcap")),
        inputs=tuple(
            Input(name, f"/{name}", f"/{name}", "TactileFrame") for name in ("source", "relay")
        ),
        outputs={},
        subscribers={},
    )
    return list(with_description([*wirings, kept], {}))


def run(wirings, watcher, folder, harm):
    harm.start()
    ending = launch(wirings, ends="counter", watch=["/relay"], watcher=watcher, work_dir=folder)
    assert multiprocessing.active_children() == []
    return ending


def recorded(folder):
    recording = open_recording(folder / "topics.mcap")
    assert recording.closed
    return sorted((kept.topic, kept.seq) for kept in recording.messages())


ALL = sorted((topic, seq) for topic in ("/source", "/relay") for seq in range(FRAMES))


@pytest.mark.parametrize("seed", [0, 1, *(pytest.param(n, marks=pytest.mark.slow) for n in (2, 3))])
def test_nodes_that_are_killed_go_on_where_they_were(seed, watcher, tmp_path):
    names = ["relay", "counter", "source", "recorder"]
    random.Random(seed).shuffle(names)
    harm = Harm(names, signal.SIGKILL, seed)
    ending = run(line(tmp_path), watcher, tmp_path, harm)
    assert (ending.status, ending.reason) == ("finished", f"{FRAMES} received")
    assert sum(ending.restarts.values()) == len(harm.when)
    assert (ending.gaps, [one.touch for _, one in watcher.messages]) == (0, list(range(FRAMES)))
    assert recorded(tmp_path) == ALL
    # A recorder that dies before it has begun its file leaves none.
    assert len(parts_of(tmp_path / "topics.mcap")) <= 1 + ending.restarts["recorder"]
    warned = [one.text for one in watcher.lines if one.level == "warning"]
    assert all("was killed by SIGKILL; it is started again" in text for text in warned) and warned


def test_neighbours_that_die_at_once_rebuild_each_other(watcher, tmp_path):
    a = toy("a", ToyParams(laps=3000, burst=1), upstream="b")
    b = toy("b", ToyParams(relay=True, expects=3000), upstream="a")
    watch = threading.Thread(target=_kill_both, daemon=True)
    watch.start()
    ending = launch([a, b], ends="b", watch=[], watcher=watcher, work_dir=tmp_path)
    assert (ending.status, ending.reason, ending.gaps) == ("finished", "3000 received", 0)
    assert ending.restarts == {"a": 2, "b": 2}


def _kill_both():
    for _ in range(2):
        time.sleep(0.4)
        for child in multiprocessing.active_children():
            if child.name in "ab":
                os.kill(child.pid or 0, signal.SIGKILL)


def test_a_node_that_is_stopped_is_found_and_started_again(watcher, tmp_path):
    harm = Harm(["relay"], signal.SIGSTOP, 1)
    ending = run(line(tmp_path), watcher, tmp_path, harm)
    assert (ending.status, ending.restarts) == ("finished", {"relay": 1})
    [warned] = [one.text for one in watcher.lines if one.level == "warning"]
    assert warned.startswith("relay hung: it gave no sign of life for 1.")
    assert recorded(tmp_path) == ALL


def test_a_sender_that_waits_for_a_busy_subscriber_does_not_hang(watcher, tmp_path):
    busy = subscriber("busy", StallingParams(expects=12_000, stalls=((2000, 1.8),)))
    flooding = Wiring(
        name="source",
        module="palpate.tools.chaos.fault_injection",
        params={"messages": 12_000},
        inputs=(),
        outputs={"/flood": "/flood"},
        subscribers={},
    )
    graph = [flooding, busy]
    ending = launch(graph, ends="busy", watch=[], watcher=watcher, work_dir=tmp_path, depth=1)
    assert (ending.reason, ending.restarts) == ("12000 received, 0 missing, 0 out of turn", {})


def test_a_message_that_breaks_a_node_twice_ends_the_run(watcher, toys, tmp_path):
    wirings = [toy("source", ToyParams(burst=5)), replace(toys.broken("raise"), on_exit="restart")]
    ending = launch(wirings, ends="source", watch=[], watcher=watcher, work_dir=tmp_path)
    assert ending.status == "died"
    assert re.fullmatch(
        r"broken failed while handling /source 2 from source: ZeroDivisionError: cannot divide by "
        r"the number of touches \(.*palpate_toy_broken\.py:\d+ in \w+\); so it did when it was "
        r"started again",
        ending.reason,
    )


def test_a_node_that_dies_again_and_again_ends_the_run(watcher, toys, tmp_path):
    wirings = [toy("source", ToyParams(burst=5)), replace(toys.broken("kill"), on_exit="restart")]
    ending = launch(wirings, ends="source", watch=[], watcher=watcher, work_dir=tmp_path)
    assert (ending.status, ending.restarts) == ("died", {"broken": 3})
    assert ending.reason == (
        "broken was killed by SIGKILL, after it had been started again 3 times in 10 s"
    )


def test_the_run_goes_on_without_a_node_that_may_be_missed(watcher, toys, tmp_path):
    wirings = [
        toy("source", ToyParams(burst=50)),
        toy("counter", ToyParams(expects=50, work=1e-2), upstream="source"),
        replace(toys.broken("kill"), on_exit="ignore"),
    ]
    ending = launch(wirings, ends="counter", watch=[], watcher=watcher, work_dir=tmp_path)
    assert (ending.status, ending.reason) == ("finished", "50 received")
    [warned] = [one.text for one in watcher.lines if one.level == "warning"]
    assert warned == "broken was killed by SIGKILL; the run goes on without it"


def test_a_node_that_acts_does_nothing_twice_but_what_was_under_way(watcher, toys, tmp_path):
    actor = Wiring(
        name="actor",
        module="palpate_toy_actor",
        params={"path": str(tmp_path / "dents"), "expects": FRAMES},
        inputs=(Input("relay", "/relay", "/in", "TactileFrame"),),
        outputs={"/out": "/actor"},
        subscribers={},
        persistent=True,
    )
    wirings = [
        toy("source", ToyParams(burst=FRAMES)),
        toy("relay", ToyParams(relay=True, work=1e-3), upstream="source"),
        actor,
    ]
    harm = Harm(["actor", "relay", "actor"], signal.SIGKILL, seed=5)
    harm.start()
    ending = launch(wirings, ends="actor", watch=["/actor"], watcher=watcher, work_dir=tmp_path)
    assert (ending.status, ending.reason) == ("finished", f"{FRAMES} done")
    assert ending.restarts["actor"] == 2
    dents = [int(line) for line in (tmp_path / "dents").read_text().split()]
    received = [message.touch for _, message in watcher.messages]
    assert sorted(set(dents)) == sorted(set(received)) == list(range(FRAMES))
    assert len(dents) <= FRAMES + 2 and len(received) <= FRAMES + 2
    assert received == sorted(received)


@pytest.mark.parametrize("on_exit", ["ignore", "restart"])
def test_a_full_disk_ends_the_recording_and_the_run_as_it_is_told_to(on_exit, watcher, tmp_path):
    source, relay, counter, kept = line(tmp_path)
    params = msgspec.structs.replace(kept.params, spare=1 << 60)
    kept = replace(kept, params=params, on_exit=on_exit)
    ending = launch(
        [source, relay, counter, kept],
        ends="counter",
        watch=["/relay"],
        watcher=watcher,
        work_dir=tmp_path,
    )
    warned = " ".join(one.text for one in watcher.lines) + ending.reason
    assert "MiB are free on the disk" in warned
    if on_exit == "ignore":
        assert (ending.status, ending.reason) == ("finished", f"{FRAMES} received")
        assert "the run goes on without it" in warned
    else:
        assert ending.status == "died"
    assert all(open_recording(part).closed for part in parts_of(tmp_path / "topics.mcap")[:1])
