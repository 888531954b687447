"""Readers of untrusted STL, OBJ and OFF files, and functions that all readers of meshes share.

Counts, offsets and sizes are checked before anything is allocated.
"""

from __future__ import annotations

import re
import struct
import warnings
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from palpate.core.shapes import cut_faces

STL_HEADER = struct.Struct("<80xI")
STL_TRIANGLE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
# The name of a solid in text, up to the end of its line or to the first facet on it.
_NAME = re.compile(rb"\b(?:end[ \t]*)?solid\b.*?(?=\bfacet\s+normal\s+(?:[-+.\d]|nan)|[\r\n]|\Z)")
_CORNER = re.compile(rb"\bvertex\s+(\S+\s+\S+\s+\S+)(?=\s+(?:vertex|endloop)\b)")
_FACET_WORD = re.compile(rb"\bvertex\b|\bendfacet\b")
_END = re.compile(rb"\bend(?:[ \t]*solid)?\b|\bsolid\b")
BOM = b"\xef\xbb\xbf"  # byte order mark before text in UTF-8
_COMMENT, _TEXTURE_AND_NORMAL = re.compile(rb"#[^\n]*"), re.compile(rb"/\S*")  # in faces of OBJ
_NO_INDEX = re.compile(rb"(?<!\S)(?!-?\d{1,9}(?:[\s/]|\Z))(\S+)")
_CONTINUED = re.compile(rb"\\[ \t]*(?:\r\n|\r|\n)")
_OFF_START = re.compile(rb"(?:\s|#[^\n]*\n)*(?:ST)?C?N?OFF\b")
MAX_TRIANGLES = 2_000_000  # of a mesh
MAX_FACE_CORNERS = 1024  # of a face
MAX_VERTICES = 3 * MAX_TRIANGLES  # of a mesh: STL repeats the corners of each triangle
Floats = NDArray[np.float64]
Indices = NDArray[np.int64]


def read_stl(data: bytes) -> RawMesh:
    """The triangles of an STL file; those of several solids are joined.

    Raises ValueError if it is neither text with whole facets, nor binary with the triangles that it
    states.
    """
    stated = STL_HEADER.unpack_from(data)[0] if len(data) >= STL_HEADER.size else 0
    n_tail = len(data) - STL_HEADER.size - stated * STL_TRIANGLE.itemsize
    text = data.removeprefix(BOM).lstrip()
    if n_tail != 0 and text[:5].lower() == b"solid" and b"\0" not in data[: STL_HEADER.size]:
        return _read_text(text.lower())
    if len(data) < STL_HEADER.size or n_tail < 0:
        n_held = max(0, len(data) - STL_HEADER.size) // STL_TRIANGLE.itemsize
        raise ValueError(f"is cut short: it states {stated} triangles and has {n_held}")
    if n_tail and n_tail % STL_TRIANGLE.itemsize == 0:
        n_held = stated + n_tail // STL_TRIANGLE.itemsize
        raise ValueError(f"states {stated} triangles and has {n_held}")
    check_counts(0, stated)
    corners = np.frombuffer(data, STL_TRIANGLE, stated, STL_HEADER.size)["corners"]
    return _unmerged(as_float64(corners), tail_note(n_tail))


def tail_note(count: int) -> tuple[str, ...]:
    """A note on bytes after the end of a mesh, if any."""
    return (f"{count} byte{'s' * (count != 1)} after its end ignored",) if count else ()


def _read_text(text: bytes) -> RawMesh:
    if not _END.search(text, text.rfind(b"endfacet") + len(b"endfacet")):
        raise ValueError("is cut short: its last solid has no end")
    text = _NAME.sub(b"", text)
    corners, words = _CORNER.findall(text), _FACET_WORD.findall(text)
    check_counts(len(corners), 0)
    facets = words.count(b"endfacet")
    if words != [b"vertex", b"vertex", b"vertex", b"endfacet"] * facets:
        raise ValueError(f"has {len(words) - facets} corners in {facets} facets")
    numbers = parse_numbers(b"\n".join(corners))
    if len(numbers) != 3 * len(corners) or len(corners) != 3 * facets:
        raise ValueError("has a corner that is not three numbers")
    return _unmerged(numbers)


