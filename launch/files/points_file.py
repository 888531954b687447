"""Files of measured points, by their suffixes: tables, arrays, clouds and recordings.

Text files have a header with the names of the columns, or only x, y and z. From a recording are
read the traced contours and probes, all contacts, and the end of the plan.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import compress
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from palpate.core.arrays import Bools, Floats
from palpate.core.poses import Pose
from palpate.core.rebuild.contours import ContactPoints, stack_points
from palpate.launch.files.file_access import read_bounded
from palpate.launch.files.mesh_file import read_cloud, read_oriented_cloud
from palpate.launch.files.point_clouds import MeasuredContours, contact_points_of, slice_cloud
from palpate.launch.files.solid_file import read_arrays
from palpate.launch.files.source_map import InputError, as_input_errors
from palpate.launch.files.units import column_name
from palpate.messages import CodecError, decode
from palpate.messages.types import Contour, PlanDone, Probe, SensorInfo, SurfacePatch, World
from palpate.nodes.rebuilding.fitting import common_frame, is_upright, touched_ends

CONTOUR_ARRAY = re.compile(r"contour_(\d+)")  # name of the array of a contour
RECORDING_NAME = "topics.mcap"  # of the recording in the folder of a run
MAX_TABLE_BYTES = 256 << 20  # of a text file
POSITION_COLUMNS, NORMAL_COLUMNS = ("x", "y", "z"), ("nx", "ny", "nz")
CONTOUR_COLUMN, TOUCH_COLUMN = "contour", "touch"
# Columns that are read; all others are ignored.
KNOWN_COLUMNS = (*POSITION_COLUMNS, CONTOUR_COLUMN, *NORMAL_COLUMNS, TOUCH_COLUMN)
MAX_NUMBER = 2**31 - 1  # of a contour or a touch: int32
# Types of the messages that are read, by the end of the topic: a finger may come before it.
MESSAGE_TYPES: Mapping[str, type] = {
    "/contour/traced": Contour,
    "/probe/traced": Probe,
    "/touch/patch": SurfacePatch,
    "/touch/info": SensorInfo,
    "/plan/done": PlanDone,
    "/world": World,
}


def read_points(path: Path) -> MeasuredContours:
    """Contours from a file, in its own unit.

    The file is NPZ, CSV, TXT, XYZ, PLY without faces, MCAP, or the folder of a run. Raises
    InputError, with file and line, if it cannot be read or holds no contours.
    """
    if not path.exists():
        raise InputError(f"{path}: cannot be read: No such file or directory")
    path = recording_of(path)
    kind = path.suffix.lower()
    if kind not in POINT_READERS:
        known = ", ".join(POINT_READERS)
        raise InputError(f"{path}: {kind or 'no suffix'!r} is no format of points; known: {known}")
    contours = POINT_READERS[kind](path)
    if not contours.contours:
        raise InputError(f"{path}: holds no points")
    return contours


def recording_of(path: Path) -> Path:
    """The recording in the folder of a run; a path of a file is returned as is.

    Raises InputError if a folder has no recording.
    """
    if not path.is_dir():
        return path
    if not (path / RECORDING_NAME).exists():
        raise InputError(f"{path}: is no folder of a run: it holds no {RECORDING_NAME}")
    return path / RECORDING_NAME


def read_oriented(path: Path) -> tuple[ContactPoints, tuple[str, ...]]:
    """Points with outward normals in no order, in the file's own unit, and notes for the user.

    The file is text with the columns x, y, z, nx, ny, nz, NPZ with ``points`` and ``normals``
    (n, 3), or PLY without faces. Text and NPZ may have ``touch``, the number of each point's touch;
    otherwise each point is a touch of its own. Raises InputError, with file and line, if it cannot
    be read, or the points have no normals.
    """
    kind, touch, notes = path.suffix.lower(), None, tuple[str, ...]()
    if kind == ".ply":
        points, normals = read_oriented_cloud(path)
    elif kind == ".npz":
        arrays = read_arrays(path)
        points, normals = (_array(path, arrays, name, 3) for name in ("points", "normals"))
        touch = arrays.get("touch")
    elif kind in (".csv", ".txt", ".xyz"):
        columns, _, notes = read_table(path)
        if NORMAL_COLUMNS[0] not in columns:
            raise InputError(f"{path}: has no columns nx, ny, nz; points in no order need normals")
        points, normals = _joined(columns, POSITION_COLUMNS), _joined(columns, NORMAL_COLUMNS)
        touch = columns.get(TOUCH_COLUMN)
    else:
        known = ".csv, .txt, .xyz, .npz, .ply, .mcap and the folder of a run"
        text = f"{kind or 'no suffix'!r} is no format of points with normals; known: {known}"
        raise InputError(f"{path}: {text}")
    numbers = np.arange(len(points)) if touch is None else np.unique(touch, return_inverse=True)[1]
    if len(normals) != len(points) or len(numbers) != len(points):
        raise InputError(f"{path}: must have as many normals and touches as points, {len(points)}")
    return ContactPoints(points, normals, numbers.astype(np.int32).reshape(-1)), notes


def read_tops(path: Path) -> Floats:
    """Contacts of ends (k, 3) from a text file of x, y and z."""
    tops, _ = read_positions(path)
    if not len(tops):
        raise InputError(f"{path}: holds no points that are finite")
    return tops


def read_positions(path: Path) -> tuple[Floats, tuple[str, ...]]:
    """Points (n, 3) from a text file of x, y and z, and notes on points that are left out."""
    table = read_table(path)
    return _joined(table.columns, POSITION_COLUMNS), table.notes


class Table(NamedTuple):
    """The known columns of a file, without the rows that are not finite."""

    columns: dict[str, Floats]  # (n,) each, by name
    lines: Sequence[int]  # number of each row's line
    notes: tuple[str, ...]  # on rows that are left out


def _joined(columns: Mapping[str, Floats], names: Sequence[str]) -> Floats:
    return np.column_stack([columns[name] for name in names])


def _read_text(path: Path) -> MeasuredContours:
    table = read_table(path)
    columns = table.columns
    points = _joined(columns, POSITION_COLUMNS)
    if CONTOUR_COLUMN not in columns:
        contours = _cut(path, points)
        unused = [name for name in (*NORMAL_COLUMNS, TOUCH_COLUMN) if name in columns]
        notes = [f"{', '.join(unused)} ignored: there is no column contour"] if unused else []
        return contours._replace(notes=(*table.notes, *contours.notes, *notes))
    rows, lines = _rows_by_number(columns[CONTOUR_COLUMN]), np.array(table.lines)
    normals = _joined(columns, NORMAL_COLUMNS) if NORMAL_COLUMNS[0] in columns else None
    contours = _by_contour(points, rows, normals, columns.get(TOUCH_COLUMN))
    places = (
        f"contour {number} (lines {lines[part].min()} to {lines[part].max()})"
        for number, part in rows.items()
    )
    return contours._replace(places=tuple(places), notes=table.notes)


def read_table(path: Path) -> Table:
    """The columns of a text file in UTF-8, separated by commas, semicolons, tabs or blanks.

    ``#`` begins a comment. Raises InputError if it cannot be read, lacks x, y or z, or a line is no
    row.
    """
    rows = list(_rows(path))
    if not rows:
        raise InputError(f"{path}: holds no points")
    number, first = rows[0]
    separator = next((mark for mark in (",", ";", "\t") if mark in first), None)
    names = [column_name(name) for name in first.split(separator)]
    if any(_as_float(name) is None for name in names):
        rows = rows[1:]
    elif len(names) == len(POSITION_COLUMNS):
        names = list(POSITION_COLUMNS)
    else:
        raise InputError(
            f"{path}:{number}: has {len(names)} columns and no header; name them, "
            f"as in {','.join(POSITION_COLUMNS)},{CONTOUR_COLUMN}"
        )
    _check_names(f"{path}:{number}", names)
    if not rows:
        raise InputError(f"{path}:{number}: holds no points under its header")
    values = np.array([_values(path, line, text, separator, names) for line, text in rows])
    return _finite(names, values, [line for line, _ in rows])


def _rows(path: Path) -> Iterator[tuple[int, str]]:
    """Lines that are not empty, with their numbers from 1."""
    data = read_bounded(path, MAX_TABLE_BYTES)
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data[: error.start].count(b"\n") + 1
        raise InputError(f"{path}:{line}: is no text in UTF-8") from None
    for number, row in enumerate(text.splitlines(), start=1):
        content = row.partition("#")[0].strip()
        if content:
            yield number, content


def _check_names(place: str, names: Sequence[str]) -> None:
    missing = [name for name in POSITION_COLUMNS if name not in names]
    if missing:
        known = ", ".join(KNOWN_COLUMNS)
        raise InputError(f"{place}: lacks the column {missing[0]}; known: {known}")
    twice = [name for name in KNOWN_COLUMNS if names.count(name) > 1]
    if twice:
        raise InputError(f"{place}: has the column {twice[0]} more than once")
    normals = [name for name in NORMAL_COLUMNS if name in names]
    if 0 < len(normals) < len(NORMAL_COLUMNS):
        raise InputError(f"{place}: has {', '.join(normals)} alone; nx, ny and nz belong together")


def _values(
    path: Path, line: int, text: str, separator: str | None, names: Sequence[str]
) -> list[float]:
    cells, place = text.split(separator), f"{path}:{line}"
    if len(cells) != len(names):
        raise InputError(f"{place}: has {len(cells)} columns where {len(names)} are named")
    values = []
    for name, cell in zip(names, cells, strict=True):
        value = _as_float(cell.strip().strip('"')) if name in KNOWN_COLUMNS else 0.0
        if value is None:
            raise InputError(f"{place}: {name} must be a number, got {cell.strip()!r:.40}")
        if name in (CONTOUR_COLUMN, TOUCH_COLUMN) and math.isfinite(value):
            if value != int(value):
                raise InputError(f"{place}: {name} must be a whole number, got {value:g}")
            if abs(value) > MAX_NUMBER:
                raise InputError(f"{place}: {name} must be at most {MAX_NUMBER}, got {value:g}")
        values.append(value)
    return values


def _as_float(text: str) -> float | None:
    try:
        return float(text)
    except ValueError:
        return None


def _finite(
    names: Sequence[str], values: Floats, lines: Sequence[int], max_named: int = 6
) -> Table:
    """The table without rows that are not finite, with a note that names `max_named` of these."""
    is_finite: Bools = np.asarray(np.isfinite(values).all(axis=1))
    kept, left = ([*compress(lines, which.tolist())] for which in (is_finite, ~is_finite))
    notes: tuple[str, ...] = ()
    if left:
        shown = ", ".join(str(line) for line in left[:max_named])
        more = f" and {len(left) - max_named} more" if len(left) > max_named else ""
        plural = "" if len(left) == 1 else "s"
        text = f"left out {len(left)} point{plural} not finite, line{plural} {shown}{more}"
        notes = (text,)
    columns = {
        name: values[is_finite, names.index(name)] for name in KNOWN_COLUMNS if name in names
    }
    return Table(columns, kept, notes)


def _read_cloud(path: Path) -> MeasuredContours:
    points = read_cloud(path, "m")
    if points is None:
        raise InputError(f"{path}: holds a surface; palpate score measures it")
    return _cut(path, points)


def _cut(path: Path, points: Floats, min_points: int = 6) -> MeasuredContours:
    """Contours of a cloud; it needs at least two contours of three points."""
    if (count := len(points)) < min_points:
        raise InputError(f"{path}: holds {count} points; at least {min_points} are needed")
    is_finite = np.isfinite(points).all(axis=1)
    if not is_finite.all():
        raise InputError(f"{path}: point {int(np.argmin(is_finite))} is not finite")
    with as_input_errors(path):
        return slice_cloud(points)


def _read_npz(path: Path) -> MeasuredContours:
    arrays = read_arrays(path)
    tops = _array(path, arrays, "tops", 3) if "tops" in arrays else None
    numbered = sorted(int(name[1]) for name in map(CONTOUR_ARRAY.fullmatch, arrays) if name)
    if numbered:
        contours = _numbered(path, arrays, numbered)
    elif "contours" in arrays:
        contours = _numbered_points(path, arrays)
    else:
        names = ", ".join(sorted(arrays)[:8]) or "nothing"
        raise InputError(
            f"{path}: must hold contours and contour, or contour_0, contour_1 and so on; "
            f"it holds {names}"
        )
    return contours._replace(tops=tops)


def _numbered(path: Path, arrays: Mapping[str, Any], numbers: list[int]) -> MeasuredContours:
    contours = tuple(_array(path, arrays, f"contour_{i}", 3) for i in numbers)
    normals = None
    if any(name.startswith("normals_") for name in arrays):
        normals = tuple(_array(path, arrays, f"normals_{i}", 3) for i in numbers)
        for number, (points, directions) in enumerate(zip(contours, normals, strict=True)):
            if len(points) != len(directions):
                text = f"normals_{number} must have {len(points)} rows, as its contour"
                raise InputError(f"{path}: {text}, got {len(directions)}")
    return MeasuredContours(contours, tuple(f"contour {i}" for i in numbers), normals)


def _numbered_points(path: Path, arrays: Mapping[str, Any]) -> MeasuredContours:
    """Contours (m, n, 3), or points (n, 3) with the number of the contour of each."""
    contours = arrays["contours"]
    if contours.ndim == 3 and contours.shape[2] == 3 and contours.dtype.kind in "fiu":
        parts = tuple(np.asarray(contour, np.float64) for contour in contours)
        return MeasuredContours(parts, tuple(f"contour {i}" for i in range(len(parts))))
    points = _array(path, arrays, "contours", 3)
    if CONTOUR_COLUMN not in arrays:
        raise InputError(
            f"{path}: contours are ({len(points)}, 3) points; contour must number them"
        )
    rows = _rows_by_number(_whole_numbers(path, arrays, CONTOUR_COLUMN, len(points)))
    normals = touches = None
    if "normals" in arrays:
        normals = _array(path, arrays, "normals", 3, len(points))
    if TOUCH_COLUMN in arrays:
        touches = _whole_numbers(path, arrays, TOUCH_COLUMN, len(points))
    return _by_contour(points, rows, normals, touches)


def _rows_by_number(numbers: Floats) -> dict[int, NDArray[np.intp]]:
    """Rows of each contour in their order; contours are in the order of their first rows."""
    unique, first = np.unique(numbers, return_index=True)
    return {int(unique[i]): np.flatnonzero(numbers == unique[i]) for i in np.argsort(first)}


def _by_contour(
    points: Floats,
    rows: Mapping[int, NDArray[np.intp]],
    normals: Floats | None,
    touches: Floats | None,
) -> MeasuredContours:
    """Contours of points (n, 3), their normals (n, 3) and touches (n,), by rows of contours."""
    contours, taxels = tuple(points[part] for part in rows.values()), None
    outwards = normals if normals is None else tuple(normals[part] for part in rows.values())
    if touches is not None:
        numbers = touches[np.concatenate(list(rows.values()))].astype(np.int32)
        taxels = contact_points_of(contours, outwards, numbers)
    return MeasuredContours(contours, tuple(f"contour {i}" for i in rows), outwards, taxels)


def _whole_numbers(
    path: Path, arrays: Mapping[str, NDArray[Any]], name: str, length: int
) -> Floats:
    numbers = _array(path, arrays, name, None, length)
    bad = ~(np.abs(numbers) <= MAX_NUMBER) | (numbers != np.round(numbers))
    if bad.any():
        row = int(np.argmax(bad))
        raise InputError(
            f"{path}: {name} must hold whole numbers up to {MAX_NUMBER}, "
            f"got {numbers[row]:g} in row {row}"
        )
    return numbers


def _array(
    path: Path,
    arrays: Mapping[str, NDArray[Any]],
    name: str,
    width: int | None,
    length: int | None = None,
) -> Floats:
    shape = "(n,)" if width is None else f"(n, {width})"
    if name not in arrays:
        raise InputError(f"{path}: lacks {name}, which must be {shape}")
    array = arrays[name]
    fits = array.ndim == (1 if width is None else 2) and array.dtype.kind in "fiu"
    if not fits or (width is not None and array.shape[1] != width):
        raise InputError(f"{path}: {name} must be {shape}, got {array.dtype} {array.shape}")
    if length is not None and len(array) != length:
        raise InputError(f"{path}: {name} must have {length} rows, as contours, got {len(array)}")
    return np.asarray(array, np.float64)


def read_recording(path: Path) -> MeasuredContours:
    """Closed contours of a recording with all taxels of their touches [m].

    Raises InputError if it cannot be read, or holds no closed contour.
    """
    return contours_of(path, _recorded(path))


def _recorded(path: Path) -> dict[type, list[Any]]:
    """All messages of the `MESSAGE_TYPES` in a recording, by their types."""
    # Imported late, with mcap: other formats do not need it.
    from palpate.messages.recording import open_recording

    recorded: dict[type, list[Any]] = {kind: [] for kind in MESSAGE_TYPES.values()}
    try:
        for kept in open_recording(path).messages():
            for end, kind in MESSAGE_TYPES.items():
                if kept.topic.endswith(end):
                    recorded[kind].append(decode(kind, kept.body))
    except CodecError as error:
        raise InputError(f"{path}: was recorded with other messages: {error}") from None
    except ValueError as error:
        raise InputError(str(error)) from None
    return recorded


class RecordedTouches(NamedTuple):
    """Contacts of all touches of a recording."""

    taxels: ContactPoints  # with the numbers of their touches [m]
    platform: float | None  # its height under the object [m]; None if the object is held


def read_touches(path: Path) -> RecordedTouches:
    """All taxels with contact of a recording, also those of contours that are not closed.

    Raises InputError if it cannot be read, or nothing was touched.
    """
    recorded = _recorded(path)
    goals = {item.id for kind in (Contour, Probe) for item in recorded[kind]}
    for done in recorded[PlanDone][-1:]:
        goals = {*done.contours, *done.probes}
    touches = _touches(recorded, goals)
    if not touches:
        raise InputError(
            f"{path}: holds no touches with their taxels; record the topics /touch/info and "
            "/touch/patch, or leave out --method general"
        )
    world = recorded[World][-1] if recorded[World] else None
    platform = None if world is None or world.held else float(world.platform)
    taxels = stack_points([points for items in touches.values() for points in items])
    return RecordedTouches(taxels, platform)


def contours_of(path: Path, recorded: Mapping[type, Sequence[Any]]) -> MeasuredContours:
    """Closed contours, contacts of ends, and all taxels, of the goals of the finished plan, if any.

    `recorded`: messages of each of the `MESSAGE_TYPES`. Raises InputError with the path if no
    contour is closed, or they were traced in several frames.
    """
    contours: Sequence[Contour] = recorded[Contour]
    probes: Sequence[Probe] = recorded[Probe]
    for done in recorded[PlanDone][-1:]:
        contours = [contour for contour in contours if contour.id in done.contours]
        probes = [probe for probe in probes if probe.id in done.probes]
    closed = [contour for contour in contours if contour.status == "closed"]
    if not closed:
        raise InputError(f"{path}: holds no closed contour, of {len(contours)} that were traced")
    hits = [probe for probe in probes if probe.outcome == "hit"]
    goals = {contour.id for contour in closed} | {probe.id for probe in hits}
    touches = _touches(recorded, goals)
    taxels, notes = None, []
    if touches:
        taxels = stack_points([points for items in touches.values() for points in items])
        notes = [f"{len(taxels.points)} taxels of {taxels.touch.max() + 1} touches"]
    if len(closed) < len(contours):
        notes.append(f"left out {len(contours) - len(closed)} contours that were not closed")
    world = recorded[World][-1] if recorded[World] else None
    platform = None if world is None or world.held else world.platform
    with as_input_errors(path):
        frame = common_frame(closed)
        tops = touched_ends(closed, hits, touches, platform)
    if not is_upright(frame):
        lean = np.degrees(np.arccos(np.clip(Pose.from_array(frame).axes[2, 2], -1.0, 1.0)))
        notes.append(f"sliced along an axis that leans by {lean:.1f} deg")
    elif platform is not None:
        notes.append("the object stands on its platform, which is a touch of its lower end")
    return MeasuredContours(
        contours=tuple(np.array(contour.points) for contour in closed),
        places=tuple(f"contour {contour.id}" for contour in closed),
        normals=tuple(np.array(contour.normals) for contour in closed),
        taxels=taxels,
        tops=tops,
        frame=np.array(frame),
        notes=tuple(notes),
    )


def _touches(
    recorded: Mapping[type, Sequence[Any]], goals: set[int]
) -> dict[int, list[ContactPoints]]:
    """Contacts of each touch of some goals, by goal, as in the reconstructor."""
    if not recorded[SensorInfo]:
        return {}
    touches: dict[int, list[ContactPoints]] = {}
    for patch in sorted(recorded[SurfacePatch], key=lambda patch: (patch.goal, patch.touch)):
        if patch.goal in goals and len(patch.points):
            points = ContactPoints.of_touch(patch.points, patch.normals)
            touches.setdefault(patch.goal, []).append(points)
    return touches


# By suffix.
POINT_READERS: Mapping[str, Callable[[Path], MeasuredContours]] = {
    ".npz": _read_npz,
    ".csv": _read_text,
    ".txt": _read_text,
    ".xyz": _read_text,
    ".ply": _read_cloud,
    ".mcap": read_recording,
}
