"""PLY files, text or binary: the header, and the rows of its elements as columns.

Rows are read at once if their lists are as long as those of the first row, else one by one.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from palpate.launch.files import mesh_formats

FACE_LISTS = ("vertex_indices", "vertex_index")  # names of the list of a face's corners
Column = NDArray[np.generic] | mesh_formats.Ragged
Columns = dict[str, Column]
ByteOrder = Literal["<", ">", "="]
MAX_HEADER_BYTES = 64 << 10  # with comments
MAX_ELEMENTS = 64  # and properties of an element
MAX_DIGITS = 18  # of a count
NORMALS = ("nx", "ny", "nz")  # properties of vertices
BYTE_ORDERS: dict[str, Literal["<", ">"] | None] = {
    "ascii": None,
    "binary_little_endian": "<",
    "binary_big_endian": ">",
}
_HEADER_END = re.compile(rb"(\r\n|\r|\n)[ \t]*end_header[ \t]*(\r\n|\r|\n)")
# Types of numbers, and their names in numpy.
PLY_TYPES = {
    **{"char": "i1", "short": "i2", "int": "i4", "float": "f4", "double": "f8"},
    **{"uchar": "u1", "ushort": "u2", "uint": "u4", "float32": "f4", "float64": "f8"},
    **{f"int{8 * size}": f"i{size}" for size in (1, 2, 4, 8)},
    **{f"uint{8 * size}": f"u{size}" for size in (1, 2, 4, 8)},
}
# Codes of the types in `struct`.
_STRUCT_CODES = {"i1": "b", "u1": "B", "i2": "h", "u2": "H", "i4": "i", "u4": "I"}
_STRUCT_CODES |= {"i8": "q", "u8": "Q", "f4": "f", "f8": "d"}


def read_ply(data: bytes) -> mesh_formats.RawMesh:
    """The vertices, normals and faces of a PLY file; all other elements are ignored.

    Raises ValueError if it has no header, or does not hold what its header states.
    """
    data = data.removeprefix(mesh_formats.BOM)
    header = read_header(data)
    elements, rows, at = header.elements, memoryview(data), header.size
    order: ByteOrder = header.order or "="
    if header.order is None:  # text is converted to binary doubles first
        rows, at = memoryview(mesh_formats.parse_numbers(data[header.size :]).tobytes()), 0
        elements = tuple(map(_as_doubles, elements))
    vertices, faces, normals = np.zeros((0, 3)), mesh_formats.NO_POLYGONS, None
    for element in elements:
        if element.name == "vertex":
            mesh_formats.check_counts(element.count, 0)
        elif element.name == "face":
            mesh_formats.check_counts(0, element.count)
        columns, at = read_rows(rows, at, element, order)
        if element.name == "vertex" and element.count:
            vertices, normals = _columns_of(columns, "xyz"), None
            if all(name in columns for name in NORMALS):
                normals = _columns_of(columns, NORMALS)
        elif element.name == "face" and element.count:
            faces = _faces(columns)
    if at != len(rows) and header.order is None:
        raise ValueError("has more in it than its header states")
    notes = mesh_formats.tail_note(len(bytes(rows[at:]).strip()))
    return mesh_formats.polygon_mesh(vertices, faces, notes)._replace(normals=normals)


def read_header(data: bytes) -> PlyHeader:
    """The header of a PLY file; ValueError if it is none."""
    lines, size = _lines(data)
    order: Literal["<", ">"] | None = None
    formats = 0
    elements: dict[str, Element] = {}
    for line in lines:
        match line.split():
            case [] | ["comment", *_] | ["obj_info", *_]:
                continue
            case ["format", word, *_] if word in BYTE_ORDERS:
                order, formats = BYTE_ORDERS[word], formats + 1
            case ["element", name, count] if name not in elements and len(elements) < MAX_ELEMENTS:
                elements[name] = Element(name, _count(count))
            case ["property", *words] if elements:
                _add_property(list(elements.values())[-1], words)
            case _:
                raise ValueError(f"has the line {line[:40]!r} in its header")
    if formats != 1:
        raise ValueError("has a header that does not state its format")
    return PlyHeader(order, tuple(elements.values()), size)


def _lines(data: bytes) -> tuple[list[str], int]:
    head = data[:MAX_HEADER_BYTES]
    if head.split(None, 1)[:1] != [b"ply"]:
        raise ValueError("does not begin with 'ply'")
    end = _HEADER_END.search(head)
    if end is None:
        raise ValueError(
            f"has a header without an end, or of more than {MAX_HEADER_BYTES >> 10} kB"
        )
    # A file of single carriage returns may begin its rows with the byte of a line feed.
    size = end.end() - (end[2] == b"\r\n" and end[1] == b"\r")
    return head[: end.start()].decode("latin-1").splitlines()[1:], size


def _count(word: str) -> int:
    if not (word.isascii() and word.isdecimal() and len(word) <= MAX_DIGITS):
        raise ValueError(f"states {word[:40]!r} as a count in its header")
    return int(word)


def _add_property(element: Element, words: list[str]) -> None:
    match words:
        case ["list", length, kind, name] if {length, kind} <= PLY_TYPES.keys():
            added = Property(name, PLY_TYPES[kind], PLY_TYPES[length])
        case [kind, name] if kind in PLY_TYPES:
            added = Property(name, PLY_TYPES[kind], None)
        case _:
            raise ValueError(f"has the property {' '.join(words)[:40]!r} in its header")
    known = {item.name for item in element.properties}
    if added.name in known or len(known) >= MAX_ELEMENTS:
        raise ValueError(f"has the property {added.name[:40]!r} twice, or more than {MAX_ELEMENTS}")
    if added.length is not None and added.length.startswith("f"):
        raise ValueError(f"has a list {added.name[:40]!r} whose length is no whole number")
    element.properties.append(added)


def _as_doubles(element: Element) -> Element:
    doubles = [Property(item.name, "f8", item.length and "f8") for item in element.properties]
    return Element(element.name, element.count, doubles)


def read_rows(data: memoryview, at: int, element: Element, order: ByteOrder) -> tuple[Columns, int]:
    """Columns of an element that begins at byte `at`, and the byte after it.

    Raises ValueError if the data end before the element does, or the length of a list is no count.
    """
    if not element.properties or not element.count:
        return {}, at
    min_size = sum(_size(item.length or item.kind) for item in element.properties)
    if element.count * min_size > len(data) - at:
        raise _cut_short(element)
    lengths, size = _first_row(data, at, element, order)
    if element.count * size <= len(data) - at:
        table = np.frombuffer(data, _row_type(element, lengths, order), element.count, at)
        if all((table[_length_field(name)] == length).all() for name, length in lengths.items()):
            return _columns(table, lengths, element), at + element.count * size
    return _rows_one_by_one(data, at, element, order)


def _first_row(
    data: memoryview, at: int, element: Element, order: ByteOrder
) -> tuple[dict[str, int], int]:
    """Lengths of the lists in the first row, and its size [bytes]."""
    lengths, start = {}, at
    for item in element.properties:
        length, at = _length(data, at, item, element, order)
        if item.length is not None:
            lengths[item.name] = length
        at += length * _size(item.kind)
    return lengths, at - start


def _row_type(element: Element, lengths: dict[str, int], order: ByteOrder) -> np.dtype[Any]:
    fields: list[tuple[str, str] | tuple[str, str, tuple[int]]] = []
    for item in element.properties:
        if item.length is None:
            fields.append((item.name, order + item.kind))
        else:
            fields.append((_length_field(item.name), order + item.length))
            fields.append((item.name, order + item.kind, (lengths[item.name],)))
    return np.dtype(fields)


def _length_field(name: str) -> str:
    """Name of the column of a list's lengths; names of properties have no blank."""
    return f"{name} length"


