"""What is drawn of messages, as arrays: pads, contours, lattices, voxels, and coloured surfaces."""

from __future__ import annotations

import json
import struct
from collections.abc import Sequence

import numpy as np
import scipy
from numpy.typing import NDArray

from palpate.core.arrays import Floats
from palpate.core.touch import Pad
from palpate.messages.types import Contour, SpaceMap
from palpate.tools.view.timeline import Touch

Faces = NDArray[np.int32]
LIGHT = np.array([-0.4, -0.5, 1.0]) / np.sqrt(1.41)  # Towards it, world frame
LIFT = 0.0004  # What lies on the surface is drawn before it by so much, m


def contour_segments(contour: Contour) -> Floats:
    """Pieces (n, 2, 3) of a contour, without those that could not be touched."""
    points = contour.points + LIFT * contour.normals
    if len(points) < 2:
        return np.zeros((0, 2, 3))
    pieces = np.stack([points, np.roll(points, -1, axis=0)], axis=1)
    if contour.status != "closed":
        pieces = pieces[:-1]
    gaps = {start.tobytes() for start in contour.gap_starts}
    return pieces[[start.tobytes() not in gaps for start in contour.points[: len(pieces)]]]


def growing(touches: Sequence[Touch], done: set[int]) -> Floats:
    """Middles (n, 3) of the contacts of the goal that is being traced."""
    if not touches or touches[-1].goal in done:
        return np.zeros((0, 3))
    goal = touches[-1].goal
    points = (lifted(one) for one in touches if one.goal == goal and len(one.points))
    middles = [some[np.argmin(np.linalg.norm(some - some.mean(axis=0), axis=1))] for some in points]
    return np.array(middles).reshape(-1, 3)


def lifted(touch: Touch) -> Floats:
    """Touched points (n, 3) of a touch, as they are drawn."""
    return touch.points + LIFT * touch.normal


def pad_body(pad: Pad) -> tuple[Floats, Faces]:
    """Vertices and triangles of a pad in its own frame: the face, and the plate behind it."""
    x, y = pad.grid()
    face = np.stack([x, y, -pad.sag()], axis=-1)
    corners = np.arange(pad.rows * pad.cols).reshape(pad.rows, pad.cols)
    a, b, c, d = corners[:-1, :-1], corners[:-1, 1:], corners[1:, 1:], corners[1:, :-1]
    skin = np.concatenate([np.stack(t, -1).reshape(-1, 3) for t in ((a, b, c), (a, c, d))])
    rim = np.concatenate([corners[0], corners[1:, -1], corners[-1, -2::-1], corners[-2:0:-1, 0]])
    vertices = face.reshape(-1, 3)
    plate = np.column_stack([vertices[rim, :2], np.full(len(rim), face[..., 2].min())])
    plate[:, 2] -= pad.thickness
    under = len(vertices) + np.arange(len(rim))
    after = np.roll(np.arange(len(rim)), -1)
    sides = [[rim, under, under[after]], [rim, under[after], rim[after]]]
    back = np.stack([np.full(len(rim), len(vertices) + len(rim)), under[after], under], axis=-1)
    faces = np.concatenate([skin, *(np.stack(t, axis=-1) for t in sides), back])
    middle = plate.mean(axis=0, keepdims=True)
    return np.concatenate([vertices, plate, middle]), faces.astype(np.int32)


def lattice_lines(control: Floats) -> tuple[Floats, Faces]:
    """Control points (n, 3), and pairs (m, 2) of neighbours on the outside of their lattice."""
    numbers = np.arange(control[..., 0].size).reshape(control.shape[:3])
    outside = np.ones(numbers.shape, np.bool_)
    outside[1:-1, 1:-1, 1:-1] = False
    pairs = []
    for axis in range(3):
        first, second = np.split(numbers, [-1], axis)[0], np.split(numbers, [1], axis)[1]
        both = np.stack([first.ravel(), second.ravel()], axis=1)
        pairs.append(both[outside.ravel()[both].all(axis=1)])
    return control.reshape(-1, 3), np.concatenate(pairs).astype(np.int32)


def boundary(space: SpaceMap, *, free: bool) -> Floats:
    """Middles (n, 3) of voxels on the boundary of free space, or of the unknown towards it."""
    if free:
        swept = space.states == 1
        edge = swept & ~scipy.ndimage.binary_erosion(swept)
    else:
        edge = (space.states == 0) & scipy.ndimage.binary_dilation(space.states != 0)
    return np.asarray(space.low + space.step * np.argwhere(edge))


