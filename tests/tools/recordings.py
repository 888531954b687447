"""Recordings of a few messages, written by hand."""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from palpate.messages import Header, encode, schema_hash
from palpate.messages.recording import RecordingWriter
from palpate.messages.types import LogRecord, TactileFrame, World

POSE = np.array([0.01, 0.02, 0.03, 0.0, 0.0, 0.0, 1.0])
WORLD = World(platform=0.0, reach=0.3, fingers=1, seed=3)


def log(value: float, text: str = "") -> LogRecord:
    """The smallest message with a number."""
    return LogRecord(node="x", level="info", text=text, robot_time=value)


def frame(touch: int, **fields: Any) -> TactileFrame:
    """Frame of 2 by 3 taxels."""
    known = {
        "goal": 1,
        "touch": touch,
        "finger": 2,
        "direction": np.array([1.0, 0.0, 0.0]),
        "pose": POSE + np.array([0.001 * touch, 0, 0, 0, 0, 0, 0]),
        "outcome": "hit",
        "array": np.arange(6.0).reshape(2, 3) + touch,
        "robot_time": 0.5 * touch,
    }
    return TactileFrame(**{**known, **fields})


def write_recording(
    path: Path,
    messages: Iterable[tuple[Any, ...]],  # topic, message or its bytes, and perhaps its number
    *,
    about: Mapping[str, str] | None = None,
    types: Mapping[str, str] | None = None,
    publisher: str = "somebody",
    sent: Sequence[int] | None = None,  # [ns]; 7 ms apart from 1 s on if left out
    schema: int = 0,  # of every message; its type's own if 0
    hashes: Mapping[str, int] | None = None,  # of schemas, by topic
    schemas: Mapping[str, str] | None = None,
    run: int = 7,
    epoch: int = 0,
    skip: int = 0,  # messages that were recorded in an earlier part
    closed: bool = True,
) -> Path:
    """Write a recording; if it is not `closed`, as a killed recorder leaves it."""
    path.unlink(missing_ok=True)
    messages = list(messages)
    types = types or {one[0]: type(one[1]).__name__ for one in messages}
    publishers = dict.fromkeys(types, publisher)
    writer = RecordingWriter(path, types, publishers, about or {}, schemas=schemas or {})
    counts = Counter[str]()
    for place, (topic, message, *numbers) in enumerate(messages):
        seq = numbers[0] if numbers else counts[topic]
        counts[topic] += 1
        if place < skip:
            continue
        raw = isinstance(message, bytes)
        own = 0 if raw else schema_hash(type(message))
        when = sent[place] if sent is not None else 10**9 + 7_000_000 * place
        number = schema or (hashes or {}).get(topic, own)
        header = Header(run, epoch, seq, when, 0.0, number)
        writer.write(topic, header, message if raw else encode(message))
    killed = path.read_bytes()
    writer.close()
    if not closed:
        path.write_bytes(killed)
    return path
