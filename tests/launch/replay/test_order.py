from __future__ import annotations

import tracemalloc
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from palpate.launch.replay.order import in_order_of_sending
from palpate.messages.codec import schema_hash
from palpate.messages.header import Header
from palpate.messages.recording.reader import Kept, open_recording
from palpate.messages.recording.writer import RecordingWriter
from palpate.messages.types import LogRecord

BODY = bytes(100_000)
MANY = 200


def recorded(path: Path, times: Sequence[int], body: bytes = b"\x80") -> Any:
    writer = RecordingWriter(path, {"/log": "LogRecord"}, {}, {})
    for seq, sent in enumerate(times):
        writer.write("/log", Header(1, 0, seq, sent, 0.0, schema_hash(LogRecord)), body)
    writer.close()
    return open_recording(path)


def test_messages_come_by_the_time_at_which_they_were_sent(tmp_path: Path) -> None:
    recording = recorded(tmp_path / "a.mcap", [5, 3, 9, 3, 1])

    found = [(kept.sent_ns, kept.seq) for kept in in_order_of_sending(recording)]

    assert found == [(1, 4), (3, 1), (3, 3), (5, 0), (9, 2)]


def test_a_recording_without_messages_has_no_order(tmp_path: Path) -> None:
    assert list(in_order_of_sending(recorded(tmp_path / "a.mcap", []))) == []


def test_a_recording_is_not_held(tmp_path: Path) -> None:
    # Each was heard after the one that was sent after it, as of two publishers.
    times = [place ^ 1 for place in range(MANY)]
    recording = recorded(tmp_path / "a.mcap", times, BODY)
    plain, ordered = peak_of(recording.messages()), peak_of(in_order_of_sending(recording))

    # Beyond what any reading takes: one message that waits, one that is handed over, and times.
    assert ordered - plain < 3 * len(BODY)
    assert MANY * len(BODY) > 5 * ordered


def peak_of(messages: Iterator[Kept]) -> int:
    """Most bytes that are held while all messages are gone through."""
    tracemalloc.start()
    assert sum(1 for _ in messages) == MANY
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    return peak


@dataclass
class Shrinking:
    """A recording that has fewer messages when it is read again."""

    kept: Kept
    left: int = 3
    path: Path = Path("a.mcap")

    def messages(self) -> Iterator[Kept]:
        self.left -= 1
        yield from [self.kept] * self.left


def test_a_recording_that_shrinks_meanwhile_is_refused(tmp_path: Path) -> None:
    [kept] = recorded(tmp_path / "a.mcap", [5]).messages()
    shrinking: Any = Shrinking(kept)

    with pytest.raises(ValueError, match=r"recording a\.mcap became shorter while it was read"):
        list(in_order_of_sending(shrinking))
