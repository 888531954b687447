"""A solid of any shape from a file of points with normals in any order: `rebuild_general`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from palpate.core.geometry import areas_and_normals, self_intersection, solidity
from palpate.core.rebuild import GeneralSolid, rebuild_general
from palpate.core.rebuild.contours import ContactPoints, checked_contacts
from palpate.core.rebuild.general import oriented, touch_distances
from palpate.core.shapes import Mesh
from palpate.launch.files.file_access import write_atomically
from palpate.launch.files.points_file import read_oriented, read_touches, recording_of
from palpate.launch.files.source_map import InputError
from palpate.launch.files.units import METRES_PER_UNIT
from palpate.launch.printing import counted
from palpate.tools.reconstruction import (
    RECORDING_SUFFIX,
    ProgressText,
    RebuildOptions,
    check_recorded_unit,
    single_threaded,
    size_warnings,
    solid_writers,
    written_files,
)


@dataclass(frozen=True, slots=True, kw_only=True)
class CoverageLimits:
    """How much of a surface may lie far from all points without a warning."""

    max_distance: float = 5.0e-3  # [m] from the nearest point; beyond it the surface is a guess
    max_far_share: float = 0.01  # fraction of the area that may lie farther off


DEFAULT_COVERAGE = CoverageLimits()


def rebuild_scattered(
    points: Path,
    wanted: RebuildOptions,
    outs: Sequence[Path],
    say: ProgressText,
    limits: CoverageLimits = DEFAULT_COVERAGE,
) -> dict[str, Any]:
    """Rebuild a solid, write the files, and return the record with the names of `rebuild_record`.

    `say` is called with each step. Raises InputError if a file cannot be read or written, the
    points have no normals, or no solid can be made of them.
    """
    for name in ("tops", "top", "tolerance"):
        if getattr(wanted, name) is not None:
            raise InputError(f"--{name} is of no use with --method general")
    say("reading the points")
    read = _read(points, wanted)
    say(f"rebuilding from {len(read.contacts.points)} points")
    pose = None if wanted.noise is None else read.metres * wanted.noise
    known = {"platform": read.platform, "pose": pose}
    options: dict[str, Any] = {name: v for name, v in known.items() if v is not None}
    notes = list(read.notes)
    try:
        with single_threaded():
            contacts, turned = oriented(checked_contacts(read.contacts))
            if turned:
                notes.append(
                    f"turned the normals of {counted(turned, 'point')}: they pointed inwards"
                )
            solid = rebuild_general(contacts, outward=True, **options)
            say("meshing")
            mesh = solid.mesh()
    except ValueError as error:
        raise InputError(f"{points}: {str(error).replace('patches', 'points')}") from None
    write_atomically(solid_writers(solid, mesh, outs))
    return {
        "points": str(points),
        "unit": read.unit,
        "unit_assumed": read.assumed,
        "notes": notes,
        **_record(solid, mesh, read.unit, limits),
        "written": written_files(outs),
    }


class _ReadPoints(NamedTuple):
    """Points with normals, and how they were read."""

    contacts: ContactPoints  # [m]
    platform: float | None  # height on which the object stands [m]
    unit: str
    metres: float  # length of that unit [m]
    assumed: bool  # whether the unit was not stated
    notes: tuple[str, ...]


def _read(points: Path, wanted: RebuildOptions) -> _ReadPoints:
    unit, metres = wanted.unit or "m", METRES_PER_UNIT[wanted.unit or "m"]
    bottom = None if wanted.bottom is None else metres * wanted.bottom
    if points.is_dir() or points.suffix.lower() == RECORDING_SUFFIX:
        check_recorded_unit(points, unit)
        taxels, platform = read_touches(recording_of(points))
        touches = counted(int(taxels.touch.max()) + 1, "touch", "touches")
        notes = (f"{len(taxels.points)} taxels of {touches}",)
        standing = platform if bottom is None else bottom
        return _ReadPoints(taxels, standing, unit, metres, False, notes)
    contacts, read_notes = read_oriented(points)
    contacts = contacts._replace(points=metres * contacts.points)
    return _ReadPoints(contacts, bottom, unit, metres, wanted.unit is None, read_notes)


def _record(solid: GeneralSolid, mesh: Mesh, unit: str, limits: CoverageLimits) -> dict[str, Any]:
    shape = solidity(mesh.vertices, mesh.faces)
    areas = areas_and_normals(mesh.vertices[mesh.faces])[0]
    _, bounds = solid.expected_errors(mesh.vertices)
    distances = touch_distances(solid.contacts, mesh.vertices[mesh.faces].mean(axis=1))
    far = distances > limits.max_distance
    share = float(areas[far].sum() / areas.sum())
    squares = np.square(bounds[mesh.faces]).mean(axis=1)
    warnings = size_warnings(mesh.vertices, unit)
    if share > limits.max_far_share:
        warnings.append(
            f"{share:.0%} of the surface lies over {1e3 * limits.max_distance:.0f} mm from any "
            "point: it is a guess there"
        )
    return {
        "method": "general",
        "contours": 0,
        "points_read": len(solid.contacts.points),
        "dropped": [],
        "vertices": len(mesh.vertices),
        "faces": len(mesh.faces),
        "watertight": shape.watertight,
        "genus": shape.genus,
        "self_intersections": self_intersection(mesh.vertices, mesh.faces).count,
        "volume_m3": float(shape.volume),
        "area_m2": float(areas.sum()),
        "size_m": np.ptp(mesh.vertices, axis=0).tolist(),
        "error_bound_95_m": float(np.sqrt((areas * squares).sum() / areas.sum())),
        "far_share": share,
        "health": solid.health(),
        "warnings": warnings,
    }
