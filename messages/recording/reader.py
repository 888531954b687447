"""Reads a recording: what it says of itself, and its messages in the order of arrival."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from mcap.records import Channel, Message, Metadata, Schema

from palpate.messages.recording.checked import NOT_OURS, checked_records
from palpate.messages.recording.framing import Closed
from palpate.messages.recording.writer import ABOUT


class Kept(NamedTuple):
    """One recorded message."""

    topic: str
    publisher: str
    """Name of the node that sent it; empty if the recording does not say."""
    type: str
    """Name of its type."""
    run: int
    epoch: int
    """Counts the publisher's starts."""
    seq: int
    """Counts up by one per topic."""
    sent_ns: int
    """The publisher's monotonic clock, ns."""
    schema: int
    """Hash of the type's schema when it was recorded."""
    body: bytes
    """The message, still encoded."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Recording:
    """A readable recording."""

    path: Path
    version: str
    """Version of palpate that wrote it."""
    graph: bytes
    """Description of the graph that ran; empty if it has none."""
    counts: Mapping[str, int]
    """Messages by topic."""
    types: Mapping[str, tuple[str, int]]
    """Topic to the name of its message type and the hash of that type's schema."""
    about: Mapping[str, str]
    """All that the recording says of itself, text by name."""
    closed: bool
    """False if the recorder was killed: then the last messages may be missing."""

    def messages(self) -> Iterator[Kept]:
        """The messages in the order in which the recorder heard them."""
        schemas: dict[tuple[Path, int], Schema] = {}
        channels: dict[tuple[Path, int], Channel] = {}
        for part, _, record in checked_records(self.path):
            if isinstance(record, Message):
                channel = channels[part, record.channel_id]
                yield kept_of(channel, schemas[part, channel.schema_id], record)
            elif isinstance(record, Channel):
                channels[part, record.id] = record
            elif isinstance(record, Schema):
                schemas[part, record.id] = record


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
        raise ValueError(f"recording {path} {NOT_OURS}")
    return Recording(
        path=path,
        version=about.get("version", ""),
        graph=about.get("graph", "").encode(),
        counts=counts,
        types=types,
        about=about,
        closed=closed,
    )


def kept_of(channel: Channel, schema: Schema, message: Message) -> Kept:
    """One message with what its channel says of it."""
    about = channel.metadata
    return Kept(
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
