"""The sockets of one node: control line, tap for tools, one place to wait, and keys."""

import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import msgpack
import pytest
import zmq

from palpate.messages import bus, decode
from palpate.messages.bus import FROM_NODES, ControlClient, NodeSockets, PastReader, TapReader
from palpate.messages.types import LogRecord, NodeStatus
from palpate.nodes.runtime.testing import example
from tests.messages.cases import addresses, cases

LINE = LogRecord(node="filter", level="info", text="hello", robot_time=1.5)


class Run:
    """The addresses of a run of two nodes, a launcher's line, and tools."""

    def __init__(self, context: zmq.Context[Any], folder: Path) -> None:
        self.context = context
        self.place = addresses(folder, "talker", "hearer")
        self.launcher = bus.ControlServer(context, self.place.control)
        self._closed: list[Any] = [self.launcher]

    def node(self, name: str, **more: Any) -> NodeSockets:
        place = replace(self.place, **more.pop("place", {}))
        ends: dict[str, Any] = {"subscriptions": {}, "publications": {}}
        made = NodeSockets(name, place, **{**ends, **more})
        self._closed.insert(0, made)
        return made

    def talker(self, **more: Any) -> NodeSockets:
        return self.node("talker", publications={"/world": ("hearer",), "/mute": ()}, **more)

    def reader(self, tap: NodeSockets, *topics: str, latched: bool = False) -> TapReader:
        made = TapReader(self.context, [self.place.taps["talker"]], topics, latched=latched)
        self._closed.insert(0, made)
        settle(tap)
        return made

    def past_reader(self) -> PastReader:
        made = PastReader(self.context, self.place.taps["talker"], ["/world"])
        self._closed.insert(0, made)
        return made

    def close(self) -> None:
        for opened in self._closed:
            opened.close()


@pytest.fixture
def run(tmp_path: Path) -> Iterator[Run]:
    with zmq.Context() as context:
        made = Run(context, tmp_path)
        yield made
        made.close()


def settle(node: NodeSockets) -> None:
    """Have a tap take note of all who have asked by now."""
    while node.tap.socket.poll(60):
        node.tap.refresh()


def until(condition: Callable[[], bool], *nodes: NodeSockets) -> None:
    deadline = time.monotonic() + 10.0
    while not condition():
        assert time.monotonic() < deadline
        for node in nodes:
            node.wait(2)
            node.take_in()


def bodies(reader: TapReader) -> list[bytes]:
    collected = []
    while reader.socket.poll(60) and (received := reader.receive()) is not None:
        collected.append(received[2])
    return collected


def test_messages_travel_between_nodes_and_words_between_launcher_and_node(run: Run):
    talker = run.talker(place={"ahead_ns": 1 << 61})
    ends: dict[str, Any] = {"publications": {"/back": ("x",)}}
    hearer = run.node("hearer", subscriptions={"talker": ["/world"]}, **ends)
    for number in range(3):
        talker.send("/world", b"%d" % number, 0.5, 9, outside=number == 1)
    until(lambda: hearer.subscriber.in_step, talker, hearer)
    assert hearer.waiting
    first = hearer.receive()
    rest = [hearer.receive(), hearer.receive()]
    assert not hearer.waiting and hearer.receive() is None
    hearer.give_back(rest)
    assert [one.body for one in (first, hearer.receive(), hearer.receive())] == [b"0", b"1", b"2"]
    assert [one.header.outside for one in (first, *rest)] == [False, True, False]
    assert first.header.run == 7
    hearer.send("/back", b"", 0.0, 9)
    assert hearer.publisher.latest_ns > rest[1].header.sent_ns > 1 << 61
    assert run.launcher.receive() is None and talker.line.receive() is None
    talker.line.send("ready")
    assert run.launcher.socket.poll(5000)
    assert run.launcher.receive() == ("talker", {"kind": "ready"})
    assert run.launcher.send("talker", "count", round=3)
    assert talker.wait(5000) == (False, True)
    assert talker.line.receive() == {"kind": "count", "round": 3}
    assert not run.launcher.send("absent", "go")


