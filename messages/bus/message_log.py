"""Published and consumed messages of a node, from which a node that was killed is restored.

Frames are held in memory up to a limit, and beyond it in a file. Frames that take long to make are
written at once, so that they are not made again. Frames of persistent nodes, which cannot be made
again because they come from the world, are written together with the message that they answer:
all answers to one message are in the file, or none. The journal has one entry for each message,
written before the message is handled. Messages that are published again after a death keep their
first send times, so that effects stay later than causes. The process may die at any moment: data
that the system has accepted is not lost.
"""

from __future__ import annotations

import errno
import mmap
import os
import struct
from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import takewhile
from pathlib import Path
from typing import NamedTuple, cast

from palpate.messages.codec import Header, pack_frame, split_frame

# A frame in memory; its place in the file, as (start << 32 | length) in one number, which saves
# memory; or a function that makes it.
StoredFrame = bytes | int | Callable[[], bytes]
_LENGTH = struct.Struct("<I")
_WORD = 8  # [bytes] of a word of the journal; an entry has two words
_PROGRESS = struct.Struct("<QB")
_UNKNOWN = 255  # whether a source is paused
_FLAGS = os.O_RDWR | os.O_CREAT | os.O_CLOEXEC  # a missing file is made


class Cause(NamedTuple):
    """A message that a persistent node has answered."""

    publisher: str
    topic: str
    seq: int
    finished: str = ""  # why the node has finished with the answer, if it has


class MessageLog:
    """The published messages of a node.

    Frames beyond `max_memory` [bytes] are written to the file, at least `write_size` [bytes] at
    once. Raises OSError if the file cannot be read or written.
    """

    def __init__(
        self,
        path: Path,  # of the file, which is made when it is needed
        topics: Iterable[str],  # with subscribers
        *,
        silent: Iterable[str] = (),  # topics without subscribers, whose messages are only counted
        max_memory: int = 1 << 20,
        write_size: int = 1 << 16,
        # Whether all frames are also written, and those of an earlier start are continued.
        persistent: bool = False,
        epoch: int = 0,  # number of earlier starts of the node
    ) -> None:
        self._path, self._persistent, self._epoch = path, persistent, epoch
        self._room, self._write_size = max_memory, write_size  # memory that is left [bytes]
        self._frames: dict[str, list[StoredFrame]] = {topic: [] for topic in topics}
        self._silent = dict.fromkeys(silent, 0)
        self._waiting: list[tuple[str, int]] = []  # to be written together
        self._file: int | None = None
        self._end = 0
        # Places of frames of an earlier start by topic and sequence.
        self._written: dict[tuple[str, int], int] = {}
        # Numbers of messages that an earlier start has answered, by publisher and topic.
        self.handled: dict[tuple[str, str], int] = {}
        self.finished = ""  # why an earlier start has finished, if it has
        self.latest_ns = 0  # latest time in messages of an earlier start [ns]
        if persistent or (epoch and path.exists()):
            self._read_earlier()

    @property
    def counts(self) -> dict[str, int]:
        """Numbers of messages by topic."""
        return {topic: len(frames) for topic, frames in self._frames.items()} | self._silent

    def count(self, topic: str) -> int:
        """Number of messages on a topic. Raises KeyError if there is no such topic."""
        return self._silent[topic] if topic in self._silent else len(self._frames[topic])

    def add(self, topic: str, frame: bytes, *, outlives: bool = False) -> None:
        """Keep a frame before it is sent; a frame that `outlives` this start is also written.

        Raises KeyError if there is no such topic; OSError if the file cannot be written.
        """
        place = self._written.get((topic, self.count(topic))) if self._written else None
        if place is None and (self._persistent or (outlives and topic not in self._silent)):
            (place,) = self._write((frame,))
        if place is not None and len(frame) > self._room:
            self._append(topic, place)
            return
        self._append(topic, frame)
        if self._room < 0 and topic not in self._silent:
            self._waiting.append((topic, len(self._frames[topic]) - 1))
            if self._room <= -self._write_size:
                self._make_room()

    def answer(self, frames: Sequence[tuple[str, bytes]], cause: Cause) -> None:
        """Keep all answers to a message, with the message, before they are sent.

        Raises KeyError if there is no such topic; OSError if the file cannot be written.
        """
        places = self._write([frame for _, frame in frames], cause)
        for (topic, frame), place in zip(frames, places, strict=True):
            self._append(topic, frame if len(frame) <= self._room else place)

    def promise(self, topic: str, make: Callable[[], bytes]) -> None:
        """Keep a function that makes a frame which an earlier start has sent.

        It is called only if the frame is not in the file and a subscriber lacks it. Raises KeyError
        if there is no such topic.
        """
        self._append(topic, self._written.get((topic, self.count(topic)), make))

    def since(self, topic: str, wanted: int) -> Iterator[bytes]:
        """Frames of a topic from a sequence on; none for a topic without subscribers."""
        for seq in range(wanted, len(self._frames.get(topic, ()))):
            kept = self._frames[topic][seq]
            if callable(kept):
                (kept,) = self._write((kept(),))
                self._frames[topic][seq] = kept
            if not isinstance(kept, bytes):
                kept = self._read(kept >> 32, kept & 0xFFFFFFFF)
                kept = self._with_own_epoch(*split_frame(kept)) if self._epoch else kept
            yield kept

    def _with_own_epoch(self, topic: str, header: Header, body: bytes) -> bytes:
        return pack_frame(topic, header._replace(epoch=self._epoch), body)

    def close(self) -> None:
        """Close the file."""
        if self._file is not None:
            os.close(self._file)
            self._file = None

    def _append(self, topic: str, kept: StoredFrame) -> None:
        if topic in self._silent:
            self._silent[topic] += 1
            return
        self._frames[topic].append(kept)
        if isinstance(kept, bytes):
            self._room -= len(kept)

    def _make_room(self) -> None:
        """Write the frames beyond the limit of memory to the file."""
        waiting, self._waiting = self._waiting, []
        frames = [cast("bytes", self._frames[topic][number]) for topic, number in waiting]
        for (topic, number), place in zip(waiting, self._write(frames), strict=True):
            self._frames[topic][number] = place
        self._room += sum(len(frame) for frame in frames)

    def _write(self, frames: Sequence[bytes], cause: Cause | None = None) -> list[int]:
        """Write a record, whole or not at all; returns the places of the frames."""
        file = self._opened()
        answered = b"" if cause is None else "\0".join(map(str, cause)).encode()
        parts, places, at = [], [], self._end + _LENGTH.size
        for piece in (answered, *frames):
            parts += [_LENGTH.pack(len(piece)), piece]
            places.append((at + _LENGTH.size) << 32 | len(piece))
            at += _LENGTH.size + len(piece)
        data = b"".join(parts)
        if os.pwrite(file, _LENGTH.pack(len(data)) + data, self._end) < _LENGTH.size + len(data):
            raise OSError(errno.ENOSPC, "the message log has no more room on the disk")
        self._end = at
        return places[1:]

    def _read(self, start: int, length: int) -> bytes:
        return os.pread(self._opened(), length, start)

    def _opened(self) -> int:
        if self._file is None:
            fresh = 0 if self._persistent or self._epoch else os.O_TRUNC
            self._file = os.open(self._path, _FLAGS | fresh, 0o600)
        return self._file

    def _read_earlier(self) -> None:
        """Read the records of an earlier start; one that was cut off was never sent."""
        size = os.fstat(self._opened()).st_size
        while self._end + _LENGTH.size <= size:
            (length,) = _LENGTH.unpack(self._read(self._end, _LENGTH.size))
            data = self._read(self._end + _LENGTH.size, length)
            if len(data) < length:
                break
            self._restore(data)
            self._end += _LENGTH.size + length
        os.ftruncate(self._opened(), self._end)

    def _restore(self, data: bytes) -> None:
        (_, answered), *frames = _pieces(data)
        if answered:
            publisher, topic, seq, finished = answered.decode().split("\0", 3)
            self.handled[publisher, topic] = int(seq) + 1
            self.finished = self.finished or finished
        for place, frame in frames:
            topic, header, body = split_frame(frame)
            if self._persistent:
                self.latest_ns = max(self.latest_ns, header.sent_ns)
                self._append(topic, self._with_own_epoch(topic, header, body))
            else:
                at = self._end + _LENGTH.size + place
                self._written[topic, header.seq] = at << 32 | len(frame)


