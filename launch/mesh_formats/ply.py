"""PLY, in text and in binary: elements in the order of the header, which is read first."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from palpate.launch.mesh_formats.ply_header import Element, Property, read_header
from palpate.launch.mesh_formats.ply_rows import Columns, Order, read_rows
from palpate.launch.mesh_formats.raw import (
    NO_FACES,
    Floats,
    Indices,
    Ragged,
    RawMesh,
    check_counts,
    doubles,
    numbers,
    triangles,
)

FACES = ("vertex_indices", "vertex_index")
"""What the list of a face's corners is called."""


def read_ply(data: bytes) -> RawMesh:
    """The vertices and faces of a PLY file; all else in it is passed over.

    Raises
    ------
    ValueError
        If the header is none, or the file has not what it states.
    """
    header = read_header(data)
    elements, rows, at = header.elements, memoryview(data), header.size
    order: Order = header.order or "="
    if header.order is None:  # text is read as if its numbers were binary, all of one type
        rows, at = memoryview(numbers(data[header.size :]).tobytes()), 0
        elements = tuple(map(_of_doubles, elements))
    vertices, faces = np.zeros((0, 3)), NO_FACES
    for element in elements:
        if element.name == "vertex":
            check_counts(element.count, 0)
        elif element.name == "face":
            check_counts(0, element.count)
        columns, at = read_rows(rows, at, element, order)
        if element.name == "vertex" and element.count:
            vertices = _places(columns)
        elif element.name == "face" and element.count:
            faces = _faces(columns)
    if at != len(rows):
        raise ValueError("has more in it than its header states")
    return RawMesh(vertices, faces)


def _of_doubles(element: Element) -> Element:
    made = [Property(one.name, "f8", one.length and "f8") for one in element.properties]
    return Element(element.name, element.count, made)


def _places(columns: Columns) -> Floats:
    found: list[NDArray[np.generic]] = []
    for axis in "xyz":
        column = columns.get(axis)
        if column is None or isinstance(column, Ragged):
            raise ValueError(f"has vertices without {axis}")
        found.append(column)
    return doubles(np.stack(found, axis=1))


def _faces(columns: Columns) -> Indices:
    for name in FACES:
        column = columns.get(name)
        if isinstance(column, Ragged):
            return triangles(column)
    raise ValueError(f"has faces without a list {FACES[0]!r}")
