"""The messages of a recording decoded for export, and common properties of those of a topic.

All rows of a table have the same columns, so a first reading finds the shapes of arrays and the
names in tables.
"""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from palpate.launch.files.source_map import InputError, as_input_errors, hint
from palpate.launch.run_directory import find_bag
from palpate.messages import CodecError, decode, schema
from palpate.messages.recording import DamagedRecording, Recording, open_recording

FIRST_FIELD = "robot_time"  # field that comes first in a table


class DecodedMessage(NamedTuple):
    """One message."""

    topic: str
    seq: int
    sent_ns: int  # monotonic clock of the publisher [ns]
    message: Any


class DecodedRecording(NamedTuple):
    """Topics of a recording."""

    recording: Recording
    topics: tuple[str, ...]  # that are wanted
    first_ns: int  # time at which the first message of any topic was sent [ns]

    def published(
        self, topics: Iterable[str] | None = None, also: frozenset[str] = frozenset()
    ) -> Iterator[DecodedMessage]:
        """Messages of some topics, and of the types `also`, in the order of arrival.

        Raises InputError if a message was recorded with another version of its type.
        """
        path, wanted = self.recording.path, frozenset(self.topics if topics is None else topics)
        for kept in self.recording.messages():
            if kept.topic not in wanted and kept.type not in also:
                continue
            with as_input_errors(path):
                cls = self.recording.type_of(kept.topic, kept.schema)
            try:
                yield DecodedMessage(kept.topic, kept.seq, kept.sent_ns, decode(cls, kept.body))
            except CodecError as error:
                raise InputError(f"{path}: {kept.topic} {kept.seq}: {error}") from None


def open_decoded(bag: Path, topics: Sequence[str] = ()) -> DecodedRecording:
    """Check a whole recording and open some of its topics, or all if none is named.

    Raises InputError if there is no such recording or topic, or it is damaged.
    """
    path = find_bag(bag)
    try:
        recording = open_recording(path)
    except DamagedRecording as error:
        raise InputError(f"{error}; `palpate bag recover` saves its intact beginning") from None
    except ValueError as error:
        raise InputError(str(error)) from None
    if not recording.counts:
        raise InputError(f"{path}: holds no message")
    for topic in topics:
        if topic not in recording.counts:
            raise InputError(f"{path}: has no topic {topic!r}; {hint(topic, recording.counts)}")
    first = min((kept.sent_ns for kept in recording.messages()), default=0)
    wanted = tuple(dict.fromkeys(topics or sorted(recording.counts)))
    return DecodedRecording(recording, wanted, first)


def file_stems(topics: Iterable[str], max_length: int = 100) -> dict[str, str]:
    """Names of letters, digits and ``_`` for topics: ``touch_raw``; equal names are numbered."""
    stems: dict[str, str] = {}
    for topic in topics:
        stem = re.sub(r"[^A-Za-z0-9_]", "_", topic.strip("/"))[:max_length] or "_"
        free, number = stem, 1
        while free in stems.values():
            number += 1
            free = f"{stem}_{number}"
        stems[topic] = free
    return stems


@dataclasses.dataclass(slots=True)
class FieldSurvey:
    """Shapes and names in the fields of one topic, as far as it has been read."""

    cls: type
    count: int = 0  # of messages
    # Shape of each array, or length of each list; None if it varies.
    shapes: dict[str, tuple[int, ...] | None] = dataclasses.field(default_factory=dict)
    # Names in each table, in the order of their first occurrence.
    names: dict[str, dict[str, None]] = dataclasses.field(default_factory=dict)

    def fields(self) -> list[str]:
        """The fields of a message, robot time first."""
        names = [field.name for field in dataclasses.fields(self.cls)]
        return sorted(names, key=lambda name: name != FIRST_FIELD)

    def add(self, message: Any) -> None:
        """Take one more message into account."""
        for name in self.fields():
            value = getattr(message, name)
            if isinstance(value, dict):
                self.names.setdefault(name, {}).update(dict.fromkeys(value))
            elif (shape := shape_of(value)) is not None:
                same = self.shapes.setdefault(name, shape) == shape
                self.shapes[name] = shape if same else None
        self.count += 1


def shape_of(value: Any) -> tuple[int, ...] | None:
    """Shape of an array or a list; None for anything else."""
    if isinstance(value, tuple):
        return (len(value),)
    shape: tuple[int, ...] | None = getattr(value, "shape", None)
    return shape


def is_list(cls: type, field: str) -> bool:
    """Whether a field is a list of any length, not an array."""
    described: dict[str, Any] = schema(cls)["properties"][field]
    return described.get("type") == "array"


def units_of(cls: type) -> dict[str, str]:
    """Units of the fields that have one."""
    units = {}
    for name, described in schema(cls)["properties"].items():
        unit = described.get("unit") or described.get("anyOf", [{}])[0].get("unit")
        if unit not in (None, "#"):
            units[name] = unit
    return units
