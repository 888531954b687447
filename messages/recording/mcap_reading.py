"""The records of an untrusted MCAP file: all lengths and checksums are checked.

A file may be cut off, damaged or hostile: sizes are checked before anything is unpacked, and unused
records, as attachments, are skipped in pieces. Memory is limited: a chunk unpacks to at most
`SMALL_CHUNK_BYTES`, or `MAX_CHUNK_RATIO` times its size in the file; its records are yielded one by
one; schemas and channels, which are remembered, have at most `MAX_DECLARED_BYTES`. palpate has its
own reader, since that of mcap cannot read files that are cut off.
"""

from __future__ import annotations

import os
import struct
import zlib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import IO, NamedTuple

import lz4.frame
from mcap.opcode import Opcode
from mcap.records import Channel, McapRecord, Message, Metadata, Schema

from palpate.messages.fields import MAX_MESSAGE_BYTES

MAGIC = b"\x89MCAP0\r\n"
MAX_CHUNK_BYTES = MAX_MESSAGE_BYTES + (1 << 20)  # the largest message, and records before it
# Maximum sizes of records that are held in memory [bytes].
MAX_HELD_BYTES: Mapping[int, int] = {
    Opcode.CHUNK: MAX_CHUNK_BYTES,
    Opcode.METADATA: MAX_MESSAGE_BYTES,  # parameters of nodes, with the mesh of the object
    Opcode.DATA_END: 1 << 10,
    Opcode.SCHEMA: 1 << 20,
    Opcode.CHANNEL: 1 << 20,
    Opcode.MESSAGE_INDEX: 16 << 20,
}
# Sizes of records of fixed size [bytes].
FIXED_BYTES: Mapping[int, int] = {Opcode.FOOTER: 20, Opcode.SUMMARY_OFFSET: 17}
KINDS = frozenset(map(int, Opcode))
_HEAD = struct.Struct("<BQ")
# Size to which any chunk may unpack [bytes]: a written chunk has 64 kB of messages and one further
# message, which has at most 1 MiB for most types.
SMALL_CHUNK_BYTES = 12 << 20
# Maximum ratio of unpacked to packed size of a larger chunk, which has a mesh: lz4 packs even flat
# grids only to two fifths of their size.
MAX_CHUNK_RATIO = 8
LZ4_RATIO = 255  # limit of lz4 on the ratio of unpacked to packed size
# Minimum size of a packed record [bytes]: records differ in channel or number, so that lz4 cannot
# pack several as one repetition.
MIN_PACKED_BYTES = 3
MAX_DECLARED_BYTES = 1 << 20  # of all schemas and channels of a file
_MESSAGE = struct.Struct("<HIQQ")
_INSIDE = (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE)
MAX_TABLE_ENTRIES = 4096  # of a table of texts, of which each takes 100 times its size in the file
MAX_NAME_CHARS = 256  # of a topic or a type
_U16 = struct.Struct("<H")
_U32 = struct.Struct("<I")
_U64 = struct.Struct("<Q")
_IDS = struct.Struct("<HH")
_CHUNK = struct.Struct("<QQQI")


class Closed(NamedTuple):
    """The end of a file that was closed."""


class DamagedRecording(ValueError):
    """A recording cannot be read, or only up to a byte."""

    def __init__(self, path: Path, why: str, byte: int) -> None:
        super().__init__(f"recording {path} {why}")
        self.path = path
        self.why = why  # the rest of a sentence that begins with the file
        self.byte = byte  # number of undamaged bytes of the file


class PlacedRecord(NamedTuple):
    """A record and its position."""

    byte: int  # of the beginning of the record, or of its chunk, in the file
    record: McapRecord | Closed


def placed_records(path: Path) -> Iterator[PlacedRecord]:
    """Channels, messages, schemas and metadata in the order of the file, with their positions.

    `Closed` comes last; it is missing if the file was not closed and ends after a whole record.
    Raises DamagedRecording if the file is missing, empty, no MCAP file, cut off within a record,
    damaged, or followed or preceded by other bytes; undamaged records have been yielded by then.
    """
    byte = 0
    try:
        with path.open("rb") as file:
            declared = Declarations()
            for byte, opcode, content, checksum in _file_frames(file):
                for record in _records(opcode, content, checksum, declared):
                    yield PlacedRecord(byte, record)
    except OSError as error:
        raise DamagedRecording(path, f"cannot be read: {error.strerror}", byte) from None
    except RecordFault as error:
        place = byte if error.byte is None else error.byte
        raise DamagedRecording(path, str(error), place) from None


