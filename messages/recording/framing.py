"""The records of an MCAP file, read with every length and checksum doubted.

A file may be cut off, damaged, or made to burst: nothing is unpacked before its size is known, and
what is of no use here, an attachment say, is passed over in pieces.
"""

from __future__ import annotations

import os
import struct
import zlib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import IO, NamedTuple

from mcap.opcode import Opcode
from mcap.records import McapRecord

from palpate.messages.recording.chunk import MOST_BYTES, Declared, chunk_records
from palpate.messages.recording.parsing import Fault, checksum_of, metadata_of

MAGIC = b"\x89MCAP0\r\n"
MOST_HELD: Mapping[int, int] = {
    Opcode.CHUNK: MOST_BYTES,
    Opcode.METADATA: 8 << 20,
    Opcode.DATA_END: 1 << 10,
}
"""Most bytes of those records that are held in memory."""

_HEAD = struct.Struct("<BQ")
_PIECE = 1 << 20
"""Bytes that are passed over at once."""


class Closed(NamedTuple):
    """The file's proper end: it was closed."""


class Damaged(ValueError):
    """A recording cannot be read any further, or at all."""

    def __init__(self, path: Path, why: str, byte: int) -> None:
        super().__init__(f"recording {path} {why}")
        self.path = path
        self.why = why
        """The rest of a sentence that begins with the file."""
        self.byte = byte
        """Bytes of the file that are whole."""


class Placed(NamedTuple):
    """A record, and where it was found."""

    byte: int
    """Where the record begins in the file, or the chunk that holds it."""
    record: McapRecord | Closed


def records(path: Path) -> Iterator[McapRecord | Closed]:
    """Channels, messages, schemas and metadata in the order of the file.

    Yields
    ------
    McapRecord or Closed
        `Closed` comes last, and is missing if the file ends after a whole record without
        having been closed.

    Raises
    ------
    Damaged
        If the file is missing, empty, no MCAP file, cut off within a record, or damaged. What
        was whole before that has been given by then.
    """
    return (record for _, record in placed_records(path))


def placed_records(path: Path) -> Iterator[Placed]:
    """Give the same with their places, and raise the same."""
    byte = 0
    try:
        with path.open("rb") as file:
            declared = Declared()
            for byte, opcode, content, checksum in _frames(file):
                for record in _records(opcode, content, checksum, declared):
                    yield Placed(byte, record)
    except OSError as error:
        raise Damaged(path, f"cannot be read: {error.strerror}", byte) from None
    except Fault as error:
        place = byte if error.byte is None else error.byte
        raise Damaged(path, str(error), place) from None


def _records(
    opcode: int, content: bytes, checksum: int, declared: Declared
) -> Iterator[McapRecord | Closed]:
    match opcode:
        case Opcode.CHUNK:
            yield from chunk_records(content, declared)
        case Opcode.METADATA:
            yield metadata_of(content)
        case Opcode.MESSAGE:
            raise Fault("has a message outside of its chunks, where no checksum guards it")
        case Opcode.DATA_END:
            if checksum_of(content) not in (0, checksum):
                raise Fault("is damaged: the checksum of its data does not fit")
        case Opcode.FOOTER:
            yield Closed()


def _frames(file: IO[bytes]) -> Iterator[tuple[int, int, bytes, int]]:
    """Place, opcode and content of each record, and the checksum of all bytes before it.

    The content is empty where it is of no use.
    """
    magic = file.read(len(MAGIC))
    if not magic:
        raise Fault("is empty", 0)
    if magic != MAGIC:
        raise Fault("is not an MCAP file: it begins otherwise", 0)
    size = os.fstat(file.fileno()).st_size
    checksum, opcode, place = zlib.crc32(magic), 0, len(MAGIC)
    while opcode != Opcode.FOOTER and place < size:
        head = file.read(_HEAD.size)
        if len(head) < _HEAD.size:
            raise Fault(f"is cut off at byte {place + len(head)}", place)
        opcode, length = _HEAD.unpack(head)
        _check_head(opcode, length, place, size)
        before, checksum = checksum, zlib.crc32(head, checksum)
        if opcode in MOST_HELD:
            content = file.read(length)
            checksum, passed = zlib.crc32(content, checksum), len(content)
        else:
            content = b""
            checksum, passed = _pass(file, length, checksum)
        if passed < length:
            raise Fault(f"is cut off at byte {place + len(head) + passed}", place)
        if opcode == Opcode.FOOTER and not _ends(file, place):
            return
        yield place, opcode, content, before
        place += len(head) + length


def _check_head(opcode: int, length: int, place: int, size: int) -> None:
    """Refuse a record that cannot be, before a byte of it is read."""
    most = MOST_HELD.get(opcode, MOST_BYTES)
    if opcode == 0 or length == 0:
        why = f"no record of kind {opcode} has {length} bytes"
        raise Fault(f"is damaged at byte {place}: {why}", place)
    if length > most:
        raise Fault(
            f"is damaged at byte {place}: a record of {length} bytes, at most {most} are allowed",
            place,
        )
    if length > size - place - _HEAD.size:
        raise Fault(f"is cut off at byte {size}", place)


def _pass(file: IO[bytes], length: int, checksum: int) -> tuple[int, int]:
    """Checksum of the next bytes too, and how many of them there are."""
    left = length
    while left:
        piece = file.read(min(left, _PIECE))
        if not piece:
            break
        checksum, left = zlib.crc32(piece, checksum), left - len(piece)
    return checksum, length - left


def _ends(file: IO[bytes], place: int) -> bool:
    """Whether the file ends as it must behind its footer; false if it ends before that."""
    end = file.read(len(MAGIC))
    if end and end != MAGIC:
        raise Fault("is cut off at its end", place)
    return bool(end)
