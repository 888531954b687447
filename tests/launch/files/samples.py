"""Sound files of an ellipsoid in every mesh format [mm], by trimesh or written by hand."""

import io
import json
import struct
from typing import Any

import numpy as np
import trimesh

from palpate.core.shapes import Superquadric

VERTICES, FACES = Superquadric(np.array([30.0, 25.0, 40.0]), np.array([1.0, 1.0])).mesh(2)


def npz(arrays: dict[str, Any]) -> bytes:
    file = io.BytesIO()
    np.savez(file, **arrays)
    return file.getvalue()


def ply_head(form: str, faces: int, more: str = "") -> str:
    places = "".join(f"property float {axis}\n" for axis in "xyz")
    return (
        f"ply\nformat {form} 1.0\ncomment by hand\nelement vertex {len(VERTICES)}\n{places}{more}"
        f"element face {faces}\nproperty list uchar int vertex_indices\nend_header\n"
    )


def _ply_big() -> bytes:
    listed = np.zeros(len(FACES), np.dtype([("n", "u1"), ("corners", ">i4", 3)]))
    listed["n"], listed["corners"] = 3, FACES
    head = ply_head("binary_big_endian", len(FACES)).encode()
    return head + VERTICES.astype(">f4").tobytes() + listed.tobytes()


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


def _by_trimesh(kind: str, **how: Any) -> bytes:
    data = trimesh.Trimesh(VERTICES, FACES, process=False).export(file_type=kind, **how)
    return data if isinstance(data, bytes) else data.encode()


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
_OBJ_VERTICES = "".join("v {} {} {}\n".format(*row) for row in VERTICES.tolist())
_OBJ_FACES = "".join(f"f {a}//1 {b}//1 {c}//1\n" for a, b, c in (FACES + 1).tolist())
_OBJ = f"mtllib none.mtl\no by hand\n{_OBJ_VERTICES}vn 0 0 1\nusemtl red\n{_OBJ_FACES}"
MESHES = {
    "text.ply": _by_trimesh("ply", encoding="ascii"),
    "little.ply": _by_trimesh("ply"),
    "big.ply": _ply_big(),
    "mixed.ply": _ply_mixed(),
    "text.stl": _by_trimesh("stl_ascii"),
    "binary.stl": _by_trimesh("stl"),
    "plain.obj": _OBJ.encode(),
    "plain.off": _by_trimesh("off").replace(b"OFF", b"OFF\n# by hand", 1),
    "plain.glb": glb(GLTF, HELD),
}
