"""From a file of points to a solid, its files and a report, as ``palpate rebuild`` does it.

Linear algebra runs on one processor: small systems lose by more on a busy computer.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.geometry import self_intersection, solidity
from palpate.core.poses import Pose
from palpate.core.rebuild import LatticeSolid, Method, Solid
from palpate.core.rebuild.contours import into_frame
from palpate.core.rebuild.recovery import Recovery
from palpate.core.rebuild.surface import SurfaceMesh
from palpate.core.shapes import Mesh
from palpate.launch.files.file_access import FileWriter, write_atomically
from palpate.launch.files.mesh_file import MESH_UNITS, write_mesh
from palpate.launch.files.point_clouds import MeasuredContours
from palpate.launch.files.points_file import read_points, read_tops
from palpate.launch.files.solid_file import LATTICE_SUFFIXES, SOLID_SUFFIX, save, write_lattice
from palpate.launch.files.source_map import InputError
from palpate.launch.files.units import METRES_PER_UNIT
from palpate.launch.printing import counted, titled

RECORDING_SUFFIX = ".mcap"  # Of a file whose unit is known; a run's folder holds such a file
CONTOUR_NUMBER = re.compile(r"\bcontour (\d+)\b")  # By its place among those that were read
ProgressText = Callable[[str], None]
MAX_PLAUSIBLE_SIZE, MIN_PLAUSIBLE_SIZE = 10.0, 1e-3  # Sizes, m, beyond which the unit is doubted
MAX_OVERSHOOT = 0.05  # Of the width: how far the side may leave the contours without doubt
# Of the height: less that is not covered, or that a touched end is missed by, is not worth a
# warning.
MIN_UNCOVERED = 1e-3
FAR_END_STEPS = 3.0  # Times the widest step between contours by which an end beyond is a guess
MOST_NAMED = 4  # Most contours that one sentence names
# Figures of the health that say something if they are not 0, in words: [for one|for more].
COUNT_WARNINGS: Mapping[str, str] = {
    "outlying_points": "{} single point[ sticks|s stick] out and [was|were] left out",
    "gaping": "{} contour[ leaves|s leave] over a quarter of [its|their] way around untouched: "
    "[it is|they are] closed across",
    "perhaps_features": "{} of the dropped contours may be a neck or a rim that no other met",
    "refined_beyond": "{} further point[ lies|s lie] beyond the side and [was|were] not passed",
    "unmatched_contours": "{} contour[|s] could not be matched to the model point by point",
    "degenerate_contours": "{} contour[|s] gave no layer of [its|their] own to the lattice",
    "radial_unused": "the single touches could not be used: the contours alone count",
}


class RebuildOptions(NamedTuple):
    """What is asked for; lengths in the unit of the points."""

    unit: str | None = None  # Of the points; m if None
    # See `palpate.reconstruct`; "general": of points with normals, see `tools.scattered`
    method: Method | Literal["general"] = "lattice"
    tops: Path | None = None  # File of points at which the ends were touched
    bottom: float | None = None  # Height of the lower end
    top: float | None = None  # Height of the upper end
    noise: float | None = None  # Standard deviation of a coordinate
    tolerance: float | None = None  # Of the mesh


class RebuildResult(NamedTuple):
    """A solid, and how it came about; in m."""

    solid: LatticeSolid
    mesh: SurfaceMesh
    found: MeasuredContours  # What was read
    unit: str  # As which it was read
    assumed: bool  # Whether nobody said so


def rebuild(points: Path, wanted: RebuildOptions, say: ProgressText) -> RebuildResult:
    """Read points and rebuild a solid from them; `say` is told what is being done.

    InputError if a file cannot be read, or no solid can be made of it: the sentence says why.
    """
    # Heavy, and not needed by those who ask for help.
    from palpate.core.rebuild import reconstruct

    method = wanted.method
    assert method != "general"
    for name in ("bottom", "top", "noise", "tolerance"):
        value = getattr(wanted, name)
        if value is not None and not math.isfinite(value):
            raise InputError(f"--{name} {value:g}: must be a finite number")
    recorded = points.is_dir() or points.suffix.lower() == RECORDING_SUFFIX
    unit, assumed = wanted.unit or "m", wanted.unit is None and not recorded
    if recorded:
        check_recorded_unit(points, unit)
    metres = METRES_PER_UNIT[unit]
    say("reading the points")
    found = read_points(points).scaled(metres)
    tops = _touched_ends(found, wanted, metres)
    say(f"rebuilding from {len(found.contours)} contours")
    try:
        with single_threaded():
            solid = reconstruct(
                found.contours,
                found.normals,
                found.taxels,
                tops=tops,
                method=method,
                frame=found.frame,
                noise=None if wanted.noise is None else metres * wanted.noise,
            )
            say("meshing")
            mesh = _meshed(solid, wanted.tolerance, unit)
    except ValueError as error:
        places = dict(enumerate(found.places))  # As in the file, with number and lines
        text = CONTOUR_NUMBER.sub(lambda match: places.get(int(match[1]), match[0]), str(error))
        raise InputError(f"{points}: {text}") from None
    return RebuildResult(solid, mesh, found, unit, assumed)


def check_recorded_unit(points: Path, unit: str) -> None:
    """InputError if a recording is to be read in another unit than its own."""
    if unit != "m":
        raise InputError(f"--unit {unit}: {points} is a recording, and recordings are in m")


def _touched_ends(found: MeasuredContours, wanted: RebuildOptions, metres: float) -> Floats | None:
    """Touched ends from all sources; heights beyond the contours, each on its side."""
    parts = [] if found.tops is None else [found.tops]
    if wanted.tops is not None:
        parts.append(metres * read_tops(wanted.tops))
    seen = [into_frame(found.frame, one) for one in found.contours if np.isfinite(one).any()]
    levels = [float(np.nanmean(one[:, 2])) for one in seen]
    if levels:
        points = np.concatenate(found.contours)
        size = float((np.nanmax(points, axis=0) - np.nanmin(points, axis=0)).max()) / metres
        if wanted.noise is not None and wanted.noise >= size:
            raise InputError(
                f"--noise {wanted.noise:g}: must be less than the object is large, "
                f"{size:.3g} {wanted.unit or 'm'}"
            )
        low, high = min(levels) / metres, max(levels) / metres
        for name, height in (("bottom", wanted.bottom), ("top", wanted.top)):
            if height is not None and (low < height if name == "bottom" else height < high):
                raise InputError(
                    f"--{name} {height:g}: must lie beyond the contours, which go from {low:.6g} "
                    f"to {high:.6g}"
                )
    for height in (wanted.bottom, wanted.top):
        if height is not None:
            point = np.array([[0.0, 0.0, metres * height]])
            parts.append(
                point if found.frame is None else Pose.from_array(found.frame).to_outer(point)
            )
    return np.concatenate(parts) if parts else None


def _meshed(solid: LatticeSolid, tolerance: float | None, unit: str) -> SurfaceMesh:
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


def check_outputs(points: Path, outs: Sequence[Path], lattice: Path | None, method: str) -> None:
    """Refuse names of files that cannot be written, before anything is done.

    Raises InputError if an ending is unknown, a folder is not there, there will be no lattice, or
    the points would be overwritten.
    """
    check_suffixes(outs, (*MESH_UNITS, SOLID_SUFFIX))
    if lattice is not None:
        if lattice.suffix.lower() not in LATTICE_SUFFIXES:
            ends = ", ".join(LATTICE_SUFFIXES)
            raise InputError(f"--lattice {lattice}: must end in one of {ends}")
        if method not in ("lattice", "thesis"):
            text = f"--lattice {lattice}: the method {method} has no control lattice"
            raise InputError(text)
    check_places(points, [*outs, *([] if lattice is None else [lattice])])


def check_suffixes(outs: Iterable[Path], known: Sequence[str], option: str = "-o ") -> None:
    """InputError if a file's format, by its ending, is none of those known."""
    for path in outs:
        if path.suffix.lower() not in known:
            raise InputError(f"{option}{path}: must end in one of {', '.join(known)}")


