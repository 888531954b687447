"""A solid, its files and a record from a file of points, as ``palpate rebuild`` makes them.

Linear algebra runs on one processor: small systems take longer on several of a busy computer.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
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

RECORDING_SUFFIX = ".mcap"  # of a recording, whose unit is known; the folder of a run has one
CONTOUR_NUMBER = re.compile(r"\bcontour (\d+)\b")  # index among the contours that were read
ProgressText = Callable[[str], None]


@dataclass(frozen=True, slots=True, kw_only=True)
class WarningLimits:
    """When a user is warned of a rebuilt solid."""

    min_size: float = 1e-3  # [m] below which the unit is doubted
    max_size: float = 10.0  # [m] above which it is doubted
    max_overshoot: float = 0.05  # [fraction of the width] that the side swings out between contours
    min_uncovered: float = 1e-3  # [fraction of the height] beyond contours, or off a touched end
    max_end_steps: float = 3.0  # [largest step between contours] from the last to a touched end
    max_named: int = 4  # contours that a sentence names; the rest is counted


DEFAULT_LIMITS = WarningLimits()
# Sentences about figures of the health that are not 0: [for one|for more].
COUNT_WARNINGS: Mapping[str, str] = {
    "outlying_points": "{} single point[ sticks|s stick] out and [was|were] left out",
    "gaping": "{} contour[ leaves|s leave] over a quarter of [its|their] circumference untouched: "
    "[it is|they are] closed across",
    "perhaps_features": "{} of the dropped contours may be a neck or a rim between the others",
    "refined_beyond": "{} further point[ lies|s lie] beyond the side and [was|were] not passed",
    "unmatched_contours": "{} contour[|s] could not be matched to the model point by point",
    "degenerate_contours": "{} contour[|s] gave no layer of [its|their] own to the lattice",
    "radial_unused": "the single touches could not be used, only the contours were",
}


class RebuildOptions(NamedTuple):
    """Options of ``palpate rebuild``; lengths in the unit of the points."""

    unit: str | None = None  # of the points; None: m
    # See `palpate.reconstruct`; "general": of points with normals, see `tools.scattered`.
    method: Method | Literal["general"] = "lattice"
    tops: Path | None = None  # file of points at which the ends were touched
    bottom: float | None = None  # height of the lower end
    top: float | None = None  # height of the upper end
    noise: float | None = None  # standard deviation of a coordinate
    tolerance: float | None = None  # of the mesh


class RebuildResult(NamedTuple):
    """A rebuilt solid and the contours that it was rebuilt from [m]."""

    solid: LatticeSolid
    mesh: SurfaceMesh
    read: MeasuredContours
    unit: str  # of the file
    assumed: bool  # whether the unit was not stated


def rebuild(points: Path, wanted: RebuildOptions, say: ProgressText) -> RebuildResult:
    """Read points and rebuild a solid from them; `say` is called with each step.

    Raises InputError if a file cannot be read, or no solid can be made of it.
    """
    from palpate.core.rebuild import reconstruct  # slow to import

    method = wanted.method
    assert method != "general"
    _check_finite(wanted)
    recorded = points.is_dir() or points.suffix.lower() == RECORDING_SUFFIX
    unit, assumed = wanted.unit or "m", wanted.unit is None and not recorded
    if recorded:
        check_recorded_unit(points, unit)
    metres = METRES_PER_UNIT[unit]
    say("reading the points")
    read = read_points(points).scaled(metres)
    tops = _touched_ends(read, wanted, metres)
    say(f"rebuilding from {len(read.contours)} contours")
    try:
        with single_threaded():
            solid = reconstruct(
                read.contours,
                read.normals,
                read.taxels,
                tops=tops,
                method=method,
                frame=read.frame,
                noise=None if wanted.noise is None else metres * wanted.noise,
            )
            say("meshing")
            mesh = _meshed(solid, wanted.tolerance, unit)
    except ValueError as error:
        places = dict(enumerate(read.places))  # names in the file, with their lines
        text = CONTOUR_NUMBER.sub(lambda match: places.get(int(match[1]), match[0]), str(error))
        raise InputError(f"{points}: {text}") from None
    return RebuildResult(solid, mesh, read, unit, assumed)


def _check_finite(wanted: RebuildOptions) -> None:
    for name in ("bottom", "top", "noise", "tolerance"):
        value = getattr(wanted, name)
        if value is not None and not math.isfinite(value):
            raise InputError(f"--{name} {value:g}: must be a finite number")


def check_recorded_unit(points: Path, unit: str) -> None:
    """Raise InputError if a recording is to be read in another unit than its own."""
    if unit != "m":
        raise InputError(f"--unit {unit}: {points} is a recording, and recordings are in m")


def _touched_ends(read: MeasuredContours, wanted: RebuildOptions, metres: float) -> Floats | None:
    """Touched ends (n, 3) from the points, the file of tops, and the stated heights; or None.

    Raises InputError if a stated height lies among the contours, or the noise is too large.
    """
    parts = [] if read.tops is None else [read.tops]
    if wanted.tops is not None:
        parts.append(metres * read_tops(wanted.tops))
    present = [into_frame(read.frame, ring) for ring in read.contours if np.isfinite(ring).any()]
    if present:
        levels = [float(np.nanmean(ring[:, 2])) for ring in present]
        _check_noise(read, wanted, metres)
        _check_heights(wanted, min(levels) / metres, max(levels) / metres)
    for height in (wanted.bottom, wanted.top):
        if height is not None:
            point = np.array([[0.0, 0.0, metres * height]])
            frame = read.frame
            parts.append(point if frame is None else Pose.from_array(frame).to_outer(point))
    return np.concatenate(parts) if parts else None


def _check_noise(read: MeasuredContours, wanted: RebuildOptions, metres: float) -> None:
    points = np.concatenate(read.contours)
    size = float((np.nanmax(points, axis=0) - np.nanmin(points, axis=0)).max()) / metres
    if wanted.noise is not None and wanted.noise >= size:
        raise InputError(
            f"--noise {wanted.noise:g}: must be less than the size of the object, "
            f"{size:.3g} {wanted.unit or 'm'}"
        )


def _check_heights(wanted: RebuildOptions, low: float, high: float) -> None:
    """Raise InputError if a stated end is not beyond the contours, from `low` to `high`."""
    for name, height in (("bottom", wanted.bottom), ("top", wanted.top)):
        if height is not None and (low < height if name == "bottom" else height < high):
            raise InputError(
                f"--{name} {height:g}: must lie beyond the contours, which go from {low:.6g} "
                f"to {high:.6g}"
            )


def _meshed(solid: LatticeSolid, tolerance: float | None, unit: str) -> SurfaceMesh:
    if tolerance is None:
        return solid.mesh()
    try:
        return solid.mesh(METRES_PER_UNIT[unit] * tolerance)
    except ValueError:
        # The message of the surface is in m, the option in the unit of the points.
        raise InputError(
            f"--tolerance {tolerance:g}: {tolerance:g} {unit} would take more triangles than a "
            "mesh may have; try a larger tolerance"
        ) from None


def check_outputs(points: Path, outs: Sequence[Path], lattice: Path | None, method: str) -> None:
    """Check paths of files before anything is done.

    Raises InputError if a suffix is unknown, a folder is missing, the method has no lattice, or the
    points would be overwritten.
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
    """Raise InputError if the suffix of a file is not a known one."""
    for path in outs:
        if path.suffix.lower() not in known:
            raise InputError(f"{option}{path}: must end in one of {', '.join(known)}")


