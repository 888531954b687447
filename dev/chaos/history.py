"""What a recording says has happened, read and judged apart from the bus that it is to judge.

It shares no code with the bus, the recorder or the replay: it reads the files with the `mcap`
package alone, and believes none of them. No message may be missing, doubled, out of order, or
answer one that is not there or is later.
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

MAX_RECORD_BYTES = 512 << 20  # Of one record
_TOUCH = ("goal", "touch")
_SHARED = ("/contour/goal", "/probe/goal")  # Published by one for all: namespaces do not count
Key = tuple[str, tuple[str, ...], tuple[int, ...]]


class Event(NamedTuple):
    """One message, as one file has it."""

    publisher: str
    topic: str
    epoch: int  # How often its publisher had been started before
    seq: int
    sent_ns: int
    body: bytes


@dataclass(frozen=True, slots=True)
class History:
    """All that the files of one recording hold, in their order."""

    events: tuple[Event, ...]  # The messages
    closed: bool  # Whether the last file was closed properly


class Violation(NamedTuple):
    """One thing that is wrong with a history."""

    law: str  # Which law is broken: gap, twice, bodies, epoch, order or cause
    text: str  # How, in a sentence


def read_history(path: Path) -> History:
    """Read a recording's parts, each as far as it is whole; raises OSError if there is none."""
    events: list[Event] = []
    closed = False
    parts = (path.with_name(f"{path.stem}.{number}{path.suffix}") for number in count(1))
    for part in (path, *takewhile(Path.exists, parts)):
        closed = _read(part, events)
    return History(tuple(events), closed)


def _read(part: Path, events: list[Event]) -> bool:
    """Add what a file holds whole; whether it was closed."""
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
            pass  # what comes behind a damage or the end of a cut-off file cannot be told
    return False


def violations_in(history: History) -> list[Violation]:
    """What is wrong with a history, whatever its messages mean."""
    topics: dict[tuple[str, str], list[Event]] = {}
    for event in history.events:
        topics.setdefault((event.publisher, event.topic), []).append(event)
    found = [one for events in topics.values() for one in _topic_violations(events)]
    return [*found, *_epochs(history.events), *_at_one_time(history.events)]


def _topic_violations(events: list[Event]) -> Iterator[Violation]:
    """One publisher's messages on a topic are numbered from 0 without a gap, each there once.

    None holds two things, and they were sent in the order of their numbers.
    """
    bodies: dict[int, bytes] = {}
    there = {event.seq for event in events}
    for seq in (number for number in range(max(there)) if number not in there):
        yield Violation("gap", f"{events[0].topic} {seq} of {events[0].publisher} is not there")
    for event in events:
        before = bodies.setdefault(event.seq, event.body)
        if before is event.body:
            continue
        yield Violation("twice", f"{event.topic} {event.seq} is there more than once")
        if before != event.body:
            yield Violation("bodies", f"{event.topic} {event.seq} holds two different messages")
    for one, other in pairwise(sorted(events, key=lambda event: event.seq)):
        if one.seq < other.seq and other.sent_ns <= one.sent_ns:
            text = f"{other.topic} {other.seq} was sent no later than {one.seq} before it"
            yield Violation("order", text)


def _epochs(events: Iterable[Event]) -> Iterator[Violation]:
    """After a restart of a node nothing comes that it sent before."""
    latest: dict[str, int] = {}
    for event in events:
        before = latest.setdefault(event.publisher, event.epoch)
        if event.epoch < before:
            text = f"{event.topic} {event.seq} has epoch {event.epoch}, {before} had come before"
            yield Violation("epoch", text)
        latest[event.publisher] = max(before, event.epoch)


def _at_one_time(events: Iterable[Event]) -> Iterator[Violation]:
    """No publisher sends two different messages at one and the same time."""
    found: dict[tuple[str, int], tuple[str, int]] = {}
    for event in events:
        name = event.topic, event.seq
        before = found.setdefault((event.publisher, event.sent_ns), name)
        if before != name:
            text = f"{event.topic} {event.seq} was sent at the time of {before[0]} {before[1]}"
            yield Violation("order", text)


def digests(history: History) -> dict[str, tuple[int, str]]:
    """Number of messages of each topic, and the SHA-256 of their bodies in order."""
    topics: dict[str, dict[int, bytes]] = {}
    for event in history.events:
        topics.setdefault(event.topic, {}).setdefault(event.seq, event.body)
    bodies = {topic: [found[seq] for seq in sorted(found)] for topic, found in topics.items()}
    return {
        topic: (len(found), hashlib.sha256(b"".join(found)).hexdigest())
        for topic, found in bodies.items()
    }


class Answer(NamedTuple):
    """A topic whose messages answer others."""

    fields: tuple[str, ...]  # What names the message that is answered
    causes: tuple[str, ...]  # Topics on which that may have been published
    named: tuple[str, ...]  # The same fields, as the causes call them


def causality_violations(history: History, *, whole: bool) -> Iterator[Violation]:
    """Messages that answer what was not published, or not yet.

    Without an end (`whole` false) a cause may just have had no time to be recorded.
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
            shared = cause in _SHARED or cause.startswith(("/model", "/plan", "/hand"))
            key = (cause if shared else space + cause), answer.named, values
            times += [first[key]] if key in first else []
        if not times and whole:
            what = ", ".join(f"{n} {v}" for n, v in zip(answer.fields, values, strict=True))
            text = f"{event.topic} {event.seq} answers {what}, which nobody published"
            yield Violation("cause", text)
        elif times and min(times) >= event.sent_ns:
            yield Violation("cause", f"{event.topic} {event.seq} was sent before what it answers")


def _first_sent(history: History) -> dict[Key, int]:
    """Time at which each message that may be answered was first sent, ns."""
    wanted: dict[str, set[tuple[str, ...]]] = {}
    for answer in ANSWERS.values():
        for cause in answer.causes:
            wanted.setdefault(cause, set()).add(answer.named)
    first: dict[Key, int] = {}
    for event in history.events:
        for named in wanted.get(_split(event.topic)[1], ()):
            key = event.topic, named, _values(event, named)
            first[key] = min(first.get(key, event.sent_ns), event.sent_ns)
    return first


def _split(topic: str) -> tuple[str, str]:
    """Namespace of a finger, maybe empty, and the rest of a topic."""
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