def check_places(source: Path, outs: Sequence[Path]) -> None:
    """InputError if a folder is not there, two files are one, or what is read would be lost."""
    for path in outs:
        if not path.parent.is_dir():
            raise InputError(f"{path}: cannot be written: there is no folder {path.parent}")
        if path.resolve() == source.resolve():
            raise InputError(f"{path}: is the file that is read; write to another")
    if len(set(outs)) < len(outs):
        raise InputError("each file that is written must have a name of its own")


def write_outputs(rebuilt: RebuildResult, outs: Sequence[Path], lattice: Path | None) -> None:
    """Write all files, or none; raises InputError if one cannot be written."""
    writers = solid_writers(rebuilt.solid, rebuilt.mesh, outs)
    if lattice is not None:
        grid = rebuilt.solid.control_lattice
        if grid is None:
            raise InputError(f"--lattice {lattice}: this solid has no control lattice")
        writers[lattice] = lambda part: write_lattice(part, grid)
    write_atomically(writers)


def solid_writers(
    solid: Solid, mesh: SurfaceMesh | Mesh, outs: Iterable[Path]
) -> dict[Path, FileWriter]:
    """What writes each file: a whole solid, or its mesh, as the ending says."""
    return {
        path: (lambda part: save(solid, part))
        if path.suffix.lower() == SOLID_SUFFIX
        else (lambda part: write_mesh(part, mesh.vertices, mesh.faces))
        for path in outs
    }


