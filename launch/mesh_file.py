"""A mesh file from anywhere: read with distrust, checked whole, and handed on as plain arrays."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Literal

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from palpate.core.measure.solidity import solidity
from palpate.launch.bounded_file import read_bounded
from palpate.launch.located import InputError
from palpate.launch.mesh_export import Y_UP
from palpate.launch.mesh_formats.glb import read_glb
from palpate.launch.mesh_formats.obj import read_obj
from palpate.launch.mesh_formats.off import read_off
from palpate.launch.mesh_formats.ply import read_ply
from palpate.launch.mesh_formats.raw import MOST_TRIANGLES, RawMesh
from palpate.launch.mesh_formats.stl import read_stl

MAX_BYTES = 64 << 20
"""Largest file."""
MAX_FACES = MOST_TRIANGLES
"""Most triangles."""
SMALLEST = 1e-4
"""Smallest extent of an object, m."""
LARGEST = 10.0
"""Largest extent of an object, m."""
METRES = {"m": 1.0, "cm": 0.01, "mm": 0.001, "in": 0.0254}
"""Metres in each unit."""
READERS: Mapping[str, Callable[[bytes], RawMesh]] = {
    "ply": read_ply,
    "stl": read_stl,
    "obj": read_obj,
    "off": read_off,
    "glb": read_glb,
}
"""Formats that are read."""

Vertices = NDArray[np.float64]
Faces = NDArray[np.int32]


class MeshFile(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """How a scene names a mesh file."""

    file: str
    """Path, relative to the scene's folder."""
    unit: Literal["m", "cm", "mm"]
    """Unit of the file's coordinates; the file itself does not say."""


def read_mesh(path: Path, unit: str) -> tuple[Vertices, Faces]:
    """The one closed surface in a file.

    Parameters
    ----------
    path : Path
        A PLY, STL, OBJ, OFF or GLB file of at most 64 MiB.
    unit : str
        Unit of its coordinates: ``m``, ``cm`` or ``mm``.

    Returns
    -------
    vertices : (n, 3) array
        Corners, each once, in m.
    faces : (m, 3) array of int32
        Triangles, counter-clockwise seen from outside.

    Raises
    ------
    InputError
        If the file cannot be read or is not one closed, outward-facing surface of fitting size.
    """
    vertices, faces = read_surface(path, unit)
    _check_closed(path, faces)
    _check_size(path, vertices, unit)
    found = solidity(vertices, faces)
    if not found.volume > 0.0:
        raise InputError(f"{path}: is inside out: its volume is negative; flip the faces")
    if found.components != 1:
        raise InputError(
            f"{path}: is made of {found.components} separate surfaces; there must be exactly one"
        )
    if found.genus:
        raise InputError(
            f"{path}: has {found.genus} hole{'s' * (found.genus > 1)} through it; only objects "
            "without can be rebuilt"
        )
    return vertices, faces


def read_surface(path: Path, unit: str) -> tuple[Vertices, Faces]:
    """The surface in a file, closed or not, of any size; arguments and arrays as of `read_mesh`.

    GLB files have y up, and are turned so that z is.

    Raises
    ------
    InputError
        If the file cannot be read or holds no triangles.
    """
    found = _load(path)
    if not len(found.faces) and len(found.vertices):
        raise InputError(f"{path}: holds points without triangles")
    vertices, faces = _merged(path, found)
    if path.suffix.lower() == ".glb":
        vertices = vertices @ Y_UP
    return vertices * METRES[unit], faces


def read_cloud(path: Path, unit: str) -> Vertices | None:
    """The points (n, 3) in a file that holds nothing else, in m; None if it holds more.

    Raises
    ------
    InputError
        If the file cannot be read.
    """
    found = _load(path)
    return None if len(found.faces) else found.vertices * METRES[unit]


def _load(path: Path) -> RawMesh:
    kind = path.suffix.lower().lstrip(".")
    if kind not in READERS:
        known = ", ".join(READERS)
        raise InputError(f"{path}: {kind or 'no suffix'!r} is no mesh format; known: {known}")
    data = read_bounded(path, MAX_BYTES, "the mesh ")
    if not data:
        raise InputError(f"{path}: the mesh file is empty")
    try:
        return READERS[kind](data)
    except ValueError as error:
        raise InputError(f"{path}: is no mesh in {kind.upper()}: it {error}") from None


def _merged(path: Path, mesh: RawMesh) -> tuple[Vertices, Faces]:
    """Vertices that are equal made one, because STL repeats them for each face."""
    vertices, faces = mesh
    if len(faces) == 0:
        raise InputError(f"{path}: holds no triangles")
    if len(faces) > MAX_FACES:
        raise InputError(f"{path}: has {len(faces)} triangles; at most {MAX_FACES} are taken")
    if faces.min() < 0 or faces.max() >= len(vertices):
        raise InputError(f"{path}: a triangle names a vertex that does not exist")
    if not np.isfinite(vertices).all():
        bad = int(np.argmin(np.isfinite(vertices).all(axis=1)))
        raise InputError(f"{path}: vertex {bad} is not finite")
    kept, first = _each_once(vertices)
    faces = first[faces]
    a, b, c = faces.T
    faces = faces[(a != b) & (b != c) & (c != a)]
    if len(faces) == 0:
        raise InputError(f"{path}: all its triangles are flat: corners of each lie in one place")
    used, numbers = np.unique(faces, return_inverse=True)
    return kept[used], numbers.reshape(-1, 3).astype(np.int32)


def _each_once(vertices: Vertices) -> tuple[Vertices, NDArray[np.int64]]:
    """Rows that differ, in their order, and which of them each row is."""
    order = np.lexsort(vertices.T[::-1])
    rows = vertices[order]
    new = np.ones(len(rows), bool)
    new[1:] = (rows[1:] != rows[:-1]).any(axis=1)
    number = np.empty(len(rows), np.int64)
    number[order] = np.cumsum(new) - 1
    return rows[new], number


def _check_closed(path: Path, faces: Faces) -> None:
    """Each edge must be walked exactly once each way."""
    start, end = faces.T.reshape(-1).astype(np.int64), faces[:, [1, 2, 0]].T.reshape(-1)
    keys = np.minimum(start, end) * (int(faces.max()) + 1) + np.maximum(start, end)
    _, number, count = np.unique(keys, return_inverse=True, return_counts=True)
    odd = int((count != 2).sum())
    if odd:
        raise InputError(
            f"{path}: is not watertight: {odd} of its {len(count)} edges do not have exactly "
            "two triangles; close the holes"
        )
    forwards = np.bincount(number, start < end, len(count))
    turned = int((forwards != 1).sum())
    if turned:
        raise InputError(
            f"{path}: neighbouring triangles face opposite ways at {turned} of its {len(count)} "
            "edges; make them agree"
        )


def _check_size(path: Path, vertices: Vertices, unit: str) -> None:
    with np.errstate(over="ignore"):
        extents = np.ptp(vertices, axis=0)
    if extents.min() < SMALLEST or extents.max() > LARGEST:
        size = " x ".join(f"{extent:.3g}" for extent in extents)
        raise InputError(
            f"{path}: measures {size} m when read in {unit}; each side must be between "
            f"{SMALLEST:g} and {LARGEST:g} m; is the unit right?"
        )
