"""Sound mesh files of every format that is read, of one closed surface, written by hand."""

from __future__ import annotations

import json
import struct
from functools import cache
from typing import Any

import numpy as np

from palpate.core.shapes.superquadric import Superquadric

LEVEL = 2
"""320 faces."""
SIZE = (30.0, 25.0, 40.0)
"""Semi-axes, mm."""


@cache
def sound_meshes() -> dict[str, bytes]:
    """Files by name; the suffix tells the format."""
    shape = Superquadric(np.array(SIZE), np.array([1.0, 1.0]))
    vertices, faces = shape.mesh(LEVEL)
    return {
        "text.ply": _ply_text(vertices, faces),
        "little.ply": _ply_binary(vertices, faces, "<"),
        "big.ply": _ply_binary(vertices, faces, ">"),
        "mixed.ply": _ply_mixed(vertices, faces),
        "text.stl": _stl_text(vertices, faces),
        "binary.stl": _stl_binary(vertices, faces),
        "plain.obj": _obj(vertices, faces),
        "plain.off": _off(vertices, faces),
        "plain.glb": glb(*_gltf(vertices, faces)),
    }


def glb(described: Any, held: bytes) -> bytes:
    """A GLB file of a description and its data."""
    text = described if isinstance(described, bytes) else json.dumps(described).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<II", len(text), 0x4E4F534A) + text
    chunks += struct.pack("<II", len(held), 0x004E4942) + held
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def gltf_of(data: bytes) -> tuple[Any, bytes]:
    """Description and data of a GLB file made by `glb`."""
    (size,) = struct.unpack_from("<I", data, 12)
    return json.loads(data[20 : 20 + size]), data[28 + size :]


def _ply_head(form: str, vertices: int, faces: int, more: str = "") -> bytes:
    return (
        f"ply\nformat {form} 1.0\ncomment by hand\nelement vertex {vertices}\n"
        f"property float x\nproperty float y\nproperty float z\n{more}"
        f"element face {faces}\nproperty list uchar int vertex_indices\nend_header\n"
    ).encode()


def _rows(table: np.ndarray[Any, Any], before: str = "") -> str:
    return "".join(f"{before}{' '.join(map(str, row))}\n" for row in table.tolist())


def _ply_text(vertices: np.ndarray[Any, Any], faces: np.ndarray[Any, Any]) -> bytes:
    rows = _rows(vertices.round(4)) + _rows(faces, "3 ")
    return _ply_head("ascii", len(vertices), len(faces)) + rows.encode()


def _ply_binary(vertices: np.ndarray[Any, Any], faces: np.ndarray[Any, Any], order: str) -> bytes:
    form = "binary_little_endian" if order == "<" else "binary_big_endian"
    listed = np.zeros(len(faces), np.dtype([("n", "u1"), ("corners", f"{order}i4", 3)]))
    listed["n"], listed["corners"] = 3, faces
    rows = vertices.astype(f"{order}f4").tobytes() + listed.tobytes()
    return _ply_head(form, len(vertices), len(faces)) + rows


def _ply_mixed(vertices: np.ndarray[Any, Any], faces: np.ndarray[Any, Any]) -> bytes:
    """Triangles beside a quadrilateral, so that lists are of several lengths."""
    a, b, c = faces[0].tolist()
    other = next(i for i, face in enumerate(faces.tolist()) if i and {a, b} <= set(face))
    (d,) = set(faces[other].tolist()) - {a, b}
    rows = [[a, d, b, c], *np.delete(faces, [0, other], axis=0).tolist()]
    packed = b"".join(struct.pack(f"<B{len(row)}i", len(row), *row) for row in rows)
    coloured = np.zeros(len(vertices), np.dtype([("at", "<f4", 3), ("red", "u1")]))
    coloured["at"] = vertices
    head = _ply_head("binary_little_endian", len(vertices), len(rows), "property uchar red\n")
    return head + coloured.tobytes() + packed


def _stl_text(vertices: np.ndarray[Any, Any], faces: np.ndarray[Any, Any]) -> bytes:
    lines = ["solid by hand"]
    for face in vertices.round(4)[faces].tolist():
        lines += ["facet normal 0 0 0", "outer loop"]
        lines += [f"vertex {x} {y} {z}" for x, y, z in face]
        lines += ["endloop", "endfacet"]
    return "\n".join([*lines, "endsolid by hand", ""]).encode()


def _stl_binary(vertices: np.ndarray[Any, Any], faces: np.ndarray[Any, Any]) -> bytes:
    kind = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
    table = np.zeros(len(faces), kind)
    table["corners"] = vertices[faces]
    return bytes(80) + struct.pack("<I", len(faces)) + table.tobytes()


def _obj(vertices: np.ndarray[Any, Any], faces: np.ndarray[Any, Any]) -> bytes:
    lines = ["mtllib none.mtl", "o by hand", *(f"v {x} {y} {z}" for x, y, z in vertices.tolist())]
    lines += ["vn 0 0 1", "usemtl red"]
    lines += [f"f {a}//1 {b}//1 {c}//1" for a, b, c in (faces + 1).tolist()]
    return "\n".join([*lines, ""]).encode()


def _off(vertices: np.ndarray[Any, Any], faces: np.ndarray[Any, Any]) -> bytes:
    rows = _rows(vertices.round(4)) + _rows(faces, "3 ")
    return f"OFF\n# by hand\n{len(vertices)} {len(faces)} 0\n{rows}".encode()


def _gltf(vertices: np.ndarray[Any, Any], faces: np.ndarray[Any, Any]) -> tuple[Any, bytes]:
    places, corners = vertices.astype("<f4").tobytes(), faces.astype("<u4").tobytes()
    described = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"children": [1]}, {"mesh": 0, "translation": [0.0, 0.0, 50.0]}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": len(vertices), "type": "VEC3"},
            {"bufferView": 1, "componentType": 5125, "count": faces.size, "type": "SCALAR"},
        ],
        "bufferViews": [
            {"buffer": 0, "byteLength": len(places)},
            {"buffer": 0, "byteOffset": len(places), "byteLength": len(corners)},
        ],
        "buffers": [{"byteLength": len(places) + len(corners)}],
    }
    return described, places + corners
