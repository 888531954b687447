"""A solid measured against a CAD model or against measured points."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from palpate.core import geometry
from palpate.core.archive import FORM_KEY
from palpate.core.arrays import Floats
from palpate.core.poses import Pose
from palpate.launch.files.file_access import read_bounded
from palpate.launch.files.mesh_file import MAX_MESH_BYTES, read_cloud, read_surface
from palpate.launch.files.points_file import read_positions
from palpate.launch.files.solid_file import load, read_npz
from palpate.launch.files.source_map import InputError, as_input_errors
from palpate.launch.files.units import METRES_PER_UNIT
from palpate.launch.printing import millimetres, titled
from palpate.launch.run_directory import find_run_mesh

ScoreRecord = Mapping[str, Any]
POINT_SUFFIXES = (".csv", ".xyz", ".txt")  # formats of points only


@dataclass(frozen=True, slots=True, kw_only=True)
class ScoreLimits:
    """What files a score takes, and when their sizes are doubted."""

    min_points: int = 6  # of a reference that consists of points
    max_coordinate: float = 1e30  # [m] so that its powers do not overflow
    max_size_ratio: float = 5.0  # larger size / smaller size; beyond it a unit is probably wrong


DEFAULT_LIMITS = ScoreLimits()


def score(
    model: Path,
    reference: Path,
    *,
    unit: str | None = None,
    reference_unit: str | None = None,
    aligned: bool = False,
    limits: ScoreLimits = DEFAULT_LIMITS,
) -> ScoreRecord:
    """Distances between a surface and its reference, by stable names; one-sided against points.

    Each is a file, or the directory or recording of a run, for its solid. `aligned`: the model is
    first moved rigidly onto the reference. Raises InputError if a file cannot be read, or has no
    surface or points.
    """
    model, unit = _solid_of(model, unit)
    reference, reference_unit = _solid_of(reference, reference_unit)
    solid = _outwards(read_mesh_or_points(model, unit, limits))
    truth = _outwards(read_mesh_or_points(reference, reference_unit, limits))
    if not len(solid.faces):
        raise InputError(f"{model}: holds points; the model must be a surface")
    surface = _prepared(model, solid)
    topology = geometry.solidity(solid.vertices, solid.faces)
    sizes = [float(np.linalg.norm(np.ptp(some.vertices, axis=0))) for some in (solid, truth)]
    shared = {
        "model": str(model),
        "reference": str(reference),
        "unit": solid.unit,
        "reference_unit": truth.unit,
        "one_sided": not len(truth.faces),
        "size_m": float(np.ptp(truth.vertices[:, 2])),
        "same_order_of_size": max(sizes) <= limits.max_size_ratio * min(sizes),
        "watertight": topology.watertight,
        "components": topology.components,
        "genus": topology.genus,
        "self_intersections": geometry.self_intersection(solid.vertices, solid.faces).count,
    }
    if len(truth.faces):
        return {**shared, **_against_surface(surface, solid, reference, truth, aligned)}
    return {**shared, **_against_points(surface, truth.vertices, aligned)}


def _solid_of(path: Path, unit: str | None) -> tuple[Path, str | None]:
    """Mesh and unit of a run, which is in m; of another file the file itself."""
    mesh = find_run_mesh(path)
    return mesh, unit or ("m" if mesh != path else None)


def read_mesh_or_points(
    path: Path, unit: str | None, limits: ScoreLimits = DEFAULT_LIMITS
) -> MeshOrPoints:
    """A surface (PLY, STL, OBJ, OFF, GLB, NPZ) or points (CSV, TXT, XYZ, a PLY without faces).

    Without a `unit` a surface is in the unit that `palpate run` assumes, or else in the one that
    palpate writes, mm for STL and m for other formats; points are in m. Raises InputError if the
    file cannot be read, or holds neither.
    """
    kind = path.suffix.lower()
    assumed = unit or "m"
    points: Floats | None = None
    if kind in POINT_SUFFIXES:
        points = _read_table(path) * METRES_PER_UNIT[assumed]
    elif kind == ".ply":
        points = read_cloud(path, assumed)
    if points is not None:
        _check_points(path, points, limits.min_points)
        vertices, faces = points, np.zeros((0, 3), np.int32)
    elif kind == ".npz":
        vertices, faces = _read_model(path)
        vertices = vertices * METRES_PER_UNIT[assumed]
    else:
        vertices, faces, assumed = read_surface(path, unit)
    size = float(np.abs(vertices).max(initial=0.0))
    if len(vertices) and np.isfinite(size) and not size <= limits.max_coordinate:
        limit = f"at most {limits.max_coordinate:g} m can"
        raise InputError(f"{path}: reaches {size:g} m from the origin; {limit}")
    return MeshOrPoints(vertices, faces, assumed)


def _check_points(path: Path, points: Floats, min_points: int) -> None:
    count, finite = len(points), np.isfinite(points).all(axis=1)
    if count < min_points:
        raise InputError(f"{path}: holds {count} points; at least {min_points} are needed")
    if not finite.all():
        raise InputError(f"{path}: point {np.argmin(finite)} is not finite")
    if not np.ptp(points, axis=0).any():
        raise InputError(f"{path}: all {count} points are in one place")


def _read_table(path: Path) -> Floats:
    """Columns x, y and z (n, 3) of a table, recognised as by `palpate rebuild`."""
    points, left_out = read_positions(path)
    if left_out:
        raise InputError(f"{path}: holds {left_out[0].removeprefix('left out ')}")
    return points


def _read_model(path: Path) -> tuple[Floats, NDArray[np.int32]]:
    """Vertices (n, 3) [m] and faces (m, 3) of a model written by a run or `palpate.save`."""
    data = read_bounded(path, MAX_MESH_BYTES)
    with as_input_errors(path):
        arrays = read_npz(data)
    if FORM_KEY in arrays and "vertices" not in arrays:
        mesh = load(path).final_mesh  # in the default resolution
        return mesh.vertices, mesh.faces
    for name in ("vertices", "faces"):
        if name not in arrays:
            raise InputError(f"{path}: is no model: it lacks {name}")
    vertices, faces = arrays["vertices"], arrays["faces"]
    if faces.ndim == 0:
        raise InputError(f"{path}: is no model: its faces are a single number")
    if not len(faces):
        raise InputError(f"{path}: the model has no surface; nothing could be rebuilt")
    try:
        geometry.triangle_corners(vertices, faces)
    except (ValueError, TypeError) as error:
        raise InputError(f"{path}: is no model: {error}") from None
    return np.asarray(vertices, np.float64), faces.astype(np.int32)


def _outwards(shape: MeshOrPoints) -> MeshOrPoints:
    """A surface; the normals of a closed one point outwards."""
    if not len(shape.faces):
        return shape
    topology = geometry.solidity(shape.vertices, shape.faces)
    if topology.watertight and topology.volume < 0.0:
        return shape._replace(faces=np.ascontiguousarray(shape.faces[:, ::-1]))
    return shape


def _against_surface(
    surface: geometry.PreparedSurface,
    solid: MeshOrPoints,
    reference: Path,
    wanted: MeshOrPoints,
    aligned: bool,
) -> ScoreRecord:
    truth = _prepared(reference, wanted)
    alignment = geometry.align(surface.samples.points, truth) if aligned else None
    if alignment is not None:
        moved = Pose.from_array(alignment.pose).to_outer(solid.vertices)
        surface = geometry.prepare_surface(moved, solid.faces)
    distances = geometry.compare_surfaces(truth, surface)
    shapes = [geometry.solidity(some.vertices, some.faces) for some in (solid, wanted)]
    closed = all(shape.watertight and shape.volume != 0.0 for shape in shapes)
    return {
        **_alignment_figures(alignment, alignment and alignment.pose),
        "chamfer_m": distances.chamfer,
        "mean_m": None,
        "rms_m": distances.rms,
        "p95_m": distances.p95,
        "hausdorff_m": distances.hausdorff,
        "normal_deg": distances.normal_deg,
        "volume_error": shapes[0].volume / shapes[1].volume - 1.0 if closed else None,
        "sampling_floor_m": geometry.facet_sag(wanted.vertices, wanted.faces),
        "points": None,
    }


def _prepared(path: Path, shape: MeshOrPoints) -> geometry.PreparedSurface:
    with as_input_errors(path):
        return geometry.prepare_surface(shape.vertices, shape.faces)


def _against_points(
    surface: geometry.PreparedSurface, points: Floats, aligned: bool
) -> ScoreRecord:
    alignment, pose, moved = None, None, points
    if aligned:
        alignment = geometry.align(points, surface)
        fitted = Pose.from_array(alignment.pose)
        moved, pose = fitted.to_outer(points), fitted.inverse().array
    distances = geometry.nearest_points(surface.search, moved).distances
    return {
        **_alignment_figures(alignment, pose),
        "chamfer_m": None,
        "mean_m": float(distances.mean()),
        "rms_m": float(np.sqrt(np.mean(distances**2))),
        "p95_m": float(np.quantile(distances, 0.95)),
        "hausdorff_m": float(distances.max()),
        "normal_deg": None,
        "volume_error": None,
        "sampling_floor_m": None,
        "points": len(points),
    }


def _alignment_figures(alignment: geometry.Alignment | None, pose: Floats | None) -> ScoreRecord:
    """Figures of an alignment; `pose` (7,) of the model in the frame of the reference."""
    return {
        "aligned": alignment is not None,
        "pose": None if pose is None else pose.tolist(),
        "alignment_rms_m": alignment and alignment.rms,
        "alignment_converged": alignment and alignment.converged,
        "alignment_ambiguous": alignment and alignment.ambiguous,
    }


class MeshOrPoints(NamedTuple):
    """A surface or points."""

    vertices: Floats  # (n, 3) [m]
    faces: NDArray[np.int32]  # (m, 3); (0, 3) for points
    unit: str  # in which the file was read


def score_text(scored: ScoreRecord) -> str:
    """Lines about a score, with lengths in mm."""
    lines = titled("model", f"{scored['model']}, read in {scored['unit']}")
    lines += titled("reference", f"{scored['reference']}, read in {scored['reference_unit']}")
    lines += [*_alignment_lines(scored), *_distance_lines(scored)]
    lines += titled(
        "solid",
        f"watertight {'yes' if scored['watertight'] else 'NO'}",
        f"pieces {scored['components']}",
        *([] if scored["genus"] is None else [f"holes through it {scored['genus']}"]),
        f"crossings with itself {scored['self_intersections']}",
    )
    if not scored["same_order_of_size"]:
        lines += titled("warning", "their sizes differ widely: see --unit and --reference-unit")
    return "\n".join(lines)


def _alignment_lines(scored: ScoreRecord) -> list[str]:
    if not scored["aligned"]:
        return []
    *position, i, j, k, w = scored["pose"]
    turn = math.degrees(2.0 * math.atan2(math.hypot(i, j, k), abs(w)))
    shift, rms = (
        ", ".join(f"{1e3 * x:.3f}" for x in position),
        millimetres(scored["alignment_rms_m"]),
    )
    lines = titled("aligned", f"model moved by ({shift}) mm, turned by {turn:.2f} deg; rms {rms}")
    if not scored["alignment_converged"]:
        lines += titled("warning", "the alignment did not converge")
    if scored["alignment_ambiguous"]:
        lines += titled("warning", "another pose fits as well: the object looks alike from there")
    return lines


def _distance_lines(scored: ScoreRecord) -> list[str]:
    first = "mean" if scored["one_sided"] else "chamfer"
    named = {first: f"{first}_m", "rms": "rms_m", "p95": "p95_m", "worst": "hausdorff_m"}
    parts = (f"{name} {millimetres(scored[key])}" for name, key in named.items())
    lines = titled("distance", *parts)
    if scored["one_sided"]:
        text = f"from {scored['points']} points to the model, not back: "
        return lines + titled("one-sided", text + "parts without points are not judged")
    volume = scored["volume_error"]
    figures = (
        f"sampling floor {millimetres(scored['sampling_floor_m'])}",
        f"normals {scored['normal_deg']:.1f} deg",
        "volume unknown" if volume is None else f"volume {100.0 * volume:+.2f} %",
    )
    return lines + titled("", *figures)
