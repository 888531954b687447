"""Files of felt or measured points, by their endings."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.core.arrays import Floats
from palpate.launch.cloud_slices import cut_cloud
from palpate.launch.located import InputError
from palpate.launch.mesh_file import read_cloud
from palpate.launch.points_found import PointsFound, felt_of
from palpate.launch.points_recording import read_recording
from palpate.launch.points_table import CONTOUR, MOST_NUMBER, NORMAL, PLACE, TOUCH, read_table
from palpate.launch.solid_file import read_arrays

NUMBERED = re.compile(r"contour_(\d+)")
"""Name of one contour's array."""
RECORDING = "topics.mcap"
"""Name of the recording in the folder of a run."""
LEAST_CLOUD = 6
"""Points of a cloud: two contours of three."""


def read_points(path: Path) -> PointsFound:
    """Contours from a file, in its own unit.

    Parameters
    ----------
    path : Path
        NPZ, CSV, TXT or XYZ, PLY without faces, MCAP, or the folder of a run.

    Raises
    ------
    InputError
        If it cannot be read or holds no contours; the sentence tells the file and the line.
    """
    if not path.exists():
        raise InputError(f"{path}: cannot be read: No such file or directory")
    if path.is_dir():
        path = path / RECORDING
        if not path.exists():
            raise InputError(f"{path.parent}: is no folder of a run: it holds no {RECORDING}")
    kind = path.suffix.lower()
    if kind not in READERS:
        known = ", ".join(READERS)
        raise InputError(f"{path}: {kind or 'no suffix'!r} is no format of points; known: {known}")
    found = READERS[kind](path)
    if not found.contours:
        raise InputError(f"{path}: holds no points")
    return found


def read_tops(path: Path) -> Floats:
    """Where ends were touched, (k, 3), from a text file of x, y and z.

    Raises
    ------
    InputError
        If it cannot be read.
    """
    columns = read_table(path).columns
    tops = np.column_stack([columns[name] for name in PLACE])
    if not len(tops):
        raise InputError(f"{path}: holds no points that are finite")
    return tops


def _read_text(path: Path) -> PointsFound:
    table = read_table(path)
    columns = table.columns
    points = np.column_stack([columns[name] for name in PLACE])
    if CONTOUR not in columns:
        found = _cut(path, points)
        passed = [name for name in (*NORMAL, TOUCH) if name in columns]
        notes = [f"{', '.join(passed)} passed over: there is no column contour"] if passed else []
        return found._replace(notes=(*table.notes, *found.notes, *notes))
    rows = _rows_by_number(columns[CONTOUR])
    lines = np.array(table.lines)
    normals = None
    if NORMAL[0] in columns:
        stacked = np.column_stack([columns[name] for name in NORMAL])
        normals = tuple(stacked[part] for part in rows.values())
    contours = tuple(points[part] for part in rows.values())
    felt = None
    if TOUCH in columns:
        order = np.concatenate(list(rows.values()))
        felt = felt_of(contours, normals, columns[TOUCH][order].astype(np.int32))
    return PointsFound(
        contours=contours,
        places=tuple(
            f"contour {number} (lines {lines[part].min()} to {lines[part].max()})"
            for number, part in rows.items()
        ),
        normals=normals,
        felt=felt,
        notes=table.notes,
    )


def _read_cloud(path: Path) -> PointsFound:
    points = read_cloud(path, "m")
    if points is None:
        raise InputError(f"{path}: holds a surface; to measure it there is palpate score")
    return _cut(path, points)


def _cut(path: Path, points: Floats) -> PointsFound:
    if len(points) < LEAST_CLOUD:
        raise InputError(f"{path}: holds {len(points)} points; at least {LEAST_CLOUD} are needed")
    good = np.isfinite(points).all(axis=1)
    if not good.all():
        raise InputError(f"{path}: point {int(np.argmin(good))} is not finite")
    try:
        return cut_cloud(points)
    except ValueError as error:
        raise InputError(f"{path}: {error}") from None


def _read_npz(path: Path) -> PointsFound:
    arrays = read_arrays(path)
    tops = _array(path, arrays, "tops", 3) if "tops" in arrays else None
    numbered = sorted(int(name[1]) for name in map(NUMBERED.fullmatch, arrays) if name)
    if numbered:
        found = _numbered(path, arrays, numbered)
    elif "contours" in arrays:
        found = _stacked(path, arrays)
    else:
        names = ", ".join(sorted(arrays)[:8]) or "nothing"
        raise InputError(
            f"{path}: must hold contours and contour, or contour_0, contour_1 and so on; "
            f"it holds {names}"
        )
    return found._replace(tops=tops)