@cases(
    "parts, words",
    ([b""], "not a word of .*: Input data was truncated"),
    ([msgpack.packb([1])], "not a word of .*: Expected `object`, got `array`"),
    ([bytes((1 << 20) + 1)], "a word has at most 1048576 bytes, got 1048577"),
    ([b"a", b"b"], "a word has one part, got 2"),
)
def test_frame_that_is_no_word_is_refused(parts: list[bytes], words: str, run: Run):
    client = ControlClient(run.context, run.place.control, name="node")
    client.socket.send_multipart(parts)
    assert run.launcher.socket.poll(5000)
    with pytest.raises(ValueError, match=words):
        run.launcher.receive()
    client.close()


COUNT: dict[str, Any] = {
    "kind": "count",
    "round": 3,
    "sent": {"/a": 1},
    "consumed": [("source", "/b", 2)],
    "waits": ["/b"],
    "can_publish": True,
}


@cases(
    "protocol, word",
    (FROM_NODES, COUNT),
    (bus.FROM_TOOLS, {"kind": "publish", "node": "a", "topic": "/a", "body": b""}),
    (bus.TO_TOOLS, {"kind": "status", "launcher": 1, "for_s": 0.5, "nodes": {"a": {"b": 1}}}),
    (bus.TO_HOSTS, {"kind": "spawn", "node": "a", "wiring": bytes(3 << 20), "place": b""}),
    (bus.FROM_HOSTS, {"kind": "ended", "node": "a", "code": -9}),
)
def test_word_is_read_as_it_was_sent(protocol: Any, word: dict[str, Any]):
    assert protocol.read(msgpack.packb(word)) == word


@cases(
    "word, words",
    ({"kind": "go"}, "not a word of ready, alive, finished, count, .*failed: .* 'go'"),
    ({"type": "ready"}, "missing required field `kind`"),
    ({"kind": "exiting"}, "missing required field `status`"),
    ({"kind": "ready", "more": 1}, "unknown field `more`"),
    ({"kind": "exiting", "status": 7}, r"Expected `bytes`, got `int` - at `\$.status`"),
    ({**COUNT, "round": True}, "`bool` - at .*round"),
    ({**COUNT, "round": -1}, "`int` >= 0 - at .*round"),
    ({**COUNT, "sent": {"/a": -1}}, "`int` >= 0 - at .*sent"),
    ({**COUNT, "sent": [1]}, "`array` - at .*sent"),
    ({**COUNT, "consumed": [["source", "/b"]]}, "of length 3, got 2 - at .*consumed"),
    ({**COUNT, "consumed": [["source", 1, 1]]}, "`int` - at .*consumed"),
    ({**COUNT, "consumed": 7}, "`int` - at .*consumed"),
    ({**COUNT, "waits": "/b"}, "`str` - at .*waits"),
    ({**COUNT, "waits": [""] * 4097}, "of length <= 4096 - at .*waits"),
    ({**COUNT, "can_publish": 1}, "`int` - at .*can_publish"),
    ({"kind": "x" * 5000}, "Invalid value 'x{20,200}$"),
)
def test_word_without_what_belongs_to_it_is_refused(word: dict[str, Any], words: str):
    with pytest.raises(ValueError, match=words):
        FROM_NODES.read(msgpack.packb(word))


@cases(
    "data",
    b"\xdd\x00\x0f\xff\x00" + b"\x90" * 0xFFF00,
    b"\xdc\x10\x00" + 200 * (b"\xdc\x10\x00" + b"\x90" * 4096) + b"\xc0" * 3896,
    b"\x91" * 2000 + b"\xc0",
    b"\xd6\xff\0\0\0\0",
    b"\xc1",
    ids=lambda data: data[:6].hex(),
)
def test_word_that_would_take_far_more_than_its_bytes_is_refused(data: bytes):
    with pytest.raises(ValueError, match=r"^not a word of "):
        FROM_NODES.read(data)
    with pytest.raises(ValueError, match=r"not a word of go, count, .* publish, set: .* 'ready'"):
        bus.TO_NODES.read(msgpack.packb({"kind": "ready"}))


