"""Reads a recording: its metadata, and its messages in the order of arrival, checked.

``topics.mcap`` is followed by ``topics.1.mcap`` and so on: a recorder that was killed goes on
in a further file. What it had not written whole it receives again, and writes into the next
file: together they have every message once.
"""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from itertools import count, takewhile
from pathlib import Path
from typing import NamedTuple

from mcap.records import Channel, McapRecord, Message, Metadata, Schema

from palpate.messages.codec import schema_hash
from palpate.messages.described import type_of_schema
from palpate.messages.fields import CodecError
from palpate.messages.recording.mcap_reading import Closed, DamagedRecording, placed_records
from palpate.messages.recording.writer import (
    ABOUT,
    COUNTS,
    OUTSIDE,
    PROFILE,
    AtomicFile,
    ChunkWriter,
)
from palpate.messages.types import TYPES

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
    outside: bool = False  # Whether a tool had its publisher publish it


@dataclass(frozen=True, slots=True, kw_only=True)
class Recording:
    """A readable recording."""

    path: Path
    version: str  # Version of palpate that wrote it
    graph: bytes  # Description of the graph that ran; empty if it has none
    counts: Mapping[str, int]  # Messages by topic
    types: Mapping[str, tuple[str, int]]  # Topic to its message type and the hash of its schema
    schemas: Mapping[str, str]  # Message type to its JSON schema, as it was recorded
    about: Mapping[str, str]  # All that the recording says of itself, text by name
    closed: bool  # False if the recorder was killed: then the last messages may be missing

    def type_of(self, topic: str, recorded: int | None = None) -> type:
        """Message type of a topic: palpate's own, or made from the schema that was recorded.

        `recorded` is the hash that a message says its schema has; the topic's last if None. Raises
        ValueError if it was recorded with another version of the type, or the schema is none of a
        message type; KeyError if there is no such topic.
        """
        name, last = self.types[topic]
        recorded = last if recorded is None else recorded
        try:
            cls = TYPES.get(name) or type_of_schema(self.schemas[name])
        except CodecError as error:
            raise ValueError(f"{topic} holds {name}: {error}") from None
        if recorded != schema_hash(cls):
            raise ValueError(
                f"{topic} was recorded with another version of {name} "
                f"(schema {recorded:08x}, now {schema_hash(cls):08x})"
            )
        return cls

    def messages(self) -> Iterator[RecordedMessage]:
        """The messages in the order in which the recorder received them."""
        for _, _, record, channel, schema in checked_records(self.path):
            if isinstance(record, Message):
                assert channel is not None and schema is not None
                about = channel.metadata
                yield RecordedMessage(
                    topic=channel.topic,
                    publisher=about.get("publisher", ""),
                    type=schema.name,
                    run=int(about["run"], 16),
                    epoch=int(about["epoch"]),
                    seq=record.sequence,
                    sent_ns=record.publish_time,
                    schema=int(about["schema_hash"], 16),
                    body=record.data,
                    outside=OUTSIDE in about,
                )