def _file_frames(file: IO[bytes]) -> Iterator[tuple[int, int, bytes, int]]:
    """Position, opcode and content of each record, and the checksum of all bytes before it.

    The content of an unused record is empty.
    """
    magic = file.read(len(MAGIC))
    if not magic:
        raise RecordFault("is empty", 0)
    size = os.fstat(file.fileno()).st_size
    if magic != MAGIC:
        raise RecordFault(_preceded(magic + file.read(1 << 20), size), 0)
    checksum, opcode, place = zlib.crc32(magic), 0, len(MAGIC)
    while opcode != Opcode.FOOTER and place < size:
        head = file.read(_HEAD.size)
        if len(head) < _HEAD.size:
            raise RecordFault(f"is cut off at byte {place + len(head)}", place)
        opcode, length = _HEAD.unpack(head)
        _check_head(opcode, length, place, size)
        before, checksum = checksum, zlib.crc32(head, checksum)
        if opcode in MAX_HELD_BYTES:
            content = file.read(length)
            checksum, n_read = zlib.crc32(content, checksum), len(content)
        else:
            content = b""
            checksum, n_read = _skip(file, length, checksum)
        if n_read < length:
            raise RecordFault(f"is cut off at byte {place + len(head) + n_read}", place)
        if opcode == Opcode.FOOTER and not _ends(file, place):
            return
        yield place, opcode, content, before
        place += len(head) + length
    if opcode == Opcode.FOOTER and place + len(MAGIC) < size:
        raise RecordFault(_followed(file, size - place - len(MAGIC)), place + len(MAGIC))


def _preceded(beginning: bytes, size: int) -> str:
    """The fault of a file that begins with other bytes than a recording."""
    start = beginning.find(MAGIC)
    if start < 0 or start + len(MAGIC) == size:  # there is none, or it is at the end
        return "is not an MCAP file: it begins otherwise"
    return f"begins later than its file: {start} bytes precede the beginning of the recording"


def _followed(file: IO[bytes], rest: int) -> str:
    """The fault of a file that continues after the recording."""
    another = ", and begin as another one" if file.read(len(MAGIC)) == MAGIC else ""
    return f"goes on after its end: {rest} bytes follow the end of the recording{another}"


def _check_head(opcode: int, length: int, place: int, size: int) -> None:
    """Raise RecordFault for an impossible record before it is read."""
    max_length = MAX_HELD_BYTES.get(opcode, MAX_CHUNK_BYTES)
    if opcode not in KINDS or length != FIXED_BYTES.get(opcode, length or -1):
        why = f"no record of kind {opcode} has {length} bytes"
        raise RecordFault(f"is damaged at byte {place}: {why}", place)
    if length > max_length:
        raise RecordFault(
            f"is damaged at byte {place}: a record of {length} bytes, at most {max_length} are "
            "allowed",
            place,
        )
    if length > size - place - _HEAD.size:
        raise RecordFault(f"is cut off at byte {size}", place)


def _skip(
    file: IO[bytes], length: int, checksum: int, piece_size: int = 1 << 20
) -> tuple[int, int]:
    """The checksum with the next `length` bytes, and the number of these that there are."""
    left = length
    while left:
        piece = file.read(min(left, piece_size))
        if not piece:
            break
        checksum, left = zlib.crc32(piece, checksum), left - len(piece)
    return checksum, length - left


def _ends(file: IO[bytes], place: int) -> bool:
    """Whether the file ends properly after its footer; False if it ends before that."""
    end = file.read(len(MAGIC))
    if end and end != MAGIC:
        raise RecordFault("is cut off at its end", place)
    return bool(end)