def _pieces(data: bytes) -> Iterator[tuple[int, bytes]]:
    """The pieces of a record, with their positions."""
    place = 0
    while place < len(data):
        (length,) = _LENGTH.unpack_from(data, place)
        place += _LENGTH.size + length
        yield place - length, data[place - length : place]


class SendTimes:
    """The times at which one node and its earlier starts sent messages.

    `topics` are in the same order at all starts. Raises OSError if the file cannot be read or
    written; ValueError if it has other topics.
    """

    def __init__(self, path: Path, name: str, topics: Iterable[str]) -> None:
        self._before: dict[str, list[int]] = {topic: [] for topic in topics}
        self._name, self._journal = name, Journal(path, [(name, topic) for topic in self._before])
        for _, topic, sent_ns in self._journal.before:
            self._before[topic].append(sent_ns)

    def before(self, topic: str, seq: int) -> int | None:
        """Time at which an earlier start sent a message [ns]; None if unknown."""
        published = self._before.get(topic, ())
        return published[seq] if seq < len(published) else None

    def note(self, topic: str, sent_ns: int) -> None:
        """Write the time of a topic's next message before it is sent; other topics are ignored.

        Raises OSError if the disk is full.
        """
        if topic in self._before:
            self._journal.note(self._name, topic, sent_ns)

    def close(self) -> None:
        """Close the file."""
        self._journal.close()


class Consumed(NamedTuple):
    """A message that was consumed."""

    publisher: str
    topic: str
    seq: int