def test_log_and_status_are_heard_by_who_listens(run: Run):
    node = run.talker(place={"epoch": 2})
    both, status = run.reader(node, "/log", "/node/status"), run.reader(node, "/node/status")
    for message in (LINE, LINE, example(NodeStatus, node="talker")):
        node.tap.publish(message)
    node.send("/world", b"x", 0.0, 9)
    heard = [both.socket.poll(5000) and both.receive() for _ in range(3)]
    assert [one[0] for one in heard] == ["/log", "/log", "/node/status"]
    headers = [one[1] for one in heard]
    assert [(one.run, one.epoch, one.seq) for one in headers] == [(7, 2, 0), (7, 2, 1), (7, 2, 0)]
    assert [one.robot_time for one in headers] == [1.5, 1.5, 0.0]
    assert decode(LogRecord, heard[0][2]).text == "hello"
    assert bodies(both) == [] and len(bodies(status)) == 1


def test_copies_of_a_topic_go_to_who_wants_it_while_it_does(run: Run):
    node = run.talker()
    reader = run.reader(node, "/world")
    node.send("/world", b"one", 0.0, 9)
    node.send("/mute", b"two", 0.0, 9)
    node.answer([("/world", b"three", 0.0, 9)], bus.Cause("a", "/in", 0))
    assert bodies(reader) == [b"one", b"three"]
    reader.socket.unsubscribe(b"/world\0")
    settle(node)
    node.send("/world", b"four", 0.0, 9)
    assert bodies(reader) == []


def test_tool_that_does_not_listen_blocks_nobody(run: Run):
    node = run.talker()
    reader = run.reader(node, "/log")
    for _ in range(2000):
        node.tap.publish(LINE)
    seqs = []
    while reader.socket.poll(60) and (received := reader.receive()) is not None:
        seqs.append(received[1].seq)
    assert seqs[0] == 0 and len(seqs) < 2000


@pytest.mark.parametrize(("kind", "depth"), [("World", 1), ("Probe", 32), ("TactileFrame", 0)])
def test_late_tool_gets_latched_messages_it_asks_for(kind: str, depth: int, run: Run):
    node = run.talker(types={"/world": kind, "/mute": "World"})
    for number in range(40):
        node.send("/world", b"%d" % number, 0.0, 9)
    latched = [b"%d" % number for number in range(40)][40 - depth :]
    first = run.reader(node, "/world", latched=True)
    assert bodies(first) == latched
    second, plain = run.reader(node, "/world", latched=True), run.reader(node, "/world")
    assert bodies(second) == latched
    node.send("/world", b"last", 0.0, 9)
    assert bodies(second)[-1:] == bodies(plain) == [b"last"]


def test_latched_messages_outlive_a_persistent_node(run: Run):
    node = run.talker(types={"/world": "World"}, persistent=True)
    node.send("/world", b"x", 0.0, 9)
    node.close()
    again = run.talker(types={"/world": "World"}, persistent=True, place={"epoch": 1})
    assert again.publisher.sent == {"/world": 1, "/mute": 0}
    assert bodies(run.reader(again, "/world", latched=True)) == [b"x"]


def answers(node: NodeSockets, reader: PastReader) -> list[int | None]:
    """Numbers of the messages that are sent once more, and the mark behind them."""
    settle(node)
    numbers: list[int | None] = []
    while reader.socket.poll(60) and (came := reader.receive()) is not None:
        assert came[0] == "/world"
        numbers.append(came[1] and came[1][0].seq)
    return numbers


