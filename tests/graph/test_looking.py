"""Tools that look at a running graph: what they say is true, and the graph stays untouched."""

from __future__ import annotations

import os
import signal
import sys
import tempfile
from contextlib import contextmanager, suppress
from itertools import pairwise

import pytest
from ruamel.yaml import YAML

from palpate.launch.processes.registry import running_graphs
from palpate.messages import decode
from palpate.messages.bus import STATUS_TOPIC
from palpate.messages.types import NodeStatus
from palpate.tools.introspection.requests import RequestTimeouts, request
from palpate.tools.introspection.topics import TapSubscription, find_topics
from tests.graph.conftest import WITHIN, handled, palpate, started, wait_for

pytestmark = [pytest.mark.graph, pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")]
# Messages that no queue on the way to a tool can hold: 64 at the node, 1000 at the tool, each twice
# as libzmq counts them, and the kernel's.
MORE = 3000
# Pause of the ring at each message, so that tools beside it get their share of the machine [s].
WORK = 2e-4


@contextmanager
def launched(folder):
    """A ring of two nodes and a sink that runs for ever, up and turning."""
    with started("run_graph.py", "ring", folder, WORK, start_new_session=True) as process:
        try:
            card = wait_for(lambda: cards().get(process.pid))
            wait_for(lambda: handled(card, "source") > 0)
            yield process
        finally:
            process.send_signal(signal.SIGCONT)
            process.send_signal(signal.SIGINT)
            process.communicate(timeout=WITHIN)
            process.kill()


def cards():
    """The graphs that run, by the number of their launcher's process."""
    return {card.pid: card for card in running_graphs()}


def nodes_of(card):
    return request(card, "status")["nodes"]


@pytest.fixture(scope="module")
def ring():
    """The only graph that runs."""
    with tempfile.TemporaryDirectory(dir="/tmp") as folder, pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_RUNTIME_DIR", folder)
        with launched(folder):
            yield running_graphs()[0]


def output(words, *more):
    done = palpate(*words.split(), *more)
    assert done.code == 0, done.err
    return done.out


def test_nodes_topics_and_parameters_of_graph_are_listed(ring):
    assert output("node list").split() == ["relay", "sink", "source"]
    assert "/relay [TactileFrame]" in output("topic list -t").splitlines()
    assert output("topic list -c") == "6\n"
    topic, node = output("topic info source -v"), output("node info source")
    assert "Subscription count: 1  relay" in topic and "  robot_time  number" in topic
    for line in ("    /relay  TactileFrame  from relay", "  state     running", "of a core now"):
        assert line in node
    params = YAML(typ="safe", pure=True).load(output("param dump source"))
    assert (params["source"]["params"]["burst"], params["source"]["params"]["laps"]) == (1, 10**9)


def test_sequence_numbers_agree_with_the_publishers_own_count(ring):
    beats: list[tuple[int, int]] = []
    frames: list[tuple[int, int]] = []
    with TapSubscription(ring, find_topics(ring, ["/relay", STATUS_TOPIC])) as taps:
        for batch in taps.batches(WITHIN):
            for message in batch:
                header = message.header
                if message.topic == "/relay":
                    frames.append((header.sent_ns, header.seq))
                elif message.publisher == "relay":
                    beats.append((header.sent_ns, decode(NodeStatus, message.body).sent))
            if len(beats) == 3:
                break
    assert frames == sorted(frames)
    for when, sent in beats:  # a message has a lower number if and only if it was sent before
        assert all((seq < sent) == (sent_ns < when) for sent_ns, seq in frames)


@pytest.mark.slow
def test_stopped_unread_killed_and_interrupted_tools_leave_the_graph_untouched(ring):
    echo = ("topic", "echo", "/relay", "--field", "touch")
    with (
        started(*echo) as stopped,
        started("topic", "echo", "/relay", "--full-length") as unread,
        started("topic", "hz", "/relay", "/source") as killed,
        started(*echo, "--no-lost-messages") as interrupted,
    ):
        tools = (stopped, unread, killed, interrupted)
        for tool in tools:
            assert tool.stdout.readline().strip()
        stopped.send_signal(signal.SIGSTOP)
        killed.kill()
        interrupted.send_signal(signal.SIGINT)
        _, err = interrupted.communicate(timeout=WITHIN)
        assert (interrupted.returncode, err) == (0, "")
        before = handled(ring, "source")
        wait_for(lambda: handled(ring, "source") > before + MORE)
        assert unread.poll() is None
        stopped.send_signal(signal.SIGCONT)
        touches: list[int] = []
        while len(touches) < 2 or touches[-1] - touches[-2] == 1:  # until numbers are missing
            line = stopped.stdout.readline().strip()
            touches += [int(line)] if line.isdigit() else []
        assert "messages lost on the way here" in stopped.stderr.readline()
        for tool in tools:
            tool.kill()
    assert {name: about["restarts"] for name, about in nodes_of(ring).items()} == {
        "source": 0, "relay": 0, "sink": 0,
    }  # fmt: skip
    with TapSubscription(ring, find_topics(ring, [STATUS_TOPIC])) as taps:
        statuses = [decode(NodeStatus, tool.body) for tool in taps.take(WITHIN)]
    assert statuses and all(status.gaps == 0 for status in statuses)


NONE = "palpate: no graph of yours is running; start one with palpate run or launch\n"
ALL_TOOLS = (
    "node list, node info a, topic list, topic info a, topic echo a, topic hz a, topic bw a, "
    "topic delay a, param dump"
)


@pytest.mark.usefixtures("runtime")
def test_without_a_graph_every_tool_says_so_in_one_sentence():
    for words in ALL_TOOLS.split(", "):
        assert palpate(*words.split()) == (2, "", NONE)
    assert "ok   no graph of yours is running\n" in output("doctor")


@pytest.mark.slow
def test_one_of_several_graphs_is_selected_and_its_end_ends_the_tool(runtime, monkeypatch):
    with launched(runtime) as first, launched(runtime) as second:
        running = cards()
        done = palpate("topic", "list", "-c")
        assert done.code == 2
        assert all(running[one.pid].run[:4] in done.err for one in (first, second))
        for card in (running[first.pid], running[second.pid]):
            pid = nodes_of(card)["source"]["pid"]
            assert f"  pid       {pid}\n" in output(f"node info source --run {card.run[:8]}")
        done = palpate("topic", "list", "--run", "graph")
        assert done.code == 2 and "several running graphs are called 'graph'" in done.err
        out = output("doctor --report")
        assert out.count("3 nodes, ") == 2 and f"launcher {first.pid}, since" in out
        # A node is received also after its death, and nothing twice.
        card, numbers, epochs = running[second.pid], [], set()
        with TapSubscription(card, find_topics(card, ["/relay"])) as taps:
            for batch in taps.batches(WITHIN):
                numbers += [one.header.seq for one in batch]
                epochs |= {one.header.epoch for one in batch}
                about = nodes_of(card)["relay"]
                if len(numbers) > 50 and about["pid"] and not about["restarts"]:
                    with suppress(ProcessLookupError):
                        os.kill(about["pid"], signal.SIGKILL)
                if 1 in epochs:
                    break
        assert 1 in epochs and all(later > earlier for earlier, later in pairwise(numbers))
        run = running[first.pid].run
        with started("topic", "hz", "/relay", "/node/status", "--run", run) as hz:
            assert hz.stdout.readline().strip()
            first.send_signal(signal.SIGINT)
            out, err = hz.communicate(timeout=WITHIN)
        assert (hz.returncode, err) == (0, "") and "average rate" in out
        monkeypatch.setitem(request.__kwdefaults__, "timeouts", RequestTimeouts(answer=0.2))
        second.send_signal(signal.SIGSTOP)
        done = palpate("doctor")
        assert done.code == 1
        kill = f"it is busy or stopped; if it stays so, kill {second.pid}"
        assert kill in " ".join(done.out.split())
        assert any(line.startswith("FAIL ") for line in done.out.splitlines())
