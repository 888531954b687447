"""What came of a rebuilding, as lines for people and as a record for programs."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from palpate.core.measure.solidity import solidity
from palpate.launch.mesh_export import UNITS
from palpate.launch.rebuild import Rebuilt

WIDTH, TITLE = 88, 11
SWINGS_OUT = 0.05
"""Share of the width by which the side leaves the contours, from which it is doubtful."""
UNKNOWN_END = 1e-3
"""Of the height: less that is not covered is not worth a warning."""

DOUBTS: Mapping[str, str] = {
    "tilted": "{:.0f} contours are tilted or not level: each is used at its mean height",
    "not_starlike": "{:.0f} contours cannot be seen whole from their middle: check what is between",
    "self_intersecting": "{:.0f} contours meet themselves",
    "outlying_points": "{:.0f} single points stick out and were left out",
    "perhaps_features": "{:.0f} of the dropped contours may be a neck or a rim that no other met",
    "suspicious": "{:.0f} contours are unlike their neighbours, and were used",
    "felt_unused": "the single touches could not be used: the contours alone count",
    "refined_beyond": "{:.0f} further points lie beyond the side and were not passed",
    "lattice_folded": "{:.2%} of the control lattice's inside is folded; the surface is not",
}
"""Figures of the health that say something if they are not 0, in words."""


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
    shape = solidity(rebuilt.mesh.vertices, rebuilt.mesh.faces)
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
            {"contour": found.places[one.which], "why": str(one.why)}
            for one in solid.slices.dropped
        ],
        "notes": list(found.notes),
        "vertices": len(rebuilt.mesh.vertices),
        "faces": len(rebuilt.mesh.faces),
        "watertight": shape.watertight,
        "genus": shape.genus,
        "volume_m3": float(moments.moments.volume),
        "area_m2": float(moments.area),
        "size_m": [float(v) for v in rebuilt.mesh.vertices.max(0) - rebuilt.mesh.vertices.min(0)],
        "error_rms_m": None if known is None else known.rms,
        "error_most_m": None if known is None else known.most,
        "resolution_m": None if known is None else known.resolution,
        "uncovered_m": list(solid.uncovered),
        "health": solid.health(),
        "warnings": warnings_of(rebuilt),
        "written": written,
    }


def rebuild_text(record: Mapping[str, Any]) -> str:
    """A record as lines; lengths in mm."""
    assumed = " (assumed; --unit says otherwise)" if record["unit_assumed"] else ""
    lines = _line(
        "read",
        f"{record['points']}: {record['contours']} contours, {record['points_read']} points, "
        f"in {record['unit']}{assumed}",
    )
    for note in record["notes"]:
        lines += _line("", note)
    for one in record["dropped"]:
        lines += _line("dropped", f"{one['contour']}: {one['why']}")
    size = " x ".join(f"{1e3 * length:.4g}" for length in record["size_m"])
    lines += _line(
        "solid",
        f"{record['method']}: {size} mm, {1e6 * record['volume_m3']:.5g} ml, "
        f"{1e4 * record['area_m2']:.5g} cm2; {record['faces']} triangles, "
        f"watertight {'yes' if record['watertight'] else 'NO'}, genus {record['genus']}",
    )
    lines += _line("trust", _trust(record))
    for text in record["warnings"]:
        lines += _line("doubtful", text)
    figures = [f"{name} {value:.3g}" for name, value in record["health"].items()]
    lines += _line("health", "  ".join(figures))
    for one in record["written"]:
        lines += _line("wrote", f"{one['file']} ({one['holds']})")
    return "\n".join(lines)


def warnings_of(rebuilt: Rebuilt) -> list[str]:
    """Sentences about everything that a user should doubt."""
    solid, health = rebuilt.solid, rebuilt.solid.health()
    said = list(rebuilt.doubts)
    said += [text.format(health[name]) for name, text in DOUBTS.items() if health.get(name)]
    if health.get("overshoot", 0.0) > SWINGS_OUT:
        said.append(
            f"between contours the side swings out by {health['overshoot']:.0%} of the width: "
            "contours close together are too unlike"
        )
    height = float(rebuilt.mesh.vertices[:, 2].max() - rebuilt.mesh.vertices[:, 2].min())
    for where, far in zip(("below", "above"), solid.uncovered, strict=True):
        if far > UNKNOWN_END * height:
            end = "bottom" if where == "below" else "top"
            said.append(
                f"{where} the last contour the object may go on by {1e3 * far:.3g} mm, nobody "
                f"touched its end: --{end} or --tops says where"
            )
    return said


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
    return [f"{head}{part}" for head, part in zip(heads, parts or [""], strict=False)]
