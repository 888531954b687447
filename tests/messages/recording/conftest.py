from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from palpate.messages.codec import Header, encode, schema_hash
from palpate.messages.recording.writer import RecordingWriter
from palpate.messages.types.catalogue import LogRecord
from palpate.messages.types.world import World

TYPES = {"/world": "World", "/log": "LogRecord"}
MILLISECOND = 1_000_000
RUN = 0xFEDC_BA98_7654_3210


def world(seed: int) -> bytes:
    return encode(World(platform=0.0, reach=0.3, fingers=1, seed=seed))


def log(number: int) -> bytes:
    text = f"step {number} " + "x" * 200
    return encode(LogRecord(node="filter", level="info", text=text, robot_time=0.1 * number))


@pytest.fixture
def writer(tmp_path: Path) -> Iterator[RecordingWriter]:
    about = {"version": "1.2.3", "graph": '["a graph"]'}
    writer = RecordingWriter(tmp_path / "topics.mcap", TYPES, {"/world": "simulator"}, about)
    yield writer
    writer.close()


@pytest.fixture
def write() -> Callable[..., None]:
    """Writes one world and then so many log records, a millisecond apart."""

    def fill(writer: RecordingWriter, count: int = 100, *, epoch: int = 0) -> None:
        world_header = Header(RUN, epoch, 0, 5 * MILLISECOND, 0.0, schema_hash(World))
        writer.write("/world", world_header, world(3))
        for i in range(count):
            sent = (6 + i) * MILLISECOND
            writer.write("/log", Header(RUN, 0, i, sent, 0.0, schema_hash(LogRecord)), log(i))

    return fill
