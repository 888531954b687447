"""What a recording holds, its longest whole beginning saved anew, and in what two differ.

The stock tool's recover leaves files that cannot be read; here the copy is read again and compared
before it is put in place. Of two recordings digests alone are held.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from hashlib import blake2b
from pathlib import Path
from typing import Any, NamedTuple, TypedDict

from mcap.records import Channel, Message, Metadata

from palpate import __version__
from palpate.launch.files.file_access import check_new, write_new
from palpate.launch.files.source_map import InputError, hint
from palpate.launch.printing import counted, size_text, text_table, titled
from palpate.launch.run_directory import find_bag
from palpate.messages import first_difference, recording
from palpate.messages.types import TYPES
from palpate.nodes.runtime.node import recorded_nodes

DIGEST_BYTES = 16  # So many that no two messages are taken for each other by chance
MessageKey = tuple[int, str, int]  # When it was sent, ns, its topic and its number
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
    metadata: dict[str, dict[str, str | int]]  # By record and name, the value, or how long it is
    nodes: list[str]


def bag_info(bag: Path) -> BagInfo:
    """Go through a recording up to its end or first damage; InputError if nothing can be read."""
    path = find_bag(bag)
    prefix = recording.ReadablePrefix(path)
    topics, metadata, (first, last) = _tallied(prefix)
    end, parts, about = prefix.end, recording.parts_of(path), metadata.get(recording.ABOUT)
    if about is None:
        raise InputError(f"{end.part}: cannot be read as a recording: it {end.why}")
    total = sum(one["bytes"] for one in topics.values())
    for one in topics.values():
        one["share"] = one["bytes"] / total if total else 0.0
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
        duration_s=1e-9 * (last - first),
        messages=sum(one["messages"] for one in topics.values()),
        topics=sorted(topics.values(), key=lambda one: one["topic"]),
        metadata={name: _short(values) for name, values in metadata.items()},
        nodes=_nodes(about.get("graph", "")),
    )


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


def _tallied(
    records: Iterable[recording.LocatedRecord],
) -> tuple[dict[str, BagTopic], dict[str, dict[str, str]], tuple[int, int]]:
    """Topics and metadata by name, and when the first message and the last were sent, ns."""
    topics: dict[str, BagTopic] = {}
    metadata: dict[str, dict[str, str]] = {}
    span: tuple[int, int] | None = None
    for record, channel, schema in ((one.record, one.channel, one.schema) for one in records):
        if isinstance(record, Message):
            assert channel is not None
            topics[channel.topic]["messages"] += 1
            topics[channel.topic]["bytes"] += len(record.data)
            first, last = span or (record.publish_time, 0)
            span = min(first, record.publish_time), max(last, record.publish_time)
        elif isinstance(record, Channel):
            assert schema is not None
            # A topic may have another one for each start of its publisher.
            publisher = printable(record.metadata.get("publisher", ""))
            about = BagTopic(
                topic=record.topic,
                type=schema.name,
                publisher=publisher,
                messages=0,
                bytes=0,
                share=0.0,
            )
            topics.setdefault(record.topic, about)
        elif isinstance(record, Metadata):
            metadata.setdefault(record.name, record.metadata)
    return topics, metadata, span or (0, 0)


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
    closed, end = "yes", info["end"]
    if end is not None:
        name = Path(end["path"]).name
        was = {part["path"]: part["closed"] for part in info["parts"]}[end["path"]]
        word = "yes, but" if was else "no:"
        closed = f"{word} {name} {end['why']}; {end['byte']} bytes of it are whole"
    for title, text in (
        ("version", info["version"] or "not known"),
        ("closed", closed),
        ("duration", f"{info['duration_s']:.3f} s"),
        ("messages", str(info["messages"])),
        ("nodes", ", ".join(info["nodes"]) or "not known"),
    ):
        lines += titled(title, text)
    for name, values in info["metadata"].items():
        if name == recording.MISSING:
            values = {topic: lacks for topic, lacks in values.items() if lacks != "0"}
        lines += titled("metadata", f"{name}: {_entries(values)}")
    rows = [("topic", "type", "publisher", "messages", "bytes", "share")]
    for one in info["topics"]:
        size, share = size_text(one["bytes"]), f"{100.0 * one['share']:.1f} %"
        counts = str(one["messages"]), size, share
        rows.append((one["topic"], one["type"], one["publisher"], *counts))
    return "\n".join([*lines, "", *text_table(rows, right=(3, 4, 5))])


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


class Recovered(NamedTuple):
    """What was saved."""

    path: Path  # The new recording
    parts: tuple[Path, ...]  # The files that it was made of
    counts: dict[str, int]  # Messages by topic
    end: recording.RecordingEnd  # Where the whole records end

    def figures(self) -> dict[str, Any]:
        """The same, ready for JSON."""
        part, byte, why = self.end
        return {
            "path": str(self.path),
            "parts": [str(one) for one in self.parts],
            "messages": self.counts,
            "end": {"path": str(part), "byte": byte, "why": why},
        }


def recover_recording(bag: Path, out: Path | None = None) -> Recovered:
    """Write all that is whole of a recording into a new file, or into ``NAME.recovered.mcap``.

    Raises InputError if nothing can be saved, or the new file exists or cannot be written.
    """
    source = find_bag(bag)
    target = out or source.with_name(f"{source.stem}.{RECOVERED_RECORD}{source.suffix}")
    check_new(target)
    further = recording.part_path(target, 1)
    if further.exists():
        raise InputError(f"{further}: would be taken for a part of {target}; take it away")
    saved: list[Recovered] = []
    write_new(target, lambda part: saved.append(_copy(source, part)))
    return saved[0]._replace(path=target)


def _copy(source: Path, target: Path) -> Recovered:
    prefix, parts = recording.ReadablePrefix(source), recording.parts_of(source)
    copy = recording.RecordingCopy(target, f"palpate {__version__}")
    try:
        copy.take(prefix)
        part, byte, why = prefix.end
        if not copy.counts:
            ends = f"its end: it {why}" if why else "its end"
            raise InputError(f"{part}: nothing can be recovered: no message comes before {ends}")
        names = " ".join(printable(one.name) for one in parts)
        about = {"from": names, "to": f"{printable(part.name)}, byte {byte}"}
        copy.close(RECOVERED_RECORD, about | {"why": why})
    finally:
        copy.give_up()
    copy.check()
    return Recovered(target, parts, dict(copy.counts), prefix.end)


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


@dataclass(slots=True)
class TopicDiff:
    """The messages of one topic, counted."""

    compared: int = 0  # Messages that are in both recordings
    differ: int = 0  # Messages of them that differ
    only_a: int = 0  # Messages that the second recording lacks
    only_b: int = 0  # Messages that the first recording lacks

    @property
    def identical(self) -> bool:
        """Whether both recordings have the same of this topic."""
        return not (self.differ or self.only_a or self.only_b)


@dataclass(frozen=True, slots=True)
class RecordingDiff:
    """How two recordings compare."""

    topics: dict[str, TopicDiff]  # By topic, in the order of their names
    first: str  # The first message that differs, in words; empty if none does
    unfinished: tuple[Path, ...]  # Recordings of the two that were never closed

    def figures(self) -> dict[str, Any]:
        """The same, ready for JSON."""
        return asdict(self) | {"unfinished": [str(path) for path in self.unfinished]}


def compare_recordings(a: Path, b: Path, topics: Sequence[str] = ()) -> RecordingDiff:
    """Compare two recordings by topic and sequence; all topics if none is named.

    Neither runs, restarts and times matter, nor in which order messages of different topics came.
    Raises ValueError if one cannot be read or is out of order, or neither has one of the topics.
    """
    both = recording.open_recording(find_bag(a)), recording.open_recording(find_bag(b))
    known = {*both[0].counts, *both[1].counts}
    for topic in topics:
        if topic not in known:
            raise ValueError(f"neither recording has a topic {topic!r}; {hint(topic, known)}")
    counts = {topic: TopicDiff() for topic in sorted(topics or known)}
    first = _count(*both, counts)
    unfinished = tuple(one.path for one in both if not one.closed)
    return RecordingDiff(counts, _difference_text(first, *both) if first else "", unfinished)


def _count(
    a: recording.Recording, b: recording.Recording, counts: dict[str, TopicDiff]
) -> MessageKey | None:
    """Count what differs, and find the first of it: in `a`, or else what only `b` has."""
    of_b = {(one.topic, one.seq): (one.sent_ns, _digest(one)) for one in _messages(b, counts)}
    first: MessageKey | None = None
    for kept in _messages(a, counts):
        count = counts[kept.topic]
        _, digest = of_b.pop((kept.topic, kept.seq), (0, b""))
        count.compared += bool(digest)
        count.only_a += not digest
        if digest == _digest(kept):
            continue
        count.differ += bool(digest)
        place = (kept.sent_ns, kept.topic, kept.seq)
        first = min(first, place) if first else place
    for topic, _ in of_b:
        counts[topic].only_b += 1
    rest = ((sent_ns, topic, seq) for (topic, seq), (sent_ns, _) in of_b.items())
    return first or min(rest, default=None)


def _digest(kept: recording.RecordedMessage) -> bytes:
    """Digest of what a message says, and of which type it is."""
    made = blake2b(f"{kept.type} {kept.schema} ".encode(), digest_size=DIGEST_BYTES)
    made.update(kept.body)
    return made.digest()


def _messages(
    bag: recording.Recording, topics: Collection[str]
) -> Iterator[recording.RecordedMessage]:
    """Messages of these topics, each topic in its order."""
    after: dict[str, int] = {}
    for kept in bag.messages():
        if kept.topic not in topics:
            continue
        if kept.seq < after.get(kept.topic, 0):
            last = after[kept.topic] - 1
            raise ValueError(
                f"recording {bag.path} is out of order: {kept.topic} {kept.seq} after {last}"
            )
        after[kept.topic] = kept.seq + 1
        yield kept


def _difference_text(place: MessageKey, a: recording.Recording, b: recording.Recording) -> str:
    """A message that differs, in words."""
    _, topic, seq = place
    one, other = (
        next((kept for kept in all_of.messages() if (kept.topic, kept.seq) == (topic, seq)), None)
        for all_of in (a, b)
    )
    if one is None or other is None:
        return f"{topic} {seq}: only in {'A' if one else 'B'}"
    found: tuple[str, str, str] | None = None  # Field and both values, or what the messages are
    if one.type != other.type:
        found = "type", one.type, other.type
    elif one.schema != other.schema:
        found = "schema", f"{one.schema:08x}", f"{other.schema:08x}"
    else:
        with suppress(ValueError):  # of another version
            cls = TYPES.get(one.type) or a.type_of(one.topic, one.schema)
            found = first_difference(cls, one.body, other.body)
    field, was, now = found or ("bytes", *(f"{len(kept.body)} bytes" for kept in (one, other)))
    return f"{topic} {seq} {field}: {was} in A, {now} in B"


def diff_text(diff: RecordingDiff) -> str:
    """The first difference, and a line for each topic that differs."""
    lines = [f"{path} was never closed: comparing as far as it goes" for path in diff.unfinished]
    topics = counted(len(diff.topics), "topic")
    if not diff.first:
        count = sum(one.compared for one in diff.topics.values())
        return "\n".join([*lines, f"identical, {counted(count, 'message')} on {topics}"])
    rows: list[tuple[str, ...]] = [("topic", "compared", "differ", "only in A", "only in B")]
    for topic, one in diff.topics.items():
        if not one.identical:
            counts = (one.compared, one.differ, one.only_a, one.only_b)
            rows.append((topic, *map(str, counts)))
    same = sum(one.identical for one in diff.topics.values())
    lines += [f"first difference: {diff.first}", *text_table(rows, right=range(1, 5))]
    return "\n".join([*lines, f"identical on {same} of {topics}"])
