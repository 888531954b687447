"""Files of rebuilt solids: complete NPZ files, which are read back bit for bit, and lattices.

The size of an array in an NPZ file is checked before it is read, and nothing in the file is ever
run. A control lattice is written as arrays, or as a structured grid for ParaView.
"""

from __future__ import annotations

import io
import math
import tokenize
import zipfile
import zlib
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, Literal, get_origin, get_type_hints

import numpy as np
from numpy.typing import NDArray

from palpate.core.archive import FORM_KEY, arrays_to_bytes, tree_from_arrays, tree_to_arrays
from palpate.core.arrays import Floats
from palpate.core.rebuild import MeshSolid, Solid
from palpate.core.rebuild.lattice import LatticeGrid, lattice_grid
from palpate.core.splines import Lattice
from palpate.launch.files.file_access import read_bounded, write_atomically
from palpate.launch.files.mesh_file import (
    ARCHIVE_FIELD,
    MESH_UNITS,
    MODEL_FILE,
    is_mesh_file,
    read_surface,
)
from palpate.launch.files.source_map import InputError, as_input_errors
from palpate.messages.types import ShapeModel

SOLID_SUFFIX = ".npz"
ARCHIVED = (FORM_KEY, "solid")  # prefixes of the names of a packed solid's arrays
Arrays = dict[str, NDArray[np.generic]]
# Exceptions that zipfile and numpy raise for damaged files.
_FAULTS = (
    zipfile.BadZipFile,
    zlib.error,
    tokenize.TokenError,
    EOFError,
    LookupError,
    MemoryError,
    OSError,
    OverflowError,
    RuntimeError,
    SyntaxError,
    TypeError,
    ValueError,
)
# Readers of the header of an array, by the version of its format.
_HEADERS = {
    (1, 0): np.lib.format.read_array_header_1_0,
    (2, 0): np.lib.format.read_array_header_2_0,
}
LATTICE_SUFFIXES = (".npz", ".vtk")
AXES = "stu"


@dataclass(frozen=True, slots=True, kw_only=True)
class NpzLimits:
    """Limits on NPZ files that are read; arrays of measured numbers stay below `max_ratio`."""

    max_file_size: int = 512 << 20  # [bytes]
    max_ratio: int = 16  # of the unpacked size to that of the file
    min_unpacked_size: int = 32 << 20  # unpacked size that is allowed with any ratio [bytes]
    max_arrays: int = 4096  # in a file
    max_axis_length: int = 1 << 40  # of an array [elements]


def save(solid: Solid, path: str | Path) -> None:
    """Write all data of a rebuilt solid to a file.

    `path`: a name with suffix ``.npz``; an existing file is replaced. Raises InputError for another
    suffix or if the file cannot be written; TypeError if `solid` is no solid.
    """
    if not isinstance(solid, Solid):
        raise TypeError(f"solid must be a Solid, as reconstruct returns it, got {solid!r:.60}")
    path = Path(path)
    if path.suffix != SOLID_SUFFIX:
        raise InputError(f"{path}: must end in {SOLID_SUFFIX}, got {path.suffix or 'no suffix'!r}")
    arrays = tree_to_arrays(solid)
    write_atomically({path: lambda part: write_arrays(part, arrays)})


def write_arrays(path: Path, arrays: Arrays) -> None:
    """Write an NPZ file of arrays; equal arrays give equal bytes."""
    with path.open("wb") as file:
        np.savez(file, allow_pickle=False, **arrays)


def load(path: str | Path, unit: Literal["m", "cm", "mm", "in"] | None = None) -> Solid:
    """The solid in a file, or of a run.

    `path`: a file of `save`; the directory of a run, or its ``model.npz``; or a mesh, ``.ply``,
    ``.stl``, ``.obj``, ``.off`` or ``.glb``, with coordinates in `unit`, by default the unit in
    which `Solid.export` writes: mm in ``.stl``, m in others. The file may be untrusted: nothing in
    it is ever run. Raises InputError if it cannot be read, holds no solid, or one of another
    version.
    """
    path = Path(path)
    if is_mesh_file(path):
        written_in = MESH_UNITS.get(path.suffix.lower(), "m").partition(",")[0]
        vertices, faces, _ = read_surface(path, unit or written_in)
        return MeshSolid(vertices, faces)
    path = path / MODEL_FILE if path.is_dir() else path
    arrays = read_arrays(path)
    with as_input_errors(path):
        return solid_of(arrays)


def solid_of(arrays: Arrays) -> Solid:
    """The solid in arrays of `save`, or of a model with its final mesh.

    Raises ValueError if there is none; the text is the rest of a sentence about the file.
    """
    mesh = None
    if {"vertices", "faces"} <= arrays.keys() and arrays["faces"].size:
        parts: Any = arrays  # MeshSolid checks their types
        mesh = MeshSolid(parts["vertices"], parts["faces"])
    if FORM_KEY not in arrays:
        if mesh is None:
            raise ValueError("holds no solid: it was not written by palpate.save")
        return mesh
    solid = tree_from_arrays(arrays)
    if not isinstance(solid, Solid):
        raise ValueError(f"holds a {type(solid).__name__}, not a solid")
    return solid if mesh is None else solid.with_final_mesh(mesh.vertices, mesh.faces)


# Fields that a model may lack: one that is not final lacks its verdict.
OPTIONAL_FIELDS = frozenset(field.name for field in fields(ShapeModel) if field.default is None)


