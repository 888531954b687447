"""STL, OBJ, OFF and GLB, read with distrust.

Counts, offsets and sizes are checked before anything is allocated.

trimesh was tried: on 400 damaged files it ran over 10 s twice, took 161 MB for a file of 1 MB,
and raised RecursionError.
"""

from __future__ import annotations

import math
import re
import struct
import warnings
from collections.abc import Sequence
from typing import Any, NamedTuple, TypeVar

import msgspec
import numpy as np
from numpy.typing import NDArray

from palpate.core import rotation_matrix

STL_HEADER = struct.Struct("<80xI")
STL_TRIANGLE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
_CORNER = re.compile(rb"^[ \t]*vertex[ \t]([^\r\n]*)", re.MULTILINE)
_OFF_START = re.compile(rb"\s*(?:ST)?C?N?OFF\b")
MAX_TRIANGLES = 2_000_000  # Of a mesh
MAX_FACE_CORNERS = 1024  # Of a face; cut into triangles about its first: no rounder ones
MAX_VERTICES = 3 * MAX_TRIANGLES  # Of a mesh: STL repeats each corner for each triangle
Floats = NDArray[np.float64]
Indices = NDArray[np.int64]
NO_FACES = np.zeros((0, 3), np.int64)
MAX_JSON_BYTES = 1 << 20  # Of the part that describes the others, bytes
TRIANGLE_MODE = 4  # Mode of a primitive
_HEAD = struct.Struct("<4sII")
_CHUNK = struct.Struct("<II")
_JSON, _BIN = 0x4E4F534A, 0x004E4942
UNSIGNED = 5125  # Of whole numbers of 4 bytes
_INDICES = {5121: "<u1", 5123: "<u2", UNSIGNED: "<u4"}
FLOAT = 5126
UNIT_ERROR = 1e-3  # By which a quaternion's length may differ from 1: files round
Part = TypeVar("Part")
Quaternion = tuple[float, float, float, float]
Vector = tuple[float, float, float]


def read_stl(data: bytes) -> RawMesh:
    """The triangles of an STL file; those of several solids are put together.

    ValueError if it is neither text with whole facets nor binary of the length that it states.
    """
    if len(data) >= STL_HEADER.size:
        (count,) = STL_HEADER.unpack_from(data)
        if len(data) == STL_HEADER.size + count * STL_TRIANGLE.itemsize:
            check_counts(0, count)
            found = np.frombuffer(data, STL_TRIANGLE, offset=STL_HEADER.size)["corners"]
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
    vertices = corners.reshape(-1, 3)
    return RawMesh(vertices, np.arange(len(vertices), dtype=np.int64).reshape(-1, 3))