def check_places(source: Path, outs: Sequence[Path]) -> None:
    """Raise InputError if a folder is missing, two files are one, or the source is overwritten."""
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
    """Writers of files by path: of the whole solid or of its mesh, as the suffix says."""
    return {
        path: (lambda part: save(solid, part))
        if path.suffix.lower() == SOLID_SUFFIX
        else (lambda part: write_mesh(part, mesh.vertices, mesh.faces))
        for path in outs
    }


def single_threaded() -> AbstractContextManager[object]:
    """A context in which numpy and scipy calculate on one processor."""
    # threadpool_limits acts on the libraries that are loaded, so scipy is loaded first.
    import scipy.linalg  # noqa: F401
    from threadpoolctl import threadpool_limits

    limits: AbstractContextManager[object] = threadpool_limits(1)
    return limits


def rebuild_record(
    rebuilt: RebuildResult, points: Path, outs: Sequence[Path], lattice: Path | None = None
) -> dict[str, Any]:
    """Facts of a rebuilt solid, by stable names with their units."""
    written = written_files(outs)
    if lattice is not None:
        written.append({"file": str(lattice), "holds": "the control lattice, in m"})
    solid, mesh, read = rebuilt.solid, rebuilt.mesh, rebuilt.read
    shape = solidity(mesh.vertices, mesh.faces)
    crossings = self_intersection(mesh.vertices, mesh.faces).count
    # A surface that passes through itself bounds no known solid.
    known, measures = None if crossings else solid.uncertainty(), solid.measures()
    return {
        "points": str(points),
        "unit": rebuilt.unit,
        "unit_assumed": rebuilt.assumed,
        "method": solid.method,
        "contours": len(read.contours),
        "points_read": sum(map(len, read.contours)),
        "dropped": [
            {"contour": read.places[drop.which], "why": str(drop.why), "off_m": float(drop.off)}
            for drop in solid.slices.dropped
        ],
        "notes": list(read.notes),
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
        "warnings": rebuild_warnings(solid, mesh, read, rebuilt.unit, crossings),
        "written": written,
    }


