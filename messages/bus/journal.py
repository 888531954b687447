"""What a node has consumed, in its order: from it a node that was killed is rebuilt.

One entry a message, written before the message is handled; what publishers still remember does
the rest. The process may die at any moment: what the system was handed stays.
"""

from __future__ import annotations

import errno
import os
import struct
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

_ENTRY = struct.Struct("<IQ")
_TALLY = struct.Struct("<QB")
_UNKNOWN = 255


class Consumed(NamedTuple):
    """One message that was consumed."""

    publisher: str
    topic: str
    seq: int


class Journal:
    """The journal of one node; what an earlier start of it has written is gone on with.

    Parameters
    ----------
    path : Path
        The file; it is made if there is none.
    edges : sequence of (publisher, topic)
        All that the node hears, in an order that is the same at every start.

    Raises
    ------
    OSError
        If the file cannot be read or written.
    ValueError
        If it speaks of what the node does not hear.
    """

    def __init__(self, path: Path, edges: Sequence[tuple[str, str]]) -> None:
        self._numbers = {edge: number for number, edge in enumerate(edges)}
        self._file = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
        try:
            self.before = self._read(path, edges)
            """What earlier starts have consumed, in its order."""
        except ValueError:
            self.close()
            raise

    def note(self, publisher: str, topic: str, seq: int) -> None:
        """Put down that a message is about to be handled.

        Raises
        ------
        OSError
            If there is no more room for it.
        """
        entry = _ENTRY.pack(self._numbers[publisher, topic], seq)
        if os.write(self._file, entry) < len(entry):
            raise OSError(errno.ENOSPC, "the journal of what was consumed has no more room")

    def close(self) -> None:
        """Close the file; closing again does nothing."""
        if self._file >= 0:
            os.close(self._file)
            self._file = -1

    def _read(self, path: Path, edges: Sequence[tuple[str, str]]) -> tuple[Consumed, ...]:
        data = path.read_bytes()
        whole = len(data) - len(data) % _ENTRY.size
        # An entry that was cut off has not been handled: it is written anew.
        os.ftruncate(self._file, whole)
        os.lseek(self._file, whole, os.SEEK_SET)
        entries = list(_ENTRY.iter_unpack(data[:whole]))
        beyond = max((number for number, _ in entries), default=-1)
        if beyond >= len(edges):
            raise ValueError(f"journal {path} speaks of input {beyond}, there are {len(edges)}")
        return tuple(Consumed._make((*edges[number], seq)) for number, seq in entries)


class Tally:
    """How much a source has said, beyond its death.

    Parameters
    ----------
    path : Path
        The file; it is made if there is none.

    Raises
    ------
    OSError
        If the file cannot be read or written.
    """

    def __init__(self, path: Path) -> None:
        self._file = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
        found = os.pread(self._file, _TALLY.size, 0)
        number, paused = _TALLY.unpack(found) if len(found) == _TALLY.size else (0, _UNKNOWN)
        self.number: int = number
        """How much has been said."""
        self.paused: bool | None = None if paused == _UNKNOWN else bool(paused)
        """Whether it was told to stand still; None if it was told nothing."""

    def up(self) -> None:
        """Count one more.

        Raises
        ------
        OSError
            If it cannot be written.
        """
        self.number += 1
        self._write()

    def stand(self, paused: bool) -> None:
        """Put down whether it stands still.

        Raises
        ------
        OSError
            If it cannot be written.
        """
        self.paused = paused
        self._write()

    def close(self) -> None:
        """Close the file."""
        os.close(self._file)

    def _write(self) -> None:
        paused = _UNKNOWN if self.paused is None else int(self.paused)
        os.pwrite(self._file, _TALLY.pack(self.number, paused), 0)
