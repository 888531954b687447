from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import msgpack
import pytest

from palpate.messages.bus.control import LauncherLine, NodeLine
from palpate.messages.bus.words import MAX_BYTES


@pytest.fixture
def lines(bench: Any) -> Iterator[tuple[LauncherLine, NodeLine]]:
    launcher = LauncherLine(bench.context, "inproc://control")
    node = NodeLine(bench.context, "inproc://control", name="finger_1/filter")
    yield launcher, node
    node.socket.close(0)
    launcher.close()


def test_words_go_both_ways(lines: tuple[LauncherLine, NodeLine]) -> None:
    launcher, node = lines
    assert launcher.receive() is None
    node.send("ready")
    assert launcher.socket.poll(1000)
    assert launcher.receive() == ("finger_1/filter", {"kind": "ready"})
    assert node.receive() is None
    assert launcher.send("finger_1/filter", "count", round=3)
    assert node.socket.poll(1000)
    assert node.receive() == {"kind": "count", "round": 3}


def test_a_word_to_a_node_that_is_not_there_is_said_to_be_lost(
    lines: tuple[LauncherLine, NodeLine],
) -> None:
    assert not lines[0].send("nobody", "go")


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (b"", "got no msgpack: ValueError: Unpack failed: incomplete input"),
        (msgpack.packb([1]), "a word is a map with a kind"),
        (msgpack.packb({"type": "ready"}), "a word is a map with a kind"),
        (bytes(MAX_BYTES + 1), f"a word has at most {MAX_BYTES} bytes, got {MAX_BYTES + 1}"),
    ],
)
def test_what_is_no_word_is_refused(
    data: bytes, words: str, lines: tuple[LauncherLine, NodeLine]
) -> None:
    launcher, node = lines
    node.socket.send(data)
    assert launcher.socket.poll(1000)
    with pytest.raises(ValueError, match=words):
        launcher.receive()


def test_a_word_in_two_parts_is_refused(lines: tuple[LauncherLine, NodeLine]) -> None:
    launcher, node = lines
    node.socket.send_multipart([b"a", b"b"])
    assert launcher.socket.poll(1000)
    with pytest.raises(ValueError, match="a word has one part, got 2"):
        launcher.receive()
