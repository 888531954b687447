import os
import signal
import subprocess
import sys
import time
from contextlib import contextmanager, suppress
from itertools import pairwise

import pytest
from ruamel.yaml import YAML

from palpate.launch.processes.registry import running_graphs
from palpate.messages.bus.node_sockets import STATUS_TOPIC
from palpate.messages.codec import decode
from palpate.messages.types.catalogue import NodeStatus
from palpate.tools.cli import command_line as cli
from palpate.tools.introspection import requests as asking
from palpate.tools.introspection.requests import request, sample_status
from palpate.tools.introspection.topics import (
    Rates,
    TapMessage,
    TapSubscription,
    Topic,
    find_topics,
)

pytestmark = [pytest.mark.graph, pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")]
SCRIPT = "tests.graph.toys.run_for_ever"
WITHIN = 30.0  # A deadline that only a broken graph or tool misses, s
# Messages that no queue on the way to a tool can hold: 64 at the node, 1000 at the tool, each twice
# as libzmq counts them, and the kernel's.
MORE = 3000
# Pause of the ring at each message, so that tools beside it get their share of the machine, s.
WORK = 2e-4


@contextmanager
def launched(folder):
    """A ring of two nodes and a sink that runs for ever, up and turning."""
    with subprocess.Popen(
        [sys.executable, "-m", SCRIPT, str(folder), str(WORK)],
        stdout=subprocess.PIPE,
        text=True,
        start_new_session=True,
    ) as process:
        try:
            wait_until(lambda: process.pid in cards(folder))
            wait_until(lambda: handled(cards(folder)[process.pid]) > 0)
            yield process
        finally:
            process.send_signal(signal.SIGCONT)
            process.send_signal(signal.SIGINT)
            with suppress(subprocess.TimeoutExpired):
                process.communicate(timeout=WITHIN)
            process.kill()


def wait_until(so):
    deadline = time.monotonic() + WITHIN
    while not so():
        assert time.monotonic() < deadline, "nothing came of it"


def cards(folder):
    """The graphs that run, by the number of their launcher's process."""
    return {card.pid: card for card in running_graphs(folder)}


def handled(card):
    """Messages that the source of the ring has handled so far, by its next status."""
    with TapSubscription(card, [Topic(STATUS_TOPIC, "NodeStatus", ("source",), ())]) as taps:
        received = taps.take(WITHIN)
    return decode(NodeStatus, received[-1].body).messages if received else 0


def only(folder):
    (card,) = running_graphs(folder)
    return card


@contextmanager
def tool(*arguments):
    """A verb in a process of its own."""
    with subprocess.Popen(
        [sys.executable, "-m", "palpate", *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        try:
            yield process
        finally:
            process.kill()


def first_line(process):
    assert process.stdout is not None
    return process.stdout.readline()


@pytest.fixture(scope="module")
def home(tmp_path_factory):
    """The run-time folder, in which one graph runs."""
    folder = tmp_path_factory.mktemp("ring")
    with launched(folder):
        yield folder


@pytest.fixture(autouse=True)
def runtime(request, monkeypatch):
    folder = "home" if "home" in request.fixturenames else "tmp_path"
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(request.getfixturevalue(folder)))


def test_echo_receives_a_running_graph(home, capsys):
    assert cli.run(["topic", "echo", "/relay", "-n", "3"]) == 0
    documents = [
        one for one in YAML(typ="safe", pure=True).load_all(capsys.readouterr().out) if one
    ]
    touches = [one["touch"] for one in documents]
    assert len(touches) == 3 and touches == sorted(set(touches))
    assert documents[0]["outcome"] == "hit"


def test_a_filter_and_a_field_choose_what_is_shown(home, capsys):
    wanted = "touch >= 0 and outcome == 'hit'"
    arguments = ["--filter", wanted, "--field", "outcome", "--field", "pose[6]", "--csv", "--once"]
    assert cli.run(["topic", "echo", "relay", *arguments]) == 0
    assert capsys.readouterr().out == "hit,1.0\n"


def test_a_graph_is_told_of_by_its_nodes_topics_and_parameters(home, capsys):
    told = {}
    for words in ("node list", "topic list -t", "topic list -c", "topic info source -v",
                  "node info source", "param dump source"):  # fmt: skip
        assert cli.run(words.split()) == 0
        told[words] = capsys.readouterr().out
    assert told["node list"].split() == ["relay", "sink", "source"]
    assert "/relay [TactileFrame]" in told["topic list -t"].splitlines()
    assert told["topic list -c"] == "6\n"
    assert "Subscription count: 1  relay" in told["topic info source -v"]
    assert "  robot_time  number" in told["topic info source -v"]
    assert "    /relay  TactileFrame  from relay" in told["node info source"]
    assert "  state     running" in told["node info source"]
    assert "of a core now" in told["node info source"]
    params = YAML(typ="safe", pure=True).load(told["param dump source"])["source"]["params"]
    assert (params["burst"], params["laps"]) == (1, 10**9)


def test_the_numbers_of_messages_are_the_publishers_own_count(home):
    card = only(home)
    beats: list[tuple[int, int]] = []
    frames: list[TapMessage] = []
    with TapSubscription(card, find_topics(card, ["/relay", STATUS_TOPIC])) as taps:
        for batch in taps.batches(WITHIN):
            for message in batch:
                if message.topic == "/relay":
                    frames.append(message)
                elif message.publisher == "relay":
                    beats.append((message.header.sent_ns, decode(NodeStatus, message.body).sent))
            if len(beats) == 5:
                break
    for when, sent in beats:
        assert all((one.header.seq < sent) == (one.header.sent_ns < when) for one in frames)
    first, last = (
        next(n for n, one in enumerate(frames) if one.header.sent_ns > when)
        for when, _ in (beats[0], beats[-2])
    )
    rates = Rates()
    for one in frames[first : last + 1]:
        rates.add(one)
    seconds = 1e-9 * (frames[last].header.sent_ns - frames[first].header.sent_ns)
    counted = beats[-2][1] - beats[0][1]
    lost = frames[last].header.seq - beats[-2][1], frames[first].header.seq - beats[0][1]
    # Of the count between two words it differs by no more than what was lost right after each.
    assert rates.rate() == pytest.approx((counted + lost[0] - lost[1]) / seconds)
    assert min(lost) >= 0


def test_hz_bw_and_delay_tell_their_figures_and_hz_on_which_topic_nothing_comes(home, capsys):
    for verb, words in (("bw", "B/s from "), ("delay", "average delay:")):
        assert cli.run(["topic", verb, "/relay", "--duration", "0.3"]) == 0
        assert words in capsys.readouterr().out
    assert cli.run(["topic", "hz", "--all", "--duration", "0.5"]) == 0
    out = capsys.readouterr().out
    assert "no messages on /relay/mark\n" in out
    assert "/relay\naverage rate: " in out
    assert cli.run(["topic", "hz", "/rely"]) == 2
    assert "nobody publishes /rely; did you mean '/relay'?" in capsys.readouterr().err


def test_tools_that_are_stopped_unread_killed_or_interrupted_leave_the_graph_untouched(home):
    card = only(home)
    told = ("topic", "echo", "/relay", "--field", "touch")
    with (
        tool(*told) as stopped,
        tool("topic", "echo", "/relay", "--full-length") as unread,
        tool("topic", "hz", "/relay", "/source") as killed,
        tool(*told, "--no-lost-messages") as interrupted,
    ):
        assert first_line(stopped).strip().isdigit()
        for one in (unread, killed, interrupted):
            assert first_line(one).strip()
        stopped.send_signal(signal.SIGSTOP)
        killed.kill()
        interrupted.send_signal(signal.SIGINT)
        _, err = interrupted.communicate(timeout=WITHIN)
        assert (interrupted.returncode, err) == (0, "")
        before = handled(card)
        wait_until(lambda: handled(card) > before + MORE)
        assert unread.poll() is None
        stopped.send_signal(signal.SIGCONT)
        assert "messages lost on the way here" in read_on(stopped)
    assert_untouched(card)


def read_on(echo):
    """Read what a tool prints until it tells something beside it, and return that."""
    assert echo.stdout is not None and echo.stderr is not None
    touches: list[int] = []
    while len(touches) < 2 or touches[-1] - touches[-2] == 1:
        line = echo.stdout.readline().strip()
        touches += [int(line)] if line.isdigit() else []
    return echo.stderr.readline()


def assert_untouched(card):
    assert only_restarts(card) == {"source": 0, "relay": 0, "sink": 0}
    found = sample_status(card, ["source", "relay", "sink"])
    assert {name: one.status.gaps for name, one in found.items()} == dict.fromkeys(found, 0)


def only_restarts(card):
    return {name: about["restarts"] for name, about in request(card, "status")["nodes"].items()}


def test_without_a_graph_every_tool_tells_so_in_one_sentence(tmp_path, capsys):
    for words in ("node list", "node info a", "topic list", "topic info a", "topic echo a",
                  "topic hz a", "topic bw a", "topic delay a", "param dump"):  # fmt: skip
        assert cli.run(words.split()) == 2
        out, err = capsys.readouterr()
        assert (out, err) == ("", f"palpate: {NONE}\n")
    assert cli.run(["doctor"]) == 0
    assert "ok   no graph of yours is running\n" in capsys.readouterr().out


NONE = "no graph of yours is running; start one with palpate run or launch"


def test_one_of_several_graphs_is_chosen_by_its_number_and_its_end_ends_the_tool(
    tmp_path, capsys, monkeypatch
):
    with launched(tmp_path) as first, launched(tmp_path) as second:
        found = cards(tmp_path)
        assert cli.run(["topic", "list", "-c"]) == 2
        err = capsys.readouterr().err
        assert all(found[one.pid].run[:4] in err for one in (first, second))
        for card in (found[first.pid], found[second.pid]):
            assert cli.run(["node", "info", "source", "--run", card.run[:8]]) == 0
            pid = request(card, "status")["nodes"]["source"]["pid"]
            assert f"  pid       {pid}\n" in capsys.readouterr().out
        assert cli.run(["topic", "list", "--run", "graph"]) == 2
        assert "several running graphs are called 'graph'" in capsys.readouterr().err
        assert cli.run(["doctor", "--report"]) == 0
        out = capsys.readouterr().out
        assert out.count("3 nodes, ") == 2
        assert f"launcher {first.pid}, since" in out
        assert_received_on(found[second.pid])
        with tool("topic", "hz", "/relay", "/node/status", "--run", found[first.pid].run) as hz:
            assert first_line(hz).strip()
            first.send_signal(signal.SIGINT)
            out, err = hz.communicate(timeout=WITHIN)
        assert (hz.returncode, err) == (0, "")
        assert "average rate" in out
        monkeypatch.setattr(asking, "REQUEST_PATIENCE", 0.2)
        second.send_signal(signal.SIGSTOP)
        assert cli.run(["doctor"]) == 1
        told = capsys.readouterr().out
        kill = f"it is busy or stopped; if it stays so, kill {second.pid}"
        assert kill in " ".join(told.split())
        assert any(line.startswith("FAIL ") for line in told.splitlines())


def assert_received_on(card):
    """A node that is started again is received on, and publishes nothing twice."""
    numbers: list[int] = []
    epochs: set[int] = set()
    with TapSubscription(card, find_topics(card, ["/relay"])) as taps:
        for batch in taps.batches(WITHIN):
            numbers += [one.header.seq for one in batch]
            epochs |= {one.header.epoch for one in batch}
            if numbers and epochs == {0} and len(numbers) > 50:
                kill_node(card, "relay")
            if 1 in epochs:
                break
    assert 1 in epochs
    assert all(later > earlier for earlier, later in pairwise(numbers))


def kill_node(card, name):
    about = request(card, "status")["nodes"][name]
    if about["pid"] and not about["restarts"]:
        with suppress(ProcessLookupError):
            os.kill(about["pid"], signal.SIGKILL)
