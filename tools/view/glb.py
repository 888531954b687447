"""Coloured surfaces as binary glTF, shaded beforehand."""

from __future__ import annotations

import json
import struct
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate.core.arrays import Floats
from palpate.tools.drawables import Faces


@dataclass(frozen=True, slots=True, kw_only=True)
class FixedLight:
    """A light that does not move with the camera."""

    towards: tuple[float, float, float] = (-0.4, -0.5, 1.0)  # world frame
    ambient: float = 0.7  # brightness of a surface parallel to the light's direction
    diffuse: float = 0.3  # added where a surface faces the light, subtracted where it faces away

    def direction(self) -> Floats:
        """Unit vector (3,) towards the light."""
        direction: Floats = np.array(self.towards) / np.linalg.norm(self.towards)
        return direction


LIGHT = FixedLight()


def shaded(
    vertices: Floats, faces: Faces, colours: NDArray[np.uint8], light: FixedLight = LIGHT
) -> NDArray[np.uint8]:
    """Colours (n, 3) of vertices (n, 3) in a fixed light, cheaper than a lit mesh.

    `colours` in full light: one for each vertex (n, 3), or one for all (3,).
    """
    a, b, c = vertices[faces].transpose(1, 0, 2)
    areas = np.repeat(np.cross(b - a, c - a), 3, axis=0)
    count = len(vertices)
    normals = np.stack([np.bincount(faces.ravel(), areas[:, i], count) for i in range(3)], axis=1)
    lengths = np.maximum(np.linalg.norm(normals, axis=1), 1e-30)
    facing = np.clip(normals @ light.direction() / lengths, -1.0, 1.0)[:, None]
    return np.asarray(np.rint(colours * (light.ambient + light.diffuse * facing)), np.uint8)


def unlit_glb(vertices: Floats, faces: Faces, colours: NDArray[np.uint8]) -> bytes:
    """Triangles (m, 3) of vertices (n, 3) as a binary glTF that shows exactly its colours (n, 3).

    viser lights every mesh without KHR_materials_unlit, and maps all colours by ACES (as three.js
    does, after Hill). The inverse of that map is applied here, for which colours are floats.
    """
    arrays = [
        np.ascontiguousarray(vertices, "<f4"),
        np.ascontiguousarray(_before_tone_map(colours), "<f4"),
        np.ascontiguousarray(faces, "<u4"),
    ]
    ends = np.cumsum([array.nbytes for array in arrays])
    views = [
        {"buffer": 0, "byteOffset": int(end) - array.nbytes, "byteLength": array.nbytes}
        for array, end in zip(arrays, ends, strict=True)
    ]
    box = {"min": arrays[0].min(axis=0).tolist(), "max": arrays[0].max(axis=0).tolist()}
    real = {"componentType": 5126, "type": "VEC3", "count": len(vertices)}
    whole = {"componentType": 5125, "type": "SCALAR", "count": int(faces.size)}
    attributes = {"POSITION": 0, "COLOR_0": 1}
    part = {"attributes": attributes, "indices": 2, "material": 0, "mode": 4}  # triangles
    tree = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [part]}],
        "extensionsUsed": ["KHR_materials_unlit"],
        "materials": [{"extensions": {"KHR_materials_unlit": {}}}],
        "accessors": [
            {"bufferView": number, **kind}
            for number, kind in enumerate(({**real, **box}, real, whole))
        ],
        "bufferViews": views,
        "buffers": [{"byteLength": int(ends[-1])}],
    }
    text = json.dumps(tree).encode()
    text += b" " * (-len(text) % 4)
    head = struct.pack("<4sII", b"glTF", 2, 28 + len(text) + int(ends[-1]))
    body = struct.pack("<I4s", int(ends[-1]), b"BIN\0") + b"".join(map(np.ndarray.tobytes, arrays))
    return head + struct.pack("<I4s", len(text), b"JSON") + text + body


def _before_tone_map(colours: NDArray[np.uint8]) -> Floats:
    """Linear colours (n, 3) that the tone map turns into `colours` (n, 3), 0 to 255."""
    share = colours / 255.0
    linear = np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)
    y = np.clip(np.linalg.solve(ACES_OUTPUT, linear.T).T, 0.0, 1.0)
    # y = (x (x + 0.0245786) - 0.000090537) / (x (0.983729 x + 0.432951) + 0.238081)
    a, b, c = 1.0 - 0.983729 * y, 0.0245786 - 0.432951 * y, -0.000090537 - 0.238081 * y
    x = (np.sqrt(b * b - 4.0 * a * c) - b) / (2.0 * a)
    return np.asarray(0.6 * np.linalg.solve(ACES_INPUT, x.T).T)


ACES_INPUT = np.array(
    [[0.59719, 0.35458, 0.04823], [0.07600, 0.90834, 0.01566], [0.02840, 0.13383, 0.83777]]
)
ACES_OUTPUT = np.array(
    [[1.60475, -0.53108, -0.07367], [-0.10208, 1.10813, -0.00605], [-0.00327, -0.07276, 1.07602]]
)
