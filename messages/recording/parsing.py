"""The content of single MCAP records, taken apart with every length checked."""

from __future__ import annotations

import struct
from typing import NamedTuple

from mcap.records import Channel, Metadata, Schema

MOST_ENTRIES = 4096
"""Of one table of texts: each costs a hundred times the bytes that it may take in a file."""
LONGEST_NAME = 256
"""Characters of a topic or a type."""

_U16 = struct.Struct("<H")
_U32 = struct.Struct("<I")
_U64 = struct.Struct("<Q")
_IDS = struct.Struct("<HH")
_CHUNK = struct.Struct("<QQQI")


class Fault(ValueError):
    """What is wrong with a file, as the rest of a sentence about it."""

    def __init__(self, why: str, byte: int | None = None) -> None:
        super().__init__(why)
        self.byte = byte
        """Where the record begins that is wrong; None if only who reads the file knows."""


class Packed(NamedTuple):
    """A chunk as it lies in the file."""

    size: int
    """Bytes that it claims to become."""
    checksum: int
    """CRC-32 of them; 0 if it has none."""
    compression: str
    data: memoryview


class Content:
    """The content of one record, taken from its beginning piece by piece."""

    def __init__(self, data: bytes | memoryview) -> None:
        self._left = memoryview(data)

    def take(self, size: int) -> memoryview:
        """The next bytes."""
        if size > len(self._left):
            raise Fault("is damaged: a record ends within a field")
        piece, self._left = self._left[:size], self._left[size:]
        return piece

    def numbers(self, layout: struct.Struct) -> tuple[int, ...]:
        """The next numbers."""
        return layout.unpack(self.take(layout.size))

    def block(self, length: struct.Struct = _U32) -> memoryview:
        """The next bytes, which their number precedes."""
        return self.take(self.numbers(length)[0])

    def text(self) -> str:
        """The next text."""
        try:
            return str(self.block(), "utf-8")
        except UnicodeDecodeError:
            raise Fault("is damaged: a text is not Unicode") from None

    def name(self) -> str:
        """The next text, which can be shown to people."""
        name = self.text()
        if len(name) > LONGEST_NAME or not name.isprintable():
            raise Fault(f"is damaged: {name[:20]!r}... is no name")
        return name

    def table(self) -> dict[str, str]:
        """The next table of texts."""
        part, entries = Content(self.block()), 0
        found: dict[str, str] = {}
        while part._left:
            entries += 1
            if entries > MOST_ENTRIES:
                raise Fault(f"is damaged: a table of more than {MOST_ENTRIES} entries")
            name = part.text()
            found[name] = part.text()
        return found


def schema_of(content: memoryview) -> Schema:
    """The schema that a record declares."""
    parts = Content(content)
    (number,) = parts.numbers(_U16)
    name, encoding = parts.name(), parts.name()
    return Schema(id=number, name=name, encoding=encoding, data=bytes(parts.block()))


def channel_of(content: memoryview) -> Channel:
    """The channel that a record declares."""
    parts = Content(content)
    number, schema_id = parts.numbers(_IDS)
    topic, encoding = parts.name(), parts.name()
    return Channel(
        id=number,
        topic=topic,
        message_encoding=encoding,
        metadata=parts.table(),
        schema_id=schema_id,
    )


def metadata_of(content: bytes) -> Metadata:
    """The metadata of a record."""
    parts = Content(content)
    return Metadata(name=parts.text(), metadata=parts.table())


def chunk_of(content: bytes) -> Packed:
    """The chunk of a record, still packed."""
    parts = Content(content)
    _, _, size, checksum = parts.numbers(_CHUNK)
    return Packed(size, checksum, parts.name(), parts.block(_U64))


def checksum_of(content: bytes) -> int:
    """The checksum that ends the data; 0 if none was kept."""
    return Content(content).numbers(_U32)[0]