def rebuild_warnings(
    solid: LatticeSolid,
    mesh: SurfaceMesh,
    read: MeasuredContours,
    unit: str,
    crossings: int,
    limits: WarningLimits = DEFAULT_LIMITS,
) -> list[str]:
    """Sentences about everything that a user should doubt."""
    warnings, health = size_warnings(mesh.vertices, unit, limits), solid.health()
    warnings += _contour_warnings(solid, read.places, limits.max_named)
    for name, text in COUNT_WARNINGS.items():
        if count := round(health.get(name, 0.0)):
            form = r"\1" if count == 1 else r"\2"
            warnings.append(re.sub(r"\[(.*?)\|(.*?)\]", form, text).format(count))
    if folded := health.get("lattice_folded", 0.0):
        warnings.append(f"{folded:.2%} of the control lattice's inside is folded")
    if crossings:
        pairs = counted(crossings, "pair")
        warnings.append(f"the surface passes through itself: {pairs} of triangles cross")
    if isinstance(solid.model, Recovery) and solid.model.warnings:
        warnings.append(f"the superquadric's fit is {', '.join(solid.model.warnings)}")
    if health.get("overshoot", 0.0) > limits.max_overshoot:
        warnings.append(
            f"between contours the side swings out by {health['overshoot']:.0%} of the width: "
            "neighbouring contours are too unlike"
        )
    return warnings + _end_warnings(solid, mesh.vertices, limits)


def size_warnings(vertices: Floats, unit: str, limits: WarningLimits = DEFAULT_LIMITS) -> list[str]:
    """A sentence if the size of vertices (n, 3) [m] makes their unit doubtful."""
    size = float(np.ptp(vertices, axis=0).max())
    if limits.min_size <= size <= limits.max_size:
        return []
    return [f"the solid is {size:.3g} m in size when read in {unit}: is the unit right?"]


def written_files(outs: Sequence[Path]) -> list[dict[str, str]]:
    """Written files, and what each holds."""
    return [
        {"file": str(path), "holds": MESH_UNITS.get(path.suffix.lower(), "everything, in m")}
        for path in outs
    ]