def read_obj(data: bytes) -> RawMesh:
    """The vertices and faces of an OBJ file; no other file that it names is opened.

    Raises ValueError if a vertex has no three numbers, or a face names a vertex that is none.
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

    Raises ValueError if it does not begin with OFF, or has not what it states.
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
    rows = (b" ".join(row.split(None, 3)[:3]) for row in lines[1:][:vertices])
    places = parse_numbers(b"\n".join(rows))
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
    """What a file holds, unchecked but for its form."""

    vertices: Floats  # (n, 3), in the file's unit
    faces: Indices  # (m, 3); none if the file holds points alone
    normals: Floats | None = (
        None  # At the vertices, (n, 3), if the format has them and they are read
    )


class Ragged(NamedTuple):
    """Lists of numbers, end to end."""

    lengths: Indices  # (n,)
    items: NDArray[np.generic]  # All items of the first list, then all of the second


def parse_numbers(text: bytes) -> Floats:
    """All numbers in a text; ValueError if there is anything else but blanks."""
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
    """Refuse a mesh that is too large, or counts that are none, by a ValueError."""
    if not 0 <= vertices <= MAX_VERTICES:
        raise ValueError(f"states {vertices} vertices; there may be 0 to {MAX_VERTICES}")
    if not 0 <= faces <= MAX_TRIANGLES:
        raise ValueError(f"states {faces} faces; there may be 0 to {MAX_TRIANGLES}")


def triangulate(polygons: Ragged) -> Indices:
    """Polygons cut into triangles (m, 3) about their first corners.

    Raises ValueError if a polygon has fewer than three corners or far too many, if a corner is no
    whole number, or if there are too many triangles.
    """
    lengths, items = polygons
    if not len(lengths):
        return NO_FACES
    if lengths.min() < 3:
        raise ValueError(f"has a face of {lengths.min()} corners; a face has three or more")
    if (most := lengths.max()) > MAX_FACE_CORNERS:
        raise ValueError(f"has a face of {most} corners; at most {MAX_FACE_CORNERS} are read")
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


class Accessor(msgspec.Struct, frozen=True, rename="camel"):
    """How numbers lie in a view."""

    component_type: int
    count: int
    type: str
    buffer_view: int | None = None
    byte_offset: int = 0
    sparse: dict[str, Any] | None = None


class BufferView(msgspec.Struct, frozen=True, rename="camel"):
    """A stretch of the data."""

    buffer: int
    byte_length: int
    byte_offset: int = 0
    byte_stride: int | None = None


class Primitive(msgspec.Struct, frozen=True):
    """One piece of a mesh."""

    attributes: dict[str, int]
    indices: int | None = None
    mode: int = TRIANGLE_MODE


class GltfMesh(msgspec.Struct, frozen=True):
    """A mesh of pieces."""

    primitives: tuple[Primitive, ...]


class Gltf(msgspec.Struct, frozen=True, rename="camel"):
    """What of the description is read."""

    meshes: tuple[GltfMesh, ...] = ()
    nodes: tuple[GltfNode, ...] = ()
    accessors: tuple[Accessor, ...] = ()
    buffer_views: tuple[BufferView, ...] = ()


def read_glb(data: bytes) -> RawMesh:
    """The one mesh in a GLB file, in its own directions: y is up.

    ValueError if the file has not what it states, or holds not exactly one mesh of one piece.
    """
    described, held = _chunks(data)
    try:
        gltf = msgspec.json.decode(described, type=Gltf)
    except (msgspec.MsgspecError, RecursionError, UnicodeDecodeError) as error:
        raise ValueError(f"is described by something else than glTF: {error!s:.80}") from None
    pieces = [piece for mesh in gltf.meshes for piece in mesh.primitives]
    if len(pieces) != 1:
        raise ValueError(f"holds {len(pieces)} meshes; there must be exactly one")
    (piece,) = pieces
    if piece.mode != TRIANGLE_MODE:
        raise ValueError(f"holds no triangles but a mesh of mode {piece.mode}")
    found = _accessor_values(gltf, held, piece.attributes.get("POSITION"), "VEC3", {FLOAT: "<f4"})
    vertices = apply_node_transform(as_float64(found), gltf.nodes)
    if piece.indices is None:
        corners = np.arange(len(vertices), dtype=np.int64)
    else:
        numbers = _accessor_values(gltf, held, piece.indices, "SCALAR", _INDICES)
        corners = numbers.astype(np.int64).ravel()
    if len(corners) % 3:
        raise ValueError(f"has triangles of {len(corners)} corners in all")
    check_counts(len(vertices), len(corners) // 3)
    return RawMesh(vertices, corners.reshape(-1, 3))


def _chunks(data: bytes) -> tuple[bytes, memoryview]:
    if len(data) < _HEAD.size + _CHUNK.size:
        raise ValueError("is cut short")
    magic, version, length = _HEAD.unpack_from(data)
    if magic != b"glTF" or version != 2:
        raise ValueError("does not begin as glTF 2 does")
    if length != len(data):
        raise ValueError(f"has {len(data)} bytes and states {length}")
    size, kind = _CHUNK.unpack_from(data, _HEAD.size)
    begin = _HEAD.size + _CHUNK.size
    if kind != _JSON or size > min(MAX_JSON_BYTES, len(data) - begin):
        raise ValueError(f"has no description, or one of more than {MAX_JSON_BYTES >> 10} kB")
    after = begin + size
    if len(data) < after + _CHUNK.size:
        return data[begin:after], memoryview(b"")
    held, kind = _CHUNK.unpack_from(data, after)
    after += _CHUNK.size
    if kind != _BIN or held > len(data) - after:
        raise ValueError("is cut short, or has no data where they must be")
    return data[begin : begin + size], memoryview(data)[after : after + held]


def glb_of(described: bytes, data: bytes) -> bytes:
    """A GLB file of a description in JSON and its data, each filled up to whole words."""
    described += b" " * (-len(described) % 4)
    data += bytes(-len(data) % 4)
    size = _HEAD.size + 2 * _CHUNK.size + len(described) + len(data)
    head = _HEAD.pack(b"glTF", 2, size) + _CHUNK.pack(len(described), _JSON)
    return head + described + _CHUNK.pack(len(data), _BIN) + data


def _accessor_values(
    gltf: Gltf, held: memoryview, number: int | None, shape: str, kinds: dict[int, str]
) -> NDArray[np.generic]:
    accessor = _at(gltf.accessors, number)
    if (accessor.type, accessor.sparse) != (shape, None) or accessor.component_type not in kinds:
        raise ValueError(f"has numbers of a kind that is not read: {accessor.type[:40]!r}")
    view = _at(gltf.buffer_views, accessor.buffer_view)
    width = 3 if shape == "VEC3" else 1
    kind = np.dtype(kinds[accessor.component_type])
    stride = view.byte_stride or width * kind.itemsize
    span = (accessor.count - 1) * stride + width * kind.itemsize
    numbers = (accessor.count, accessor.byte_offset, view.byte_offset, view.byte_length)
    fits = min(numbers) >= 0 and view.buffer == 0 and stride >= width * kind.itemsize
    within = accessor.byte_offset + span <= view.byte_length
    if not (fits and within and view.byte_offset + view.byte_length <= len(held)):
        raise ValueError(f"states {accessor.count} numbers that it does not hold")
    if accessor.count == 0:
        return np.zeros((0, width), kind)
    start = view.byte_offset + accessor.byte_offset
    return np.ndarray((accessor.count, width), kind, held, start, (stride, kind.itemsize))


def _at(parts: Sequence[Part], number: int | None) -> Part:
    if number is None or not 0 <= number < len(parts):
        raise ValueError("names a part that does not exist")
    return parts[number]


def apply_node_transform(vertices: Floats, nodes: Sequence[GltfNode]) -> Floats:
    """Vertices (n, 3) of the only mesh, where the node that has it puts them.

    Raises ValueError if several nodes have it, or a node has several parents or is its own.
    """
    have = [number for number, node in enumerate(nodes) if node.mesh is not None]
    if len(have) > 1:
        raise ValueError(f"puts its mesh in {len(have)} places; there must be one")
    if not have:
        return vertices
    parents = _parents(nodes)
    number: int | None = have[0]
    whole = np.eye(4)
    for _ in range(len(nodes) + 1):
        with np.errstate(over="ignore", invalid="ignore"):  # what is not finite is looked for later
            if number is None:
                return np.asarray(vertices @ whole[:3, :3].T + whole[:3, 3])
            whole = _node_matrix(nodes[number]) @ whole
        number = parents.get(number)
    raise ValueError("has a node that is within itself")


def _parents(nodes: Sequence[GltfNode]) -> dict[int, int]:
    parents: dict[int, int] = {}
    for number, node in enumerate(nodes):
        for child in node.children:
            if child in parents:
                raise ValueError(f"has a node {child} that is within two others")
            parents[child] = number
    return parents


def _node_matrix(node: GltfNode) -> Floats:
    if node.matrix is not None:
        if len(node.matrix) != 16:
            raise ValueError(f"has a node with a matrix of {len(node.matrix)} numbers")
        return np.array(node.matrix, np.float64).reshape(4, 4).T
    length = math.hypot(*node.rotation)
    if not abs(length - 1.0) <= UNIT_ERROR:
        raise ValueError(f"has a node whose rotation has the length {length:g}, not 1")
    motion = np.eye(4)
    motion[:3, :3] = rotation_matrix(np.array(node.rotation) / length) * np.array(node.scale)
    motion[:3, 3] = node.translation
    return motion


class GltfNode(msgspec.Struct, frozen=True):
    """A place, within that of the node whose child it is."""

    mesh: int | None = None
    children: tuple[int, ...] = ()
    matrix: tuple[float, ...] | None = None
    translation: Vector = (0.0, 0.0, 0.0)
    rotation: Quaternion = (0.0, 0.0, 0.0, 1.0)
    scale: Vector = (1.0, 1.0, 1.0)
