from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import msgpack
import pytest

from palpate.messages.bus.control import (
    FROM_NODES,
    MAX_CONTROL_BYTES,
    TO_NODES,
    ControlClient,
    ControlServer,
)


@pytest.fixture
def lines(bench: Any) -> Iterator[tuple[ControlServer, ControlClient]]:
    launcher = ControlServer(bench.context, "inproc://control")
    node = ControlClient(bench.context, "inproc://control", name="finger_1/filter")
    yield launcher, node
    node.socket.close(0)
    launcher.close()


def test_words_go_both_ways(lines: tuple[ControlServer, ControlClient]):
    launcher, node = lines
    assert launcher.receive() is None
    node.send("ready")
    assert launcher.socket.poll(1000)
    assert launcher.receive() == ("finger_1/filter", {"kind": "ready"})
    assert node.receive() is None
    assert launcher.send("finger_1/filter", "count", round=3)
    assert node.socket.poll(1000)
    assert node.receive() == {"kind": "count", "round": 3}


def test_a_word_to_a_node_that_is_not_there_is_published_to_be_lost(
    lines: tuple[ControlServer, ControlClient],
):
    assert not lines[0].send("nobody", "go")


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (b"", "not a word of .*: Input data was truncated"),
        (msgpack.packb([1]), "not a word of .*: Expected `object`, got `array`"),
        (msgpack.packb({"type": "ready"}), "missing required field `kind`"),
        (
            bytes(MAX_CONTROL_BYTES + 1),
            f"a word has at most {MAX_CONTROL_BYTES} bytes, got {MAX_CONTROL_BYTES + 1}",
        ),
    ],
)
def test_what_is_no_word_is_refused(
    data: bytes, words: str, lines: tuple[ControlServer, ControlClient]
):
    launcher, node = lines
    node.socket.send(data)
    assert launcher.socket.poll(1000)
    with pytest.raises(ValueError, match=words):
        launcher.receive()


def test_a_word_in_two_parts_is_refused(lines: tuple[ControlServer, ControlClient]):
    launcher, node = lines
    node.socket.send_multipart([b"a", b"b"])
    assert launcher.socket.poll(1000)
    with pytest.raises(ValueError, match="a word has one part, got 2"):
        launcher.receive()


COUNT: dict[str, Any] = {
    "kind": "count",
    "round": 3,
    "sent": {"/a": 1},
    "consumed": [("source", "/b", 2)],
    "waits": ["/b"],
    "can_publish": True,
}


@pytest.mark.parametrize(
    "word",
    [
        {"kind": "ready"},
        {"kind": "alive"},
        {"kind": "finished", "reason": "all felt"},
        {"kind": "exiting", "status": b"\x80"},
        {"kind": "failed", "text": "on /a 3", "trace": ""},
        COUNT,
    ],
)
def test_words_of_nodes_are_read_as_they_were_sent(word: dict[str, Any]):
    assert FROM_NODES.read(msgpack.packb(word)) == word


@pytest.mark.parametrize(
    ("word", "words"),
    [
        (
            {"kind": "go"},
            "not a word of ready, alive, finished, count, acknowledged, refused, .*failed: .* 'go'",
        ),
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
    ],
)
def test_a_word_without_what_belongs_to_it_is_refused(word: dict[str, Any], words: str):
    with pytest.raises(ValueError, match=words):
        FROM_NODES.read(msgpack.packb(word))


def test_each_side_receives_the_words_of_the_other_alone():
    assert TO_NODES.read(msgpack.packb({"kind": "go"})) == {"kind": "go"}
    with pytest.raises(
        ValueError,
        match=r"not a word of go, count, stop, pause, resume, step, publish, set: .* 'ready'",
    ):
        TO_NODES.read(msgpack.packb({"kind": "ready"}))


@pytest.mark.parametrize(
    "data",
    [
        b"\xdd\x00\x0f\xff\x00" + b"\x90" * 0xFFF00,
        b"\xdc\x10\x00" + 200 * (b"\xdc\x10\x00" + b"\x90" * 4096) + b"\xc0" * 3896,
        b"\x91" * 2000 + b"\xc0",
        b"\xd6\xff\0\0\0\0",
        b"\xc1",
    ],
)
def test_what_would_take_far_more_than_it_is_tells_nothing(data: bytes):
    with pytest.raises(ValueError, match=r"^not a word of "):
        FROM_NODES.read(data)