def single_threaded() -> AbstractContextManager[object]:
    """A context in which numpy and scipy calculate on one processor."""
    # Looks through all loaded libraries: after numpy and scipy are.
    import scipy.linalg  # noqa: F401
    from threadpoolctl import threadpool_limits

    limits: AbstractContextManager[object] = threadpool_limits(1)
    return limits


def rebuild_record(
    rebuilt: RebuildResult, points: Path, outs: Sequence[Path], lattice: Path | None = None
) -> dict[str, Any]:
    """Everything that is told, by stable names with the unit in them."""
    written = written_files(outs)
    if lattice is not None:
        written.append({"file": str(lattice), "holds": "the control lattice, in m"})
    solid, mesh, found = rebuilt.solid, rebuilt.mesh, rebuilt.found
    shape = solidity(mesh.vertices, mesh.faces)
    crossings = self_intersection(mesh.vertices, mesh.faces).count
    # Of a surface that passes through itself nobody knows what it bounds.
    known, measures = None if crossings else solid.uncertainty(), solid.measures()
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
        "volume_m3": float(measures.volume_m3),
        "area_m2": float(measures.area_m2),
        "size_m": [float(v) for v in mesh.vertices.max(0) - mesh.vertices.min(0)],
        "error_rms_m": None if known is None else known.rms,
        "error_most_m": None if known is None else known.most,
        "resolution_m": None if known is None else known.resolution,
        "uncovered_m": list(solid.uncovered),
        "health": solid.health(),
        "warnings": rebuild_warnings(solid, mesh, found, rebuilt.unit, crossings),
        "written": written,
    }


def rebuild_warnings(
    solid: LatticeSolid, mesh: SurfaceMesh, found: MeasuredContours, unit: str, crossings: int
) -> list[str]:
    """Sentences about everything that a user should doubt."""
    told, health = size_warnings(mesh.vertices, unit), solid.health()
    told += _contours(solid, found.places)
    for name, text in COUNT_WARNINGS.items():
        if count := round(health.get(name, 0.0)):
            told.append(
                re.sub(r"\[(.*?)\|(.*?)\]", r"\1" if count == 1 else r"\2", text).format(count)
            )
    if folded := health.get("lattice_folded", 0.0):
        told.append(f"{folded:.2%} of the control lattice's inside is folded")
    if crossings:
        pairs = counted(crossings, "pair")
        told.append(f"the surface passes through itself: {pairs} of triangles cross")
    if isinstance(solid.model, Recovery) and solid.model.warnings:
        told.append(f"the superquadric's fit is {', '.join(solid.model.warnings)}")
    if health.get("overshoot", 0.0) > MAX_OVERSHOOT:
        told.append(
            f"between contours the side swings out by {health['overshoot']:.0%} of the width: "
            "contours close together are too unlike"
        )
    return told + _ends(solid, mesh.vertices)


def size_warnings(vertices: Floats, unit: str) -> list[str]:
    """A sentence if the size of a solid, m, lets doubt the unit in which it was read."""
    size = float(np.ptp(vertices, axis=0).max())
    if MIN_PLAUSIBLE_SIZE <= size <= MAX_PLAUSIBLE_SIZE:
        return []
    return [f"the solid is {size:.3g} m in size when read in {unit}: is the unit right?"]


def written_files(outs: Sequence[Path]) -> list[dict[str, str]]:
    """What was written, and what it holds."""
    return [
        {"file": str(path), "holds": MESH_UNITS.get(path.suffix.lower(), "everything, in m")}
        for path in outs
    ]


