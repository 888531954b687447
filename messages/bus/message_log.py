"""What a node has published and consumed: from this a node that was killed is rebuilt.

Frames are held in memory up to a limit, and in a file behind that. What takes long to make is in
the file at once, so that nobody waits for it to be made a second time. What cannot be published
again, for it came from the world, is kept in the file as well, with what it answered: all that
answers one message is there, or nothing of it. The journal has one entry a message, written
before the message is handled. A time orders what was sent: an effect that others have kept must
stay later than its cause, though the cause is published again after a death. The process may
die at any moment: what the system was handed stays.
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

# A frame in memory, its place in the file (where it starts and, in the last 32 bits, its length, as
# one number: there is one for each message of a long run), or what makes it.
StoredFrame = bytes | int | Callable[[], bytes]
MEMORY_BYTES = 1 << 20  # Most bytes of frames that a node keeps in memory
WRITTEN_TOGETHER = 1 << 16  # Bytes of frames that are written at once when memory is full
_LENGTH = struct.Struct("<I")
_WORD = 8  # Bytes of a word of the journal, of which an entry has two
GROWN_BYTES = 1 << 14  # A journal grows by so much
_PROGRESS = struct.Struct("<QB")
_UNKNOWN = 255
_FLAGS = os.O_RDWR | os.O_CREAT | os.O_CLOEXEC  # A file is made if there is none


class Cause(NamedTuple):
    """What a node that acts has answered."""

    publisher: str
    topic: str
    seq: int
    finished: str = ""  # Why the node has finished with that, if it has


class MessageLog:
    """What a node has published on its topics.

    Raises OSError if the file cannot be read or written.
    """

    def __init__(
        self,
        path: Path,  # The file behind the memory; it is made when it is needed
        topics: Iterable[str],  # The topics that have subscribers: others are only counted
        *,
        silent: Iterable[str] = (),  # The topics without subscribers
        memory: int = MEMORY_BYTES,  # Most bytes of frames in memory
        # Whether every frame is kept in the file, too, and what an earlier start has kept is gone
        # on with
        persistent: bool = False,
        epoch: int = 0,  # How often the node was started before: it goes into frames of the file
    ) -> None:
        self._path, self._room, self._persistent, self._epoch = path, memory, persistent, epoch
        self._frames: dict[str, list[StoredFrame]] = {topic: [] for topic in topics}
        self._silent = dict.fromkeys(silent, 0)
        self._waiting: list[tuple[str, int]] = []  # What is to be written with others
        self._file: int | None = None
        self._end = 0
        # Places of frames that an earlier start has written, by topic and sequence
        self._written: dict[tuple[str, int], int] = {}
        # Messages that an earlier start has answered, by publisher and topic
        self.handled: dict[tuple[str, str], int] = {}
        self.finished = ""  # Why an earlier start has finished, if it has
        self.latest_ns = 0  # The latest time in what an earlier start has kept, ns
        if persistent or (epoch and path.exists()):
            self._go_on()

    @property
    def counts(self) -> dict[str, int]:
        """Number of messages on each topic."""
        return {topic: len(frames) for topic, frames in self._frames.items()} | self._silent

    def count(self, topic: str) -> int:
        """Number of messages on a topic. Raises KeyError if there is no such topic."""
        return self._silent[topic] if topic in self._silent else len(self._frames[topic])

    def add(self, topic: str, frame: bytes, *, outlives: bool = False) -> None:
        """Keep what is about to be sent; in the file as well if it `outlives` this start.

        Raises KeyError if there is no such topic; OSError if the file is needed, and cannot be
        written.
        """
        place = self._written.get((topic, self.count(topic))) if self._written else None
        if place is None and (self._persistent or (outlives and topic not in self._silent)):
            (place,) = self._write((frame,))
        if place is not None and len(frame) > self._room:
            self._hold(topic, place)
            return
        self._hold(topic, frame)
        if self._room < 0 and topic not in self._silent:
            self._waiting.append((topic, len(self._frames[topic]) - 1))
            if self._room <= -WRITTEN_TOGETHER:
                self._make_room()

    def answer(self, frames: Sequence[tuple[str, bytes]], cause: Cause) -> None:
        """Keep all that answers a message, with that message, before any of it is sent.

        Raises KeyError if there is no such topic; OSError if the file cannot be written.
        """
        places = self._write([frame for _, frame in frames], cause)
        for (topic, frame), place in zip(frames, places, strict=True):
            self._hold(topic, frame if len(frame) <= self._room else place)

    def promise(self, topic: str, make: Callable[[], bytes]) -> None:
        """Keep what makes a frame: it had been sent, and may have to be made once more.

        That is if it is not in the file, and somebody lacks it. Raises KeyError if there is no such
        topic.
        """
        self._hold(topic, self._written.get((topic, self.count(topic)), make))

    def since(self, topic: str, wanted: int) -> Iterator[bytes]:
        """Frames of a topic from a sequence on; none of a topic without subscribers."""
        for seq in range(wanted, len(self._frames.get(topic, ()))):
            kept = self._frames[topic][seq]
            if callable(kept):
                (kept,) = self._write((kept(),))
                self._frames[topic][seq] = kept
            if not isinstance(kept, bytes):
                kept = self._read(kept >> 32, kept & 0xFFFFFFFF)
                kept = self._of_this_start(*split_frame(kept)) if self._epoch else kept
            yield kept

    def _of_this_start(self, topic: str, header: Header, body: bytes) -> bytes:
        return pack_frame(topic, header._replace(epoch=self._epoch), body)

    def close(self) -> None:
        """Close the file."""
        if self._file is not None:
            os.close(self._file)
            self._file = None

    def _hold(self, topic: str, kept: StoredFrame) -> None:
        if topic in self._silent:
            self._silent[topic] += 1
            return
        self._frames[topic].append(kept)
        if isinstance(kept, bytes):
            self._room -= len(kept)

    def _make_room(self) -> None:
        """Put what is in memory beyond the limit into the file."""
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

    def _go_on(self) -> None:
        """Take up what an earlier start has kept; a record that was cut off was never sent."""
        size = os.fstat(self._opened()).st_size
        while self._end + _LENGTH.size <= size:
            (length,) = _LENGTH.unpack(self._read(self._end, _LENGTH.size))
            data = self._read(self._end + _LENGTH.size, length)
            if len(data) < length:
                break
            self._take_up(data)
            self._end += _LENGTH.size + length
        os.ftruncate(self._opened(), self._end)

    def _take_up(self, data: bytes) -> None:
        (_, answered), *frames = _pieces(data)
        if answered:
            publisher, topic, seq, finished = answered.decode().split("\0", 3)
            self.handled[publisher, topic] = int(seq) + 1
            self.finished = self.finished or finished
        for place, frame in frames:
            topic, header, body = split_frame(frame)
            if self._persistent:
                self.latest_ns = max(self.latest_ns, header.sent_ns)
                self._hold(topic, self._of_this_start(topic, header, body))
            else:
                at = self._end + _LENGTH.size + place
                self._written[topic, header.seq] = at << 32 | len(frame)


def _pieces(data: bytes) -> Iterator[tuple[int, bytes]]:
    """The pieces of a record and where they begin in it."""
    place = 0
    while place < len(data):
        (length,) = _LENGTH.unpack_from(data, place)
        place += _LENGTH.size + length
        yield place - length, data[place - length : place]


class SendTimes:
    """The times at which one node, and earlier starts of it, have sent messages.

    Raises OSError if the file cannot be read or written; ValueError if it speaks of other topics.
    """

    # `topics`: those that are put down, in an order that is the same at every start
    def __init__(self, path: Path, name: str, topics: Iterable[str]) -> None:
        self._before: dict[str, list[int]] = {topic: [] for topic in topics}
        self._name, self._journal = name, Journal(path, [(name, topic) for topic in self._before])
        for _, topic, sent_ns in self._journal.before:
            self._before[topic].append(sent_ns)

    def before(self, topic: str, seq: int) -> int | None:
        """Time at which an earlier start has sent a message, ns; None if that is not put down."""
        published = self._before.get(topic, ())
        return published[seq] if seq < len(published) else None

    def note(self, topic: str, sent_ns: int) -> None:
        """Put down the time of a topic's next message, before it is sent; of other topics nothing.

        Raises OSError if there is no more room for it.
        """
        if topic in self._before:
            self._journal.note(self._name, topic, sent_ns)

    def close(self) -> None:
        """Close the file."""
        self._journal.close()


class Consumed(NamedTuple):
    """One message that was consumed."""

    publisher: str
    topic: str
    seq: int


class Journal:
    """The journal of one node; what an earlier start of it has written is gone on with.

    Raises OSError as its file does; ValueError if it has what the node does not subscribe to.
    """

    # `edges`: all that the node subscribes to, in an order that is the same at every start
    def __init__(self, path: Path, edges: Sequence[tuple[str, str]]) -> None:
        self._numbers = {edge: number for number, edge in enumerate(edges, 1)}
        self._path, self._file = path, os.open(path, _FLAGS, 0o600)
        self._map: mmap.mmap | None = None
        self._words = memoryview(b"").cast("q")
        try:
            self.before = self._read(edges)  # What earlier starts have consumed, in its order
        except ValueError:
            self.close()
            raise
        self._next = 2 * len(self.before)

    def note(self, publisher: str, topic: str, seq: int) -> None:
        """Put down that a message is about to be handled.

        Raises OSError if there is no more room for it.
        """
        place = self._next
        if place >= len(self._words):
            self._grow()
        # It is written into memory that outlives the process. With its second word it is an entry.
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
        """Have room for the next entry, in a file that is written: a hole could not be filled."""
        size = max(_WORD * self._next + GROWN_BYTES, os.fstat(self._file).st_size)
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
        # An entry that was cut off has not been handled: it is written anew.
        entries = [*takewhile(lambda entry: entry[1], zip(words[::2], words[1::2], strict=True))]
        beyond = max((number for _, number in entries), default=0)
        if beyond > len(edges):
            path = self._path
            raise ValueError(f"journal {path} speaks of input {beyond}, there are {len(edges)}")
        return tuple(Consumed(*edges[number - 1], seq) for seq, number in entries)


class OutsideMessage(NamedTuple):
    """A message that a tool had a node publish."""

    topic: str  # On the wire
    seq: int  # Its number on the topic
    body: bytes  # Encoded
    schema: int  # Hash of the type's schema


class ParameterLog:
    """What tools had a node do, beyond its death, in a file beside its journal: set parameters.

    With `end` "o" the file is that of its `OutsideMessage`s. Raises OSError if the file cannot be
    read or written.
    """

    def __init__(self, journal: Path, end: str = "c") -> None:
        path = journal.with_name(f"{journal.name}{end}")
        self._file = os.open(path, _FLAGS | os.O_APPEND, 0o600)
        # What earlier starts have put down, one a line; a line that was cut off was never done
        self.before = path.read_bytes().splitlines(keepends=True)
        if self.before and not self.before[-1].endswith(b"\n"):
            os.ftruncate(self._file, sum(map(len, self.before[:-1])))
            self.before.pop()

    def note(self, change: bytes) -> None:
        """Put down what is about to be done, without a line break in it."""
        os.write(self._file, change + b"\n")

    def close(self) -> None:
        """Close the file."""
        os.close(self._file)


class SourceProgress:
    """How much a source has published, beyond its death.

    Raises OSError if the file cannot be read or written.
    """

    def __init__(self, path: Path) -> None:
        self._file = os.open(path, _FLAGS, 0o600)
        found = os.pread(self._file, _PROGRESS.size, 0)
        number, paused = _PROGRESS.unpack(found) if len(found) == _PROGRESS.size else (0, _UNKNOWN)
        self.number: int = number  # How much has been published
        # Whether it was told to stand still; None if it was told nothing
        self.paused: bool | None = None if paused == _UNKNOWN else bool(paused)

    def up(self) -> None:
        """Count one more. Raises OSError if it cannot be written."""
        self.number += 1
        self._write()

    def stand(self, paused: bool) -> None:
        """Put down whether it stands still. Raises OSError if it cannot be written."""
        self.paused = paused
        self._write()

    def close(self) -> None:
        """Close the file."""
        os.close(self._file)

    def _write(self) -> None:
        paused = _UNKNOWN if self.paused is None else int(self.paused)
        os.pwrite(self._file, _PROGRESS.pack(self.number, paused), 0)
