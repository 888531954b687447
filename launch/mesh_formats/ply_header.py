"""The header of a PLY file: which elements follow, how many of each, and what they are made of."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal, NamedTuple

MOST_BYTES = 64 << 10
"""Of a header, comments and all."""
MOST_PARTS = 64
"""Elements, and properties of an element."""
MOST_DIGITS = 18
"""Of a count."""
ORDERS: dict[str, Literal["<", ">"] | None] = {
    "ascii": None,
    "binary_little_endian": "<",
    "binary_big_endian": ">",
}
TYPES = {
    "char": "i1",
    "uchar": "u1",
    "short": "i2",
    "ushort": "u2",
    "int": "i4",
    "uint": "u4",
    "float": "f4",
    "double": "f8",
    "int8": "i1",
    "uint8": "u1",
    "int16": "i2",
    "uint16": "u2",
    "int32": "i4",
    "uint32": "u4",
    "int64": "i8",
    "uint64": "u8",
    "float32": "f4",
    "float64": "f8",
}
"""Names of numbers, and what numpy calls them."""


class Property(NamedTuple):
    """A number of each row, or a list of numbers."""

    name: str
    kind: str
    """Of the number, or of a list's items."""
    length: str | None
    """Of the number before a list that tells its length; None for a single number."""


@dataclass(frozen=True, slots=True)
class Element:
    """Rows that are made alike."""

    name: str
    count: int
    properties: list[Property] = field(default_factory=list)


class PlyHeader(NamedTuple):
    """What stands before the rows."""

    order: Literal["<", ">"] | None
    """Of bytes; None if the rows are text."""
    elements: tuple[Element, ...]
    size: int
    """Bytes up to the first row."""


def read_header(data: bytes) -> PlyHeader:
    """The header of a PLY file.

    Raises
    ------
    ValueError
        If it is none.
    """
    lines, size = _lines(data)
    order: Literal["<", ">"] | None = None
    formats = 0
    elements: dict[str, Element] = {}
    for line in lines:
        match line.split():
            case [] | ["comment", *_] | ["obj_info", *_]:
                continue
            case ["format", word, *_] if word in ORDERS:
                order, formats = ORDERS[word], formats + 1
            case ["element", name, count] if name not in elements and len(elements) < MOST_PARTS:
                elements[name] = Element(name, _count(count))
            case ["property", *words] if elements:
                _add(list(elements.values())[-1], words)
            case _:
                raise ValueError(f"has the line {line[:40]!r} in its header")
    if formats != 1:
        raise ValueError("has a header that does not tell its format")
    return PlyHeader(order, tuple(elements.values()), size)


def _lines(data: bytes) -> tuple[list[str], int]:
    """Lines of the header between its first and its last, and its length."""
    head = data[:MOST_BYTES]
    if head.split(None, 1)[:1] != [b"ply"]:
        raise ValueError("does not begin with 'ply'")
    end = head.find(b"end_header")
    size = head.find(b"\n", end) + 1
    if end < 0 or size == 0:
        raise ValueError(f"has a header without an end, or of more than {MOST_BYTES >> 10} kB")
    text = head[:end].decode("latin-1")
    return text.splitlines()[1:], size


def _count(word: str) -> int:
    if not (word.isascii() and word.isdecimal() and len(word) <= MOST_DIGITS):
        raise ValueError(f"states {word[:40]!r} as a count in its header")
    return int(word)


def _add(element: Element, words: list[str]) -> None:
    match words:
        case ["list", length, kind, name] if {length, kind} <= TYPES.keys():
            found = Property(name, TYPES[kind], TYPES[length])
        case [kind, name] if kind in TYPES:
            found = Property(name, TYPES[kind], None)
        case _:
            raise ValueError(f"has the property {' '.join(words)[:40]!r} in its header")
    known = {one.name for one in element.properties}
    if found.name in known or len(known) >= MOST_PARTS:
        raise ValueError(f"has the property {found.name[:40]!r} twice, or more than {MOST_PARTS}")
    if found.length is not None and found.length.startswith("f"):
        raise ValueError(f"has a list {found.name[:40]!r} whose length is no whole number")
    element.properties.append(found)
