"""Reads a recording: its metadata, and its checked messages in the order of arrival.

A recorder that was killed continues ``topics.mcap`` in ``topics.1.mcap`` and so on. It receives
incompletely written messages again, and writes them into the next file, so that together the parts
have each message once.
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
    """A recorded message."""

    topic: str
    publisher: str  # name of the sending node; empty if unknown
    type: str  # name of its type
    run: int
    epoch: int  # number of the publisher's earlier starts
    seq: int  # counts up by one per topic
    sent_ns: int  # publisher's monotonic clock [ns]
    schema: int  # hash of the type's schema when it was recorded
    body: bytes  # encoded
    outside: bool = False  # whether a tool requested the message


@dataclass(frozen=True, slots=True, kw_only=True)
class Recording:
    """A readable recording."""

    path: Path
    version: str  # of palpate that wrote it
    graph: bytes  # description of the graph; empty if it has none
    counts: Mapping[str, int]  # of messages by topic
    types: Mapping[str, tuple[str, int]]  # message type and hash of its schema by topic
    schemas: Mapping[str, str]  # recorded JSON schemas by message type
    about: Mapping[str, str]  # description of the run, texts by name
    closed: bool  # False if the recorder was killed: the last messages may be missing

    def type_of(self, topic: str, recorded: int | None = None) -> type:
        """Message type of a topic: palpate's own, or made from the schema that was recorded.

        `recorded`: the hash of a message's schema, by default the last one of the topic. Raises
        ValueError if the type has another version now, or the schema is none of a message type;
        KeyError if there is no such topic.
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
    """Check a recording completely, with all its parts.

    Raises ValueError if it is missing, empty, no MCAP file, cut off, damaged, not written by
    palpate, or followed or preceded by other bytes.
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
    """The end of the readable records of a recording."""

    part: Path  # file in which they end
    byte: int  # number of undamaged bytes in that file
    why: str  # the rest of a sentence that begins with the file; empty if it was closed


class ReadablePrefix:
    """The records of a recording up to its first fault, which is stored and not raised."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self.end = RecordingEnd(path, 0, "was not read")  # known after iteration
        self.closed: set[Path] = set()  # closed parts of those that have been read

    def __iter__(self) -> Iterator[LocatedRecord]:
        try:
            for located in checked_records(self._path):
                if isinstance(located.record, Closed):
                    self.closed.add(located.part)
                yield located
        except DamagedRecording as error:
            self.end = RecordingEnd(error.path, error.byte, error.why)
            return
        last = parts_of(self._path)[-1]
        why = "" if last in self.closed else "was never closed"
        self.end = RecordingEnd(last, last.stat().st_size, why)


def checked_records(path: Path) -> Iterator[LocatedRecord]:
    """Records of all parts of one recording.

    Raises DamagedRecording if a part cannot be read any further, was not written by palpate, or
    does not begin where those before it end.
    """
    is_palpate = False
    schemas: dict[tuple[Path, int], Schema] = {}
    channels: dict[tuple[Path, int], Channel] = {}
    counts = Counter[str]()
    for part, byte, record, *_ in records_of_parts(path):
        channel = schema = None
        match record:
            case Message(sequence=sequence):
                if not is_palpate:
                    raise DamagedRecording(part, NOT_PALPATE, byte)
                channel = channels[part, record.channel_id]
                topic, schema = channel.topic, schemas[part, channel.schema_id]
                # A part continues those before it, unless one of them is damaged.
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
                is_palpate = is_palpate or name == ABOUT
        yield LocatedRecord(part, byte, record, channel, schema)