def _records(
    opcode: int, content: bytes, checksum: int, declared: Declarations
) -> Iterator[McapRecord | Closed]:
    match opcode:
        case Opcode.CHUNK:
            yield from chunk_records(content, declared)
        # Unused records are checked, too: one may be a chunk with a damaged kind.
        case Opcode.SCHEMA:
            yield declared.schema(memoryview(content))
        case Opcode.CHANNEL:
            yield declared.channel(memoryview(content))
        case Opcode.MESSAGE_INDEX:
            parts = RecordContent(content)
            parts.numbers(_U16)
            if len(parts.block()) != len(content) - _U16.size - _U32.size:
                raise RecordFault("is damaged: an index of messages has another length")
        case Opcode.METADATA:
            parts = RecordContent(content)
            yield Metadata(name=parts.text(), metadata=parts.table())
        case Opcode.MESSAGE:
            raise RecordFault("has a message outside of its chunks, where no checksum guards it")
        case Opcode.DATA_END:
            if RecordContent(content).numbers(_U32)[0] not in (0, checksum):
                raise RecordFault("is damaged: the checksum of its data does not fit")
        case Opcode.FOOTER:
            yield Closed()


def chunk_records(content: bytes, declared: Declarations) -> Iterator[Schema | Channel | Message]:
    """Records of a chunk, one by one, after all their lengths and the checksum are checked.

    Raises RecordFault if the chunk is damaged, or not packed by lz4.
    """
    parts = RecordContent(content)
    _, _, size, checksum = parts.numbers(_CHUNK)
    compression, packed = parts.name(), parts.block(_U64)
    data = memoryview(_unpacked(size, compression, packed))
    if checksum not in (0, zlib.crc32(data)):
        raise RecordFault("is damaged: the checksum of a chunk does not fit")
    max_records = len(packed) // MIN_PACKED_BYTES
    for _ in _chunk_frames(data, max_records):
        pass  # all records are checked before one is used
    for opcode, start, end in _chunk_frames(data, max_records):
        record = data[start:end]
        if opcode == Opcode.SCHEMA:
            yield declared.schema(record)
        elif opcode == Opcode.CHANNEL:
            yield declared.channel(record)
        else:
            yield _message(record, declared)


def _unpacked(size: int, compression: str, packed: memoryview) -> bytearray | memoryview:
    if compression not in ("", "lz4"):
        raise RecordFault(f"has chunks packed by {compression!r}; only lz4 is read")
    length = len(packed)
    max_size = min(LZ4_RATIO * length, max_chunk_bytes(length))
    if size > max_size:
        raise RecordFault(
            f"is damaged: a chunk of {size} bytes, at most {max_size} are allowed of "
            f"{length} packed"
        )
    if not compression:
        if length != size:
            raise _wrong_size(size)
        return packed
    try:
        return _unpacked_lz4(packed, size)
    except RuntimeError:
        raise RecordFault("is damaged: a chunk cannot be unpacked") from None


def max_chunk_bytes(packed: int) -> int:
    """Maximum size of a chunk of `packed` bytes; larger chunks are neither written nor read."""
    return min(MAX_CHUNK_BYTES, max(SMALL_CHUNK_BYTES, MAX_CHUNK_RATIO * packed))


def _unpacked_lz4(packed: memoryview, size: int, piece_size: int = 1 << 14) -> bytearray:
    """Unpack to exactly `size` bytes; a piece unpacks to at most 4 MiB and lz4's last block."""
    data, filled = bytearray(size), 0
    unpack = lz4.frame.LZ4FrameDecompressor()
    for start in range(0, len(packed), piece_size):
        if unpack.eof:
            raise _wrong_size(size)
        piece = unpack.decompress(packed[start : start + piece_size])
        if len(piece) > size - filled:
            raise _wrong_size(size)
        data[filled : filled + len(piece)] = piece
        filled += len(piece)
    if filled != size or not unpack.eof:
        raise _wrong_size(size)
    return data


def _wrong_size(size: int) -> RecordFault:
    return RecordFault(f"is damaged: a chunk does not hold the {size} bytes that it states")


