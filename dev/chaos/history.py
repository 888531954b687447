"""Checks of recordings that share no code with the bus, the recorder or the replay.

Files are read with the `mcap` package only. No message may be missing, doubled or out of order, or
answer a message that is missing or later.
"""

from __future__ import annotations

import hashlib
import struct
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import count, pairwise, takewhile
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
from mcap.exceptions import McapError
from mcap.records import Channel, Footer, Message
from mcap.stream_reader import StreamReader

MAX_RECORD_BYTES = 512 << 20
_TOUCH = ("goal", "touch")
_SHARED = ("/contour/goal", "/probe/goal")  # Topics without the namespace of a finger
Key = tuple[str, tuple[str, ...], tuple[int, ...]]


class Event(NamedTuple):
    """One message of a file."""

    publisher: str
    topic: str
    epoch: int  # Number of earlier starts of its publisher
    seq: int  # Number of the message on its topic, from 0
    sent_ns: int  # Time of sending [ns]
    body: bytes  # Packed by msgpack


@dataclass(frozen=True, slots=True)
class History:
    """Messages of a recording, in the order of its files."""

    events: tuple[Event, ...]
    is_closed: bool  # Whether the last file was closed properly


class Violation(NamedTuple):
    """A violation of a law."""

    law: str  # gap, twice, bodies, epoch, order or cause
    text: str  # A sentence


def read_history(path: Path) -> History:
    """Read the intact beginning of each part of a recording; raises OSError if there is none."""
    events: list[Event] = []
    closed = False
    parts = (path.with_name(f"{path.stem}.{number}{path.suffix}") for number in count(1))
    for part in (path, *takewhile(Path.exists, parts)):
        closed = _read(part, events)
    return History(tuple(events), closed)


def _read(part: Path, events: list[Event]) -> bool:
    """Add the messages of the intact beginning of a file; return whether it was closed."""
    channels: dict[int, Channel] = {}
    with part.open("rb") as file:
        stream = StreamReader(file, validate_crcs=True, record_size_limit=MAX_RECORD_BYTES)
        try:
            for record in stream.records:
                if isinstance(record, Footer):
                    return True
                if isinstance(record, Channel):
                    channels[record.id] = record
                elif isinstance(record, Message):
                    channel = channels[record.channel_id]
                    about, seq, sent_ns = channel.metadata, record.sequence, record.publish_time
                    sender = about["publisher"], channel.topic, int(about["epoch"])
                    events.append(Event(*sender, seq, sent_ns, record.data))
        except (McapError, ValueError, struct.error, RuntimeError, KeyError):
            pass  # the rest is damaged or cut off
    return False


def violations_in(history: History) -> list[Violation]:
    """Violations that do not depend on the meaning of messages."""
    topics: dict[tuple[str, str], list[Event]] = {}
    for event in history.events:
        topics.setdefault((event.publisher, event.topic), []).append(event)
    violations = [v for events in topics.values() for v in _topic_violations(events)]
    return [*violations, *_epochs(history.events), *_at_one_time(history.events)]


def _topic_violations(events: list[Event]) -> Iterator[Violation]:
    """A publisher's messages on a topic are numbered from 0, without a gap and once each.

    They are sent in the order of their numbers.
    """
    bodies: dict[int, bytes] = {}
    numbers = {event.seq for event in events}
    for seq in (number for number in range(max(numbers)) if number not in numbers):
        yield Violation("gap", f"{events[0].topic} {seq} of {events[0].publisher} is missing")
    for event in events:
        earlier = bodies.setdefault(event.seq, event.body)
        if earlier is event.body:
            continue
        yield Violation("twice", f"{event.topic} {event.seq} is recorded more than once")
        if earlier != event.body:
            yield Violation("bodies", f"{event.topic} {event.seq} has two different contents")
    for before, after in pairwise(sorted(events, key=lambda event: event.seq)):
        if before.seq < after.seq and after.sent_ns <= before.sent_ns:
            text = f"{after.topic} {after.seq} was sent no later than {before.seq}"
            yield Violation("order", text)


def _epochs(events: Iterable[Event]) -> Iterator[Violation]:
    """After the restart of a node no earlier message of it is received."""
    latest: dict[str, int] = {}
    for event in events:
        before = latest.setdefault(event.publisher, event.epoch)
        if event.epoch < before:
            text = f"{event.topic} {event.seq} has epoch {event.epoch} after epoch {before}"
            yield Violation("epoch", text)
        latest[event.publisher] = max(before, event.epoch)


