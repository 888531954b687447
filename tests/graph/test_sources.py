"""Sources in a graph: recordings that are played and tools that publish, also through deaths."""

from __future__ import annotations

import signal
import sys
import threading
import time
from subprocess import PIPE, Popen

import pytest
from palpate_toy import frame, toy, wiring

from palpate.launch.files.source_map import InputError
from palpate.launch.processes.node_status import SupervisionSettings
from palpate.launch.processes.registry import running_graphs
from palpate.messages import Header, encode, schema_hash
from palpate.messages.recording import RecordingWriter
from palpate.messages.types import TactileFrame
from palpate.nodes import console, player
from palpate.tools.introspection.requests import control_player, publish, request
from tests.graph.conftest import Harm, handled, wait_for

pytestmark = pytest.mark.graph


def bag(path, frames, period=0.001):
    writer = RecordingWriter(path, {"/player": "TactileFrame"}, {}, {"version": "1"})
    for number in range(frames):
        sent = 1 + round(1e9 * period * number)
        header = Header(1, 0, number, sent, 0.0, schema_hash(TactileFrame))
        writer.write("/player", header, encode(frame(number)))
    writer.close()
    return path


def source(name, params, **more):
    topics = {f"/{name}": f"/{name}"}
    types = dict.fromkeys(topics, "TactileFrame")
    return wiring(name, f"palpate.nodes.{name}", params, outputs=topics, types=types, **more)


def playing(path, **params):
    return source("player", player.Params(path=str(path), **params))


def typing():
    params = console.Params(topics={"/console": "TactileFrame"})
    return source("console", params, persistent=True)


class Aside(threading.Thread):
    """Does something while the graph runs, as soon as tools find it."""

    def __init__(self, act):
        super().__init__(daemon=True)
        self._act = act
        self.failure: Exception | None = None
        self.start()

    def run(self):
        wait_for(running_graphs)
        try:
            self._act()
        except Exception as error:
            self.failure = error


def test_recording_is_played_at_its_times_and_has_not_stalled_between(run, watcher, tmp_path):
    times: list[float] = []
    received = watcher.received
    watcher.received = lambda *word: (times.append(time.monotonic()), received(*word))
    graph = [
        toy("counter", upstream="player", expects=6),
        playing(bag(tmp_path / "a.mcap", 6, period=0.2)),
    ]
    ending = run(graph, watch=["/player"], settings=SupervisionSettings(stall_time=0.1))
    assert (ending.status, ending.reason) == ("finished", "played 6 messages")
    assert watcher.touches() == list(range(6))
    assert ending.statuses["counter"].messages == 6
    assert times[-1] - times[0] > 0.2 * 5 - 0.1


def test_killed_player_goes_on_where_it_was(run, watcher, tmp_path):
    Harm(["player", "counter", "player"], signal.SIGKILL, seed=3)
    counter = toy("counter", upstream="player", expects=700)
    ending = run([counter, playing(bag(tmp_path / "a.mcap", 700, 2e-3))], watch=["/player"])
    assert (ending.status, ending.reason) == ("finished", "played 700 messages")
    assert watcher.touches() == list(range(700))
    assert (ending.gaps, ending.statuses["counter"].messages) == (0, 700)
    assert ending.restarts["player"] == 2


def test_player_pauses_steps_and_resumes(run, watcher, tmp_path):
    received: list[int] = []

    def act():
        control_player(None, "step", number=3)
        wait_for(lambda: len(watcher.messages) >= 4)
        received.append(len(watcher.messages))
        control_player(None, "resume")

    aside = Aside(act)
    ending = run([playing(bag(tmp_path / "a.mcap", 50), paused=True)], watch=["/player"])
    assert (aside.failure, ending.status) == (None, "finished")
    assert received == [4] and len(watcher.messages) == 50


IN_TERMINAL = "import os, pty, sys; sys.exit(os.waitstatus_to_exitcode(pty.spawn(sys.argv[1:])))"


