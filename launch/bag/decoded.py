"""The messages of a recording, decoded for those who write them in another format."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from palpate.launch.bag.bag_file import find_bag
from palpate.launch.located import InputError
from palpate.launch.nearest import hint
from palpate.messages.codec import decode, schema_hash
from palpate.messages.fields import CodecError
from palpate.messages.recording.framing import Damaged
from palpate.messages.recording.reader import Kept, Recording, open_recording
from palpate.messages.types import TYPES

LONGEST_STEM = 100
"""Characters of a topic's name in a file's name."""


class Said(NamedTuple):
    """One message."""

    topic: str
    seq: int
    sent_ns: int
    """The publisher's monotonic clock, ns."""
    message: Any


class Source(NamedTuple):
    """Topics of a recording."""

    recording: Recording
    topics: tuple[str, ...]
    """Those that are wanted."""
    first_ns: int
    """When the first message of the recording was sent, whatever its topic."""

    def said(
        self, topics: Iterable[str] | None = None, also: frozenset[str] = frozenset()
    ) -> Iterator[Said]:
        """Messages of these topics, in the order of arrival.

        Parameters
        ----------
        topics : texts, optional
            All that are wanted if left out.
        also : set of str
            Types of messages that are given whatever their topic.

        Raises
        ------
        InputError
            If one of them was recorded with other types than those of today.
        """
        wanted = frozenset(self.topics if topics is None else topics)
        for kept in self.recording.messages():
            if kept.topic in wanted or kept.type in also:
                yield Said(kept.topic, kept.seq, kept.sent_ns, self._decoded(kept))

    def _decoded(self, kept: Kept) -> Any:
        place = f"{self.recording.path}: {kept.topic}"
        cls = TYPES.get(kept.type)
        if cls is None:
            raise InputError(f"{place} holds {kept.type}; there is no such type of message")
        if kept.schema != schema_hash(cls):
            raise InputError(
                f"{place} was recorded with another version of {kept.type} "
                f"(schema {kept.schema:08x}, now {schema_hash(cls):08x})"
            )
        try:
            return decode(cls, kept.body)
        except CodecError as error:
            raise InputError(f"{place} {kept.seq}: {error}") from None


def open_source(bag: Path, topics: Sequence[str] = ()) -> Source:
    """Check a recording from end to end.

    Parameters
    ----------
    bag : Path
        A recording, or a run directory.
    topics : sequence of str
        The topics that are wanted; all if empty.

    Raises
    ------
    InputError
        If there is no such recording or topic, or it is damaged.
    """
    path = find_bag(bag)
    try:
        recording = open_recording(path)
    except Damaged as error:
        raise InputError(f"{error}; `palpate bag recover` saves what is whole of it") from None
    except ValueError as error:
        raise InputError(str(error)) from None
    if not recording.counts:
        raise InputError(f"{path}: holds no message")
    for topic in topics:
        if topic not in recording.counts:
            raise InputError(f"{path}: has no topic {topic!r}; {hint(topic, recording.counts)}")
    first = min((kept.sent_ns for kept in recording.messages()), default=0)
    return Source(recording, tuple(dict.fromkeys(topics or sorted(recording.counts))), first)


def stems(topics: Iterable[str]) -> dict[str, str]:
    """Names for topics in which nothing but letters, digits and ``_`` occurs: ``touch_raw``.

    A name that an earlier topic has already is numbered.
    """
    found: dict[str, str] = {}
    for topic in topics:
        stem = re.sub(r"[^A-Za-z0-9_]", "_", topic.strip("/"))[:LONGEST_STEM] or "_"
        free, number = stem, 1
        while free in found.values():
            number += 1
            free = f"{stem}_{number}"
        found[topic] = free
    return found
