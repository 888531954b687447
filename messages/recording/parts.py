"""The files of one recording: a recorder that was killed goes on in a further one.

``topics.mcap`` is followed by ``topics.1.mcap`` and so on. What the killed recorder had not
written whole it hears again, and writes into the next file: together they have every message once.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import count
from pathlib import Path
from typing import NamedTuple

from mcap.records import Channel, McapRecord, Message

from palpate.messages.recording.framing import Closed, placed_records, records


class Found(NamedTuple):
    """A record, and where it was found."""

    part: Path
    byte: int
    """Where the record begins in the part, or the chunk that holds it."""
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


def records_of(path: Path) -> Iterator[Found]:
    """Records of all parts; a part that another follows may be cut off.

    Raises
    ------
    Damaged
        As `records` does, of the last part.
    """
    parts = parts_of(path)
    for part in parts[:-1]:
        try:
            yield from (Found(part, *placed) for placed in placed_records(part))
        except ValueError:
            continue  # its recorder was killed: the next part begins where this one ends
    yield from (Found(parts[-1], *placed) for placed in placed_records(parts[-1]))


def counts_of(path: Path) -> dict[str, int]:
    """Messages of each topic that the parts of a recording hold whole."""
    counts: dict[str, int] = {}
    for part in parts_of(path):
        topics: dict[int, str] = {}
        try:
            for record in records(part):
                if isinstance(record, Channel):
                    topics[record.id] = record.topic
                elif isinstance(record, Message):
                    topic = topics[record.channel_id]
                    counts[topic] = max(counts.get(topic, 0), record.sequence + 1)
        except (ValueError, KeyError):
            continue  # what is damaged holds nothing whole from there on
    return counts