def _contour_warnings(solid: LatticeSolid, places: Sequence[str], max_named: int) -> list[str]:
    """Sentences about odd contours that were used, by their names in the file."""
    slices, feature_candidates = solid.slices, solid.evidence.feature_candidates
    marks = (
        (slices.tilted, ("is tilted or not level", "are tilted or not level")),
        (~slices.star, ("cannot be seen whole from its middle",) * 2),
        (slices.self_intersecting, ("meets itself", "meet themselves")),
    )
    reordered = [loop.which for loop in slices.loops if loop.reordered]
    warnings = []
    if reordered:
        names = _names(places, reordered, max_named)
        warnings.append(f"{names}: the points were in no order, and were put in order")
    for marked, (singular, plural) in marks:
        rows = slices.rows[marked].tolist()
        if rows:
            fault = singular if len(rows) == 1 else plural
            warnings.append(f"{_names(places, rows, max_named)} {fault}, yet used")
    if feature_candidates:
        off = 1e3 * max(candidate.off for candidate in feature_candidates)
        rows = [candidate.which for candidate in feature_candidates]
        verb, names = "is" if len(rows) == 1 else "are", _names(places, rows, max_named)
        warnings.append(f"{names} {verb} unlike the neighbours, by {off:.3g} mm at most, yet used")
    return warnings


def _names(places: Sequence[str], rows: Iterable[int], max_named: int) -> str:
    named = [places[row] for row in rows]
    more = f" and {len(named) - max_named} more" if len(named) > max_named else ""
    return ", ".join(named[:max_named]) + more


def _end_warnings(solid: LatticeSolid, vertices: Floats, limits: WarningLimits) -> list[str]:
    """Sentences about ends that are untouched, far from contours, or missed by the surface."""
    heights = into_frame(solid.frame, vertices)[:, 2]
    low, high = float(heights.min()), float(heights.max())
    axis = "z =" if solid.frame is None else "height"
    levels = solid.slices.heights
    min_gap = limits.min_uncovered * (high - low)
    step = float(np.diff(levels).max()) if len(levels) > 1 else 0.0
    evidence, (below, above) = solid.evidence, solid.uncovered
    warnings = []
    for end, which, touched, made, rim, unknown in (
        ("bottom", "lowest", evidence.bottom, low, float(levels[0]), below),
        ("top", "highest", evidence.top, high, float(levels[-1]), above),
    ):
        side = "below" if end == "bottom" else "above"
        if unknown > min_gap:
            warnings.append(
                f"the object may extend {1e3 * unknown:.3g} mm {side} the {which} contour, where "
                f"its end was not touched: --{end} or --tops says where"
            )
        if touched is None:
            continue
        if abs(touched - made) > min_gap:
            warnings.append(
                f"the {end} was touched at {axis} {1e3 * touched:.5g} mm, and the solid ends at "
                f"{1e3 * made:.5g} mm"
            )
        if step and abs(touched - rim) > limits.max_end_steps * step:
            warnings.append(
                f"the {end} lies {1e3 * abs(touched - rim):.3g} mm {side} the {which} contour, "
                f"where contours are at most {1e3 * step:.3g} mm apart: the part between is a guess"
            )
    return warnings


def rebuild_text(record: Mapping[str, Any]) -> str:
    """Lines about a record, with lengths in mm."""
    assumed = " (assumed; if not, give --unit)" if record["unit_assumed"] else ""
    contours = f"{record['contours']} contours, " if record["contours"] else ""
    read = f"{record['points']}: {contours}{record['points_read']} points"
    lines = titled("read", f"{read}, unit {record['unit']}{assumed}")
    for note in record["notes"]:
        lines += titled("", note)
    for drop in record["dropped"]:
        off = f" by {1e3 * drop['off_m']:.3g} mm" if drop["off_m"] else ""
        lines += titled("dropped", f"{drop['contour']}: {drop['why']}{off}")
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
    for file in record["written"]:
        lines += titled("wrote", f"{file['file']} ({file['holds']})")
    return "\n".join(lines)
