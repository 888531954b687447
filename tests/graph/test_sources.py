"""Sources in a graph: recordings that are played, tools that speak, and both through deaths."""

import signal
import threading
import time

import pytest

from palpate.launch.files.source_map import InputError
from palpate.launch.launcher import launch
from palpate.launch.processes.registry import running_graphs
from palpate.messages.codec import Header, encode, schema_hash
from palpate.messages.recording.writer import RecordingWriter
from palpate.messages.types.touch import TactileFrame
from palpate.nodes import console, player
from palpate.nodes.runtime.node import Wiring
from palpate.tools.introspection.requests import control_player, publish, request
from tests.graph.test_restarts import Harm
from tests.studies.toy_node import ToyParams, frame, toy

pytestmark = pytest.mark.graph


@pytest.fixture(autouse=True)
def own_register(tmp_path, monkeypatch):
    """Tools shall find the graphs of this test alone."""
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))


def bag(path, frames, every=0.001):
    writer = RecordingWriter(path, {"/player": "TactileFrame"}, {}, {"version": "1"})
    for number in range(frames):
        header = Header(
            1, 0, number, 1 + round(1e9 * every * number), 0.0, schema_hash(TactileFrame)
        )
        writer.write("/player", header, encode(frame(number)))
    writer.close()
    return path


def playing(path, **params):
    return Wiring(
        name="player",
        module="palpate.nodes.player",
        params=player.Params(path=str(path), **params),
        inputs=(),
        outputs={"/player": "/player"},
        types={"/player": "TactileFrame"},
        subscribers={},
    )


def typing():
    return Wiring(
        name="console",
        module="palpate.nodes.console",
        params=console.Params(topics={"/console": "TactileFrame"}),
        inputs=(),
        outputs={"/console": "/console"},
        types={"/console": "TactileFrame"},
        subscribers={},
        persistent=True,
    )


class Aside(threading.Thread):
    """Does something while the graph runs, as soon as tools find it."""

    def __init__(self, act):
        super().__init__(daemon=True)
        self._act = act
        self.failure: Exception | None = None

    def run(self):
        while not running_graphs():
            time.sleep(0.005)
        try:
            self._act()
        except Exception as error:
            self.failure = error


def test_a_recording_is_played_to_its_last_message_at_its_times(watcher, tmp_path):
    counter = toy("counter", ToyParams(expects=300), upstream="player")
    wirings = [playing(bag(tmp_path / "a.mcap", 300)), counter]
    ending = launch(wirings, ends="player", watch=["/player"], watcher=watcher)
    assert (ending.status, ending.reason) == ("finished", "played 300 messages")
    assert [message.touch for _, message in watcher.messages] == list(range(300))
    assert ending.statuses["counter"].messages == 300
    wirings = [playing(bag(tmp_path / "b.mcap", 21, every=0.02))]
    times: list[float] = []
    watcher.received = lambda *_: times.append(time.monotonic())
    launch(wirings, ends="player", watch=["/player"], watcher=watcher)
    assert times[-1] - times[0] > 0.02 * 20 - 0.1


def test_a_player_that_is_killed_goes_on_where_it_was(watcher, tmp_path):
    harm = Harm(["player", "counter", "player"], signal.SIGKILL, seed=3)
    counter = toy("counter", ToyParams(expects=900), upstream="player")
    harm.start()
    wirings = [playing(bag(tmp_path / "a.mcap", 900, every=2e-3)), counter]
    ending = launch(wirings, ends="player", watch=["/player"], watcher=watcher)
    assert (ending.status, ending.reason) == ("finished", "played 900 messages")
    assert [message.touch for _, message in watcher.messages] == list(range(900))
    assert (ending.gaps, ending.statuses["counter"].messages) == (0, 900)
    assert ending.restarts["player"] == 2


def test_a_player_stands_still_steps_and_goes_on(watcher, tmp_path):
    received: list[int] = []

    def act():
        control_player(None, "step", number=3)
        while len(watcher.messages) < 4:
            time.sleep(0.005)
        received.append(len(watcher.messages))
        control_player(None, "resume")

    aside = Aside(act)
    aside.start()
    wirings = [playing(bag(tmp_path / "a.mcap", 50), paused=True)]
    ending = launch(wirings, ends="player", watch=["/player"], watcher=watcher)
    assert aside.failure is None
    assert ending.status == "finished"
    assert received == [4]
    assert len(watcher.messages) == 50


