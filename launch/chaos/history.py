"""What a recording says has happened, read and judged apart from the bus that it is to judge.

It shares no code with the bus, the recorder or the replay: it reads the files with the `mcap`
package alone, and believes none of them.
"""

from __future__ import annotations

import hashlib
import struct
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import count, pairwise
from pathlib import Path
from typing import NamedTuple

from mcap.exceptions import McapError
from mcap.records import Channel, Footer, McapRecord, Message
from mcap.stream_reader import StreamReader

MOST_BYTES = 512 << 20
"""Of one record."""


class Event(NamedTuple):
    """One message, as one file has it."""

    publisher: str
    topic: str
    epoch: int
    """How often its publisher had been started before."""
    seq: int
    sent_ns: int
    body: bytes


@dataclass(frozen=True, slots=True)
class History:
    """All that the files of one recording hold, in their order."""

    events: tuple[Event, ...]
    """The messages."""
    closed: bool
    """Whether the last file was closed properly."""


class Breach(NamedTuple):
    """One thing that is wrong with a history."""

    law: str
    """Which law is broken: gap, twice, bodies, epoch, order or cause."""
    text: str
    """How, in a sentence."""


def read_history(path: Path) -> History:
    """Read a recording with all its parts, each as far as it is whole.

    Raises
    ------
    OSError
        If there is no such file.
    """
    events: list[Event] = []
    closed = False
    for part in _parts(path):
        closed = _read(part, events)
    return History(tuple(events), closed)


def breaches(history: History) -> list[Breach]:
    """What is wrong with a history, whatever its messages mean."""
    topics: dict[tuple[str, str], list[Event]] = {}
    for event in history.events:
        topics.setdefault((event.publisher, event.topic), []).append(event)
    found: list[Breach] = []
    for events in topics.values():
        found += _lacking(events)
        found += _repeated(events)
        found += _out_of_time(events)
    return [*found, *_epochs(history.events), *_at_one_time(history.events)]


def digests(history: History) -> dict[str, tuple[int, str]]:
    """Number of messages of each topic, and the SHA-256 of their bodies in order."""
    topics: dict[str, dict[int, bytes]] = {}
    for event in history.events:
        topics.setdefault(event.topic, {}).setdefault(event.seq, event.body)
    return {
        topic: (len(said), hashlib.sha256(b"".join(said[seq] for seq in sorted(said))).hexdigest())
        for topic, said in topics.items()
    }


def _parts(path: Path) -> Iterator[Path]:
    yield path
    for number in count(1):
        part = path.with_name(f"{path.stem}.{number}{path.suffix}")
        if not part.exists():
            return
        yield part


def _read(part: Path, events: list[Event]) -> bool:
    """Add what a file holds whole; whether it was closed."""
    channels: dict[int, Channel] = {}
    with part.open("rb") as file:
        stream = StreamReader(file, validate_crcs=True, record_size_limit=MOST_BYTES)
        try:
            for record in stream.records:
                if isinstance(record, Footer):
                    return True
                _take(record, channels, events)
        except (McapError, ValueError, struct.error, RuntimeError, KeyError):
            pass  # what comes behind a damage or the end of a cut-off file cannot be told
    return False


def _take(record: McapRecord, channels: dict[int, Channel], events: list[Event]) -> None:
    if isinstance(record, Channel):
        channels[record.id] = record
    elif isinstance(record, Message):
        channel = channels[record.channel_id]
        said = channel.metadata
        publisher, epoch = said["publisher"], int(said["epoch"])
        seq, sent_ns = record.sequence, record.publish_time
        events.append(Event(publisher, channel.topic, epoch, seq, sent_ns, record.data))


def _lacking(events: list[Event]) -> Iterator[Breach]:
    """One topic's messages must be numbered from 0 without a gap."""
    there = {event.seq for event in events}
    for seq in range(max(there)):
        if seq not in there:
            yield Breach("gap", f"{events[0].topic} {seq} of {events[0].publisher} is not there")


def _repeated(events: list[Event]) -> Iterator[Breach]:
    """Each of one topic's messages must be there once, and never say two things."""
    bodies: dict[int, bytes] = {}
    for event in events:
        before = bodies.setdefault(event.seq, event.body)
        if before is event.body:
            continue
        yield Breach("twice", f"{event.topic} {event.seq} is there more than once")
        if before != event.body:
            yield Breach("bodies", f"{event.topic} {event.seq} says two different things")


def _out_of_time(events: list[Event]) -> Iterator[Breach]:
    """One topic's messages must have been sent in the order of their numbers."""
    ordered = sorted(events, key=lambda event: event.seq)
    for one, other in pairwise(ordered):
        if one.seq < other.seq and other.sent_ns <= one.sent_ns:
            text = f"{other.topic} {other.seq} was sent no later than {one.seq} before it"
            yield Breach("order", text)


def _epochs(events: Iterable[Event]) -> Iterator[Breach]:
    """Who was heard from after a restart is not heard from before it any more."""
    latest: dict[str, int] = {}
    for event in events:
        before = latest.setdefault(event.publisher, event.epoch)
        if event.epoch < before:
            text = f"{event.topic} {event.seq} has epoch {event.epoch}, {before} had come before"
            yield Breach("epoch", text)
        latest[event.publisher] = max(before, event.epoch)


def _at_one_time(events: Iterable[Event]) -> Iterator[Breach]:
    """No publisher sends two different messages at one and the same time."""
    said: dict[tuple[str, int], tuple[str, int]] = {}
    for event in events:
        name = event.topic, event.seq
        before = said.setdefault((event.publisher, event.sent_ns), name)
        if before != name:
            text = f"{event.topic} {event.seq} was sent at the time of {before[0]} {before[1]}"
            yield Breach("order", text)