def _contours(solid: LatticeSolid, places: Sequence[str]) -> list[str]:
    """What is odd about contours that were used, by their names in the file."""
    slices, feature_candidates = solid.slices, solid.evidence.feature_candidates
    marks = (
        (slices.tilted, ("is tilted or not level", "are tilted or not level")),
        (~slices.star, ("cannot be seen whole from its middle",) * 2),
        (slices.self_intersecting, ("meets itself", "meet themselves")),
    )
    reordered = [loop.which for loop in slices.loops if loop.reordered]
    told = []
    if reordered:
        told.append(
            f"{_names(places, reordered)}: points were given in no order, and were put in order"
        )
    for marked, (one, more) in marks:
        rows = slices.rows[marked].tolist()
        if rows:
            told.append(f"{_names(places, rows)} {one if len(rows) == 1 else more}, yet used")
    if feature_candidates:
        off = 1e3 * max(one.off for one in feature_candidates)
        named = _names(places, [one.which for one in feature_candidates])
        are = "is" if len(feature_candidates) == 1 else "are"
        told.append(f"{named} {are} unlike the neighbours, by {off:.3g} mm at most, yet used")
    return told


def _names(places: Sequence[str], rows: Iterable[int]) -> str:
    named = [places[row] for row in rows]
    more = f" and {len(named) - MOST_NAMED} more" if len(named) > MOST_NAMED else ""
    return ", ".join(named[:MOST_NAMED]) + more


def _ends(solid: LatticeSolid, vertices: Floats) -> list[str]:
    """Ends that nobody touched, that lie far off, and that the surface does not reach."""
    heights = into_frame(solid.frame, vertices)[:, 2]
    low, high = float(heights.min()), float(heights.max())
    axis = "z =" if solid.frame is None else "height"
    levels = solid.slices.heights
    least = MIN_UNCOVERED * (high - low)
    step = float(np.diff(levels).max()) if len(levels) > 1 else 0.0
    evidence, (below, above) = solid.evidence, solid.uncovered
    told = []
    for end, which, touched, made, rim, unknown in (
        ("bottom", "lowest", evidence.bottom, low, float(levels[0]), below),
        ("top", "highest", evidence.top, high, float(levels[-1]), above),
    ):
        side = "below" if end == "bottom" else "above"
        if unknown > least:
            told.append(
                f"{side} the {which} contour the object may go on by {1e3 * unknown:.3g} mm, "
                f"nobody touched its end: --{end} or --tops says where"
            )
        if touched is None:
            continue
        if abs(touched - made) > least:
            told.append(
                f"the {end} was touched at {axis} {1e3 * touched:.5g} mm, and the solid ends at "
                f"{1e3 * made:.5g} mm"
            )
        if step and abs(touched - rim) > FAR_END_STEPS * step:
            told.append(
                f"the {end} lies {1e3 * abs(touched - rim):.3g} mm {side} the {which} contour, "
                f"where contours are at most {1e3 * step:.3g} mm apart: what is between is a guess"
            )
    return told


def rebuild_text(record: Mapping[str, Any]) -> str:
    """A record as lines; lengths in mm."""
    assumed = " (assumed; if not, give --unit)" if record["unit_assumed"] else ""
    contours = f"{record['contours']} contours, " if record["contours"] else ""
    read = f"{record['points']}: {contours}{record['points_read']} points"
    lines = titled("read", f"{read}, unit {record['unit']}{assumed}")
    for note in record["notes"]:
        lines += titled("", note)
    for one in record["dropped"]:
        off = f" by {1e3 * one['off_m']:.3g} mm" if one["off_m"] else ""
        lines += titled("dropped", f"{one['contour']}: {one['why']}{off}")
    size = " x ".join(f"{1e3 * length:.4g}" for length in record["size_m"])
    lines += titled(
        "solid",
        f"{record['method']}: {size} mm, {1e6 * record['volume_m3']:.5g} ml, "
        f"{1e4 * record['area_m2']:.5g} cm2; {record['faces']} triangles, "
        f"watertight {'yes' if record['watertight'] else 'NO'}, holes through it "
        f"{record['genus']}, crossings with itself {record['self_intersections']}",
    )
    confidence = f"the method {record['method']} does not say how far its surface can be trusted"
    if record["self_intersections"]:
        confidence = "none: the surface passes through itself"
    if "error_bound_95_m" in record:
        bound = 1e3 * record["error_bound_95_m"]
        confidence = f"95 % bound of the root mean square error {bound:.3g} mm"
    elif record["error_rms_m"] is not None:
        confidence = (
            f"side within {1e3 * record['error_rms_m']:.3g} mm (root mean square), "
            f"{1e3 * record['error_most_m']:.3g} mm at most, if nothing on it is narrower than "
            f"{1e3 * record['resolution_m']:.3g} mm"
        )
    lines += titled("confidence", confidence)
    for text in record["warnings"]:
        lines += titled("warning", text)
    lines += titled("health", *(f"{name} {value:.3g}" for name, value in record["health"].items()))
    for one in record["written"]:
        lines += titled("wrote", f"{one['file']} ({one['holds']})")
    return "\n".join(lines)