BODY = (
    "{goal: 0, touch: %d, finger: 1, direction: [0, 0, 1], pose: [0, 0, 0, 0, 0, 0, 1], "
    "outcome: hit, array: [[1e-6, 2e-6]], move: [0, 0, 0, 0, -1], robot_time: 1}"
)


def test_what_a_user_types_is_received_though_the_console_dies_in_between(watcher, tmp_path):
    def act():
        for number in range(4):
            publish("/console", BODY % number, rate=1, times=1, run=None, echo=echoed.append)
            if number == 1:
                harm = Harm(["console"], signal.SIGKILL, seed=1)
                harm.start()
                harm.join()
                while not any("started again" in one.text for one in watcher.lines):
                    time.sleep(0.005)

    echoed: list[str] = []
    aside = Aside(act)
    aside.start()
    counter = toy("counter", ToyParams(expects=4), upstream="console")
    ending = launch([typing(), counter], ends="counter", watch=["/console"], watcher=watcher)
    assert aside.failure is None
    assert (ending.status, ending.reason) == ("finished", "4 received")
    assert [message.touch for _, message in watcher.messages] == [0, 1, 2, 3]
    assert echoed == ["published TactileFrame on /console"] * 4


def test_what_cannot_be_published_is_refused_in_a_sentence(watcher, tmp_path):
    refused: list[str] = []

    def act():
        for topic, body in [
            ("/consule", "{}"),
            ("/counter", "{}"),
            ("/console", "{goal: 1}"),
            ("/console", "[1]"),
            ("/console", (BODY % 0).replace("hit", "hot")),
            ("/console", (BODY % 0).replace("[0, 0, 1]", "[0, x]")),
        ]:
            try:
                publish(topic, body, rate=1, times=1, run=None, echo=print)
            except InputError as error:
                refused.append(str(error))
        try:
            control_player(None, "pause")
        except InputError as error:
            refused.append(str(error))
        publish("/console", BODY % 0, rate=1, times=1, run=None, echo=lambda _: None)

    aside = Aside(act)
    aside.start()
    counter = toy("counter", ToyParams(expects=1), upstream="console")
    launch([typing(), counter], ends="counter", watch=[], watcher=watcher)
    assert aside.failure is None
    words = [
        "nobody publishes /consule; did you mean '/console'?",
        "a TactileFrame lacks goal, touch, finger",
        "a TactileFrame lacks touch, finger",
        "BODY must be a map of fields",
        "must be one of ['hit', 'miss', 'inside', 'bottomed'], got 'hot'",
        "direction must be an array of float64",
        "must have one player, it has none",
    ]
    assert len(refused) == len(words)
    for text, part in zip(refused, words, strict=True):
        assert part in text


def test_a_source_that_is_quiet_for_long_has_not_stalled(watcher, tmp_path, monkeypatch):
    monkeypatch.setattr("palpate.launch.processes.supervisor.STALL", 0.2)
    wirings = [playing(bag(tmp_path / "a.mcap", 3, every=0.6))]
    ending = launch(wirings, ends="player", watch=["/player"], watcher=watcher)
    assert (ending.status, ending.reason) == ("finished", "played 3 messages")


def test_a_tool_of_another_version_cannot_hurt_a_source(watcher, tmp_path):
    refused = []

    def act():
        card = running_graphs()[0]
        for kind, fields in [
            ("publish", {"node": "console", "topic": "/nowhere", "body": b""}),
            ("publish", {"node": "console", "topic": "/console", "body": b"\x80"}),
            ("pause", {"node": "counter"}),
            ("pause", {"node": "nobody"}),
        ]:
            try:
                request(card, kind, **fields)
            except ValueError as error:
                refused.append(str(error))
        publish("/console", BODY % 0, rate=1, times=1, run=None, echo=lambda _: None)

    aside = Aside(act)
    aside.start()
    counter = toy("counter", ToyParams(expects=1), upstream="console")
    ending = launch([typing(), counter], ends="counter", watch=[], watcher=watcher)
    assert aside.failure is None
    assert (ending.status, ending.restarts) == ("finished", {})
    assert refused[0] == "console does not publish '/nowhere'"
    assert refused[1].startswith("not a TactileFrame: missing field goal")
    assert refused[2] == "counter is no source: it publishes when it receives something"
    assert refused[3] == "there is no node 'nobody'"
