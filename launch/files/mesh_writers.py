"""PLY, STL, GLB and OBJ, written in one go from arrays of single precision.

trimesh writes them, too, but takes longer to be imported than a final model to be fitted.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray

from palpate.launch.files import mesh_formats

Faces = NDArray[np.int32]
_PLY_HEADER = """ply
format binary_little_endian 1.0
element vertex {vertices}
property float x
property float y
property float z
element face {faces}
property list uchar int vertex_indices
end_header
"""
_PLY_FACE = np.dtype([("count", "u1"), ("corners", "<i4", 3)])


def ply_bytes(vertices: mesh_formats.Floats, faces: Faces) -> bytes:
    """A mesh of vertices (n, 3) and triangles (m, 3) as PLY."""
    rows = np.empty(len(faces), _PLY_FACE)
    rows["count"], rows["corners"] = 3, faces
    header = _PLY_HEADER.format(vertices=len(vertices), faces=len(faces))
    return header.encode() + vertices.astype("<f4").tobytes() + rows.tobytes()


def stl_bytes(vertices: mesh_formats.Floats, faces: Faces) -> bytes:
    """The same as binary STL; flat triangles have a normal of 0."""
    corners = vertices[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    rows = np.zeros(len(faces), mesh_formats.STL_TRIANGLE)
    rows["normal"] = normals / np.where(lengths > 0.0, lengths, 1.0)
    rows["corners"] = corners
    return mesh_formats.STL_HEADER.pack(len(faces)) + rows.tobytes()


def glb_bytes(vertices: mesh_formats.Floats, faces: Faces) -> bytes:
    """The same as glTF 2 in one file, of one node with one mesh of one piece."""
    corners, places = faces.astype("<u4").tobytes(), vertices.astype("<f4")
    parts = ((0, len(corners)), (len(corners), places.nbytes))
    views = [{"buffer": 0, "byteOffset": at, "byteLength": size} for at, size in parts]
    bounds = {"min": places.min(axis=0).tolist(), "max": places.max(axis=0).tolist()}
    numbers, floats = mesh_formats.UNSIGNED, mesh_formats.FLOAT
    accessors = [
        {"bufferView": 0, "componentType": numbers, "type": "SCALAR", "count": faces.size},
        {"bufferView": 1, "componentType": floats, "type": "VEC3", "count": len(places), **bounds},
    ]
    piece = {"attributes": {"POSITION": 1}, "indices": 0, "mode": mesh_formats.TRIANGLE_MODE}
    described = {
        "asset": {"version": "2.0", "generator": "palpate"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [piece]}],
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{"byteLength": len(corners) + places.nbytes}],
    }
    return mesh_formats.glb_of(json.dumps(described).encode(), corners + places.tobytes())


def obj_bytes(vertices: mesh_formats.Floats, faces: Faces) -> bytes:
    """The same as OBJ, in text."""
    places = map("v %.9g %.9g %.9g\n".__mod__, map(tuple, vertices.tolist()))
    corners = map("f %d %d %d\n".__mod__, map(tuple, (faces + 1).tolist()))
    return "".join([*places, *corners]).encode()


WRITERS: Mapping[str, Callable[[mesh_formats.Floats, Faces], bytes]] = {
    ".ply": ply_bytes,
    ".stl": stl_bytes,
    ".glb": glb_bytes,
    ".obj": obj_bytes,
}