def shaded(vertices: Floats, faces: Faces, colours: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Colours (n, 3) of vertices (n, 3) in a light that stands still, cheaper than a lit mesh.

    `colours` in full light: one for each vertex (n, 3), or one for all (3,).
    """
    a, b, c = vertices[faces].transpose(1, 0, 2)
    areas = np.repeat(np.cross(b - a, c - a), 3, axis=0)
    count = len(vertices)
    normals = np.stack([np.bincount(faces.ravel(), areas[:, i], count) for i in range(3)], axis=1)
    lengths = np.maximum(np.linalg.norm(normals, axis=1), 1e-30)
    facing = np.clip(normals @ LIGHT / lengths, -1.0, 1.0)[:, None]
    return np.asarray(np.rint(colours * (0.7 + 0.3 * facing)), np.uint8)


def unlit_glb(vertices: Floats, faces: Faces, colours: NDArray[np.uint8]) -> bytes:
    """A binary glTF that no light changes: what its colours are is what is seen.

    Of triangles (m, 3), or of lines (m, 2) one pixel wide, between vertices (n, 3) with colours
    (n, 3). viser maps what it draws by ACES (as three.js has it, after Hill), and lights every mesh
    but one with KHR_materials_unlit; the map is undone here, for which colours must be floats.
    """
    arrays = [
        np.ascontiguousarray(vertices, "<f4"),
        np.ascontiguousarray(_before_tone_map(colours), "<f4"),
        np.ascontiguousarray(faces, "<u4"),
    ]
    ends = np.cumsum([one.nbytes for one in arrays])
    views = [
        {"buffer": 0, "byteOffset": int(end) - one.nbytes, "byteLength": one.nbytes}
        for one, end in zip(arrays, ends, strict=True)
    ]
    box = {"min": arrays[0].min(axis=0).tolist(), "max": arrays[0].max(axis=0).tolist()}
    real = {"componentType": 5126, "type": "VEC3", "count": len(vertices)}
    whole = {"componentType": 5125, "type": "SCALAR", "count": int(faces.size)}
    mode = {2: 1, 3: 4}[faces.shape[1]]  # lines, triangles
    attributes = {"POSITION": 0, "COLOR_0": 1}
    part = {"attributes": attributes, "indices": 2, "material": 0, "mode": mode}
    tree = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [part]}],
        "extensionsUsed": ["KHR_materials_unlit"],
        "materials": [{"extensions": {"KHR_materials_unlit": {}}}],
        "accessors": [
            {"bufferView": number, **one}
            for number, one in enumerate(({**real, **box}, real, whole))
        ],
        "bufferViews": views,
        "buffers": [{"byteLength": int(ends[-1])}],
    }
    text = json.dumps(tree).encode()
    text += b" " * (-len(text) % 4)
    head = struct.pack("<4sII", b"glTF", 2, 28 + len(text) + int(ends[-1]))
    body = struct.pack("<I4s", int(ends[-1]), b"BIN\0") + b"".join(one.tobytes() for one in arrays)
    return head + struct.pack("<I4s", len(text), b"JSON") + text + body


def _before_tone_map(colours: NDArray[np.uint8]) -> Floats:
    """Linear colours (n, 3), which the tone map turns into the given ones, 0 to 255."""
    share = colours / 255.0
    linear = np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)
    y = np.clip(np.linalg.solve(_ACES_OUT, linear.T).T, 0.0, 1.0)
    # y = (x (x + 0.0245786) - 0.000090537) / (x (0.983729 x + 0.432951) + 0.238081)
    a, b, c = 1.0 - 0.983729 * y, 0.0245786 - 0.432951 * y, -0.000090537 - 0.238081 * y
    x = (np.sqrt(b * b - 4.0 * a * c) - b) / (2.0 * a)
    return np.asarray(0.6 * np.linalg.solve(_ACES_IN, x.T).T)


_ACES_IN = np.array(
    [[0.59719, 0.35458, 0.04823], [0.07600, 0.90834, 0.01566], [0.02840, 0.13383, 0.83777]]
)
_ACES_OUT = np.array(
    [[1.60475, -0.53108, -0.07367], [-0.10208, 1.10813, -0.00605], [-0.00327, -0.07276, 1.07602]]
)