def _at_one_time(events: Iterable[Event]) -> Iterator[Violation]:
    """A publisher sends no two messages at the same time."""
    names: dict[tuple[str, int], tuple[str, int]] = {}
    for event in events:
        name = event.topic, event.seq
        before = names.setdefault((event.publisher, event.sent_ns), name)
        if before != name:
            text = f"{event.topic} {event.seq} was sent at the time of {before[0]} {before[1]}"
            yield Violation("order", text)


def digests(history: History) -> dict[str, tuple[int, str]]:
    """Number of messages of each topic, and the SHA-256 of their bodies in order."""
    topics: dict[str, dict[int, bytes]] = {}
    for event in history.events:
        topics.setdefault(event.topic, {}).setdefault(event.seq, event.body)
    in_order = {topic: [body for _, body in sorted(by.items())] for topic, by in topics.items()}
    return {
        topic: (len(bodies), hashlib.sha256(b"".join(bodies)).hexdigest())
        for topic, bodies in in_order.items()
    }


class Answer(NamedTuple):
    """A topic whose messages answer messages of other topics, their causes."""

    fields: tuple[str, ...]  # Of the answer, which identify its cause
    causes: tuple[str, ...]  # Topics of the cause
    cause_fields: tuple[str, ...]  # Of the cause, with the same values


def causality_violations(history: History, *, is_whole: bool) -> Iterator[Violation]:
    """Messages whose cause is missing or later.

    In a recording without its end (`is_whole` false) a cause may be missing.
    """
    first = _first_sent(history)
    for event in history.events:
        space, topic = _split(event.topic)
        answer = ANSWERS.get(topic)
        if answer is None:
            continue
        values = _values(event, answer.fields)
        times = []
        for cause in answer.causes:
            is_shared = cause in _SHARED or cause.startswith(("/model", "/plan", "/hand"))
            key = (cause if is_shared else space + cause), answer.cause_fields, values
            times += [first[key]] if key in first else []
        if not times and is_whole:
            what = ", ".join(f"{n} {v}" for n, v in zip(answer.fields, values, strict=True))
            text = f"{event.topic} {event.seq} answers {what}, which was not published"
            yield Violation("cause", text)
        elif times and min(times) >= event.sent_ns:
            yield Violation("cause", f"{event.topic} {event.seq} was sent before its cause")


def _first_sent(history: History) -> dict[Key, int]:
    """Time [ns] at which each possible cause was first sent."""
    keys: dict[str, set[tuple[str, ...]]] = {}
    for answer in ANSWERS.values():
        for cause in answer.causes:
            keys.setdefault(cause, set()).add(answer.cause_fields)
    first: dict[Key, int] = {}
    for event in history.events:
        for fields in keys.get(_split(event.topic)[1], ()):
            key = event.topic, fields, _values(event, fields)
            first[key] = min(first.get(key, event.sent_ns), event.sent_ns)
    return first


def _split(topic: str) -> tuple[str, str]:
    """Namespace of a finger, or an empty text, and the rest of a topic."""
    head, _, rest = topic[1:].partition("/")
    return (f"/{head}", f"/{rest}") if head.startswith("finger_") else ("", topic)


def _values(event: Event, fields: tuple[str, ...]) -> tuple[int, ...]:
    body: Any = msgspec.msgpack.decode(event.body)
    return tuple(body.get(field, -1) for field in fields)


# Topics without the namespace of a finger.
ANSWERS = {
    "/touch/raw": Answer(_TOUCH, ("/finger/goal",), _TOUCH),
    "/touch/image": Answer(_TOUCH, ("/touch/raw",), _TOUCH),
    "/touch/patch": Answer(_TOUCH, ("/touch/image",), _TOUCH),
    "/finger/goal": Answer(("goal",), ("/contour/goal", "/probe/goal"), ("id",)),
    "/contour/traced": Answer(("id",), ("/contour/goal",), ("id",)),
    "/probe/traced": Answer(("id",), ("/probe/goal",), ("id",)),
    "/hand/contacts": Answer(("number",), ("/hand/goal",), ("number",)),
    "/model/coarse": Answer(("number",), ("/model/goal",), ("number",)),
    "/model/shape": Answer(("number",), ("/model/goal", "/plan/done"), ("number",)),
    "/score": Answer(("number",), ("/model/shape",), ("number",)),
}
