"""The records of one chunk, which is unpacked no further than the bytes in the file allow.

What bounds memory: a chunk unpacks to at most `FEW_BYTES`, or `LARGE_RATIO` times what it takes in
the file; its records are given one by one; and what has to be remembered of a file, its schemas and
channels, is at most `DECLARED_BYTES`.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator

import lz4.frame
from mcap.opcode import Opcode
from mcap.records import Channel, Message, Schema

from palpate.messages.recording.parsing import Fault, Packed, channel_of, chunk_of, schema_of

MOST_BYTES = (256 << 20) + (1 << 20)
"""Of a chunk, packed or not: the largest message, and what a writer puts before it."""
FEW_BYTES = 12 << 20
"""To which any chunk may unpack, be it all zeros: it holds 64 kB of messages and one more, which is
at most 1 MiB for most types."""
LARGE_RATIO = 8
"""Of a larger chunk, unpacked to packed. What is larger is a mesh, and even flat grids
are packed by lz4 to two fifths only."""
LZ4_RATIO = 255
"""No byte packed by lz4 becomes more."""
LEAST_PACKED = 3
"""Bytes that a packed record takes at least: no two have the same channel and number, so that none
can be a part of one repetition."""
DECLARED_BYTES = 1 << 20
"""Of all schemas and channels of a file."""

_PIECE = 1 << 14
"""Packed bytes that are unpacked at once, to at most 4 MiB and what lz4 holds back of one block."""
_HEAD = struct.Struct("<BQ")
_MESSAGE = struct.Struct("<HIQQ")
_INSIDE = (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE)


class Declared:
    """The schemas and channels of a file, as far as it has been read."""

    def __init__(self) -> None:
        self._schemas: dict[int, Schema] = {}
        self._channels: dict[int, Channel] = {}
        self._bytes = 0

    def has(self, channel: int) -> bool:
        """Whether there is such a channel."""
        return channel in self._channels

    def schema(self, content: memoryview) -> Schema:
        """Take in a schema."""
        self._count(content)
        schema = schema_of(content)
        if self._schemas.setdefault(schema.id, schema) != schema:
            raise Fault(f"is damaged: it declares schema {schema.id} in two ways")
        return schema

    def channel(self, content: memoryview) -> Channel:
        """Take in a channel."""
        self._count(content)
        channel = channel_of(content)
        if self._channels.setdefault(channel.id, channel) != channel:
            raise Fault(f"is damaged: it declares channel {channel.id} in two ways")
        return channel

    def _count(self, content: memoryview) -> None:
        self._bytes += len(content)
        if self._bytes > DECLARED_BYTES:
            raise Fault(f"is damaged: schemas and channels of more than {DECLARED_BYTES} bytes")


def chunk_records(content: bytes, declared: Declared) -> Iterator[Schema | Channel | Message]:
    """Records of a chunk, one at a time, once all their lengths and the checksum are known to fit.

    Raises
    ------
    Fault
        If the chunk is damaged, or packed in another way than by lz4.
    """
    packed = chunk_of(content)
    data = memoryview(_unpacked(packed))
    if packed.checksum not in (0, zlib.crc32(data)):
        raise Fault("is damaged: the checksum of a chunk does not fit")
    most = len(packed.data) // LEAST_PACKED
    for _ in _frames(data, most):
        pass  # a chunk is believed whole or not at all
    for opcode, start, end in _frames(data, most):
        record = data[start:end]
        if opcode == Opcode.SCHEMA:
            yield declared.schema(record)
        elif opcode == Opcode.CHANNEL:
            yield declared.channel(record)
        else:
            yield _message(record, declared)


def _unpacked(chunk: Packed) -> bytearray | memoryview:
    size, packed = chunk.size, len(chunk.data)
    if chunk.compression not in ("", "lz4"):
        raise Fault(f"has chunks packed by {chunk.compression!r}; only lz4 is read")
    most = min(MOST_BYTES, LZ4_RATIO * packed, max(FEW_BYTES, LARGE_RATIO * packed))
    if size > most:
        raise Fault(
            f"is damaged: a chunk of {size} bytes, at most {most} are allowed of {packed} packed"
        )
    if not chunk.compression:
        if packed != size:
            raise _lies(size)
        return chunk.data
    try:
        return _unpacked_lz4(chunk.data, size)
    except RuntimeError:
        raise Fault("is damaged: a chunk cannot be unpacked") from None


def _unpacked_lz4(packed: memoryview, size: int) -> bytearray:
    """Unpack to exactly `size` bytes, and look at no further ones."""
    data, filled = bytearray(size), 0
    unpack = lz4.frame.LZ4FrameDecompressor()
    for start in range(0, len(packed), _PIECE):
        if unpack.eof:
            raise _lies(size)
        piece = unpack.decompress(packed[start : start + _PIECE])
        if len(piece) > size - filled:
            raise _lies(size)
        data[filled : filled + len(piece)] = piece
        filled += len(piece)
    if filled != size or not unpack.eof:
        raise _lies(size)
    return data


def _lies(size: int) -> Fault:
    return Fault(f"is damaged: a chunk does not hold the {size} bytes that it states")


def _frames(data: memoryview, most: int) -> Iterator[tuple[int, int, int]]:
    """Opcode of each record, and where its content begins and ends."""
    at, size = 0, len(data)
    while at < size:
        if size - at < _HEAD.size:
            raise Fault("is damaged: a chunk ends within a record")
        opcode, length = _HEAD.unpack_from(data, at)
        if opcode not in _INSIDE:
            raise Fault(
                f"is damaged: a chunk holds a record of kind {opcode}, not of its own kinds"
            )
        at += _HEAD.size
        if length > size - at:
            raise Fault("is damaged: a record reaches beyond its chunk")
        if most == 0:
            raise Fault(f"is damaged: a chunk holds a record in less than {LEAST_PACKED} bytes")
        most -= 1
        yield opcode, at, at + length
        at += length


def _message(content: memoryview, declared: Declared) -> Message:
    if len(content) <= _MESSAGE.size:
        raise Fault("is damaged: a message without a body")
    channel, sequence, logged, sent = _MESSAGE.unpack_from(content)
    if not declared.has(channel):
        raise Fault("is damaged: a message without a channel")
    return Message(
        channel_id=channel,
        log_time=logged,
        data=bytes(content[_MESSAGE.size :]),
        publish_time=sent,
        sequence=sequence,
    )