def _columns(table: NDArray[Any], lengths: dict[str, int], element: Element) -> Columns:
    columns: Columns = {item.name: table[item.name] for item in element.properties}
    for name, length in lengths.items():
        counts, items = np.full(len(table), length), table[name].reshape(-1)
        columns[name] = mesh_formats.Ragged(counts, items)
    return columns


def _rows_one_by_one(
    data: memoryview, at: int, element: Element, order: ByteOrder
) -> tuple[Columns, int]:
    pieces = {item.name: bytearray() for item in element.properties}
    lengths: dict[str, list[int]] = {item.name: [] for item in element.properties}
    for _ in range(element.count):
        for item in element.properties:
            length, at = _length(data, at, item, element, order)
            end = at + length * _size(item.kind)
            if end > len(data):
                raise _cut_short(element)
            pieces[item.name] += data[at:end]
            lengths[item.name].append(length)
            at = end
    columns: Columns = {}
    for item in element.properties:
        items = np.frombuffer(pieces[item.name], order + item.kind)
        counted = np.array(lengths[item.name], np.int64)
        columns[item.name] = items if item.length is None else mesh_formats.Ragged(counted, items)
    return columns, at


def _length(
    data: memoryview, at: int, item: Property, element: Element, order: ByteOrder
) -> tuple[int, int]:
    """The number of values that follow, and the byte at which they begin."""
    if item.length is None:
        return 1, at
    size = _size(item.length)
    if at + size > len(data):
        raise _cut_short(element)
    (length,) = struct.unpack_from(order + _STRUCT_CODES[item.length], data, at)
    if not 0 <= length <= len(data) or length != int(length):
        raise ValueError(f"has a list {item.name[:40]!r} of {length:g} items")
    return int(length), at + size


def _size(kind: str) -> int:
    return int(kind[1])


def _cut_short(element: Element) -> ValueError:
    return ValueError(
        f"is cut short: it lacks some of {element.count} rows of {element.name[:40]!r}"
    )


def _columns_of(columns: Columns, names: Sequence[str]) -> mesh_formats.Floats:
    values: list[NDArray[np.generic]] = []
    for axis in names:
        column = columns.get(axis)
        if column is None or isinstance(column, mesh_formats.Ragged):
            raise ValueError(f"has vertices without {axis}")
        values.append(column)
    return mesh_formats.as_float64(np.stack(values, axis=1))


def _faces(columns: Columns) -> mesh_formats.Ragged:
    for name in FACE_LISTS:
        column = columns.get(name)
        if isinstance(column, mesh_formats.Ragged):
            return column
    raise ValueError(f"has faces without a list {FACE_LISTS[0]!r}")


class Property(NamedTuple):
    """A number of each row, or a list of numbers."""

    name: str
    kind: str  # type of the number, or of the items of a list
    length: str | None  # type of the length before a list; None if it is no list


@dataclass(frozen=True, slots=True)
class Element:
    """Rows with the same properties."""

    name: str
    count: int
    properties: list[Property] = field(default_factory=list)


class PlyHeader(NamedTuple):
    """The header before the rows."""

    order: Literal["<", ">"] | None  # of bytes; None if the rows are text
    elements: tuple[Element, ...]
    size: int  # before the first row [bytes]
