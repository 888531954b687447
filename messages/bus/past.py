"""All that one node has said: who joins late, or died, hears it from here.

Frames are held in memory up to a limit, and in a file behind that. What cannot be said again, for
it came from the world, is kept in the file as well, with what it answered: a node that is started
again finds it there. All that answers one message is there, or nothing of it.
"""

from __future__ import annotations

import errno
import os
import struct
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

from palpate.messages.header import pack_frame, split_frame

Kept = bytes | tuple[int, int] | Callable[[], bytes]
"""A frame in memory, its place in the file, or what makes it."""

MEMORY = 64 << 20
"""Most bytes of frames that a node keeps in memory."""
_LENGTH = struct.Struct("<I")


class Cause(NamedTuple):
    """What a node that acts has answered."""

    publisher: str
    topic: str
    seq: int
    finished: str = ""
    """Why the node has finished with that, if it has."""


class Past:
    """What a node has said on its topics.

    Parameters
    ----------
    path : Path
        The file behind the memory; it is made when it is needed.
    topics : iterable of str
        The topics that somebody hears: what nobody hears is only counted.
    silent : iterable of str
        The topics that nobody hears.
    memory : int
        Most bytes of frames in memory.
    keep : bool
        Whether every frame is kept in the file, too, and what an earlier start has kept is gone on
        with.
    epoch : int
        Epoch that is put into the frames of an earlier start.

    Raises
    ------
    OSError
        If the file cannot be read or written.
    """

    def __init__(
        self,
        path: Path,
        topics: Iterable[str],
        *,
        silent: Iterable[str] = (),
        memory: int = MEMORY,
        keep: bool = False,
        epoch: int = 0,
    ) -> None:
        self._path, self._room, self._keep = path, memory, keep
        self._frames: dict[str, list[Kept]] = {topic: [] for topic in topics}
        self._silent = dict.fromkeys(silent, 0)
        self._file: int | None = None
        self._end = 0
        self.handled: dict[tuple[str, str], int] = {}
        """Messages that an earlier start has answered, by publisher and topic."""
        self.finished = ""
        """Why an earlier start has finished, if it has."""
        self.latest_ns = 0
        """The latest time in what an earlier start has kept, ns."""
        if keep:
            self._go_on(epoch)

    @property
    def counts(self) -> dict[str, int]:
        """Number of messages on each topic."""
        return {topic: len(frames) for topic, frames in self._frames.items()} | self._silent

    def count(self, topic: str) -> int:
        """Number of messages on a topic.

        Raises
        ------
        KeyError
            If there is no such topic.
        """
        return self._silent[topic] if topic in self._silent else len(self._frames[topic])

    def add(self, topic: str, frame: bytes) -> None:
        """Keep what is about to be sent.

        Raises
        ------
        KeyError
            If there is no such topic.
        OSError
            If the memory is full, and the file cannot be written.
        """
        silent, fits = topic in self._silent, len(frame) <= self._room
        kept: Kept = frame
        if self._keep or not (silent or fits):
            (place,) = self._write((frame,))
            kept = frame if fits else place
        self._hold(topic, kept)

    def answer(self, frames: Sequence[tuple[str, bytes]], cause: Cause) -> None:
        """Keep all that answers a message, with that message, before any of it is sent.

        Raises
        ------
        KeyError
            If there is no such topic.
        OSError
            If the file cannot be written.
        """
        places = self._write([frame for _, frame in frames], cause)
        for (topic, frame), place in zip(frames, places, strict=True):
            self._hold(topic, frame if len(frame) <= self._room else place)

    def promise(self, topic: str, make: Callable[[], bytes]) -> None:
        """Keep what makes a frame: it had been sent, and is made once more if somebody lacks it.

        Raises
        ------
        KeyError
            If there is no such topic.
        """
        if topic in self._silent:
            self._silent[topic] += 1
        else:
            self._frames[topic].append(make)

    def since(self, topic: str, wanted: int) -> Iterator[bytes]:
        """Frames of a topic from a sequence on; none of a topic that nobody hears."""
        for seq in range(wanted, len(self._frames.get(topic, ()))):
            kept = self._frames[topic][seq]
            if callable(kept):
                kept = self._frames[topic][seq] = kept()
            yield kept if isinstance(kept, bytes) else self._read(*kept)

    def close(self) -> None:
        """Close the file."""
        if self._file is not None:
            os.close(self._file)
            self._file = None

    def _hold(self, topic: str, kept: Kept) -> None:
        if topic in self._silent:
            self._silent[topic] += 1
            return
        self._frames[topic].append(kept)
        if isinstance(kept, bytes):
            self._room -= len(kept)

    def _write(self, frames: Sequence[bytes], cause: Cause | None = None) -> list[tuple[int, int]]:
        """Write a record, whole or not at all; returns the places of the frames."""
        file = self._opened()
        words = b"" if cause is None else "\0".join(map(str, cause)).encode()
        parts = [_LENGTH.pack(len(words)), words]
        places, at = [], self._end + 2 * _LENGTH.size + len(words)
        for frame in frames:
            parts += [_LENGTH.pack(len(frame)), frame]
            places.append((at + _LENGTH.size, len(frame)))
            at += _LENGTH.size + len(frame)
        data = b"".join(parts)
        if os.pwrite(file, _LENGTH.pack(len(data)) + data, self._end) < _LENGTH.size + len(data):
            raise OSError(errno.ENOSPC, "what was said has no more room on the disk")
        self._end = at
        return places

    def _read(self, start: int, length: int) -> bytes:
        return os.pread(self._opened(), length, start)

    def _opened(self) -> int:
        if self._file is None:
            flags = os.O_RDWR | os.O_CREAT | os.O_CLOEXEC
            self._file = os.open(self._path, flags if self._keep else flags | os.O_TRUNC, 0o600)
        return self._file

    def _go_on(self, epoch: int) -> None:
        """Take up what an earlier start has kept; a record that was cut off was never sent."""
        size = os.fstat(self._opened()).st_size
        while self._end + _LENGTH.size <= size:
            (length,) = _LENGTH.unpack(self._read(self._end, _LENGTH.size))
            data = self._read(self._end + _LENGTH.size, length)
            if len(data) < length:
                break
            self._end += _LENGTH.size + length
            self._take_up(data, epoch)
        os.ftruncate(self._opened(), self._end)

    def _take_up(self, data: bytes, epoch: int) -> None:
        words, *frames = _pieces(data)
        if words:
            publisher, topic, seq, finished = words.decode().split("\0", 3)
            self.handled[publisher, topic] = int(seq) + 1
            self.finished = self.finished or finished
        for frame in frames:
            topic, header, body = split_frame(frame)
            self.latest_ns = max(self.latest_ns, header.sent_ns)
            self._hold(topic, pack_frame(topic, header._replace(epoch=epoch), body))


def _pieces(data: bytes) -> Iterator[bytes]:
    place = 0
    while place < len(data):
        (length,) = _LENGTH.unpack_from(data, place)
        place += _LENGTH.size + length
        yield data[place - length : place]
