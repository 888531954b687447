"""A rebuilt solid as one file that holds everything, and back, bit for bit; NPZ files.

No array of an NPZ file is read before its size is known, and nothing in it is ever run. A control
lattice is written as arrays, or as a structured grid that ParaView shows.
"""

from __future__ import annotations

import io
import math
import tokenize
import zipfile
import zlib
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from palpate.core import FORM_KEY, Floats, tree_from_arrays, tree_to_arrays
from palpate.core.rebuild import GeneralSolid, Solid
from palpate.core.rebuild.lattice import LatticeGrid, lattice_grid
from palpate.core.splines import Lattice
from palpate.launch.files.file_access import read_bounded, write_atomically
from palpate.launch.files.source_map import InputError, as_input_errors

SOLID_SUFFIX = ".npz"
MAX_SOLID_BYTES = 512 << 20  # Largest file
ALWAYS_ALLOWED_BYTES = 32 << 20  # Bytes to which any file may unpack
MAX_RATIO = 16  # Times its own size to which a larger one may: measured numbers do not pack better
MAX_ARRAYS = 4096  # Arrays of a file
MAX_AXIS_LENGTH = 1 << 40  # Along an axis
Arrays = dict[str, NDArray[np.generic]]
# What zipfile and numpy raise at files that are not what they say.
_FAULTS = (
    zipfile.BadZipFile,
    zlib.error,
    tokenize.TokenError,
    EOFError,
    LookupError,
    MemoryError,
    NotImplementedError,
    OSError,
    OverflowError,
    RecursionError,
    RuntimeError,
    SyntaxError,
    TypeError,
    ValueError,
)
LATTICE_SUFFIXES = (".npz", ".vtk")
AXES = "stu"


def save(solid: Solid | GeneralSolid, path: str | Path) -> None:
    """Write everything that there is to a solid that was rebuilt.

    `path`: a name that ends in ``.npz``; it is replaced as a whole. Raises InputError if it ends
    otherwise, or the file cannot be written; TypeError if it is no solid.
    """
    if not isinstance(solid, Solid | GeneralSolid):
        raise TypeError(f"solid must be a Solid, as reconstruct returns it, got {solid!r:.60}")
    path = Path(path)
    if path.suffix != SOLID_SUFFIX:
        raise InputError(f"{path}: must end in {SOLID_SUFFIX}, got {path.suffix or 'no suffix'!r}")
    arrays = tree_to_arrays(solid)
    write_atomically({path: lambda part: write_arrays(part, arrays)})


def write_arrays(path: Path, arrays: Arrays) -> None:
    """An NPZ file of arrays, the same bytes for the same arrays."""
    with path.open("wb") as file:
        np.savez(file, allow_pickle=False, **arrays)


def load(path: str | Path) -> Solid | GeneralSolid:
    """The solid that `save` wrote, or that a run left in its ``model.npz``.

    The file may be from anybody: nothing in it is ever run. Raises InputError if it cannot be read,
    or holds no solid, or one of another version.
    """
    path = Path(path)
    arrays = read_arrays(path)
    if FORM_KEY not in arrays:
        raise InputError(f"{path}: holds no solid: it was not written by palpate.save")
    with as_input_errors(path):
        found = tree_from_arrays(arrays)
    if not isinstance(found, Solid | GeneralSolid):
        raise InputError(f"{path}: holds a {type(found).__name__}, not a solid")
    return found


def read_arrays(path: Path) -> Arrays:
    """All arrays of an NPZ file; InputError if it is unreadable, too large, or holds objects."""
    data = read_bounded(path, MAX_SOLID_BYTES)
    with as_input_errors(path):
        return read_npz(data)


def read_npz(data: bytes) -> Arrays:
    """All arrays in the bytes of an NPZ file, by name.

    Raises ValueError if it is none, holds objects, or unpacks to far more than it is; the text is
    the rest of a sentence about the file.
    """
    try:
        parts = zipfile.ZipFile(io.BytesIO(data))
    except _FAULTS:
        raise ValueError("is no NPZ file") from None
    with parts:
        _check_sizes(parts.infolist(), len(data))
        return {one.filename.removesuffix(".npy"): _array(parts, one) for one in parts.infolist()}


def _check_sizes(parts: list[zipfile.ZipInfo], size: int) -> None:
    unpacked = sum(part.file_size for part in parts)
    packed = sum(part.compress_size for part in parts)
    if len(parts) > MAX_ARRAYS:
        raise ValueError(f"holds {len(parts)} arrays; at most {MAX_ARRAYS} are read")
    if unpacked > max(ALWAYS_ALLOWED_BYTES, MAX_RATIO * size):
        raise ValueError(f"unpacks to {unpacked >> 20} MiB, more than is read of such a file")
    if packed > size:
        raise ValueError("is no NPZ file: its parts overlap")
    if any(part.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED) for part in parts):
        raise ValueError("is no NPZ file: it is packed in a way that is not read")


def _array(parts: zipfile.ZipFile, part: zipfile.ZipInfo) -> NDArray[np.generic]:
    name = part.filename[:40]
    try:
        content = io.BytesIO(parts.read(part))
        version = np.lib.format.read_magic(content)
        if version == (1, 0):
            header = np.lib.format.read_array_header_1_0(content)
        elif version == (2, 0):
            header = np.lib.format.read_array_header_2_0(content)
        else:
            raise ValueError(f"an array of format {version}")
        shape, _, kind = header
        if kind.hasobject:
            raise ValueError("an array of objects, which are not read")
        stated = math.prod(shape) * kind.itemsize
        held = part.file_size - content.tell()
        if min(shape, default=0) < 0 or max(shape, default=0) > MAX_AXIS_LENGTH or stated != held:
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
    with path.open("wb") as file:
        np.savez(file, allow_pickle=False, **arrays)


def _vtk(parts: LatticeGrid) -> str:
    """A structured grid of the deformed points, which know their weights and where they were."""
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
    """Points with the first axis fastest, as the format has it, to the last bit."""
    flat = points.transpose(2, 1, 0, 3).reshape(-1, 3)
    return [" ".join(map(repr, row)) for row in flat.tolist()]
