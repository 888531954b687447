"""Reads a recording: its metadata, and its messages in the order of arrival, checked.

``topics.mcap`` is followed by ``topics.1.mcap`` and so on: a recorder that was killed goes on
in a further file. What it had not written whole it receives again, and writes into the next
file: together they have every message once.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from typing import NamedTuple

from mcap.records import Channel, McapRecord, Message, Metadata, Schema

from palpate.messages.recording.mcap_reading import (
    Closed,
    DamagedRecording,
    file_records,
    placed_records,
)
from palpate.messages.recording.writer import ABOUT

NOT_PALPATE = "was not written by palpate, or ends before it began"


class RecordedMessage(NamedTuple):
    """One recorded message."""

    topic: str
    publisher: str  # Name of the node that sent it; empty if the recording does not say
    type: str  # Name of its type
    run: int
    epoch: int  # Counts the publisher's starts
    seq: int  # Counts up by one per topic
    sent_ns: int  # The publisher's monotonic clock, ns
    schema: int  # Hash of the type's schema when it was recorded
    body: bytes  # The message, still encoded


@dataclass(frozen=True, slots=True, kw_only=True)
class Recording:
    """A readable recording."""

    path: Path
    version: str  # Version of palpate that wrote it
    graph: bytes  # Description of the graph that ran; empty if it has none
    counts: Mapping[str, int]  # Messages by topic
    # Topic to the name of its message type and the hash of that type's schema.
    types: Mapping[str, tuple[str, int]]
    about: Mapping[str, str]  # All that the recording says of itself, text by name
    closed: bool  # False if the recorder was killed: then the last messages may be missing

    def messages(self) -> Iterator[RecordedMessage]:
        """The messages in the order in which the recorder received them."""
        schemas: dict[tuple[Path, int], Schema] = {}
        channels: dict[tuple[Path, int], Channel] = {}
        for part, _, record in checked_records(self.path):
            if isinstance(record, Message):
                channel = channels[part, record.channel_id]
                yield recorded_message(channel, schemas[part, channel.schema_id], record)
            elif isinstance(record, Channel):
                channels[part, record.id] = record
            elif isinstance(record, Schema):
                schemas[part, record.id] = record


def recorded_message(channel: Channel, schema: Schema, message: Message) -> RecordedMessage:
    """One message with what its channel says of it."""
    about = channel.metadata
    return RecordedMessage(
        topic=channel.topic,
        publisher=about.get("publisher", ""),
        type=schema.name,
        run=int(about["run"], 16),
        epoch=int(about["epoch"]),
        seq=message.sequence,
        sent_ns=message.publish_time,
        schema=int(about["schema_hash"], 16),
        body=message.data,
    )


def open_recording(path: Path) -> Recording:
    """Check a recording from end to end, with the parts in which its recorder went on.

    Raises
    ------
    ValueError
        If it is missing, empty, no MCAP file, cut off, damaged, or not written by palpate.
    """
    about: Mapping[str, str] | None = None
    schemas: dict[tuple[Path, int], str] = {}
    types: dict[str, tuple[str, int]] = {}
    topics: dict[tuple[Path, int], str] = {}
    counts: dict[str, int] = {}
    closed = False
    for part, _, record in checked_records(path):
        if isinstance(record, Message):
            topic = topics[part, record.channel_id]
            counts[topic] = counts.get(topic, 0) + 1
        elif isinstance(record, Schema):
            schemas[part, record.id] = record.name
        elif isinstance(record, Channel):
            topics[part, record.id] = record.topic
            name = schemas[part, record.schema_id]
            types[record.topic] = name, int(record.metadata["schema_hash"], 16)
        elif isinstance(record, Metadata) and record.name == ABOUT:
            about = record.metadata
        closed = isinstance(record, Closed)
    if about is None:
        raise ValueError(f"recording {path} {NOT_PALPATE}")
    return Recording(
        path=path,
        version=about.get("version", ""),
        graph=about.get("graph", "").encode(),
        counts=counts,
        types=types,
        about=about,
        closed=closed,
    )


class RecordingEnd(NamedTuple):
    """Where the records of a recording end."""

    part: Path  # The file in which they end
    byte: int  # So many bytes of it are whole
    # Why they end there, as the rest of a sentence that begins with the file; empty if the
    # recording was closed.
    why: str


class ReadablePrefix:
    """The records of a recording up to its first fault, which is kept instead of raised."""

    def __init__(self, path: Path) -> None:
        self._path = path
        # Where they end, once they have been gone through
        self.end = RecordingEnd(path, 0, "was not read")
        # The parts that were closed, of those that have been gone through
        self.closed: set[Path] = set()

    def __iter__(self) -> Iterator[LocatedRecord]:
        try:
            for found in checked_records(self._path):
                if isinstance(found.record, Closed):
                    self.closed.add(found.part)
                yield found
        except DamagedRecording as error:
            self.end = RecordingEnd(error.path, error.byte, error.why)
            return
        last = parts_of(self._path)[-1]
        why = "" if last in self.closed else "was never closed"
        self.end = RecordingEnd(last, last.stat().st_size, why)


def checked_records(path: Path) -> Iterator[LocatedRecord]:
    """Records of all parts, as far as they belong to one recording.

    Raises DamagedRecording if a part cannot be read any further, was not written by palpate, or
    does not begin where those before it end.
    """
    ours = False
    schemas: set[tuple[Path, int]] = set()
    topics: dict[tuple[Path, int], str] = {}
    counts: dict[str, int] = {}
    for found in records_of_parts(path):
        part, byte, record = found
        if isinstance(record, Message):
            if not ours:
                raise DamagedRecording(part, NOT_PALPATE, byte)
            topic = topics[part, record.channel_id]
            had = counts.get(topic, 0)
            if part != path and record.sequence != had:
                # A part begins where those before it ended: one of them was damaged since.
                raise DamagedRecording(part, f"is damaged: it lacks {topic} {had}", byte)
            counts[topic] = had + 1
        elif isinstance(record, Schema):
            schemas.add((part, record.id))
        elif isinstance(record, Channel):
            why = _fault(record, (part, record.schema_id) in schemas)
            if why:
                raise DamagedRecording(part, why, byte)
            topics[part, record.id] = record.topic
        elif isinstance(record, Metadata):
            ours = ours or record.name == ABOUT
        yield found


def records_of_parts(path: Path) -> Iterator[LocatedRecord]:
    """Records of all parts; a part that another follows may be cut off.

    Raises DamagedRecording as `file_records` does, of the last part.
    """
    parts = parts_of(path)
    for part in parts[:-1]:
        try:
            yield from (LocatedRecord(part, *placed) for placed in placed_records(part))
        except ValueError:
            continue  # its recorder was killed: the next part begins where this one ends
    yield from (LocatedRecord(parts[-1], *placed) for placed in placed_records(parts[-1]))


def _fault(channel: Channel, has_schema: bool) -> str:
    """Why the messages of a channel could not be told apart; empty if they can."""
    about = channel.metadata
    try:
        int(about["run"], 16), int(about["epoch"]), int(about["schema_hash"], 16)
    except (KeyError, ValueError):
        return f"was not written by palpate: {channel.topic} lacks its run, epoch or schema hash"
    if not has_schema or channel.message_encoding != "msgpack":
        return f"has no schema of msgpack for {channel.topic}"
    return ""


class LocatedRecord(NamedTuple):
    """A record, and where it was found."""

    part: Path
    byte: int  # Where the record begins in the part, or the chunk that holds it
    record: McapRecord | Closed


def part_path(path: Path, number: int) -> Path:
    """File of a part; number 0 is the recording's own."""
    return path.with_name(f"{path.stem}.{number}{path.suffix}") if number else path


def parts_of(path: Path) -> tuple[Path, ...]:
    """The parts of a recording that are there; its own path if there is none."""
    found = []
    for number in count():
        part = part_path(path, number)
        if not part.exists():
            break
        found.append(part)
    return tuple(found) or (path,)


def counts_of(path: Path) -> dict[str, int]:
    """Messages of each topic that the parts of a recording hold whole."""
    counts: dict[str, int] = {}
    for part in parts_of(path):
        topics: dict[int, str] = {}
        try:
            for record in file_records(part):
                if isinstance(record, Channel):
                    topics[record.id] = record.topic
                elif isinstance(record, Message):
                    topic = topics[record.channel_id]
                    counts[topic] = max(counts.get(topic, 0), record.sequence + 1)
        except (ValueError, KeyError):
            continue  # what is damaged holds nothing whole from there on
    return counts