def _unmerged(corners: Floats, notes: tuple[str, ...] = ()) -> RawMesh:
    vertices = corners.reshape(-1, 3)
    return RawMesh(vertices, np.arange(len(vertices), dtype=np.int64).reshape(-1, 3), notes)


def read_obj(data: bytes) -> RawMesh:
    """The vertices and faces of an OBJ file; other files that it names are not opened.

    Raises ValueError if a vertex has no three numbers, or a vertex of a face does not exist.
    """
    vertices: list[bytes] = []
    faces: list[bytes] = []
    n_before: list[int] = []  # number of vertices before each face
    for line in _CONTINUED.sub(b" ", data.removeprefix(BOM)).splitlines():
        words = line.split(None, 1)
        if len(words) < 2:
            continue
        if words[0] == b"v":
            vertices.append(b" ".join(words[1].split(None, 3)[:3]))
        elif words[0] == b"f":
            faces.append(words[1])
            n_before.append(len(vertices))
    check_counts(len(vertices), len(faces))
    numbers = parse_numbers(b"\n".join(vertices))
    if len(numbers) != 3 * len(vertices):
        raise ValueError("has a vertex that is not three numbers")
    polygons = _obj_polygons(b"\n".join(faces), np.array(n_before, np.int64))
    return polygon_mesh(numbers.reshape(-1, 3), polygons)


def _obj_polygons(text: bytes, n_before: Indices) -> Ragged:
    """Indices of vertices in lines ``1/2/3 -1 4``; negative ones count back from the last."""
    text = _COMMENT.sub(b"", text)
    if (fault := _NO_INDEX.search(text)) is not None:
        word = fault.group(1)[:20].decode(errors="replace")
        raise ValueError(f"has a face with the corner {word!r}")
    text = _TEXTURE_AND_NORMAL.sub(b"", text)
    letters = np.frombuffer(b"\n" + text, np.uint8)
    blank = np.isin(letters, np.frombuffer(b" \t\n\v\f\r", np.uint8))
    begins = np.flatnonzero(blank[:-1] & ~blank[1:])
    face = np.cumsum(letters == ord("\n"))[begins] - 1
    numbers = parse_numbers(text).astype(np.int64)
    corners = np.where(numbers > 0, numbers - 1, n_before[face] + numbers)
    corners[numbers == 0] = -1
    return Ragged(np.bincount(face, minlength=len(n_before)), corners)


def read_off(data: bytes) -> RawMesh:
    """The mesh of an OFF file; colours and normals are ignored.

    Raises ValueError if it does not begin with OFF, or does not hold what it states.
    """
    data = data.removeprefix(BOM)
    start = _OFF_START.match(data)
    if start is None:
        raise ValueError("does not begin with OFF")
    stripped = (line.partition(b"#")[0].strip() for line in data[start.end() :].splitlines())
    lines = [line for line in stripped if line]
    counts = b" ".join(lines[:3]).split()
    try:
        vertices, faces = int(counts[0]), int(counts[1])
    except (IndexError, ValueError):
        raise ValueError("does not state how many vertices and faces it has") from None
    check_counts(vertices, faces)
    if len(lines) < 1 + vertices + faces:
        if start.group().strip() == b"OFF":
            lines = _off_lines(b" ".join(lines).split(), vertices, faces)
        else:
            raise _off_cut_short(vertices, faces, len(lines) - 1)
    rows = (b" ".join(row.split(None, 3)[:3]) for row in lines[1:][:vertices])
    places = parse_numbers(b"\n".join(rows))
    if len(places) != 3 * vertices:
        raise ValueError("has a vertex that is not three numbers")
    polygons = _off_polygons(lines[1 + vertices :][:faces])
    return polygon_mesh(places.reshape(-1, 3), polygons)


def _off_lines(words: list[bytes], vertices: int, faces: int) -> list[bytes]:
    """Lines of a file without colours that has other line breaks, or none."""
    at = 3 + 3 * vertices
    lines = [b" ".join(words[:3])]
    lines += [b" ".join(words[begin : begin + 3]) for begin in range(3, min(at, len(words)), 3)]
    while at < len(words) and len(lines) < 1 + vertices + faces:
        count = int(words[at]) if words[at].isdigit() and len(words[at]) < 10 else len(words)
        if at + 1 + count > len(words):
            break
        lines.append(b" ".join(words[at : at + 1 + count]))
        at += 1 + count
    if len(lines) < 1 + vertices + faces:
        raise _off_cut_short(vertices, faces, len(lines) - 1)
    return lines


