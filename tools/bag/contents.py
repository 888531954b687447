"""Contents of a recording, recovery of its intact beginning, and differences of two recordings.

The recover command of mcap leaves files that cannot be read; here the copy is read again and
compared before it is put in place. Two recordings are compared by digests, to save memory.
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

MessageKey = tuple[int, str, int]  # time of sending [ns], topic and sequence number
RECOVERED_RECORD = "recovered"  # name of the metadata record about the source of a copy


class BagTopic(TypedDict):
    """One topic of a recording."""

    topic: str
    type: str
    publisher: str
    messages: int
    bytes: int  # of the messages, uncompressed
    share: float  # of the bytes of all messages


class BagInfo(TypedDict):
    """Contents of a recording."""

    path: str
    parts: list[dict[str, Any]]  # path and bytes of each file, and whether it was closed
    bytes: int
    version: str  # of palpate, that wrote it
    closed: bool
    end: dict[str, Any] | None  # file, byte and reason, if it ends before it was closed
    duration_s: float  # between sending the first message and the last
    messages: int
    topics: list[BagTopic]
    metadata: dict[str, dict[str, str | int]]  # by record and name: the value, or its length
    nodes: list[str]


def bag_info(bag: Path) -> BagInfo:
    """Read a recording up to its end or first damage.

    Raises InputError if nothing can be read.
    """
    path = find_bag(bag)
    prefix = recording.ReadablePrefix(path)
    topics, metadata, (first, last) = _tallied(prefix)
    end, parts, about = prefix.end, recording.parts_of(path), metadata.get(recording.ABOUT)
    if about is None:
        raise InputError(f"{end.part}: cannot be read as a recording: it {end.why}")
    total = sum(topic["bytes"] for topic in topics.values())
    for topic in topics.values():
        topic["share"] = topic["bytes"] / total if total else 0.0
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
        messages=sum(topic["messages"] for topic in topics.values()),
        topics=sorted(topics.values(), key=lambda topic: topic["topic"]),
        metadata={name: _short(values) for name, values in metadata.items()},
        nodes=_nodes(about.get("graph", "")),
    )


def _short(values: dict[str, str], max_length: int = 60) -> dict[str, str | int]:
    """Values by name; the length of a value that is long or has several lines."""
    return {
        printable(name): len(value)
        if len(value) > max_length or "\n" in value
        else printable(value)
        for name, value in values.items()
    }


def _nodes(graph: str) -> list[str]:
    """Names of the nodes; empty if the recording has no graph."""
    try:
        return [printable(node.name) for node in recorded_nodes(graph.encode())] if graph else []
    except ValueError:
        return []


def _tallied(
    records: Iterable[recording.LocatedRecord],
) -> tuple[dict[str, BagTopic], dict[str, dict[str, str]], tuple[int, int]]:
    """Topics and metadata by name, and times of sending of the first and last message [ns]."""
    topics: dict[str, BagTopic] = {}
    metadata: dict[str, dict[str, str]] = {}
    span: tuple[int, int] | None = None
    for record, channel, schema in ((some.record, some.channel, some.schema) for some in records):
        if isinstance(record, Message):
            assert channel is not None
            topics[channel.topic]["messages"] += 1
            topics[channel.topic]["bytes"] += len(record.data)
            first, last = span or (record.publish_time, 0)
            span = min(first, record.publish_time), max(last, record.publish_time)
        elif isinstance(record, Channel):
            assert schema is not None
            # A topic has a channel for each start of its publisher.
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
    """A text from a file as one line without control characters."""
    return text if text.isprintable() else repr(text)


def info_text(info: BagInfo) -> str:
    """Lines about a recording, and a table of its topics."""
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
    for topic in info["topics"]:
        size, share = size_text(topic["bytes"]), f"{100.0 * topic['share']:.1f} %"
        counts = str(topic["messages"]), size, share
        rows.append((topic["topic"], topic["type"], topic["publisher"], *counts))
    return "\n".join([*lines, "", *text_table(rows, right=(3, 4, 5))])


def _entries(values: dict[str, str | int], max_named: int = 12) -> str:
    if len(values) > max_named:
        return f"{len(values)} entries"
    return (
        ", ".join(
            f"{name} of {value} characters" if isinstance(value, int) else f"{name} {value}"
            for name, value in values.items()
        )
        or "none"
    )


class Recovered(NamedTuple):
    """A recovered recording."""

    path: Path  # of the new recording
    parts: tuple[Path, ...]  # files that it was made of
    counts: dict[str, int]  # messages by topic
    end: recording.RecordingEnd  # of the intact records

    def figures(self) -> dict[str, Any]:
        """The fields as JSON values."""
        part, byte, why = self.end
        return {
            "path": str(self.path),
            "parts": [*map(str, self.parts)],
            "messages": self.counts,
            "end": {"path": str(part), "byte": byte, "why": why},
        }


def recover_recording(bag: Path, out: Path | None = None) -> Recovered:
    """Copy the intact beginning of a recording into a file, by default ``NAME.recovered.mcap``.

    Raises InputError if nothing is intact, or the new file exists or cannot be written.
    """
    source = find_bag(bag)
    target = out or source.with_name(f"{source.stem}.{RECOVERED_RECORD}{source.suffix}")
    check_new(target)
    further = recording.part_path(target, 1)
    if further.exists():
        raise InputError(f"{further}: would be taken for a part of {target}; move it away")
    copies: list[Recovered] = []
    write_new(target, lambda part: copies.append(_copy(source, part)))
    return copies[0]._replace(path=target)


def _copy(source: Path, target: Path) -> Recovered:
    prefix, parts = recording.ReadablePrefix(source), recording.parts_of(source)
    copy = recording.RecordingCopy(target, f"palpate {__version__}")
    try:
        copy.take(prefix)
        part, byte, why = prefix.end
        if not copy.counts:
            ends = f"its end: it {why}" if why else "its end"
            raise InputError(f"{part}: nothing can be recovered: no message comes before {ends}")
        names = " ".join(printable(some.name) for some in parts)
        about = {"from": names, "to": f"{printable(part.name)}, byte {byte}"}
        copy.close(RECOVERED_RECORD, about | {"why": why})
    finally:
        copy.give_up()
    copy.check()
    return Recovered(target, parts, dict(copy.counts), prefix.end)


def recovered_text(recovered: Recovered) -> str:
    """A line about a recovered recording, and the part of the source that it has."""
    path, parts, counts, (part, byte, why) = recovered
    if not why:
        extent = "all that there was"
    elif byte == part.stat().st_size:
        extent = f"all that there is in {part.name}, which {why}"
    else:
        extent = f"up to byte {byte} of {part.name}, which {why}"
    of = f", of {len(parts)} files" if len(parts) > 1 else ""
    return f"{path}: {sum(counts.values())} messages on {len(counts)} topics{of}; that is {extent}"


@dataclass(slots=True)
class TopicDiff:
    """Counts of the messages of one topic in two recordings."""

    compared: int = 0  # in both
    differ: int = 0  # in both, with different contents
    only_a: int = 0
    only_b: int = 0

    @property
    def identical(self) -> bool:
        """Whether both recordings have the same messages of this topic."""
        return not (self.differ or self.only_a or self.only_b)


@dataclass(frozen=True, slots=True)
class RecordingDiff:
    """Differences of two recordings."""

    topics: dict[str, TopicDiff]  # by topic, sorted by name
    first: str  # the first message that differs, in words; empty if none does
    unfinished: tuple[Path, ...]  # those of the two that were never closed

    def figures(self) -> dict[str, Any]:
        """The fields as JSON values."""
        return asdict(self) | {"unfinished": [str(path) for path in self.unfinished]}


def compare_recordings(a: Path, b: Path, topics: Sequence[str] = ()) -> RecordingDiff:
    """Compare two recordings by topic and sequence number; all topics if none is named.

    Differences in run, restarts, times, and order between topics are ignored. Raises ValueError if
    a recording cannot be read or is out of order, or neither has one of the topics.
    """
    both = recording.open_recording(find_bag(a)), recording.open_recording(find_bag(b))
    known = {*both[0].counts, *both[1].counts}
    for topic in topics:
        if topic not in known:
            raise ValueError(f"neither recording has a topic {topic!r}; {hint(topic, known)}")
    counts = {topic: TopicDiff() for topic in sorted(topics or known)}
    first = _count(*both, counts)
    unfinished = tuple(bag.path for bag in both if not bag.closed)
    return RecordingDiff(counts, _difference_text(first, *both) if first else "", unfinished)


def _count(
    a: recording.Recording, b: recording.Recording, counts: dict[str, TopicDiff]
) -> MessageKey | None:
    """Count differences, and return the first: in `a`, or else the first that only `b` has."""
    of_b = {(kept.topic, kept.seq): (kept.sent_ns, _digest(kept)) for kept in _messages(b, counts)}
    first: MessageKey | None = None
    for kept in _messages(a, counts):
        count = counts[kept.topic]
        _, digest = of_b.pop((kept.topic, kept.seq), (0, b""))
        count.compared += bool(digest)
        count.only_a += not digest
        if digest == _digest(kept):
            continue
        count.differ += bool(digest)
        key = (kept.sent_ns, kept.topic, kept.seq)
        first = min(first, key) if first else key
    for topic, _ in of_b:
        counts[topic].only_b += 1
    rest = ((sent_ns, topic, seq) for (topic, seq), (sent_ns, _) in of_b.items())
    return first or min(rest, default=None)


def _digest(kept: recording.RecordedMessage, size: int = 16) -> bytes:
    """Digest of the content and the type of a message, long enough to be unique."""
    digest = blake2b(f"{kept.type} {kept.schema} ".encode(), digest_size=size)
    digest.update(kept.body)
    return digest.digest()


def _messages(
    bag: recording.Recording, topics: Collection[str]
) -> Iterator[recording.RecordedMessage]:
    """Messages of some topics; raises ValueError if a topic is out of order."""
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


def _difference_text(key: MessageKey, a: recording.Recording, b: recording.Recording) -> str:
    """The difference of a message, in words."""
    _, topic, seq = key
    in_a, in_b = (
        next((kept for kept in all_of.messages() if (kept.topic, kept.seq) == (topic, seq)), None)
        for all_of in (a, b)
    )
    if in_a is None or in_b is None:
        return f"{topic} {seq}: only in {'A' if in_a else 'B'}"
    difference: tuple[str, str, str] | None = None  # field, or property of messages, and values
    if in_a.type != in_b.type:
        difference = "type", in_a.type, in_b.type
    elif in_a.schema != in_b.schema:
        difference = "schema", f"{in_a.schema:08x}", f"{in_b.schema:08x}"
    else:
        with suppress(ValueError):  # of another version
            cls = TYPES.get(in_a.type) or a.type_of(in_a.topic, in_a.schema)
            difference = first_difference(cls, in_a.body, in_b.body)
    lengths = "bytes", f"{len(in_a.body)} bytes", f"{len(in_b.body)} bytes"
    field, value_a, value_b = difference or lengths
    return f"{topic} {seq} {field}: {value_a} in A, {value_b} in B"


def diff_text(diff: RecordingDiff) -> str:
    """The first difference, and a line for each topic that differs."""
    lines = [f"{path} was never closed: compared up to its end" for path in diff.unfinished]
    topics = counted(len(diff.topics), "topic")
    if not diff.first:
        count = sum(topic.compared for topic in diff.topics.values())
        return "\n".join([*lines, f"identical, {counted(count, 'message')} on {topics}"])
    rows: list[tuple[str, ...]] = [("topic", "compared", "differ", "only in A", "only in B")]
    for name, topic in diff.topics.items():
        if not topic.identical:
            counts = (topic.compared, topic.differ, topic.only_a, topic.only_b)
            rows.append((name, *map(str, counts)))
    same = sum(topic.identical for topic in diff.topics.values())
    lines += [f"first difference: {diff.first}", *text_table(rows, right=range(1, 5))]
    return "\n".join([*lines, f"identical on {same} of {topics}"])