class Journal:
    """The journal of one node, which continues that of an earlier start.

    `edges`: publishers and topics of all subscriptions, in the same order at all starts. The file
    grows by `growth` [bytes]. Raises OSError if it cannot be read or written; ValueError if it has
    messages of other edges.
    """

    def __init__(self, path: Path, edges: Sequence[tuple[str, str]], growth: int = 1 << 14) -> None:
        self._growth = growth
        self._numbers = {edge: number for number, edge in enumerate(edges, 1)}
        self._path, self._file = path, os.open(path, _FLAGS, 0o600)
        self._map: mmap.mmap | None = None
        self._words = memoryview(b"").cast("q")
        try:
            self.before = self._read(edges)  # messages of earlier starts, in order
        except ValueError:
            self.close()
            raise
        self._next = 2 * len(self.before)

    def note(self, publisher: str, topic: str, seq: int) -> None:
        """Write a message before it is handled.

        Raises OSError if the disk is full.
        """
        place = self._next
        if place >= len(self._words):
            self._grow()
        # The mapped memory outlives the process. The entry is complete with its second word.
        self._words[place] = seq
        self._words[place + 1] = self._numbers[publisher, topic]
        self._next = place + 2

    def close(self) -> None:
        """Close the file; closing again does nothing."""
        self._words.release()
        if self._map is not None:
            self._map.close()
        if self._file >= 0:
            os.close(self._file)
            self._file = -1

    def _grow(self) -> None:
        """Extend the file by written bytes: a hole might have no room on the disk later."""
        size = max(_WORD * self._next + self._growth, os.fstat(self._file).st_size)
        missing = size - _WORD * self._next
        if os.pwrite(self._file, bytes(missing), _WORD * self._next) < missing:
            raise OSError(errno.ENOSPC, "the journal of what was consumed has no more room")
        self._words.release()
        if self._map is not None:
            self._map.close()
        self._map = mmap.mmap(self._file, size - size % _WORD)
        self._words = memoryview(self._map).cast("q")

    def _read(self, edges: Sequence[tuple[str, str]]) -> tuple[Consumed, ...]:
        data = self._path.read_bytes()
        words = memoryview(data[: len(data) - len(data) % (2 * _WORD)]).cast("q").tolist()
        # A message with an incomplete entry has not been handled.
        entries = [*takewhile(lambda entry: entry[1], zip(words[::2], words[1::2], strict=True))]
        largest = max((number for _, number in entries), default=0)
        if largest > len(edges):
            path = self._path
            raise ValueError(f"journal {path} has input {largest}, there are {len(edges)}")
        return tuple(Consumed(*edges[number - 1], seq) for seq, number in entries)


class OutsideMessage(NamedTuple):
    """A message that a tool requested of a node."""

    topic: str  # on the wire
    seq: int  # number on the topic
    body: bytes  # encoded
    schema: int  # hash of the type's schema


class ParameterLog:
    """Parameters that tools set, in a file beside the journal of a node.

    With `end` "o" it is the file of `OutsideMessage`s. Raises OSError if the file cannot be read or
    written.
    """

    def __init__(self, journal: Path, end: str = "c") -> None:
        path = journal.with_name(f"{journal.name}{end}")
        self._file = os.open(path, _FLAGS | os.O_APPEND, 0o600)
        # Lines of earlier starts; an incomplete line has not been carried out.
        self.before = path.read_bytes().splitlines(keepends=True)
        if self.before and not self.before[-1].endswith(b"\n"):
            os.ftruncate(self._file, sum(map(len, self.before[:-1])))
            self.before.pop()

    def note(self, change: bytes) -> None:
        """Write a change, without a line break, before it is carried out."""
        os.write(self._file, change + b"\n")

    def close(self) -> None:
        """Close the file."""
        os.close(self._file)


class SourceProgress:
    """The number of messages of a source, which survives its death.

    Raises OSError if the file cannot be read or written.
    """

    def __init__(self, path: Path) -> None:
        self._file = os.open(path, _FLAGS, 0o600)
        data = os.pread(self._file, _PROGRESS.size, 0)
        number, paused = _PROGRESS.unpack(data) if len(data) == _PROGRESS.size else (0, _UNKNOWN)
        self.number: int = number  # of published messages
        # Whether it was paused; None if it was neither paused nor resumed.
        self.paused: bool | None = None if paused == _UNKNOWN else bool(paused)

    def increment(self) -> None:
        """Count one more message. Raises OSError if it cannot be written."""
        self.number += 1
        self._write()

    def set_paused(self, paused: bool) -> None:
        """Write whether the source is paused. Raises OSError if it cannot be written."""
        self.paused = paused
        self._write()

    def close(self) -> None:
        """Close the file."""
        os.close(self._file)

    def _write(self) -> None:
        paused = _UNKNOWN if self.paused is None else int(self.paused)
        os.pwrite(self._file, _PROGRESS.pack(self.number, paused), 0)
