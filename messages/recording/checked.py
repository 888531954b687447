"""The records of a recording of palpate, checked across its parts."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from mcap.records import Channel, Message, Schema

from palpate.messages.recording.framing import Damaged
from palpate.messages.recording.parts import Found, records_of


def checked_records(path: Path) -> Iterator[Found]:
    """Records of all parts, as far as they belong to one recording.

    Raises
    ------
    Damaged
        If a part cannot be read any further, was not written by palpate, or does not begin where
        those before it end.
    """
    schemas: set[tuple[Path, int]] = set()
    topics: dict[tuple[Path, int], str] = {}
    counts: dict[str, int] = {}
    for found in records_of(path):
        part, byte, record = found
        if isinstance(record, Message):
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
        yield found


class Prefix:
    """The records of a recording up to its first fault, which is kept instead of raised."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self.fault: Damaged | None = None
        """Why there are no more records, once they have been gone through; None if there is no
        reason."""

    def __iter__(self) -> Iterator[Found]:
        self.fault = None
        try:
            yield from checked_records(self._path)
        except Damaged as error:
            self.fault = error


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
