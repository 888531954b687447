"""Readers of STL, OBJ and OFF, and what all readers of meshes share: bytes to arrays.

They take time that grows with the bytes alone. No count that a file states is believed before the
file is seen to be long enough for it. Each reader raises ValueError, whose text is the rest of a
sentence about the file.
"""

from __future__ import annotations

import re
import struct
import warnings
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

_STL_HEADER = struct.Struct("<80xI")
_TRIANGLE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
_CORNER = re.compile(rb"^[ \t]*vertex[ \t]([^\r\n]*)", re.MULTILINE)
_OFF_START = re.compile(rb"\s*(?:ST)?C?N?OFF\b")
MAX_TRIANGLES = 2_000_000  # Of a mesh
# Of a face; it is cut into triangles about its first one, which suits no rounder ones.
MAX_FACE_CORNERS = 1024
MAX_VERTICES = 3 * MAX_TRIANGLES  # Of a mesh: STL repeats each corner for each triangle
Floats = NDArray[np.float64]
Indices = NDArray[np.int64]
NO_FACES = np.zeros((0, 3), np.int64)


def read_stl(data: bytes) -> RawMesh:
    """The triangles of an STL file; those of several solids are put together.

    Raises
    ------
    ValueError
        If it is neither text with whole facets nor binary of the length that it states.
    """
    if len(data) >= _STL_HEADER.size:
        (count,) = _STL_HEADER.unpack_from(data)
        if len(data) == _STL_HEADER.size + count * _TRIANGLE.itemsize:
            check_counts(0, count)
            found = np.frombuffer(data, _TRIANGLE, offset=_STL_HEADER.size)["corners"]
            return _unmerged(as_float64(found))
    if data[:100].lstrip()[:5].lower() != b"solid":
        raise ValueError("is cut short, or has not the triangles that it states")
    return _read_text(data.lower())


def _read_text(text: bytes) -> RawMesh:
    if text.rfind(b"endsolid") < text.rfind(b"facet"):
        raise ValueError("is cut short: its last solid has no end")
    corners = _CORNER.findall(text)
    check_counts(len(corners), 0)
    if len(corners) != 3 * text.count(b"endfacet"):
        raise ValueError(f"has {len(corners)} corners in {text.count(b'endfacet')} facets")
    found = parse_numbers(b"\n".join(corners))
    if len(found) != 3 * len(corners):
        raise ValueError("has a corner that is not three numbers")
    return _unmerged(found)


def _unmerged(corners: Floats) -> RawMesh:
    """Triangles that share nothing yet."""
    vertices = corners.reshape(-1, 3)
    return RawMesh(vertices, np.arange(len(vertices), dtype=np.int64).reshape(-1, 3))


def read_obj(data: bytes) -> RawMesh:
    """The vertices and faces of an OBJ file; no other file that it names is opened.

    Raises
    ------
    ValueError
        If a vertex has no three numbers, or a face names a vertex that is none.
    """
    places: list[bytes] = []
    lengths: list[int] = []
    corners: list[int] = []
    for line in data.replace(b"\\\r\n", b" ").replace(b"\\\n", b" ").splitlines():
        words = line.split(None, 1)
        if len(words) < 2:
            continue
        if words[0] == b"v":
            places.append(b" ".join(words[1].split(None, 3)[:3]))
        elif words[0] == b"f":
            named = _obj_corners(words[1], len(places))
            lengths.append(len(named))
            corners += named
    check_counts(len(places), len(lengths))
    found = parse_numbers(b"\n".join(places))
    if len(found) != 3 * len(places):
        raise ValueError("has a vertex that is not three numbers")
    polygons = Ragged(np.array(lengths, np.int64), np.array(corners, np.int64))
    return RawMesh(found.reshape(-1, 3), triangulate(polygons))


def _obj_corners(text: bytes, vertices: int) -> list[int]:
    """Vertices, from 0, that ``1/2/3 -1 4`` names; negative ones count back from the last."""
    found = []
    for word in text.partition(b"#")[0].split():
        name = word.partition(b"/")[0]
        if not name.removeprefix(b"-").isdigit() or len(name) > 9:
            raise ValueError(f"has a face with the corner {word[:20].decode(errors='replace')!r}")
        number = int(name)
        found.append(number - 1 if number > 0 else vertices + number if number else -1)
    return found