def open_recording(path: Path) -> Recording:
    """Check a recording from end to end, with the parts in which its recorder went on.

    ValueError if it is missing, empty, no MCAP file, cut off, damaged, not written by palpate, or
    followed or preceded by other bytes.
    """
    about: Mapping[str, str] | None = None
    types: dict[str, tuple[str, int]] = {}
    schemas: dict[str, str] = {}
    counts = Counter[str]()
    closed = False
    for _, _, record, channel, schema in checked_records(path):
        if isinstance(record, Message) and channel is not None:
            counts[channel.topic] += 1
        elif channel is not None and schema is not None:
            types[channel.topic] = schema.name, int(channel.metadata["schema_hash"], 16)
            schemas[schema.name] = schema.data.decode(errors="replace")
        elif isinstance(record, Metadata) and record.name == ABOUT:
            about = record.metadata
        closed = isinstance(record, Closed)
    if about is None:
        raise ValueError(f"recording {path} {NOT_PALPATE}")
    return Recording(
        path=path,
        version=about.get("version", ""),
        graph=about.get("graph", "").encode(),
        counts=dict(counts),
        types=types,
        schemas=schemas,
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
    schemas: dict[tuple[Path, int], Schema] = {}
    channels: dict[tuple[Path, int], Channel] = {}
    counts = Counter[str]()
    for part, byte, record, *_ in records_of_parts(path):
        channel = schema = None
        match record:
            case Message(sequence=sequence):
                if not ours:
                    raise DamagedRecording(part, NOT_PALPATE, byte)
                channel = channels[part, record.channel_id]
                topic, schema = channel.topic, schemas[part, channel.schema_id]
                # A part begins where those before it ended, or one of them was damaged since.
                if part != path and sequence != counts[topic]:
                    lacks = f"is damaged: it lacks {topic} {counts[topic]}"
                    raise DamagedRecording(part, lacks, byte)
                counts[topic] += 1
            case Schema():
                schemas[part, record.id] = record
            case Channel():
                channel, schema = record, schemas.get((part, record.schema_id))
                if why := _fault(record, schema is not None):
                    raise DamagedRecording(part, why, byte)
                channels[part, record.id] = record
            case Metadata(name=name):
                ours = ours or name == ABOUT
        yield LocatedRecord(part, byte, record, channel, schema)


def records_of_parts(path: Path) -> Iterator[LocatedRecord]:
    """Records of all parts; a part that another follows may be cut off.

    Raises DamagedRecording as `placed_records` does, of the last part, or of one that was closed.
    """
    parts = parts_of(path)
    for part in parts[:-1]:
        closed = False
        try:
            for placed in placed_records(part):
                closed = isinstance(placed.record, Closed)
                yield LocatedRecord(part, *placed)
        except ValueError:
            if closed:  # other bytes follow it
                raise
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
    channel: Channel | None = None  # Of a message; of a channel, itself
    schema: Schema | None = None  # Of what either holds


def part_path(path: Path, number: int) -> Path:
    """File of a part; number 0 is the recording's own."""
    return path.with_name(f"{path.stem}.{number}{path.suffix}") if number else path


def parts_of(path: Path) -> tuple[Path, ...]:
    """The parts of a recording that are there; its own path if there is none."""
    numbered = (part_path(path, number) for number in count())
    return tuple(takewhile(Path.exists, numbered)) or (path,)


def counts_of(path: Path) -> dict[str, int]:
    """Messages of each topic that the parts of a recording hold whole."""
    counts: dict[str, int] = {}
    for part in parts_of(path):
        topics: dict[int, str] = {}
        # What is damaged holds nothing whole from there on.
        with suppress(ValueError, KeyError):
            for _, record in placed_records(part):
                if isinstance(record, Channel):
                    topics[record.id] = record.topic
                elif isinstance(record, Message):
                    topic = topics[record.channel_id]
                    counts[topic] = max(counts.get(topic, 0), record.sequence + 1)
    return counts


class RecordingCopy:
    """A recording that is being copied undecoded, its parts into one new file.

    Raises OSError if the file exists or cannot be written.
    """

    def __init__(self, path: Path, library: str) -> None:
        self.counts: Counter[str] = Counter()  # Messages by topic, as far as taken
        self._path, self._file = path, AtomicFile(path)
        self._writer = ChunkWriter(self._file)
        try:
            self._writer.start(profile=PROFILE, library=library)
        except OSError:
            self._file.close()
            raise
        self._channels: dict[tuple[Path, int], tuple[str, int]] = {}
        self._registered: dict[object, int] = {}
        self._declared: set[str] = set()
        self._told: set[object] = set()
        self._logged = 0
        self._digest = hashlib.sha256()

    def take(self, found: Iterable[LocatedRecord]) -> None:
        """Write records in their order; how many messages of each topic, is written at the end."""
        for part, _, record, _, described in found:
            match record:
                case Channel(topic=topic, metadata=about):
                    assert described is not None
                    schema = (described.name, described.encoding, described.data)
                    if schema not in self._registered:
                        self._registered[schema] = self._writer.register_schema(*schema)
                    channel = (topic, record.message_encoding, self._registered[schema])
                    key = (*channel, tuple(sorted(about.items())))
                    if key not in self._registered:
                        self._registered[key] = self._writer.register_channel(*channel, about)
                    self._channels[part, record.id] = topic, self._registered[key]
                case Message():
                    self._message(record, *self._channels[part, record.channel_id])
                case Metadata(name=name) if name == COUNTS:
                    self._declared |= record.metadata.keys()
                case Metadata(name=name, metadata=about):
                    told = (name, tuple(sorted(about.items())))
                    if told not in self._told:  # each part of a recording says the same
                        self._told.add(told)
                        self._writer.add_metadata(name, about)

    def close(self, name: str, about: Mapping[str, str]) -> None:
        """Write the counts, what there is to say about the copy, and the index."""
        counts = {topic: str(self.counts[topic]) for topic in self._declared | self.counts.keys()}
        self._writer.flush()  # type: ignore[no-untyped-call]
        self._writer.add_metadata(COUNTS, dict(sorted(counts.items())))
        self._writer.add_metadata(name, dict(about))
        self._writer.finish()  # type: ignore[no-untyped-call]
        self._file.close()

    def give_up(self) -> None:
        """Close the file as it is."""
        self._file.close()

    def check(self) -> None:
        """Read the closed copy again, by our own reader and by that of the MCAP project.

        Raises ValueError if one of them does not find exactly the messages that were taken.
        """
        ours, theirs = hashlib.sha256(), hashlib.sha256()
        recording = open_recording(self._path)
        for kept in recording.messages():
            _add(ours, kept.topic, kept.seq, kept.sent_ns, kept.body)
        from mcap.reader import make_reader

        counts: Counter[str] = Counter()
        with self._path.open("rb") as file:
            reader = make_reader(file, validate_crcs=True)
            for _, channel, message in reader.iter_messages(log_time_order=False):
                counts[channel.topic] += 1
                sequence, sent = message.sequence, message.publish_time
                _add(theirs, channel.topic, sequence, sent, message.data)
        same = ours.digest() == theirs.digest() == self._digest.digest()
        if not (same and recording.closed and recording.counts == counts == self.counts):
            raise ValueError(f"recording {self._path} does not hold what was written to it")

    def _message(self, message: Message, topic: str, channel_id: int) -> None:
        sent, sequence = message.publish_time, message.sequence
        self._logged = max(self._logged, message.log_time)  # as if one recorder had written all
        self._writer.add_message(channel_id, self._logged, message.data, sent, sequence)
        self.counts[topic] += 1
        _add(self._digest, topic, sequence, sent, message.data)


def _add(digest: hashlib._Hash, topic: str, sequence: int, sent: int, body: bytes) -> None:
    digest.update(f"{topic} {sequence} {sent} {len(body)} ".encode())
    digest.update(body)