def _off_cut_short(vertices: int, faces: int, held: int) -> ValueError:
    return ValueError(f"states {vertices} vertices and {faces} faces, and has {held} lines of them")


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
    """Contents of a mesh file, of which only the form is checked."""

    vertices: Floats  # (n, 3), in the file's unit
    faces: Indices  # (m, 3); empty if the file has only points
    notes: tuple[str, ...] = ()  # on what was ignored, each a part of a sentence
    normals: Floats | None = None  # at the vertices, (n, 3), if the format has them


class Ragged(NamedTuple):
    """Lists of numbers, concatenated."""

    lengths: Indices  # (n,)
    items: NDArray[np.generic]  # of all lists in their order


NO_POLYGONS = Ragged(np.zeros(0, np.int64), np.zeros(0, np.int64))


def parse_numbers(text: bytes) -> Floats:
    """All numbers in a text; ValueError if it has anything else than numbers and blanks."""
    if not text.strip():  # numpy reads a number in it
        return np.zeros(0)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            return np.fromstring(text, dtype=np.float64, sep=" ")
        except (DeprecationWarning, ValueError):
            raise ValueError("has something else where there must be numbers") from None


def as_float64(values: NDArray[np.generic]) -> Floats:
    """Numbers in double precision, without warnings of NaN."""
    with np.errstate(invalid="ignore"):
        return values.astype(np.float64)


def check_counts(vertices: int, faces: int) -> None:
    """Raise ValueError for a mesh that is too large, or negative counts."""
    if not 0 <= vertices <= MAX_VERTICES:
        raise ValueError(f"states {vertices} vertices; there may be 0 to {MAX_VERTICES}")
    if not 0 <= faces <= MAX_TRIANGLES:
        raise ValueError(f"states {faces} faces; there may be 0 to {MAX_TRIANGLES}")


def polygon_mesh(vertices: Floats, polygons: Ragged, notes: tuple[str, ...] = ()) -> RawMesh:
    """Vertices (n, 3) and their polygons, cut into triangles in their own planes.

    Raises ValueError if a polygon has fewer than 3 or more than `MAX_FACE_CORNERS` corners, is not
    planar or crosses itself, if a corner is no whole number, or if there are too many triangles.
    """
    lengths, items = polygons
    if not len(lengths):
        return RawMesh(vertices, np.zeros((0, 3), np.int64), notes)
    if lengths.min() < 3:
        raise ValueError(f"has a face of {lengths.min()} corners; a face has three or more")
    if (n_corners := lengths.max()) > MAX_FACE_CORNERS:
        raise ValueError(f"has a face of {n_corners} corners; at most {MAX_FACE_CORNERS} are read")
    check_counts(0, len(items) - 2 * len(lengths))
    corners = _whole_numbers(items)
    if n_corners > 3:
        _check_corners(vertices, lengths, corners)
    return RawMesh(vertices, cut_faces(vertices, lengths, corners).astype(np.int64), notes)


def _check_corners(vertices: Floats, lengths: Indices, corners: Indices) -> None:
    outside = (corners < 0) | (corners >= len(vertices))
    if outside.any():
        face = int(np.searchsorted(np.cumsum(lengths), outside.argmax(), side="right"))
        raise ValueError(f"has a face, number {face + 1}, of a vertex that does not exist")
    finite = np.asarray(np.isfinite(vertices).all(axis=1))
    if not finite[corners].all():
        raise ValueError(f"has a vertex, number {int(np.argmin(finite))}, that is not finite")


def _whole_numbers(items: NDArray[np.generic]) -> Indices:
    if items.dtype.kind == "f":
        with np.errstate(invalid="ignore"):
            numbers = items.astype(np.int64)
        if not np.array_equal(numbers, items):
            raise ValueError("has a face with a corner that is no whole number")
        return numbers
    return items.astype(np.int64)
