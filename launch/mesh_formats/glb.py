"""GLB: one mesh of one piece, where its node puts it; colours and all else are passed over."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from typing import Any, TypeVar

import msgspec
import numpy as np
from numpy.typing import NDArray

from palpate.launch.mesh_formats.glb_nodes import Node, placed
from palpate.launch.mesh_formats.raw import RawMesh, check_counts, doubles

MOST_TEXT = 1 << 20
"""Of the part that describes the others, bytes."""
TRIANGLES = 4
"""Mode of a primitive."""

_HEAD = struct.Struct("<4sII")
_CHUNK = struct.Struct("<II")
_JSON, _BIN = 0x4E4F534A, 0x004E4942
_INDICES = {5121: "<u1", 5123: "<u2", 5125: "<u4"}
_FLOAT = 5126

Part = TypeVar("Part")


class Accessor(msgspec.Struct, frozen=True, rename="camel"):
    """How numbers lie in a view."""

    component_type: int
    count: int
    type: str
    buffer_view: int | None = None
    byte_offset: int = 0
    sparse: dict[str, Any] | None = None


class View(msgspec.Struct, frozen=True, rename="camel"):
    """A stretch of the data."""

    buffer: int
    byte_length: int
    byte_offset: int = 0
    byte_stride: int | None = None


class Primitive(msgspec.Struct, frozen=True):
    """One piece of a mesh."""

    attributes: dict[str, int]
    indices: int | None = None
    mode: int = TRIANGLES


class GltfMesh(msgspec.Struct, frozen=True):
    """A mesh of pieces."""

    primitives: tuple[Primitive, ...]


class Gltf(msgspec.Struct, frozen=True, rename="camel"):
    """What of the description is read."""

    meshes: tuple[GltfMesh, ...] = ()
    nodes: tuple[Node, ...] = ()
    accessors: tuple[Accessor, ...] = ()
    buffer_views: tuple[View, ...] = ()


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
    if piece.mode != TRIANGLES:
        raise ValueError(f"holds no triangles but a mesh of mode {piece.mode}")
    found = _column(gltf, held, piece.attributes.get("POSITION"), "VEC3", {_FLOAT: "<f4"})
    vertices = placed(doubles(found), gltf.nodes)
    if piece.indices is None:
        corners = np.arange(len(vertices), dtype=np.int64)
    else:
        corners = _column(gltf, held, piece.indices, "SCALAR", _INDICES).astype(np.int64).ravel()
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
    if kind != _JSON or size > min(MOST_TEXT, len(data) - begin):
        raise ValueError(f"has no description, or one of more than {MOST_TEXT >> 10} kB")
    after = begin + size
    if len(data) < after + _CHUNK.size:
        return data[begin:after], memoryview(b"")
    held, kind = _CHUNK.unpack_from(data, after)
    after += _CHUNK.size
    if kind != _BIN or held > len(data) - after:
        raise ValueError("is cut short, or has no data where they must be")
    return data[begin : begin + size], memoryview(data)[after : after + held]


def _column(
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
