"""What can be scored, read from files: surfaces, and points that were measured."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from palpate.core.archive import FORM
from palpate.core.measure.triangles import corners_of
from palpate.launch.bounded_file import read_bounded
from palpate.launch.located import InputError
from palpate.launch.mesh_file import MAX_BYTES, METRES, read_cloud, read_surface
from palpate.launch.npz_file import read_npz
from palpate.launch.solid_file import load

OWN_UNITS = {".stl": "mm"}
"""Unit of a format if the user does not say, where it is not the metre: as palpate writes it."""
POINTS = (".csv", ".xyz", ".txt")
"""Formats that hold points alone."""
FEWEST = 6
"""Points, so that they say anything."""
FARTHEST = 1e30
"""Coordinate, m, of which powers are still numbers."""


class Shape(NamedTuple):
    """A surface or points, in m."""

    vertices: NDArray[np.float64]
    """(n, 3)."""
    faces: NDArray[np.int32]
    """(m, 3); none for points."""
    unit: str
    """As which the file was read."""


def read_shape(path: Path, unit: str | None) -> Shape:
    """What a file holds.

    Parameters
    ----------
    path : Path
        A surface (PLY, STL, OBJ, OFF, GLB, or an NPZ file of a run or of `palpate.save`),
        closed or not; or points (CSV, or a PLY without faces).
    unit : str or None
        Unit of its coordinates: ``m``, ``cm`` or ``mm``; as palpate writes it if None, which is
        mm for STL and m for all others.

    Raises
    ------
    InputError
        If the file cannot be read, or holds neither.
    """
    shape = _read(path, unit)
    size = float(np.abs(shape.vertices).max(initial=0.0))
    if len(shape.vertices) and np.isfinite(size) and not size <= FARTHEST:
        raise InputError(f"{path}: reaches {size:g} m from the origin; at most {FARTHEST:g} m can")
    return shape


def _read(path: Path, unit: str | None) -> Shape:
    kind = path.suffix.lower()
    taken = unit if unit is not None else OWN_UNITS.get(kind, "m")
    none = np.zeros((0, 3), np.int32)
    if kind in POINTS:
        return Shape(_enough(path, _read_csv(path) * METRES[taken]), none, taken)
    if kind == ".npz":
        vertices, faces = _read_model(path)
        return Shape(vertices * METRES[taken], faces, taken)
    if kind == ".ply" and (points := read_cloud(path, taken)) is not None:
        return Shape(_enough(path, points), none, taken)
    return Shape(*read_surface(path, taken), taken)


def _enough(path: Path, points: NDArray[np.float64]) -> NDArray[np.float64]:
    if len(points) < FEWEST:
        raise InputError(f"{path}: holds {len(points)} points; at least {FEWEST} are needed")
    if not np.isfinite(points).all():
        bad = int(np.argmin(np.isfinite(points).all(axis=1)))
        raise InputError(f"{path}: point {bad} is not finite")
    if not np.ptp(points, axis=0).any():
        raise InputError(f"{path}: all {len(points)} points are in one place")
    return points


def _read_csv(path: Path) -> NDArray[np.float64]:
    """The columns x, y and z if a header names them, else the first three."""
    try:
        text = read_bounded(path, MAX_BYTES).decode("utf-8-sig")
    except UnicodeDecodeError:
        raise InputError(f"{path}: is no text in UTF-8") from None
    lines = [line for line in text.splitlines() if line.strip() and line.lstrip()[0] != "#"]
    if not lines:
        raise InputError(f"{path}: holds no points")
    delimiter = next((mark for mark in (",", ";", "\t") if mark in lines[0]), None)
    header = [name.strip().strip('"').lower() for name in lines[0].split(delimiter)]
    named = not all(_is_number(name) for name in header)
    columns = [0, 1, 2]
    if named and {"x", "y", "z"} <= set(header):
        columns = [header.index(name) for name in "xyz"]
    if len(header) < 3:
        raise InputError(f"{path}: has {len(header)} columns; x, y and z are needed")
    rows = lines[1:] if named else lines
    if not rows:
        raise InputError(f"{path}: holds no points under its header")
    try:
        found = np.loadtxt(rows, delimiter=delimiter, usecols=columns, ndmin=2, comments=None)
    except ValueError as error:
        raise InputError(f"{path}: is no table of numbers: {error}") from None
    return np.asarray(found, np.float64)


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _read_model(path: Path) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    """Vertices, m, and faces of a model as a run or `palpate.save` leaves it."""
    data = read_bounded(path, MAX_BYTES)
    try:
        arrays = read_npz(data)
    except ValueError as error:
        raise InputError(f"{path}: {error}") from None
    if FORM in arrays and "vertices" not in arrays:
        return _meshed(path)
    for name in ("vertices", "faces"):
        if name not in arrays:
            raise InputError(f"{path}: is no model: it lacks {name}")
    vertices, faces = arrays["vertices"], arrays["faces"]
    if faces.ndim == 0:
        raise InputError(f"{path}: is no model: its faces are a single number")
    if not len(faces):
        raise InputError(f"{path}: the model has no surface; nothing could be rebuilt")
    try:
        corners_of(vertices, faces)
    except (ValueError, TypeError) as error:
        raise _no_surface(path, error) from None
    return np.asarray(vertices, np.float64), faces.astype(np.int32)


def _meshed(path: Path) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    """The mesh of a solid that `save` wrote, as fine as meshes are by themselves."""
    mesh = load(path).mesh()
    return mesh.vertices, mesh.faces


def _no_surface(path: Path, error: Exception) -> InputError:
    return InputError(f"{path}: is no model: {error}")