@pytest.mark.usefixtures("runtime")
def test_keys_step_pause_and_resume_a_recording_in_a_terminal(tmp_path):
    play = ("-m", "palpate", "bag", "play", bag(tmp_path / "a.mcap", 50), "--start-paused")
    command = (sys.executable, "-c", IN_TERMINAL, sys.executable, *play)
    with Popen(command, stdin=PIPE, stdout=PIPE, bufsize=0) as terminal:
        assert terminal.stdout.readline().endswith(b": 1 topics, 1 x, paused\r\n")
        terminal.stdin.write(b"\x1b[C\x1b[C")  # the right arrow
        wait_for(lambda: handled(running_graphs()[0], "player", "sent") == 1 + 2)
        terminal.stdin.write(b"   ")
        lines = terminal.stdout.readlines()
    assert lines == [b"resumed\r\n", b"paused\r\n", b"resumed\r\n", b"played 50 messages\r\n"]
    assert terminal.returncode == 0


BODY = (
    "{goal: 0, touch: %d, finger: 1, placement: 0, direction: [0, 0, 1], "
    "pose: [0, 0, 0, 0, 0, 0, 1], "
    "outcome: hit, array: [[1e-6, 2e-6]], move: [0, 0, 0, 0, -1], robot_time: 1}"
)


def typed(topic, body, echo=lambda _: None):
    publish(topic, body, rate=1, times=1, run=None, echo=echo)


def test_published_messages_arrive_though_the_console_dies_in_between(run, watcher):
    def act():
        for number in range(4):
            typed("/console", BODY % number, echoed.append)
            if number == 1:
                Harm(["console"]).join()
                wait_for(lambda: any("started again" in one.text for one in watcher.lines))

    echoed: list[str] = []
    aside = Aside(act)
    ending = run([typing(), toy("counter", upstream="console", expects=4)], watch=["/console"])
    assert aside.failure is None
    assert (ending.status, ending.reason) == ("finished", "4 received")
    assert watcher.touches() == [0, 1, 2, 3]
    assert echoed == ["published TactileFrame on /console"] * 4


REFUSED = [
    ("/consule", "{}", "no node publishes /consule; did you mean '/console'?"),
    ("/counter", "{}", "a TactileFrame lacks goal, touch, finger"),
    ("/console", "{goal: 1}", "a TactileFrame lacks touch, finger"),
    ("/console", "[1]", "BODY must be a map of fields"),
    ("/console", (BODY % 0).replace("hit", "hot"),
     "must be one of ['hit', 'miss', 'inside', 'bottomed'], got 'hot'"),
    ("/console", (BODY % 0).replace("[0, 0, 1]", "[0, x]"), "direction must be an array of float"),
]  # fmt: skip
ODD = [
    ("publish", {"node": "console", "topic": "/nowhere", "body": b""},
     "console does not publish '/nowhere'"),
    ("publish", {"node": "console", "topic": "/console", "body": b"\x80"},
     "not a TactileFrame: missing field goal"),
    ("pause", {"node": "counter"},
     "counter is no source: it publishes when it receives something"),
    ("pause", {"node": "nobody"}, "there is no node 'nobody'"),
]  # fmt: skip


def test_what_cannot_be_published_is_refused_by_tool_and_launcher(run):
    def act():
        for topic, body, words in REFUSED:
            with pytest.raises(InputError) as caught:
                typed(topic, body)
            assert words in str(caught.value)
        with pytest.raises(InputError, match="must have one player, it has none"):
            control_player(None, "pause")
        for kind, fields, words in ODD:  # of a tool of another version
            with pytest.raises(ValueError) as refused:
                request(running_graphs()[0], kind, **fields)
            assert str(refused.value).startswith(words)

    def act_and_end():
        try:
            act()
        finally:
            typed("/console", BODY % 0)

    aside = Aside(act_and_end)
    ending = run([typing(), toy("counter", upstream="console", expects=1)])
    assert aside.failure is None
    assert (ending.status, ending.restarts) == ("finished", {})
