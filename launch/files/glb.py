"""GLB, the binary form of glTF 2: all triangles of the scene that an untrusted file shows.

Materials, textures, cameras, skins and animations are ignored. Source: Khronos, glTF 2.0
specification, sections 3.5 to 3.7 and 4.4.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple, TypeVar

import msgspec
import numpy as np
from numpy.typing import NDArray

from palpate.core.poses import rotation_matrix
from palpate.launch.files.mesh_formats import (
    Floats,
    Indices,
    RawMesh,
    as_float64,
    check_counts,
    tail_note,
)

MAX_JSON_BYTES = 1 << 20  # of the description
# Modes of primitives.
POINT_AND_LINE_MODES = (0, 1, 2, 3)
TRIANGLE_MODE, STRIP_MODE, FAN_MODE = 4, 5, 6
_HEAD = struct.Struct("<4sII")
_CHUNK = struct.Struct("<II")
_JSON, _BIN = 0x4E4F534A, 0x004E4942  # types of chunks
UNSIGNED, FLOAT = 5125, 5126  # types of numbers of 4 bytes
_INDICES = {5121: "<u1", 5123: "<u2", UNSIGNED: "<u4"}
_COORDINATES = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", FLOAT: "<f4"}
# Prefixes of extensions that a file may require: they change no triangle, or are read.
HARMLESS_EXTENSIONS = (
    *("KHR_materials_", "KHR_texture_", "EXT_texture_", "MSFT_texture_"),
    *("KHR_lights_", "KHR_mesh_quantization", "KHR_xmp", "KHR_animation_"),
)
Part = TypeVar("Part")
Quaternion = tuple[float, float, float, float]
Vector = tuple[float, float, float]
IDENTITY_ROTATION: Quaternion = (0.0, 0.0, 0.0, 1.0)
UNIT_SCALE: Vector = (1.0, 1.0, 1.0)


class Accessor(msgspec.Struct, frozen=True, rename="camel"):
    """Layout of numbers in a view."""

    component_type: int
    count: int
    type: str
    buffer_view: int | None = None
    byte_offset: int = 0
    normalized: bool = False
    sparse: dict[str, Any] | None = None


class BufferView(msgspec.Struct, frozen=True, rename="camel"):
    """A range of the data."""

    buffer: int
    byte_length: int
    byte_offset: int = 0
    byte_stride: int | None = None


class Buffer(msgspec.Struct, frozen=True):
    """The data; in another file if it has a URI."""

    uri: str | None = None


class Primitive(msgspec.Struct, frozen=True):
    """A piece of a mesh."""

    attributes: dict[str, int]
    indices: int | None = None
    mode: int = TRIANGLE_MODE


class GltfMesh(msgspec.Struct, frozen=True):
    """A mesh, made of pieces."""

    primitives: tuple[Primitive, ...]


class GltfNode(msgspec.Struct, frozen=True):
    """A transform, relative to the parent node, of a mesh and children."""

    mesh: int | None = None
    children: tuple[int, ...] = ()
    matrix: tuple[float, ...] | None = None
    translation: Vector = (0.0, 0.0, 0.0)
    rotation: Quaternion = IDENTITY_ROTATION
    scale: Vector = UNIT_SCALE


class GltfScene(msgspec.Struct, frozen=True):
    """Root nodes that are shown together."""

    nodes: tuple[int, ...] = ()


class Gltf(msgspec.Struct, frozen=True, rename="camel"):
    """The parts of the description that are read."""

    scene: int | None = None
    scenes: tuple[GltfScene, ...] = ()
    meshes: tuple[GltfMesh, ...] = ()
    nodes: tuple[GltfNode, ...] = ()
    accessors: tuple[Accessor, ...] = ()
    buffer_views: tuple[BufferView, ...] = ()
    buffers: tuple[Buffer, ...] = ()
    extensions_required: tuple[str, ...] = ()


class Placed(NamedTuple):
    """A mesh by its number, with the transform of a node."""

    mesh: int
    transform: Floats  # (4, 4)


def read_glb(data: bytes) -> RawMesh:
    """All triangles of the scene that a GLB file shows, in its own frame, with y up.

    The notes name joined and ignored pieces. Raises ValueError if the file does not hold what it
    states, needs an extension that is not read, or shows no triangles.
    """
    description, contents, n_tail = _chunks(data)
    try:
        gltf = msgspec.json.decode(description, type=Gltf)
    except (msgspec.MsgspecError, RecursionError, UnicodeDecodeError) as error:
        raise ValueError(f"is described by something else than glTF: {error!s:.80}") from None
    _check_extensions(gltf)
    placed = list(_placed_meshes(gltf))
    vertices, faces = [np.zeros((0, 3))], [np.zeros((0, 3), np.int64)]
    n_pieces = n_ignored = n_vertices = n_faces = 0
    for mesh, transform in placed:
        for piece in _at(gltf.meshes, mesh).primitives:
            if piece.mode in POINT_AND_LINE_MODES:
                n_ignored += 1
                continue
            points, corners = _read_piece(gltf, contents, piece)
            n_pieces, n_faces = n_pieces + 1, n_faces + len(corners)
            check_counts(n_vertices + len(points), n_faces)
            vertices.append(apply_transform(transform, points))
            is_mirrored = np.linalg.det(transform[:3, :3]) < 0.0
            faces.append(n_vertices + (corners[:, ::-1] if is_mirrored else corners))
            n_vertices += len(points)
    if not n_pieces:
        raise ValueError("shows no triangles" + " but points or lines" * (n_ignored > 0))
    n_unused = len(gltf.meshes) - len({item.mesh for item in placed})
    notes = _notes(n_pieces, n_ignored, n_unused)
    return RawMesh(np.concatenate(vertices), np.concatenate(faces), notes + tail_note(n_tail))


def _notes(n_pieces: int, n_ignored: int, n_unused: int) -> tuple[str, ...]:
    counts = (
        (n_pieces if n_pieces > 1 else 0, "piece", "put together"),
        (n_ignored, "piece", "of points or lines left out"),
        (n_unused, "mesh", "that the scene does not show left out"),
    )
    plural = {"piece": "pieces", "mesh": "meshes"}
    return tuple(
        f"{count} {noun if count == 1 else plural[noun]} {text}"
        for count, noun, text in counts
        if count
    )


def _check_extensions(gltf: Gltf) -> None:
    for name in gltf.extensions_required:
        if not name.startswith(HARMLESS_EXTENSIONS):
            fault = "is compressed with" if "compression" in name else "needs the extension"
            raise ValueError(f"{fault} {name[:60]}, which is not read; export it without")
    for buffer in gltf.buffers[:1]:
        if buffer.uri is not None:
            raise ValueError(f"keeps its data elsewhere, in {buffer.uri[:40]!r}; export it whole")


def _placed_meshes(gltf: Gltf) -> Iterator[Placed]:
    """The meshes of the scene, once for each node with the mesh; of all nodes without a scene.

    Raises ValueError if a node has several parents, or is an ancestor of itself.
    """
    _check_parents(gltf.nodes)
    if gltf.scenes:
        roots = _at(gltf.scenes, gltf.scene or 0).nodes
    else:
        children = {child for node in gltf.nodes for child in node.children}
        roots = tuple(number for number in range(len(gltf.nodes)) if number not in children)
    if not any(node.mesh is not None for node in gltf.nodes):
        yield from (Placed(number, np.eye(4)) for number in range(len(gltf.meshes)))
        return
    waiting = [(root, np.eye(4)) for root in reversed(roots)]
    while waiting:
        number, outer = waiting.pop()
        node = _at(gltf.nodes, number)
        with np.errstate(over="ignore", invalid="ignore"):  # finiteness is checked later
            transform = outer @ _node_matrix(node)
        if node.mesh is not None:
            yield Placed(node.mesh, transform)
        waiting += [(child, transform) for child in reversed(node.children)]


def _check_parents(nodes: Sequence[GltfNode]) -> None:
    parents: dict[int, int] = {}
    for outer, node in enumerate(nodes):
        for child in node.children:
            if child in parents:
                raise ValueError(f"has a node {child} that is within two others")
            parents[child] = outer
    checked: set[int] = set()
    for start in range(len(nodes)):
        path: set[int] = set()
        number: int | None = start
        while number is not None and number not in checked:
            if number in path:
                raise ValueError("has a node that is within itself")
            path.add(number)
            number = parents.get(number)
        checked |= path


def _node_matrix(node: GltfNode, max_length_error: float = 1e-3) -> Floats:
    """Transform (4, 4) of a node; `max_length_error` of its quaternion allows for rounding."""
    if node.matrix is not None:
        if len(node.matrix) != 16:
            raise ValueError(f"has a node with a matrix of {len(node.matrix)} numbers")
        return np.array(node.matrix, np.float64).reshape(4, 4).T
    length = math.hypot(*node.rotation)
    if not abs(length - 1.0) <= max_length_error:
        raise ValueError(f"has a node whose rotation has the length {length:g}, not 1")
    motion = np.eye(4)
    if node.rotation != IDENTITY_ROTATION or node.scale != UNIT_SCALE:
        motion[:3, :3] = rotation_matrix(np.array(node.rotation) / length) * np.array(node.scale)
    motion[:3, 3] = node.translation
    return motion


def apply_transform(transform: Floats, vertices: Floats) -> Floats:
    """Vertices (n, 3) transformed by (4, 4)."""
    with np.errstate(over="ignore", invalid="ignore"):
        return np.asarray(vertices @ transform[:3, :3].T + transform[:3, 3])


def _read_piece(gltf: Gltf, contents: memoryview, piece: Primitive) -> tuple[Floats, Indices]:
    """Vertices (n, 3) and triangles (m, 3) of a primitive."""
    accessor = _at(gltf.accessors, piece.attributes.get("POSITION"))
    values = _accessor_values(gltf, contents, accessor, "VEC3", _COORDINATES)
    vertices = as_float64(values)
    kind: np.dtype[Any] = values.dtype
    if accessor.normalized and kind.kind in "iu":
        vertices = np.maximum(vertices / np.iinfo(kind).max, -1.0)
    if piece.indices is None:
        corners = np.arange(len(vertices), dtype=np.int64)
    else:
        numbers = _at(gltf.accessors, piece.indices)
        indices = _accessor_values(gltf, contents, numbers, "SCALAR", _INDICES)
        corners = indices.astype(np.int64).ravel()
    triangles = _triangles(corners, piece.mode)
    if len(triangles) and not triangles.max() < len(vertices):
        raise ValueError("has a triangle of a vertex that does not exist")
    return vertices, triangles


def _triangles(corners: Indices, mode: int) -> Indices:
    """Triangles (m, 3) from the corners (n,) of a list, a strip or a fan."""
    if mode == TRIANGLE_MODE:
        if len(corners) % 3:
            raise ValueError(f"has triangles of {len(corners)} corners in all")
        return corners.reshape(-1, 3)
    step = np.arange(max(0, len(corners) - 2))
    if mode == STRIP_MODE:  # the orientation alternates
        odd = step % 2
        return np.stack([corners[step], corners[step + 1 + odd], corners[step + 2 - odd]], axis=1)
    if mode == FAN_MODE:
        return np.stack([corners[0 * step], corners[step + 1], corners[step + 2]], axis=1)
    raise ValueError(f"has a piece of mode {mode}, which glTF does not know")


def _chunks(data: bytes) -> tuple[bytes, memoryview, int]:
    """The description, the data, and the number of bytes after both."""
    if len(data) < _HEAD.size + _CHUNK.size:
        raise ValueError("is cut short")
    magic, version, length = _HEAD.unpack_from(data)
    if magic != b"glTF" or version != 2:
        raise ValueError("does not begin as glTF 2 does")
    if length > len(data):
        raise ValueError(f"is cut short: it has {len(data)} bytes and states {length}")
    data, n_tail = data[:length], len(data) - length
    size, kind = _CHUNK.unpack_from(data, _HEAD.size)
    begin = _HEAD.size + _CHUNK.size
    if kind != _JSON or size > min(MAX_JSON_BYTES, len(data) - begin):
        raise ValueError(f"has no description, or one of more than {MAX_JSON_BYTES >> 10} kB")
    after = begin + size
    if len(data) < after + _CHUNK.size:
        return data[begin:after], memoryview(b""), n_tail
    n_held, kind = _CHUNK.unpack_from(data, after)
    after += _CHUNK.size
    if kind != _BIN or n_held > len(data) - after:
        raise ValueError("is cut short, or has no data where they must be")
    return data[begin : begin + size], memoryview(data)[after : after + n_held], n_tail


def glb_of(description: bytes, data: bytes) -> bytes:
    """A GLB file of a description in JSON and its data, each padded to whole words."""
    description += b" " * (-len(description) % 4)
    data += bytes(-len(data) % 4)
    size = _HEAD.size + 2 * _CHUNK.size + len(description) + len(data)
    head = _HEAD.pack(b"glTF", 2, size) + _CHUNK.pack(len(description), _JSON)
    return head + description + _CHUNK.pack(len(data), _BIN) + data


def _accessor_values(
    gltf: Gltf, contents: memoryview, accessor: Accessor, shape: str, kinds: dict[int, str]
) -> NDArray[np.generic]:
    if (accessor.type, accessor.sparse) != (shape, None) or accessor.component_type not in kinds:
        kind_text = "sparse ones" if accessor.sparse else f"{accessor.type[:40]!r}"
        raise ValueError(f"has numbers of a kind that is not read: {kind_text}")
    view = _at(gltf.buffer_views, accessor.buffer_view)
    width = 3 if shape == "VEC3" else 1
    kind = np.dtype(kinds[accessor.component_type])
    stride = view.byte_stride or width * kind.itemsize
    span = (accessor.count - 1) * stride + width * kind.itemsize
    numbers = (accessor.count, accessor.byte_offset, view.byte_offset, view.byte_length)
    fits = min(numbers) >= 0 and view.buffer == 0 and stride >= width * kind.itemsize
    is_inside = accessor.byte_offset + span <= view.byte_length
    if not (fits and is_inside and view.byte_offset + view.byte_length <= len(contents)):
        raise ValueError(f"states {accessor.count} numbers that it does not hold")
    if accessor.count == 0:
        return np.zeros((0, width), kind)
    start = view.byte_offset + accessor.byte_offset
    return np.ndarray((accessor.count, width), kind, contents, start, (stride, kind.itemsize))


def _at(parts: Sequence[Part], number: int | None) -> Part:
    if number is None or not 0 <= number < len(parts):
        raise ValueError("names a part that does not exist")
    return parts[number]
