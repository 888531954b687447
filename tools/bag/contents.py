"""What a recording holds, and its longest whole beginning saved as a new one.

The stock tool's recover leaves files that cannot be read; here the copy is read again and compared
before it is put in place.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple, TypedDict

from mcap.records import Channel, Message, Metadata, Schema

from palpate import __version__
from palpate.launch import find_bag, size_text, text_table, titled
from palpate.launch.files import InputError, check_new, write_new
from palpate.messages.recording import (
    ABOUT,
    MISSING,
    LocatedRecord,
    ReadablePrefix,
    RecordingCopy,
    RecordingEnd,
    part_path,
    parts_of,
)
from palpate.nodes.runtime import recorded_nodes

MAX_VALUE_LENGTH = 60  # Characters of a value that is shown whole
FEW = 12  # Entries of a metadata record that are named one by one
RECOVERED_RECORD = "recovered"  # Name of the metadata record that says where a copy comes from


class BagTopic(TypedDict):
    """One topic of a recording."""

    topic: str
    type: str
    publisher: str
    messages: int
    bytes: int  # Of the messages, unpacked
    share: float  # Of the bytes of all messages


class BagInfo(TypedDict):
    """What a recording holds."""

    path: str
    parts: list[dict[str, Any]]  # Of each file its path, its bytes, and whether it was closed
    bytes: int
    version: str  # Version of palpate that wrote it
    closed: bool
    end: dict[str, Any] | None  # Where and why it ends before it was closed: file, byte, reason
    duration_s: float  # From the first message to the last, by the time at which they were sent
    messages: int
    topics: list[BagTopic]
    # By record and name, the value, or the number of its characters if it is long.
    metadata: dict[str, dict[str, str | int]]
    nodes: list[str]


def bag_info(bag: Path) -> BagInfo:
    """Go through a recording, up to its end or its first damage.

    `bag`: a recording, or a run directory. Raises InputError if there is none, or nothing of it can
    be read.
    """
    path = find_bag(bag)
    prefix, tally = ReadablePrefix(path), _Tally()
    for found in prefix:
        tally.take(found)
    about = tally.metadata.get(ABOUT)
    if about is None:
        raise InputError(f"{prefix.end.part}: cannot be read as a recording: it {prefix.end.why}")
    end, parts = prefix.end, parts_of(path)
    return BagInfo(
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
        topics=_with_shares(tally.topics),
        metadata={name: _short(values) for name, values in tally.metadata.items()},
        nodes=_nodes(about.get("graph", "")),
    )


def _with_shares(topics: dict[str, BagTopic]) -> list[BagTopic]:
    total = sum(one["bytes"] for one in topics.values())
    found = [one | {"share": one["bytes"] / total if total else 0.0} for one in topics.values()]
    return sorted(found, key=lambda one: one["topic"])


def _short(values: dict[str, str]) -> dict[str, str | int]:
    return {
        printable(name): len(value)
        if len(value) > MAX_VALUE_LENGTH or "\n" in value
        else printable(value)
        for name, value in values.items()
    }


def _nodes(graph: str) -> list[str]:
    """Names of the nodes; none if the recording does not say."""
    try:
        return [printable(one.name) for one in recorded_nodes(graph.encode())] if graph else []
    except ValueError:
        return []


@dataclass(slots=True)
class _Tally:
    """What has been met so far."""

    topics: dict[str, BagTopic] = field(default_factory=dict)
    metadata: dict[str, dict[str, str]] = field(default_factory=dict)
    first: int = 0
    last: int = 0
    _schemas: dict[tuple[Path, int], str] = field(default_factory=dict)
    _channels: dict[tuple[Path, int], BagTopic] = field(default_factory=dict)
    _begun: bool = False

    def take(self, found: LocatedRecord) -> None:
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

    def _topic(self, part: Path, channel: Channel) -> BagTopic:
        """The topic of a channel, which may have another one for each start of its publisher."""
        return self.topics.setdefault(
            channel.topic,
            BagTopic(
                topic=channel.topic,
                type=self._schemas[part, channel.schema_id],
                publisher=printable(channel.metadata.get("publisher", "")),
                messages=0,
                bytes=0,
                share=0.0,
            ),
        )


def printable(text: str) -> str:
    """A text out of a file as it can be shown: in one line, without anything that steers."""
    return text if text.isprintable() else repr(text)


def info_text(info: BagInfo) -> str:
    """All that is known of a recording, and a table of its topics."""
    parts = [
        f"{part['path']}, {size_text(part['bytes'])}{'' if part['closed'] else ', not closed'}"
        for part in info["parts"]
    ]
    lines = [f"{'' if number else 'recording':<11}{part}" for number, part in enumerate(parts)]
    for title, text in (
        ("version", info["version"] or "not known"),
        ("closed", _closed_text(info)),
        ("duration", f"{info['duration_s']:.3f} s"),
        ("messages", str(info["messages"])),
        ("nodes", ", ".join(info["nodes"]) or "not known"),
    ):
        lines += titled(title, text)
    for name, values in info["metadata"].items():
        if name == MISSING:
            values = {topic: lacks for topic, lacks in values.items() if lacks != "0"}
        lines += titled("metadata", f"{name}: {_entries(values)}")
    return "\n".join([*lines, "", *_topic_table(info["topics"])])


def _closed_text(info: BagInfo) -> str:
    end = info["end"]
    if end is None:
        return "yes"
    name = Path(end["path"]).name
    return f"no: {name} {end['why']}; {end['byte']} bytes of it are whole"


def _entries(values: dict[str, str | int]) -> str:
    if len(values) > FEW:
        return f"{len(values)} entries"
    return (
        ", ".join(
            f"{name} of {value} characters" if isinstance(value, int) else f"{name} {value}"
            for name, value in values.items()
        )
        or "none"
    )


def _topic_table(topics: Sequence[BagTopic]) -> list[str]:
    rows = [("topic", "type", "publisher", "messages", "bytes", "share")]
    for one in topics:
        size, share = size_text(one["bytes"]), f"{100.0 * one['share']:.1f} %"
        rows.append(
            (one["topic"], one["type"], one["publisher"], str(one["messages"]), size, share)
        )
    return text_table(rows, right=(3, 4, 5))


class Recovered(NamedTuple):
    """What was saved."""

    path: Path  # The new recording
    parts: tuple[Path, ...]  # The files that it was made of
    counts: dict[str, int]  # Messages by topic
    end: RecordingEnd  # Where the whole records end


def recover_recording(bag: Path, out: Path | None = None) -> Recovered:
    """Write all that is whole of a recording, from its beginning on, into one new file.

    `bag`: a recording, or a run directory; `out`: the new file; ``NAME.recovered.mcap`` beside the
    recording if left out. Raises InputError if nothing can be saved, or the new file exists or
    cannot be written.
    """
    source = find_bag(bag)
    target = out or source.with_name(f"{source.stem}.{RECOVERED_RECORD}{source.suffix}")
    check_new(target)
    further = part_path(target, 1)
    if further.exists():
        raise InputError(f"{further}: would be taken for a part of {target}; take it away")
    saved: list[Recovered] = []
    write_new(target, lambda part: saved.append(_copy(source, part)))
    return saved[0]._replace(path=target)


def _copy(source: Path, target: Path) -> Recovered:
    prefix, parts = ReadablePrefix(source), parts_of(source)
    copy = RecordingCopy(target, f"palpate {__version__}")
    try:
        copy.take(prefix)
        part, byte, why = prefix.end
        if not copy.counts:
            raise InputError(
                f"{part}: nothing can be recovered: no message comes before {_end_text(why)}"
            )
        about = {"from": " ".join(one.name for one in parts), "to": f"{part.name}, byte {byte}"}
        copy.close(RECOVERED_RECORD, about | {"why": why})
    finally:
        copy.give_up()
    copy.check()
    return Recovered(target, parts, dict(copy.counts), prefix.end)


def _end_text(why: str) -> str:
    return f"its end: it {why}" if why else "its end"


def recovered_text(saved: Recovered) -> str:
    """What was saved, and what was not, in a line for each."""
    part, byte, why = saved.end
    if not why:
        what = "all that there was"
    elif byte == part.stat().st_size:
        what = f"all that there is in {part.name}, which {why}"
    else:
        what = f"up to byte {byte} of {part.name}, which {why}"
    of = f", of {len(saved.parts)} files" if len(saved.parts) > 1 else ""
    return (
        f"{saved.path}: {sum(saved.counts.values())} messages on {len(saved.counts)} topics{of}; "
        f"that is {what}"
    )
