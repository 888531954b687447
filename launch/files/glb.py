"""GLB: one mesh of one piece, where its node puts it; colours and all else are passed over."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from typing import Any, TypeVar

import msgspec
import numpy as np
from numpy.typing import NDArray

from palpate.launch.files.mesh_formats import Floats, RawMesh, as_float64, check_counts

MAX_JSON_BYTES = 1 << 20  # Of the part that describes the others, bytes
TRIANGLE_MODE = 4  # Mode of a primitive
_HEAD = struct.Struct("<4sII")
_CHUNK = struct.Struct("<II")
_JSON, _BIN = 0x4E4F534A, 0x004E4942
_INDICES = {5121: "<u1", 5123: "<u2", 5125: "<u4"}
_FLOAT = 5126
Part = TypeVar("Part")
Quaternion = tuple[float, float, float, float]
Vector = tuple[float, float, float]


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

    Raises
    ------
    ValueError
        If the file has not what it states, or does not hold exactly one mesh of one piece.
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
    found = _accessor_values(gltf, held, piece.attributes.get("POSITION"), "VEC3", {_FLOAT: "<f4"})
    vertices = apply_node_transform(as_float64(found), gltf.nodes)
    if piece.indices is None:
        corners = np.arange(len(vertices), dtype=np.int64)
    else:
        corners = (
            _accessor_values(gltf, held, piece.indices, "SCALAR", _INDICES).astype(np.int64).ravel()
        )
    if len(corners) % 3:
        raise ValueError(f"has triangles of {len(corners)} corners in all")
    check_counts(len(vertices), len(corners) // 3)
    return RawMesh(vertices, corners.reshape(-1, 3))


def _chunks(data: bytes) -> tuple[bytes, memoryview]:
    """The description, and the data behind it."""
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


def _accessor_values(
    gltf: Gltf, held: memoryview, number: int | None, shape: str, kinds: dict[int, str]
) -> NDArray[np.generic]:
    """Numbers (n, 1 or 3) that an accessor tells of."""
    accessor = _at(gltf.accessors, number)
    if (
        accessor.type != shape
        or accessor.component_type not in kinds
        or accessor.sparse is not None
    ):
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
    steps = (stride, kind.itemsize)
    return np.ndarray((accessor.count, width), kind, held, start, steps)


def _at(parts: Sequence[Part], number: int | None) -> Part:
    if number is None or not 0 <= number < len(parts):
        raise ValueError("names a part that does not exist")
    return parts[number]


def apply_node_transform(vertices: Floats, nodes: Sequence[GltfNode]) -> Floats:
    """Vertices (n, 3) of the only mesh, where the node that has it puts them.

    Raises
    ------
    ValueError
        If several nodes have it, or a node has several parents or is its own.
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
                return _transformed(vertices, whole)
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


def _transformed(vertices: Floats, motion: Floats) -> Floats:
    moved: Floats = vertices @ motion[:3, :3].T + motion[:3, 3]
    return moved


def _node_matrix(node: GltfNode) -> Floats:
    """The (4, 4) matrix from a node's frame to that around it."""
    if node.matrix is not None:
        if len(node.matrix) != 16:
            raise ValueError(f"has a node with a matrix of {len(node.matrix)} numbers")
        return np.array(node.matrix, np.float64).reshape(4, 4).T
    motion = np.eye(4)
    motion[:3, :3] = _rotation_matrix(node.rotation) * np.array(node.scale)
    motion[:3, 3] = node.translation
    return motion


def _rotation_matrix(rotation: Quaternion) -> Floats:
    x, y, z, w = rotation
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


class GltfNode(msgspec.Struct, frozen=True):
    """A place, within that of the node whose child it is."""

    mesh: int | None = None
    children: tuple[int, ...] = ()
    matrix: tuple[float, ...] | None = None
    translation: Vector = (0.0, 0.0, 0.0)
    rotation: Quaternion = (0.0, 0.0, 0.0, 1.0)
    scale: Vector = (1.0, 1.0, 1.0)