def records_of_parts(path: Path) -> Iterator[LocatedRecord]:
    """Records of all parts; parts before the last one may be cut off.

    Raises DamagedRecording as `placed_records` does for the last part, or for a closed one.
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
            continue  # its recorder was killed: the next part continues it
    yield from (LocatedRecord(parts[-1], *placed) for placed in placed_records(parts[-1]))


def _fault(channel: Channel, has_schema: bool) -> str:
    """The reason why messages of a channel cannot be identified; empty if they can."""
    about = channel.metadata
    try:
        int(about["run"], 16), int(about["epoch"]), int(about["schema_hash"], 16)
    except (KeyError, ValueError):
        return f"was not written by palpate: {channel.topic} lacks its run, epoch or schema hash"
    if not has_schema or channel.message_encoding != "msgpack":
        return f"has no schema of msgpack for {channel.topic}"
    return ""


class LocatedRecord(NamedTuple):
    """A record and its position."""

    part: Path
    byte: int  # of the beginning of the record, or of its chunk, in the part
    record: McapRecord | Closed
    channel: Channel | None = None  # of a message, or the record itself
    schema: Schema | None = None  # of the channel


def part_path(path: Path, number: int) -> Path:
    """File of a part; part 0 is the path of the recording."""
    return path.with_name(f"{path.stem}.{number}{path.suffix}") if number else path


def parts_of(path: Path) -> tuple[Path, ...]:
    """The existing parts of a recording; its own path if there are none."""
    numbered = (part_path(path, number) for number in count())
    return tuple(takewhile(Path.exists, numbered)) or (path,)


def counts_of(path: Path) -> dict[str, int]:
    """Numbers of complete messages by topic in the parts of a recording."""
    counts: dict[str, int] = {}
    for part in parts_of(path):
        topics: dict[int, str] = {}
        # After a fault there are no complete messages.
        with suppress(ValueError, KeyError):
            for _, record in placed_records(part):
                if isinstance(record, Channel):
                    topics[record.id] = record.topic
                elif isinstance(record, Message):
                    topic = topics[record.channel_id]
                    counts[topic] = max(counts.get(topic, 0), record.sequence + 1)
    return counts


class RecordingCopy:
    """A copy of the undecoded parts of a recording in one new file.

    Raises OSError if the file exists or cannot be written.
    """

    def __init__(self, path: Path, library: str) -> None:
        self.counts: Counter[str] = Counter()  # of messages by topic so far
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
        self._metadata: set[object] = set()
        self._logged = 0
        self._digest = hashlib.sha256()

    def take(self, records: Iterable[LocatedRecord]) -> None:
        """Write records in their order; counts of messages are written at the end."""
        for part, _, record, _, described in records:
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
                    metadata = (name, tuple(sorted(about.items())))
                    if metadata not in self._metadata:  # the same in each part of a recording
                        self._metadata.add(metadata)
                        self._writer.add_metadata(name, about)

    def close(self, name: str, about: Mapping[str, str]) -> None:
        """Write the counts, a description of the copy as metadata `name`, and the index."""
        counts = {topic: str(self.counts[topic]) for topic in self._declared | self.counts.keys()}
        self._writer.flush()  # type: ignore[no-untyped-call]
        self._writer.add_metadata(COUNTS, dict(sorted(counts.items())))
        self._writer.add_metadata(name, dict(about))
        self._writer.finish()  # type: ignore[no-untyped-call]
        self._file.close()

    def give_up(self) -> None:
        """Close the incomplete file."""
        self._file.close()

    def check(self) -> None:
        """Read the closed copy with our own reader and that of the MCAP project.

        Raises ValueError unless both read exactly the messages that were written.
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
        is_same = ours.digest() == theirs.digest() == self._digest.digest()
        if not (is_same and recording.closed and recording.counts == counts == self.counts):
            raise ValueError(f"recording {self._path} does not hold what was written to it")

    def _message(self, message: Message, topic: str, channel_id: int) -> None:
        sent, sequence = message.publish_time, message.sequence
        self._logged = max(self._logged, message.log_time)  # as of a single recorder
        self._writer.add_message(channel_id, self._logged, message.data, sent, sequence)
        self.counts[topic] += 1
        _add(self._digest, topic, sequence, sent, message.data)


def _add(digest: hashlib._Hash, topic: str, sequence: int, sent: int, body: bytes) -> None:
    digest.update(f"{topic} {sequence} {sent} {len(body)} ".encode())
    digest.update(body)