def test_past_is_sent_once_more_a_batch_at_a_time(run: Run):
    node, batch = run.talker(), bus.PAST_BATCH
    for _ in range(batch + 3):
        node.send("/world", b"x", 0.0, 9)
    reader = run.past_reader()
    for words in (b"", b"/world", b"/world\0", b"/world\0x", b"/world\0-1", b"\xff\0", b"\0" * 9):
        reader.socket.subscribe(b"\x03" + words)
    reader.socket.subscribe(b"\x03/world\0" + b"9" * 40)
    assert answers(node, reader) == []
    reader.ask("/world", 0)
    assert answers(node, reader) == [*range(batch), None]
    for _ in range(2):
        reader.ask("/world", batch)
        assert answers(node, reader) == [*range(batch, batch + 3), None]
    reader.ask("/world", 999)
    assert answers(node, reader) == [None]


def test_blocked_node_still_receives_and_says_it_is_alive(run: Run):
    calls: list[int] = []
    talker = run.talker(place={"depth": 1})
    hearer = run.node("hearer", subscriptions={"talker": ["/world"]}, place={"depth": 1})
    until(lambda: hearer.subscriber.in_step, talker, hearer)

    def look_up() -> None:
        calls.append(1)
        hearer.take_in()

    talker.while_blocked = look_up
    for number in range(3000):
        talker.send("/world", b"%d" % number, 0.0, 9)
    received: list[int] = []

    def all_received() -> bool:
        while (arrival := hearer.receive()) is not None:
            received.append(int(arrival.body))
        return len(received) == 3000

    until(all_received, hearer)
    assert calls and received == list(range(3000))


def test_key_locks_sockets_of_a_network(tmp_path: Path):
    key, other = tmp_path / "keys" / "key", tmp_path / "other"
    bus.make_key(key)
    bus.make_key(other)
    assert key.stat().st_mode & 0o777 == 0o600 and key.parent.stat().st_mode & 0o777 == 0o700
    with pytest.raises(FileExistsError, match="exists already; it is not overwritten"):
        bus.make_key(key)
    locked, wrong = bus.SocketContext(str(key)), bus.SocketContext(str(other))
    server = bus.ControlServer(locked.context, "tcp://127.0.0.1:*")
    endpoint = server.socket.getsockopt(zmq.LAST_ENDPOINT).decode()
    stranger = ControlClient(wrong.context, endpoint, name="stranger")
    friend = ControlClient(locked.context, endpoint, name="friend")
    keyless = zmq.Context.instance().socket(zmq.DEALER)
    keyless.connect(endpoint)
    keyless.send(msgpack.packb({"kind": "ready"}))
    for client in (stranger, friend):
        client.send("ready")
    assert server.socket.poll(10_000)
    assert server.receive() == ("friend", {"kind": "ready"})
    assert not server.socket.poll(100)
    for client in (server, friend):
        client.close()
    for closed in (stranger.socket, keyless):
        closed.close(0)
    locked.close()
    wrong.close()
    with zmq.Context() as plain:
        for end in (bus.ControlServer, partial(ControlClient, name="keyless")):
            with pytest.raises(ValueError, match=r"tcp://.* cannot be used without a key"):
                end(plain, "tcp://127.0.0.1:5555")


def test_file_without_a_usable_key_is_refused(tmp_path: Path):
    good = tmp_path / "good"
    bus.make_key(good)
    half = good.read_text().partition("secret-key")[0]
    short = 'curve\n    public-key = "short"\n    secret-key = "short"\n'
    path = tmp_path / "key"
    for text, words in (
        (None, "cannot be used: No such file"),
        *((odd, "cannot be used: ") for odd in ("", "\0", "curve\n", short)),
        (half, "cannot be used: it holds no key pair"),
        (good.read_text(), "can be read by others; run chmod 600"),
    ):
        if text is not None:
            path.write_text(text)
            path.chmod(0o644 if words.startswith("can be read") else 0o600)
        with pytest.raises(ValueError, match=f"key {path} {words}"):
            bus.SocketContext(str(path))