def read_model(path: Path) -> ShapeModel:
    """The model in a run's ``model.npz``, as it was published.

    Raises InputError if the file cannot be read, or holds no model of this version.
    """
    arrays, types = read_arrays(path), get_type_hints(ShapeModel)
    packed = {name: a for name, a in arrays.items() if name.partition("/")[0] in ARCHIVED}
    values: dict[str, Any] = {ARCHIVE_FIELD: arrays_to_bytes(packed)} if packed else {}
    for name in (field.name for field in fields(ShapeModel)):
        if name not in arrays and name in OPTIONAL_FIELDS:
            continue
        hint = types[name]
        try:
            if get_origin(hint) is dict:
                keys, numbers = arrays[f"{name}_names"], arrays[f"{name}_values"]
                values[name] = dict(zip(keys.tolist(), numbers.tolist(), strict=True))
            elif name != ARCHIVE_FIELD:
                array = arrays[name]
                plain = tuple(array.tolist()) if get_origin(hint) is tuple else array
                values[name] = plain if array.ndim else array.item()
        except (KeyError, TypeError):
            raise InputError(f"{path}: holds no model of this version: no {name} in it") from None
    return ShapeModel(**values)


def read_arrays(path: Path, limits: NpzLimits = NpzLimits()) -> Arrays:
    """All arrays of an NPZ file; InputError if it is unreadable, too large, or holds objects."""
    data = read_bounded(path, limits.max_file_size)
    with as_input_errors(path):
        return read_npz(data, limits)


def read_npz(data: bytes, limits: NpzLimits = NpzLimits()) -> Arrays:
    """All arrays in the bytes of an NPZ file, by name.

    Raises ValueError if it is no NPZ file, holds objects, or exceeds a limit; the text is the rest
    of a sentence about the file.
    """
    try:
        parts = zipfile.ZipFile(io.BytesIO(data))
    except _FAULTS:
        raise ValueError("is no NPZ file") from None
    with parts:
        _check_sizes(parts.infolist(), len(data), limits)
        return {
            part.filename.removesuffix(".npy"): _array(parts, part, limits.max_axis_length)
            for part in parts.infolist()
        }


def _check_sizes(parts: list[zipfile.ZipInfo], size: int, limits: NpzLimits) -> None:
    unpacked = sum(part.file_size for part in parts)
    packed = sum(part.compress_size for part in parts)
    if len(parts) > limits.max_arrays:
        raise ValueError(f"holds {len(parts)} arrays; at most {limits.max_arrays} are read")
    if unpacked > max(limits.min_unpacked_size, limits.max_ratio * size):
        raise ValueError(f"unpacks to {unpacked >> 20} MiB, more than is read of such a file")
    if packed > size:
        raise ValueError("is no NPZ file: its parts overlap")
    if any(part.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED) for part in parts):
        raise ValueError("is no NPZ file: its compression is not read")


def _array(
    parts: zipfile.ZipFile, part: zipfile.ZipInfo, max_axis_length: int
) -> NDArray[np.generic]:
    name = part.filename[:40]
    try:
        content = io.BytesIO(parts.read(part))
        version = np.lib.format.read_magic(content)
        if version not in _HEADERS:
            raise ValueError(f"an array of format {version}")
        shape, _, kind = _HEADERS[version](content)
        if kind.hasobject:
            raise ValueError("an array of objects, which are not read")
        stated = math.prod(shape) * kind.itemsize
        held = part.file_size - content.tell()
        if min(shape, default=0) < 0 or max(shape, default=0) > max_axis_length or stated != held:
            raise ValueError(f"an array that states {stated} bytes, and holds {held}")
        content.seek(0)
        return np.asarray(np.lib.format.read_array(content, allow_pickle=False))
    except _FAULTS as error:
        reason = " ".join(str(error).split())[:100] or type(error).__name__
        raise ValueError(f"is no NPZ file of numbers: {name!r}: {reason}") from None


def write_lattice(path: Path, lattice: Lattice) -> None:
    """Write a lattice; the suffix is one of `LATTICE_SUFFIXES`."""
    parts = lattice_grid(lattice)
    if path.suffix.lower() == ".vtk":
        path.write_text(_vtk(parts), encoding="ascii")
        return
    arrays: dict[str, NDArray[np.generic]] = {
        "control": parts.control,
        "undeformed": parts.undeformed,
        "weights": parts.weights,
    }
    for axis, knots, degree in zip(AXES, parts.knots, parts.degrees, strict=True):
        arrays[f"knots_{axis}"] = knots
        arrays[f"degree_{axis}"] = np.array(degree)
    write_arrays(path, arrays)


def _vtk(parts: LatticeGrid) -> str:
    """A structured grid of the deformed points, with weights and displacements."""
    l, m, n = parts.weights.shape  # noqa: E741 (the letters of the text)
    count = l * m * n
    lines = [
        "# vtk DataFile Version 3.0",
        "palpate control lattice, lengths in m",
        "ASCII",
        "DATASET STRUCTURED_GRID",
        f"DIMENSIONS {l} {m} {n}",
        f"POINTS {count} double",
        *_vtk_rows(parts.control),
        f"POINT_DATA {count}",
        "SCALARS weight double 1",
        "LOOKUP_TABLE default",
        *(repr(float(weight)) for weight in parts.weights.ravel(order="F")),
        "VECTORS undeformed double",
        *_vtk_rows(parts.undeformed),
        "VECTORS displacement double",
        *_vtk_rows(parts.control - parts.undeformed),
    ]
    return "\n".join(lines) + "\n"


def _vtk_rows(points: Floats) -> list[str]:
    """Points with the first axis fastest, as in the format, to the last bit."""
    flat = points.transpose(2, 1, 0, 3).reshape(-1, 3)
    return [" ".join(map(repr, row)) for row in flat.tolist()]
