"""What came of a rebuilding, as lines for people and as a record for programs."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from palpate.core.measure.self_intersection import self_intersection
from palpate.core.measure.solidity import solidity
from palpate.launch.mesh_export import UNITS
from palpate.launch.rebuild import Rebuilt
from palpate.launch.rebuild_doubts import doubts_of

WIDTH, TITLE = 88, 11

TIED = "\N{NO-BREAK SPACE}"
"""Between what must stay on one line."""


def rebuild_record(
    rebuilt: Rebuilt, points: Path, outs: Sequence[Path], lattice: Path | None = None
) -> dict[str, Any]:
    """Everything that is told, by stable names with the unit in them."""
    written = [
        {"file": str(path), "holds": UNITS.get(path.suffix.lower(), "everything, in m")}
        for path in outs
    ]
    if lattice is not None:
        written.append({"file": str(lattice), "holds": "the control lattice, in m"})
    solid, found = rebuilt.solid, rebuilt.found
    mesh = rebuilt.mesh
    shape = solidity(mesh.vertices, mesh.faces)
    crossings = self_intersection(mesh.vertices, mesh.faces).count
    known = solid.uncertainty()
    moments = solid.measures()
    return {
        "points": str(points),
        "unit": rebuilt.unit,
        "unit_assumed": rebuilt.assumed,
        "method": solid.method,
        "contours": len(found.contours),
        "points_read": sum(map(len, found.contours)),
        "dropped": [
            {"contour": found.places[one.which], "why": str(one.why), "off_m": float(one.off)}
            for one in solid.slices.dropped
        ],
        "notes": list(found.notes),
        "vertices": len(mesh.vertices),
        "faces": len(mesh.faces),
        "watertight": shape.watertight,
        "genus": shape.genus,
        "self_intersections": crossings,
        "volume_m3": float(moments.moments.volume),
        "area_m2": float(moments.area),
        "size_m": [float(v) for v in mesh.vertices.max(0) - mesh.vertices.min(0)],
        "error_rms_m": None if known is None else known.rms,
        "error_most_m": None if known is None else known.most,
        "resolution_m": None if known is None else known.resolution,
        "uncovered_m": list(solid.uncovered),
        "health": solid.health(),
        "warnings": doubts_of(solid, mesh, found, rebuilt.unit, crossings),
        "written": written,
    }


def rebuild_text(record: Mapping[str, Any]) -> str:
    """A record as lines; lengths in mm."""
    assumed = " (assumed; if not, give --unit)" if record["unit_assumed"] else ""
    lines = _line(
        "read",
        f"{record['points']}: {record['contours']} contours, {record['points_read']} points, "
        f"unit {record['unit']}{assumed}",
    )
    for note in record["notes"]:
        lines += _line("", note)
    for one in record["dropped"]:
        off = f" by {1e3 * one['off_m']:.3g} mm" if one["off_m"] else ""
        lines += _line("dropped", f"{one['contour']}: {one['why']}{off}")
    size = " x ".join(f"{1e3 * length:.4g}" for length in record["size_m"])
    lines += _line(
        "solid",
        f"{record['method']}: {size} mm, {1e6 * record['volume_m3']:.5g} ml, "
        f"{1e4 * record['area_m2']:.5g} cm2; {record['faces']} triangles, "
        f"watertight {'yes' if record['watertight'] else 'NO'}, "
        f"holes through it {record['genus']}, crossings with itself "
        f"{record['self_intersections']}",
    )
    lines += _line("trust", _trust(record))
    for text in record["warnings"]:
        lines += _line("doubtful", text)
    figures = [f"{name}{TIED}{value:.3g}" for name, value in record["health"].items()]
    lines += _line("health", "  ".join(figures))
    for one in record["written"]:
        lines += _line("wrote", f"{one['file']} ({one['holds']})")
    return "\n".join(lines)


def _trust(record: Mapping[str, Any]) -> str:
    if record["error_rms_m"] is None:
        return f"the method {record['method']} does not say how far its surface can be trusted"
    return (
        f"side within {1e3 * record['error_rms_m']:.3g} mm (root mean square), "
        f"{1e3 * record['error_most_m']:.3g} mm at most, if nothing on it is narrower than "
        f"{1e3 * record['resolution_m']:.3g} mm"
    )


def _line(title: str, text: str) -> list[str]:
    """Text behind a title, broken where it is too long."""
    parts = textwrap.wrap(text, WIDTH - TITLE, break_long_words=False, break_on_hyphens=False)
    heads = [f"{title:<{TITLE}}", *[" " * TITLE] * len(parts)]
    parts = [part.replace(TIED, " ") for part in parts]
    return [f"{head}{part}" for head, part in zip(heads, parts or [""], strict=False)]
