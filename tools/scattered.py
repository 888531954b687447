"""From a file of points with normals, in no order, to a solid of any shape: `rebuild_general`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from palpate.core.geometry import areas_and_normals, self_intersection, solidity
from palpate.core.rebuild import GeneralSolid, rebuild_general
from palpate.core.rebuild.general import touch_distances
from palpate.core.shapes import Mesh
from palpate.launch import files
from palpate.tools.reconstruction import ProgressText, RebuildOptions, single_threaded
from palpate.tools.reconstruction import size_warnings, solid_writers, written_files

FAR = 5.0e-3  # From every point: what of the surface lies farther is made up, m
MOST_FAR = 0.01  # Of the surface: more of that is worth a warning


def rebuild_scattered(
    points: Path, wanted: RebuildOptions, outs: Sequence[Path], say: ProgressText
) -> dict[str, Any]:
    """Rebuild, write the files, and return what is told, by the names of a rebuilt solid's record.

    Raises InputError if a file cannot be read or written, the points have no normals, or no solid
    can be made of them: the sentence says why.
    """
    for name in ("tops", "top", "tolerance"):
        if getattr(wanted, name) is not None:
            raise files.InputError(f"--{name} is of no use with --method general")
    unit, metres = wanted.unit or "m", files.METRES_PER_UNIT[wanted.unit or "m"]
    say("reading the points")
    found, notes = files.read_oriented(points)
    say(f"rebuilding from {len(found.points)} points")
    given = {"platform": wanted.bottom, "pose": wanted.noise}
    options: dict[str, Any] = {k: metres * v for k, v in given.items() if v is not None}
    try:
        with single_threaded():
            solid = rebuild_general(found._replace(points=metres * found.points), **options)
            say("meshing")
            mesh = solid.mesh()
    except ValueError as error:
        raise files.InputError(f"{points}: {str(error).replace('patches', 'points')}") from None
    files.write_atomically(solid_writers(solid, mesh, outs))
    told = {"points": str(points), "unit": unit, "unit_assumed": wanted.unit is None}
    return {**told, "notes": notes, **_record(solid, mesh, unit), "written": written_files(outs)}


def _record(solid: GeneralSolid, mesh: Mesh, unit: str) -> dict[str, Any]:
    shape = solidity(mesh.vertices, mesh.faces)
    areas = areas_and_normals(mesh.vertices[mesh.faces])[0]
    _, bounds = solid.expected_errors(mesh.vertices)
    far = touch_distances(solid.contacts, mesh.vertices[mesh.faces].mean(axis=1)) > FAR
    share = float(areas[far].sum() / areas.sum())
    squares = np.square(bounds[mesh.faces]).mean(axis=1)
    warnings = size_warnings(mesh.vertices, unit)
    if share > MOST_FAR:
        warnings.append(
            f"{share:.0%} of the surface lies over {1e3 * FAR:.0f} mm from any point: what is "
            "there is made up"
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
