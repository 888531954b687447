"""From a file of points to a solid and its files, as ``palpate rebuild`` does it.

Linear algebra runs on one processor: small systems gain nothing from more, and lose much on a busy
computer.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from pathlib import Path
from typing import NamedTuple

import numpy as np

from palpate.core import Floats, transform_points
from palpate.core.rebuild import Method, Solid
from palpate.core.rebuild.contours import into_frame
from palpate.core.rebuild.surface import SurfaceMesh
from palpate.launch.files import (
    LATTICE_SUFFIXES,
    MESH_UNITS,
    METRES_PER_UNIT,
    SOLID_SUFFIX,
    FileWriter,
    InputError,
    MeasuredContours,
    read_points,
    read_tops,
    save,
    write_atomically,
    write_lattice,
    write_mesh,
)

# Ending of a file whose unit is known; a folder is that of a run, which holds such a file.
RECORDING_SUFFIX = ".mcap"
# A contour by its place among those that were read.
CONTOUR_NUMBER = re.compile(r"\bcontour (\d+)\b")
ProgressText = Callable[[str], None]


class RebuildOptions(NamedTuple):
    """What is asked for; lengths in the unit of the points."""

    unit: str | None = None  # Of the points; m if None
    method: Method = "lattice"  # See `palpate.reconstruct`
    tops: Path | None = None  # File of points at which the ends were touched
    bottom: float | None = None  # Height of the lower end
    top: float | None = None  # Height of the upper end
    noise: float | None = None  # Standard deviation of a coordinate
    tolerance: float | None = None  # Of the mesh


class RebuildResult(NamedTuple):
    """A solid, and how it came about; in m."""

    solid: Solid
    mesh: SurfaceMesh
    found: MeasuredContours  # What was read
    unit: str  # As which it was read
    assumed: bool  # Whether nobody said so


def rebuild(points: Path, wanted: RebuildOptions, say: ProgressText) -> RebuildResult:
    """Read points and rebuild a solid from them.

    Parameters
    ----------
    points : Path
        See `read_points`.
    wanted : Wanted
        What is asked for.
    say : callable
        Told in some words what is being done.

    Raises
    ------
    InputError
        If a file cannot be read, or no solid can be made of it: the sentence says why.
    """
    # Heavy, and not needed by those who ask for help.
    from palpate.core.rebuild import reconstruct

    _check_lengths(wanted)
    unit, assumed = _unit_of_points(points, wanted.unit)
    say("reading the points")
    found = read_points(points).scaled(METRES_PER_UNIT[unit])
    tops = _touched_ends(found, wanted, METRES_PER_UNIT[unit])
    say(f"rebuilding from {len(found.contours)} contours")
    try:
        with single_threaded():
            solid = reconstruct(
                found.contours,
                found.normals,
                found.felt,
                tops=tops,
                method=wanted.method,
                frame=found.frame,
                noise=None if wanted.noise is None else METRES_PER_UNIT[unit] * wanted.noise,
            )
            say("meshing")
            mesh = _meshed(solid, wanted.tolerance, unit)
    except ValueError as error:
        raise InputError(f"{points}: {_with_contour_names(str(error), found)}") from None
    return RebuildResult(solid, mesh, found, unit, assumed)


def _check_lengths(wanted: RebuildOptions) -> None:
    for name in ("bottom", "top", "noise", "tolerance"):
        value = getattr(wanted, name)
        if value is not None and not math.isfinite(value):
            raise InputError(f"--{name} {value:g}: must be a finite number")


def _unit_of_points(points: Path, unit: str | None) -> tuple[str, bool]:
    recorded = points.is_dir() or points.suffix.lower() == RECORDING_SUFFIX
    if recorded and unit not in (None, "m"):
        raise InputError(f"--unit {unit}: {points} is a recording, and recordings are in m")
    return unit or "m", unit is None and not recorded


def _touched_ends(found: MeasuredContours, wanted: RebuildOptions, metres: float) -> Floats | None:
    """Touched ends from all sources; heights beyond the contours, each on its side."""
    parts = [] if found.tops is None else [found.tops]
    if wanted.tops is not None:
        parts.append(metres * read_tops(wanted.tops))
    seen = [into_frame(found.frame, one) for one in found.contours if np.isfinite(one).any()]
    levels = [float(np.nanmean(one[:, 2])) for one in seen]
    if levels:
        _check_noise(wanted, found, metres)
        _check_ends(wanted, min(levels) / metres, max(levels) / metres)
    for height in (wanted.bottom, wanted.top):
        if height is not None:
            point = np.array([[0.0, 0.0, metres * height]])
            parts.append(point if found.frame is None else transform_points(found.frame, point))
    return np.concatenate(parts) if parts else None


def _check_noise(wanted: RebuildOptions, found: MeasuredContours, metres: float) -> None:
    points = np.concatenate(found.contours)
    size = float((np.nanmax(points, axis=0) - np.nanmin(points, axis=0)).max()) / metres
    if wanted.noise is not None and wanted.noise >= size:
        raise InputError(
            f"--noise {wanted.noise:g}: must be less than the object is large, "
            f"{size:.3g} {wanted.unit or 'm'}"
        )


def _check_ends(wanted: RebuildOptions, low: float, high: float) -> None:
    for name, height, way in (("--bottom", wanted.bottom, -1.0), ("--top", wanted.top, 1.0)):
        if height is not None and not (low if way < 0.0 else high) * way <= height * way:
            raise InputError(
                f"{name} {height:g}: must lie beyond the contours, which go from {low:.6g} "
                f"to {high:.6g}"
            )


def _meshed(solid: Solid, tolerance: float | None, unit: str) -> SurfaceMesh:
    if tolerance is None:
        return solid.mesh()
    try:
        return solid.mesh(METRES_PER_UNIT[unit] * tolerance)
    except ValueError:
        # The surface speaks in m, and whoever asks in the unit of the points.
        raise InputError(
            f"--tolerance {tolerance:g}: {tolerance:g} {unit} would take more triangles than a "
            "mesh may have; try a larger one"
        ) from None


def _with_contour_names(text: str, found: MeasuredContours) -> str:
    """A sentence with contours called as in the file, where each has a number and lines."""
    places = found.places
    return CONTOUR_NUMBER.sub(
        lambda match: places[int(match[1])] if int(match[1]) < len(places) else match[0], text
    )


def check_outputs(points: Path, outs: Sequence[Path], lattice: Path | None, method: Method) -> None:
    """Refuse names of files that cannot be written, before anything is done.

    Raises
    ------
    InputError
        If an ending is unknown, a folder is not there, there will be no lattice, or the points
        would be overwritten.
    """
    known = (*MESH_UNITS, SOLID_SUFFIX)
    for path in outs:
        if path.suffix.lower() not in known:
            raise InputError(f"-o {path}: must end in one of {', '.join(known)}")
    if lattice is not None:
        if lattice.suffix.lower() not in LATTICE_SUFFIXES:
            raise InputError(
                f"--lattice {lattice}: must end in one of {', '.join(LATTICE_SUFFIXES)}"
            )
        if method not in ("lattice", "thesis"):
            raise InputError(f"--lattice {lattice}: the method {method} has no control lattice")
    everything = [*outs, *([] if lattice is None else [lattice])]
    for path in everything:
        if not path.parent.is_dir():
            raise InputError(f"{path}: cannot be written: there is no folder {path.parent}")
        if path.resolve() == points.resolve():
            raise InputError(f"{path}: is the file that is read; write to another")
    if len(set(everything)) < len(everything):
        raise InputError("each file that is written must have a name of its own")


def write_outputs(rebuilt: RebuildResult, outs: Sequence[Path], lattice: Path | None) -> None:
    """Write all files, or none.

    Raises
    ------
    InputError
        If one cannot be written.
    """
    files: dict[Path, FileWriter] = {}
    mesh, solid = rebuilt.mesh, rebuilt.solid
    for path in outs:
        if path.suffix.lower() == SOLID_SUFFIX:
            files[path] = lambda part: save(solid, part)
        else:
            files[path] = lambda part: write_mesh(part, mesh.vertices, mesh.faces)
    control = None if lattice is None else solid.control_lattice
    if lattice is not None:
        if control is None:
            raise InputError(f"--lattice {lattice}: this solid has no control lattice")
        grid = control
        files[lattice] = lambda part: write_lattice(part, grid)
    write_atomically(files)


def single_threaded() -> AbstractContextManager[object]:
    """A context in which numpy and scipy calculate on one processor."""
    # Looks through all loaded libraries: after numpy and scipy are.
    import scipy.linalg  # noqa: F401
    from threadpoolctl import threadpool_limits

    limits: AbstractContextManager[object] = threadpool_limits(1)
    return limits