def _numbered(path: Path, arrays: Mapping[str, Any], numbers: list[int]) -> PointsFound:
    contours = tuple(_array(path, arrays, f"contour_{i}", 3) for i in numbers)
    normals = None
    if any(name.startswith("normals_") for name in arrays):
        normals = tuple(_array(path, arrays, f"normals_{i}", 3) for i in numbers)
        _check_lengths(path, "normals", contours, normals)
    return PointsFound(contours, tuple(f"contour {i}" for i in numbers), normals)


def _stacked(path: Path, arrays: Mapping[str, Any]) -> PointsFound:
    """Contours (m, n, 3), or points (n, 3) with the number of the contour of each."""
    given = arrays["contours"]
    if given.ndim == 3 and given.shape[2] == 3 and given.dtype.kind in "fiu":
        parts = tuple(np.asarray(one, np.float64) for one in given)
        return PointsFound(parts, tuple(f"contour {i}" for i in range(len(parts))))
    points = _array(path, arrays, "contours", 3)
    if CONTOUR not in arrays:
        raise InputError(
            f"{path}: contours are ({len(points)}, 3) points; contour must number them"
        )
    rows = _rows_by_number(_whole(path, arrays, CONTOUR, len(points)))
    contours = tuple(points[part] for part in rows.values())
    normals = felt = None
    if "normals" in arrays:
        stacked = _array(path, arrays, "normals", 3, len(points))
        normals = tuple(stacked[part] for part in rows.values())
    if TOUCH in arrays:
        numbers = _whole(path, arrays, TOUCH, len(points)).astype(np.int32)
        felt = felt_of(contours, normals, numbers[np.concatenate(list(rows.values()))])
    names = tuple(f"contour {number}" for number in rows)
    return PointsFound(contours, names, normals, felt)


def _array(
    path: Path,
    arrays: Mapping[str, NDArray[Any]],
    name: str,
    width: int | None,
    length: int | None = None,
) -> Floats:
    """One array of numbers, of a width and a length."""
    wanted = "(n,)" if width is None else f"(n, {width})"
    if name not in arrays:
        raise InputError(f"{path}: lacks {name}, which must be {wanted}")
    found = arrays[name]
    fits = found.ndim == (1 if width is None else 2) and found.dtype.kind in "fiu"
    if not fits or (width is not None and found.shape[1] != width):
        raise InputError(f"{path}: {name} must be {wanted}, got {found.dtype} {found.shape}")
    if length is not None and len(found) != length:
        raise InputError(f"{path}: {name} must have {length} rows, as contours, got {len(found)}")
    return np.asarray(found, np.float64)


def _whole(path: Path, arrays: Mapping[str, NDArray[Any]], name: str, length: int) -> Floats:
    """One array of whole numbers, of a length."""
    numbers = _array(path, arrays, name, None, length)
    bad = ~(np.abs(numbers) <= MOST_NUMBER) | (numbers != np.round(numbers))
    if bad.any():
        row = int(np.argmax(bad))
        raise InputError(
            f"{path}: {name} must hold whole numbers up to {MOST_NUMBER}, "
            f"got {numbers[row]:g} in row {row}"
        )
    return numbers


def _check_lengths(
    path: Path, name: str, contours: tuple[Floats, ...], others: tuple[Floats, ...]
) -> None:
    for number, (one, other) in enumerate(zip(contours, others, strict=True)):
        if len(one) != len(other):
            raise InputError(
                f"{path}: {name}_{number} must have {len(one)} rows, as its contour, "
                f"got {len(other)}"
            )


def _rows_by_number(numbers: Floats) -> dict[int, NDArray[np.intp]]:
    """Rows of each contour in their order, the contours as they first appear."""
    found, first = np.unique(numbers, return_index=True)
    return {int(found[i]): np.flatnonzero(numbers == found[i]) for i in np.argsort(first)}


READERS: Mapping[str, Callable[[Path], PointsFound]] = {
    ".npz": _read_npz,
    ".csv": _read_text,
    ".txt": _read_text,
    ".xyz": _read_text,
    ".ply": _read_cloud,
    ".mcap": read_recording,
}
"""By ending."""
