"""Sound files of an ellipsoid in every mesh format, written by hand [mm]."""

import io
import json
import struct
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.core.shapes import Superquadric

Table = NDArray[Any]
VERTICES, FACES = Superquadric(np.array([30.0, 25.0, 40.0]), np.array([1.0, 1.0])).mesh(2)


def npz(arrays: dict[str, Any]) -> bytes:
    file = io.BytesIO()
    np.savez(file, **arrays)
    return file.getvalue()


def _lines(table: Table, before: str = "") -> str:
    return "".join(f"{before}{' '.join(map(str, row))}\n" for row in table.tolist())


def ply_head(form: str, faces: int, more: str = "") -> str:
    places = "".join(f"property float {axis}\n" for axis in "xyz")
    return (
        f"ply\nformat {form} 1.0\ncomment by hand\nelement vertex {len(VERTICES)}\n{places}{more}"
        f"element face {faces}\nproperty list uchar int vertex_indices\nend_header\n"
    )


def _ply_binary(order: str, name: str) -> bytes:
    listed = np.zeros(len(FACES), np.dtype([("n", "u1"), ("corners", f"{order}i4", 3)]))
    listed["n"], listed["corners"] = 3, FACES
    head = ply_head(f"binary_{name}_endian", len(FACES)).encode()
    return head + VERTICES.astype(f"{order}f4").tobytes() + listed.tobytes()


def _ply_mixed() -> bytes:
    """Triangles beside a quadrilateral, so that lists are of several lengths."""
    a, b, c = FACES[0].tolist()
    other = next(i for i, face in enumerate(FACES.tolist()) if i and {a, b} <= set(face))
    (d,) = {*FACES[other].tolist()} - {a, b}
    rows = [[a, d, b, c], *np.delete(FACES, [0, other], axis=0).tolist()]
    packed = b"".join(struct.pack(f"<B{len(row)}i", len(row), *row) for row in rows)
    coloured = np.zeros(len(VERTICES), np.dtype([("at", "<f4", 3), ("red", "u1")]))
    coloured["at"] = VERTICES
    head = ply_head("binary_little_endian", len(rows), "property uchar red\n")
    return head.encode() + coloured.tobytes() + packed


def _stl(binary: bool) -> bytes:
    if binary:
        kind = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
        table = np.zeros(len(FACES), kind)
        table["corners"] = VERTICES[FACES]
        return bytes(80) + struct.pack("<I", len(FACES)) + table.tobytes()
    facets = [
        f"facet normal 0 0 0\nouter loop\n{_lines(corners, 'vertex ')}endloop\nendfacet\n"
        for corners in VERTICES.round(4)[FACES]
    ]
    return f"solid by hand\n{''.join(facets)}endsolid by hand\n".encode()


def glb(described: Any, held: bytes) -> bytes:
    """A GLB file of a description and its data."""
    text = described if isinstance(described, bytes) else json.dumps(described).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<II", len(text), 0x4E4F534A) + text
    chunks += struct.pack("<II", len(held), 0x004E4942) + held
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


_PLACES, _CORNERS = VERTICES.astype("<f4").tobytes(), FACES.astype("<u4").tobytes()
HELD = _PLACES + _CORNERS
GLTF: dict[str, Any] = {
    "asset": {"version": "2.0"},
    "scene": 0,
    "scenes": [{"nodes": [0]}],
    "nodes": [{"children": [1]}, {"mesh": 0, "translation": [0.0, 0.0, 50.0]}],
    "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
    "accessors": [
        {"bufferView": 0, "componentType": 5126, "count": len(VERTICES), "type": "VEC3"},
        {"bufferView": 1, "componentType": 5125, "count": FACES.size, "type": "SCALAR"},
    ],
    "bufferViews": [
        {"buffer": 0, "byteLength": len(_PLACES)},
        {"buffer": 0, "byteOffset": len(_PLACES), "byteLength": len(_CORNERS)},
    ],
    "buffers": [{"byteLength": len(HELD)}],
}
_ROWS = _lines(VERTICES.round(4)) + _lines(FACES, "3 ")
_OBJ_FACES = "".join(f"f {a}//1 {b}//1 {c}//1\n" for a, b, c in (FACES + 1).tolist())
_OBJ = f"mtllib none.mtl\no by hand\n{_lines(VERTICES, 'v ')}vn 0 0 1\nusemtl red\n{_OBJ_FACES}"
MESHES = {
    "text.ply": (ply_head("ascii", len(FACES)) + _ROWS).encode(),
    "little.ply": _ply_binary("<", "little"),
    "big.ply": _ply_binary(">", "big"),
    "mixed.ply": _ply_mixed(),
    "text.stl": _stl(binary=False),
    "binary.stl": _stl(binary=True),
    "plain.obj": _OBJ.encode(),
    "plain.off": f"OFF\n# by hand\n{len(VERTICES)} {len(FACES)} 0\n{_ROWS}".encode(),
    "plain.glb": glb(GLTF, HELD),
}
