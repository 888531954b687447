"""The records of a recording of palpate, checked across its parts."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from mcap.records import Channel, Message, Metadata, Schema

from palpate.messages.recording.framing import Closed, Damaged
from palpate.messages.recording.parts import Found, parts_of, records_of
from palpate.messages.recording.writer import ABOUT

NOT_OURS = "was not written by palpate, or ends before it began"


def checked_records(path: Path) -> Iterator[Found]:
    """Records of all parts, as far as they belong to one recording.

    Raises
    ------
    Damaged
        If a part cannot be read any further, was not written by palpate, or does not begin where
        those before it end.
    """
    ours = False
    schemas: set[tuple[Path, int]] = set()
    topics: dict[tuple[Path, int], str] = {}
    counts: dict[str, int] = {}
    for found in records_of(path):
        part, byte, record = found
        if isinstance(record, Message):
            if not ours:
                raise Damaged(part, NOT_OURS, byte)
            topic = topics[part, record.channel_id]
            had = counts.get(topic, 0)
            if part != path and record.sequence != had:
                # A part begins where those before it ended: one of them was damaged since.
                raise Damaged(part, f"is damaged: it lacks {topic} {had}", byte)
            counts[topic] = had + 1
        elif isinstance(record, Schema):
            schemas.add((part, record.id))
        elif isinstance(record, Channel):
            why = _fault(record, (part, record.schema_id) in schemas)
            if why:
                raise Damaged(part, why, byte)
            topics[part, record.id] = record.topic
        elif isinstance(record, Metadata):
            ours = ours or record.name == ABOUT
        yield found


class End(NamedTuple):
    """Where the records of a recording end."""

    part: Path
    """The file in which they end."""
    byte: int
    """So many bytes of it are whole."""
    why: str
    """Why they end there, as the rest of a sentence that begins with the file; empty if the
    recording was closed."""


class Prefix:
    """The records of a recording up to its first fault, which is kept instead of raised."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self.end = End(path, 0, "was not read")
        """Where they end, once they have been gone through."""
        self.closed: set[Path] = set()
        """The parts that were closed, of those that have been gone through."""

    def __iter__(self) -> Iterator[Found]:
        try:
            for found in checked_records(self._path):
                if isinstance(found.record, Closed):
                    self.closed.add(found.part)
                yield found
        except Damaged as error:
            self.end = End(error.path, error.byte, error.why)
            return
        last = parts_of(self._path)[-1]
        why = "" if last in self.closed else "was never closed"
        self.end = End(last, last.stat().st_size, why)


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
