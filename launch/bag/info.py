"""What a recording holds, as far as it can be read."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypedDict

from mcap.records import Channel, Message, Metadata, Schema

from palpate.launch.bag.bag_file import find_bag
from palpate.launch.located import InputError
from palpate.messages.recording.checked import Prefix
from palpate.messages.recording.parts import Found, parts_of
from palpate.messages.recording.writer import ABOUT
from palpate.nodes.recording import recorded_wirings

LONGEST_VALUE = 60
"""Characters of a value that is shown whole."""


class Topic(TypedDict):
    """One topic of a recording."""

    topic: str
    type: str
    publisher: str
    messages: int
    bytes: int
    """Of the messages, unpacked."""
    share: float
    """Of the bytes of all messages."""


class Info(TypedDict):
    """What a recording holds."""

    path: str
    parts: list[dict[str, Any]]
    """Of each file its path, its bytes, and whether it was closed."""
    bytes: int
    version: str
    """Version of palpate that wrote it."""
    closed: bool
    end: dict[str, Any] | None
    """Where and why it ends before it was closed: file, byte, reason."""
    duration_s: float
    """From the first message to the last, by the time at which they were sent."""
    messages: int
    topics: list[Topic]
    metadata: dict[str, dict[str, str | int]]
    """By record and name, the value, or the number of its characters if it is long."""
    nodes: list[str]


def bag_info(bag: Path) -> Info:
    """Go through a recording, up to its end or its first damage.

    Parameters
    ----------
    bag : Path
        A recording, or a run directory.

    Raises
    ------
    InputError
        If there is none, or nothing of it can be read.
    """
    path = find_bag(bag)
    prefix, tally = Prefix(path), _Tally()
    for found in prefix:
        tally.take(found)
    about = tally.metadata.get(ABOUT)
    if about is None:
        raise InputError(f"{prefix.end.part}: cannot be read as a recording: it {prefix.end.why}")
    end, parts = prefix.end, parts_of(path)
    return Info(
        path=str(path),
        parts=[
            {"path": str(part), "bytes": part.stat().st_size, "closed": part in prefix.closed}
            for part in parts
        ],
        bytes=sum(part.stat().st_size for part in parts),
        version=about.get("version", ""),
        closed=not end.why,
        end={"path": str(end.part), "byte": end.byte, "why": end.why} if end.why else None,
        duration_s=1e-9 * (tally.last - tally.first),
        messages=sum(one["messages"] for one in tally.topics.values()),
        topics=_shared(tally.topics),
        metadata={name: _short(values) for name, values in tally.metadata.items()},
        nodes=_nodes(about.get("graph", "")),
    )


@dataclass(slots=True)
class _Tally:
    """What has been met so far."""

    topics: dict[str, Topic] = field(default_factory=dict)
    metadata: dict[str, dict[str, str]] = field(default_factory=dict)
    first: int = 0
    last: int = 0
    _schemas: dict[tuple[Path, int], str] = field(default_factory=dict)
    _channels: dict[tuple[Path, int], Topic] = field(default_factory=dict)
    _begun: bool = False

    def take(self, found: Found) -> None:
        part, _, record = found
        match record:
            case Message():
                one = self._channels[part, record.channel_id]
                one["messages"] += 1
                one["bytes"] += len(record.data)
                sent = record.publish_time
                self.first = min(self.first, sent) if self._begun else sent
                self.last = max(self.last, sent)
                self._begun = True
            case Schema():
                self._schemas[part, record.id] = record.name
            case Channel():
                self._channels[part, record.id] = self._topic(part, record)
            case Metadata():
                self.metadata.setdefault(record.name, record.metadata)

    def _topic(self, part: Path, channel: Channel) -> Topic:
        """The topic of a channel, which may have another one for each start of its publisher."""
        return self.topics.setdefault(
            channel.topic,
            Topic(
                topic=channel.topic,
                type=self._schemas[part, channel.schema_id],
                publisher=shown(channel.metadata.get("publisher", "")),
                messages=0,
                bytes=0,
                share=0.0,
            ),
        )


def shown(text: str) -> str:
    """A text out of a file as it can be shown: in one line, without anything that steers."""
    return text if text.isprintable() else repr(text)


def _shared(topics: dict[str, Topic]) -> list[Topic]:
    total = sum(one["bytes"] for one in topics.values())
    found = [one | {"share": one["bytes"] / total if total else 0.0} for one in topics.values()]
    return sorted(found, key=lambda one: one["topic"])


def _short(values: dict[str, str]) -> dict[str, str | int]:
    return {
        shown(name): len(value) if len(value) > LONGEST_VALUE or "\n" in value else shown(value)
        for name, value in values.items()
    }


def _nodes(graph: str) -> list[str]:
    """Names of the nodes; none if the recording does not say."""
    try:
        return [shown(one.name) for one in recorded_wirings(graph.encode())] if graph else []
    except ValueError:
        return []