def read_off(data: bytes) -> RawMesh:
    """The mesh of an OFF file; colours and normals are passed over.

    Raises
    ------
    ValueError
        If it does not begin with OFF, or has not what it states.
    """
    start = _OFF_START.match(data)
    if start is None:
        raise ValueError("does not begin with OFF")
    whole = (line.partition(b"#")[0].strip() for line in data[start.end() :].splitlines())
    lines = [line for line in whole if line]
    counts = lines[0].split() if lines else []
    try:
        vertices, faces = int(counts[0]), int(counts[1])
    except (IndexError, ValueError):
        raise ValueError("does not state how many vertices and faces it has") from None
    check_counts(vertices, faces)
    if len(lines) < 1 + vertices + faces:
        raise ValueError(
            f"states {vertices} vertices and {faces} faces, and has {len(lines) - 1} lines of them"
        )
    places = parse_numbers(
        b"\n".join(b" ".join(row.split(None, 3)[:3]) for row in lines[1:][:vertices])
    )
    if len(places) != 3 * vertices:
        raise ValueError("has a vertex that is not three numbers")
    polygons = _off_polygons(lines[1 + vertices :][:faces])
    return RawMesh(places.reshape(-1, 3), triangulate(polygons))


def _off_polygons(lines: list[bytes]) -> Ragged:
    lengths, rows = [], []
    for line in lines:
        words = line.split()
        length = int(words[0]) if words[0].isdigit() and len(words[0]) < 10 else -1
        if not 0 <= length < len(words):
            raise ValueError("has a face without the corners that it states")
        lengths.append(length)
        rows.append(b" ".join(words[1 : 1 + length]))
    items = parse_numbers(b"\n".join(rows))
    if len(items) != sum(lengths):
        raise ValueError("has a face with a corner that is no whole number")
    return Ragged(np.array(lengths, np.int64), items)


class RawMesh(NamedTuple):
    """What a file says, unchecked but for its form."""

    vertices: Floats  # (n, 3), in the file's unit
    faces: Indices  # (m, 3); none if the file holds points alone


class Ragged(NamedTuple):
    """Lists of numbers, end to end."""

    lengths: Indices  # (n,)
    items: NDArray[np.generic]  # All items of the first list, then all of the second


def parse_numbers(text: bytes) -> Floats:
    """All numbers in a text, in which there must be nothing else but blanks.

    Raises
    ------
    ValueError
        If there is something else.
    """
    if not text.strip():  # which numpy takes for a number
        return np.zeros(0)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            return np.fromstring(text, dtype=np.float64, sep=" ")
        except (DeprecationWarning, ValueError):
            raise ValueError("has something else where there must be numbers") from None


def as_float64(found: NDArray[np.generic]) -> Floats:
    """Numbers in double precision, without a word about those that are none."""
    with np.errstate(invalid="ignore"):
        return found.astype(np.float64)


def check_counts(vertices: int, faces: int) -> None:
    """Refuse a mesh that is too large, or counts that are none.

    Raises
    ------
    ValueError
        If it is.
    """
    if not 0 <= vertices <= MAX_VERTICES:
        raise ValueError(f"states {vertices} vertices; there may be 0 to {MAX_VERTICES}")
    if not 0 <= faces <= MAX_TRIANGLES:
        raise ValueError(f"states {faces} faces; there may be 0 to {MAX_TRIANGLES}")


def triangulate(polygons: Ragged) -> Indices:
    """Polygons cut into triangles (m, 3) about their first corners.

    Raises
    ------
    ValueError
        If a polygon has fewer than three corners or far too many, if a corner is no whole number,
        or if there are too many triangles.
    """
    lengths, items = polygons
    if not len(lengths):
        return NO_FACES
    if lengths.min() < 3:
        raise ValueError(f"has a face of {lengths.min()} corners; a face has three or more")
    if lengths.max() > MAX_FACE_CORNERS:
        raise ValueError(
            f"has a face of {lengths.max()} corners; at most {MAX_FACE_CORNERS} are read"
        )
    total = len(items) - 2 * len(lengths)
    check_counts(0, total)
    corners = _whole_numbers(items)
    cut = lengths - 2
    first = np.repeat(np.cumsum(lengths) - lengths, cut)
    turn = np.arange(total) - np.repeat(np.cumsum(cut) - cut, cut)
    return np.stack([corners[first], corners[first + turn + 1], corners[first + turn + 2]], axis=1)


def _whole_numbers(items: NDArray[np.generic]) -> Indices:
    if items.dtype.kind == "f":
        with np.errstate(invalid="ignore"):
            found = items.astype(np.int64)
        if not np.array_equal(found, items):
            raise ValueError("has a face with a corner that is no whole number")
        return found
    return items.astype(np.int64)
