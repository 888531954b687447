from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import pytest

from palpate.messages.codec import encode, schema_hash
from palpate.messages.header import Header
from palpate.messages.recording.writer import RecordingWriter

Message = tuple[str, object]
"""Topic and message."""
Record = Callable[..., Path]

MILLISECOND = 1_000_000


@pytest.fixture
def record(tmp_path: Path) -> Record:
    """Writes a recording of some messages, a few milliseconds apart."""

    def write(
        messages: Sequence[Message],
        *,
        name: str = "topics.mcap",
        skip: int = 0,
        graph: str = "",
        close: bool = True,
    ) -> Path:
        types = {topic: type(message).__name__ for topic, message in messages}
        publishers = {topic: f"{topic.strip('/')}_node" for topic in types}
        about = {"version": "1.2.3", "graph": graph}
        writer = RecordingWriter(tmp_path / name, types, publishers, about)
        counts = dict.fromkeys(types, 0)
        for number, (topic, message) in enumerate(messages):
            sent = (1000 + 7 * number) * MILLISECOND
            seq, counts[topic] = counts[topic], counts[topic] + 1
            if number >= skip:
                header = Header(7, 0, seq, sent, 0.0, schema_hash(type(message)))
                writer.write(topic, header, encode(message))
        killed = (tmp_path / name).read_bytes()
        writer.close()
        if not close:
            (tmp_path / name).write_bytes(killed)
        return tmp_path / name

    return write