def _chunk_frames(data: memoryview, max_records: int) -> Iterator[tuple[int, int, int]]:
    """Opcode of each record, with the beginning and end of its content."""
    at, size = 0, len(data)
    while at < size:
        if size - at < _HEAD.size:
            raise RecordFault("is damaged: a chunk ends within a record")
        opcode, length = _HEAD.unpack_from(data, at)
        if opcode not in _INSIDE:
            raise RecordFault(
                f"is damaged: a chunk holds a record of kind {opcode}, not of its own kinds"
            )
        at += _HEAD.size
        if length > size - at:
            raise RecordFault("is damaged: a record reaches beyond its chunk")
        if max_records == 0:
            raise RecordFault(
                f"is damaged: a chunk holds a record in less than {MIN_PACKED_BYTES} bytes"
            )
        max_records -= 1
        yield opcode, at, at + length
        at += length


def _message(content: memoryview, declared: Declarations) -> Message:
    if len(content) <= _MESSAGE.size:
        raise RecordFault("is damaged: a message without a body")
    channel, sequence, logged, sent = _MESSAGE.unpack_from(content)
    if not declared.has(channel):
        raise RecordFault("is damaged: a message without a channel")
    return Message(channel, logged, bytes(content[_MESSAGE.size :]), sent, sequence)


class Declarations:
    """The schemas and channels of a file up to the current record."""

    def __init__(self) -> None:
        self._schemas: dict[int, Schema] = {}
        self._channels: dict[int, Channel] = {}
        self._bytes = 0

    def has(self, channel: int) -> bool:
        """Whether there is such a channel."""
        return channel in self._channels

    def schema(self, content: memoryview) -> Schema:
        """Read and remember a schema."""
        parts = self._counted(content)
        (number,) = parts.numbers(_U16)
        name, encoding = parts.name(), parts.name()
        schema = Schema(id=number, name=name, encoding=encoding, data=bytes(parts.block()))
        if self._schemas.setdefault(number, schema) != schema:
            raise RecordFault(f"is damaged: it declares schema {number} in two ways")
        return schema

    def channel(self, content: memoryview) -> Channel:
        """Read and remember a channel."""
        parts = self._counted(content)
        number, schema_id = parts.numbers(_IDS)
        topic, encoding, about = parts.name(), parts.name(), parts.table()
        channel = Channel(number, topic, encoding, about, schema_id)
        if self._channels.setdefault(number, channel) != channel:
            raise RecordFault(f"is damaged: it declares channel {number} in two ways")
        return channel

    def _counted(self, content: memoryview) -> RecordContent:
        self._bytes += len(content)
        if self._bytes > MAX_DECLARED_BYTES:
            raise RecordFault(
                f"is damaged: schemas and channels of more than {MAX_DECLARED_BYTES} bytes"
            )
        return RecordContent(content)


class RecordFault(ValueError):
    """A fault of a file, as the rest of a sentence about it."""

    def __init__(self, why: str, byte: int | None = None) -> None:
        super().__init__(why)
        self.byte = byte  # beginning of the faulty record; None if unknown here


class RecordContent:
    """The content of a record, read piece by piece."""

    def __init__(self, data: bytes | memoryview) -> None:
        self._left = memoryview(data)

    def take(self, size: int) -> memoryview:
        """The next bytes."""
        if size > len(self._left):
            raise RecordFault("is damaged: a record ends within a field")
        piece, self._left = self._left[:size], self._left[size:]
        return piece

    def numbers(self, layout: struct.Struct) -> tuple[int, ...]:
        """The next numbers."""
        return layout.unpack(self.take(layout.size))

    def block(self, length: struct.Struct = _U32) -> memoryview:
        """The next bytes, after their number."""
        return self.take(self.numbers(length)[0])

    def text(self) -> str:
        """The next text."""
        try:
            return str(self.block(), "utf-8")
        except UnicodeDecodeError:
            raise RecordFault("is damaged: a text is not Unicode") from None

    def name(self) -> str:
        """The next text, which must be printable."""
        name = self.text()
        if len(name) > MAX_NAME_CHARS or not name.isprintable():
            raise RecordFault(f"is damaged: {name[:20]!r}... is no name")
        return name

    def table(self) -> dict[str, str]:
        """The next table of texts."""
        part, entries = RecordContent(self.block()), 0
        table: dict[str, str] = {}
        while part._left:
            entries += 1
            if entries > MAX_TABLE_ENTRIES:
                raise RecordFault(f"is damaged: a table of more than {MAX_TABLE_ENTRIES} entries")
            name = part.text()
            table[name] = part.text()
        return table
