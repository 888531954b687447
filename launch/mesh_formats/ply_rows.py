"""The rows of one PLY element, column by column.

Rows are taken at once if their lists are as long as those of the first row, and else one by one.
"""

from __future__ import annotations

import struct
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from palpate.launch.mesh_formats.ply_header import Element, Property
from palpate.launch.mesh_formats.raw import Ragged

Column = NDArray[np.generic] | Ragged
Columns = dict[str, Column]
Order = Literal["<", ">", "="]

_CODES = {"i1": "b", "u1": "B", "i2": "h", "u2": "H", "i4": "i", "u4": "I", "i8": "q", "u8": "Q"}
_CODES |= {"f4": "f", "f8": "d"}
"""Of numbers in `struct`."""


def read_rows(data: memoryview, at: int, element: Element, order: Order) -> tuple[Columns, int]:
    """Columns of an element that begins at a byte, and the byte after it.

    Raises
    ------
    ValueError
        If the data end before the element does, or a list's length is none.
    """
    if not element.properties or not element.count:
        return {}, at
    least = sum(_size(one.length or one.kind) for one in element.properties)
    if element.count * least > len(data) - at:
        raise _cut_short(element)
    lengths, size = _first_row(data, at, element, order)
    if element.count * size <= len(data) - at:
        table = np.frombuffer(data, _row_type(element, lengths, order), element.count, at)
        if all((table[_told(name)] == length).all() for name, length in lengths.items()):
            return _columns(table, lengths, element), at + element.count * size
    return _one_by_one(data, at, element, order)


def _first_row(
    data: memoryview, at: int, element: Element, order: Order
) -> tuple[dict[str, int], int]:
    """Lengths of the lists in the first row, and its bytes."""
    lengths, start = {}, at
    for one in element.properties:
        length, at = _length(data, at, one, element, order)
        if one.length is not None:
            lengths[one.name] = length
        at += length * _size(one.kind)
    return lengths, at - start


def _row_type(element: Element, lengths: dict[str, int], order: Order) -> np.dtype[Any]:
    fields: list[tuple[str, str] | tuple[str, str, tuple[int]]] = []
    for one in element.properties:
        if one.length is None:
            fields.append((one.name, order + one.kind))
        else:
            fields.append((_told(one.name), order + one.length))
            fields.append((one.name, order + one.kind, (lengths[one.name],)))
    return np.dtype(fields)


def _columns(table: NDArray[Any], lengths: dict[str, int], element: Element) -> Columns:
    return {
        one.name: table[one.name]
        if one.length is None
        else Ragged(np.full(len(table), lengths[one.name]), table[one.name].reshape(-1))
        for one in element.properties
    }


def _one_by_one(data: memoryview, at: int, element: Element, order: Order) -> tuple[Columns, int]:
    pieces = {one.name: bytearray() for one in element.properties}
    lengths: dict[str, list[int]] = {one.name: [] for one in element.properties}
    for _ in range(element.count):
        for one in element.properties:
            length, at = _length(data, at, one, element, order)
            end = at + length * _size(one.kind)
            if end > len(data):
                raise _cut_short(element)
            pieces[one.name] += data[at:end]
            lengths[one.name].append(length)
            at = end
    columns: Columns = {}
    for one in element.properties:
        items = np.frombuffer(pieces[one.name], order + one.kind)
        counted = np.array(lengths[one.name], np.int64)
        columns[one.name] = items if one.length is None else Ragged(counted, items)
    return columns, at


def _length(
    data: memoryview, at: int, one: Property, element: Element, order: Order
) -> tuple[int, int]:
    """How many numbers follow, and where they begin."""
    if one.length is None:
        return 1, at
    size = _size(one.length)
    if at + size > len(data):
        raise _cut_short(element)
    (length,) = struct.unpack_from(order + _CODES[one.length], data, at)
    if not 0 <= length <= len(data) or length != int(length):
        raise ValueError(f"has a list {one.name[:40]!r} of {length:g} items")
    return int(length), at + size


def _size(kind: str) -> int:
    return int(kind[1])


def _told(name: str) -> str:
    """Name of the column that tells a list's length; no property has a blank in its name."""
    return f"{name} length"


def _cut_short(element: Element) -> ValueError:
    return ValueError(f"is cut short: it has not the {element.count} of {element.name[:40]!r}")
