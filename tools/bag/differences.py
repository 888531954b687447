"""Two recordings side by side: the first message that differs, and how many do.

Only digests of the messages are held, and in the end the two that differ first.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from hashlib import blake2b
from pathlib import Path
from typing import NamedTuple

from palpate.launch import counted, find_bag, text_table
from palpate.launch.files import hint
from palpate.messages import first_difference
from palpate.messages.recording import RecordedMessage, Recording, open_recording
from palpate.messages.types import TYPES

DIGEST_BYTES = 16  # So many that no two messages are taken for each other by chance


class MessageKey(NamedTuple):
    """Where a message stands: first by time, then by topic."""

    sent_ns: int
    topic: str
    seq: int


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


def compare_recordings(a: Path, b: Path, topics: Sequence[str] = ()) -> RecordingDiff:
    """Compare two recordings by topic and sequence.

    Neither runs, restarts and times matter, nor in which order messages of different topics came.
    `a`, `b`: recordings, or the folders of their runs; `topics`: topics to compare; all if empty.
    Raises ValueError if one of them cannot be read or is out of order, or neither has one of the
    topics.
    """
    both = open_recording(find_bag(a)), open_recording(find_bag(b))
    known = {*both[0].counts, *both[1].counts}
    for topic in topics:
        if topic not in known:
            raise ValueError(f"neither recording has a topic {topic!r}; {hint(topic, known)}")
    counts = {topic: TopicDiff() for topic in sorted(topics or known)}
    first = _count(*both, counts)
    unfinished = tuple(recording.path for recording in both if not recording.closed)
    return RecordingDiff(counts, _difference_text(first, *both) if first else "", unfinished)


def _count(a: Recording, b: Recording, counts: dict[str, TopicDiff]) -> MessageKey | None:
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
        place = MessageKey(kept.sent_ns, kept.topic, kept.seq)
        first = min(first, place) if first else place
    for topic, _ in of_b:
        counts[topic].only_b += 1
    rest = (MessageKey(sent_ns, topic, seq) for (topic, seq), (sent_ns, _) in of_b.items())
    return first or min(rest, default=None)


def _digest(kept: RecordedMessage) -> bytes:
    """Digest of what a message says, and of which type it is."""
    made = blake2b(f"{kept.type} {kept.schema} ".encode(), digest_size=DIGEST_BYTES)
    made.update(kept.body)
    return made.digest()


def _messages(recording: Recording, topics: Collection[str]) -> Iterator[RecordedMessage]:
    """Messages of these topics, each topic in its order."""
    after: dict[str, int] = {}
    for kept in recording.messages():
        if kept.topic not in topics:
            continue
        if kept.seq < after.get(kept.topic, 0):
            last = after[kept.topic] - 1
            raise ValueError(
                f"recording {recording.path} is out of order: {kept.topic} {kept.seq} after {last}"
            )
        after[kept.topic] = kept.seq + 1
        yield kept


def _difference_text(place: MessageKey, a: Recording, b: Recording) -> str:
    """A message that differs, in words."""
    found = [_find(recording, place) for recording in (a, b)]
    where = f"{place.topic} {place.seq}"
    one, other = found
    if one is None or other is None:
        return f"{where}: only in {'A' if one else 'B'}"
    field, value_a, value_b = _differing_field(one, other)
    return f"{where} {field}: {value_a} in A, {value_b} in B"


def _find(recording: Recording, place: MessageKey) -> RecordedMessage | None:
    wanted = (place.topic, place.seq)
    return next((one for one in recording.messages() if (one.topic, one.seq) == wanted), None)


def _differing_field(one: RecordedMessage, other: RecordedMessage) -> tuple[str, str, str]:
    """Field and both values; what the messages are, if they are not of one type."""
    if one.type != other.type:
        return "type", one.type, other.type
    if one.schema != other.schema:
        return "schema", f"{one.schema:08x}", f"{other.schema:08x}"
    cls = TYPES.get(one.type)
    found = first_difference(cls, one.body, other.body) if cls else None
    return found or ("bytes", f"{len(one.body)} bytes", f"{len(other.body)} bytes")


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
