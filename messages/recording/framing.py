"""The records of an MCAP file, read with every length and checksum doubted.

A file may be cut off, damaged, or made to burst: nothing is unpacked before its size is known.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from io import BytesIO
from pathlib import Path
from typing import IO, NamedTuple, TypeVar

import lz4.frame
from mcap.data_stream import ReadDataStream
from mcap.exceptions import EndOfFile
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, DataEnd, McapRecord, Metadata, Schema
from mcap.stream_reader import breakup_chunk

MAGIC = b"\x89MCAP0\r\n"
MOST_BYTES = 64 << 20
"""Of a record, packed or unpacked: the largest message is half of that."""

Record = TypeVar("Record", Channel, Chunk, DataEnd, Metadata, Schema)
_HEAD = struct.Struct("<BQ")


class Closed(NamedTuple):
    """The file's proper end: it was closed."""


def records(path: Path) -> Iterator[McapRecord | Closed]:
    """Channels, messages, schemas and metadata in the order of the file.

    Yields
    ------
    McapRecord or Closed
        `Closed` comes last, and is missing if the file ends after a whole record without
        having been closed.

    Raises
    ------
    ValueError
        If the file is missing, empty, no MCAP file, cut off within a record, or damaged. What
        was whole before that has been given by then.
    """
    try:
        file = path.open("rb")
    except OSError as error:
        raise ValueError(f"recording {path} cannot be read: {error.strerror}") from None
    with file:
        try:
            yield from _records(file)
        except (ValueError, EndOfFile, struct.error, RuntimeError) as error:
            raise ValueError(f"recording {path} {_why(error)}") from None


class _Fault(ValueError):
    """What is wrong with a file, as the rest of a sentence about it."""


def _why(error: Exception) -> str:
    if isinstance(error, _Fault):
        return str(error)
    return f"is damaged: {error or type(error).__name__}"


def _records(file: IO[bytes]) -> Iterator[McapRecord | Closed]:
    for opcode, content, checksum in _frames(file):
        match opcode:
            case Opcode.CHUNK:
                yield from _unpacked(_parsed(Chunk, content))
            case Opcode.METADATA:
                yield _parsed(Metadata, content)
            case Opcode.DATA_END:
                stated = _parsed(DataEnd, content).data_section_crc
                if stated not in (0, checksum):
                    raise _Fault("is damaged: the checksum of its data does not fit")
            case Opcode.FOOTER:
                yield Closed()


def _frames(file: IO[bytes]) -> Iterator[tuple[int, bytes, int]]:
    """Opcode and content of each record, and the checksum of all bytes before it."""
    magic = file.read(len(MAGIC))
    if not magic:
        raise _Fault("is empty")
    if magic != MAGIC:
        raise _Fault("is not an MCAP file: it begins otherwise")
    checksum, opcode = zlib.crc32(magic), 0
    while opcode != Opcode.FOOTER:
        place = file.tell()
        head = file.read(_HEAD.size)
        if not head:
            return
        if len(head) < _HEAD.size:
            raise _Fault(f"is cut off at byte {place + len(head)}")
        opcode, length = _HEAD.unpack(head)
        if length > MOST_BYTES:
            raise _Fault(
                f"is damaged at byte {place}: a record of {length} bytes, at most {MOST_BYTES} "
                f"are allowed"
            )
        content = file.read(length)
        if len(content) < length:
            raise _Fault(f"is cut off at byte {place + len(head) + len(content)}")
        if opcode == Opcode.FOOTER:
            end = file.read(len(MAGIC))
            if not end:
                return
            if end != MAGIC:
                raise _Fault("is cut off at its end")
        yield opcode, content, checksum
        checksum = zlib.crc32(content, zlib.crc32(head, checksum))


def _parsed(kind: type[Record], content: bytes) -> Record:
    record: Record = kind.read(ReadDataStream(BytesIO(content)))
    return record


def _unpacked(chunk: Chunk) -> list[McapRecord]:
    """Records of a chunk, whose size is checked before it is unpacked."""
    size = chunk.uncompressed_size
    if size > MOST_BYTES:
        raise _Fault(f"is damaged: a chunk of {size} bytes, at most {MOST_BYTES} are allowed")
    if chunk.compression not in ("", "lz4"):
        raise _Fault(f"has chunks packed by {chunk.compression!r}; only lz4 is read")
    data = chunk.data
    if chunk.compression:
        # One byte more than stated shows a chunk that bursts, and is all that it may take.
        data = lz4.frame.LZ4FrameDecompressor().decompress(data, max_length=size + 1)
    if len(data) != size:
        raise _Fault(f"is damaged: a chunk does not hold the {size} bytes that it states")
    chunk.data, chunk.compression = data, ""
    return breakup_chunk(chunk, validate_crc=True)
