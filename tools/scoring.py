"""A solid measured against a CAD model or against measured points."""

from __future__ import annotations

import math
from collections.abc import Mapping
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

MAX_SIZE_RATIO = 5.0  # Times as large or as small: one of the units is probably wrong
ScoreRecord = Mapping[str, Any]
POINT_SUFFIXES = (".csv", ".xyz", ".txt")  # Formats that hold points alone
MIN_POINTS = 6  # Points, so that they say anything
MAX_COORDINATE = 1e30  # Coordinate, m, of which powers are still numbers


def score(
    model: Path,
    reference: Path,
    *,
    unit: str | None = None,
    reference_unit: str | None = None,
    aligned: bool = False,
) -> ScoreRecord:
    """Distances between a surface and what it should be, by stable names; one-sided against points.

    Each may be a run, by its directory or recording, whose solid is meant. `aligned` moves the
    model onto the reference first, rigidly. Raises InputError if a file cannot be read or does not
    hold what it must.
    """
    model, unit = _solid_of(model, unit)
    reference, reference_unit = _solid_of(reference, reference_unit)
    solid = _outwards(read_mesh_or_points(model, unit))
    wanted = _outwards(read_mesh_or_points(reference, reference_unit))
    if not len(solid.faces):
        raise InputError(f"{model}: holds points; the model must be a surface")
    surface = _prepared(model, solid)
    found = geometry.solidity(solid.vertices, solid.faces)
    sizes = [float(np.linalg.norm(np.ptp(one.vertices, axis=0))) for one in (solid, wanted)]
    shared = {
        "model": str(model),
        "reference": str(reference),
        "unit": solid.unit,
        "reference_unit": wanted.unit,
        "one_sided": not len(wanted.faces),
        "size_m": float(np.ptp(wanted.vertices[:, 2])),
        "same_order_of_size": max(sizes) <= MAX_SIZE_RATIO * min(sizes),
        "watertight": found.watertight,
        "components": found.components,
        "genus": found.genus,
        "self_intersections": geometry.self_intersection(solid.vertices, solid.faces).count,
    }
    if len(wanted.faces):
        return {**shared, **_against_surface(surface, solid, reference, wanted, aligned)}
    return {**shared, **_against_points(surface, wanted.vertices, aligned)}


def _solid_of(path: Path, unit: str | None) -> tuple[Path, str | None]:
    """The mesh of a run, which is in m; another file is itself."""
    mesh = find_run_mesh(path)
    return mesh, unit or ("m" if mesh != path else None)


def read_mesh_or_points(path: Path, unit: str | None) -> MeshOrPoints:
    """A surface (PLY, STL, OBJ, OFF, GLB, NPZ) or points (CSV, TXT, XYZ, a PLY without faces).

    Without a `unit` a surface is in the one that `palpate run` takes it to be in, or else in the
    one in which palpate writes it, mm for STL and m for all others; points are in m. Raises
    InputError if the file cannot be read, or holds neither.
    """
    kind = path.suffix.lower()
    taken = unit or "m"
    points: Floats | None = None
    if kind in POINT_SUFFIXES:
        points = _read_table(path) * METRES_PER_UNIT[taken]
    elif kind == ".ply":
        points = read_cloud(path, taken)
    if points is not None:
        count, finite = len(points), np.isfinite(points).all(axis=1)
        if count < MIN_POINTS:
            raise InputError(f"{path}: holds {count} points; at least {MIN_POINTS} are needed")
        if not finite.all():
            raise InputError(f"{path}: point {np.argmin(finite)} is not finite")
        if not np.ptp(points, axis=0).any():
            raise InputError(f"{path}: all {count} points are in one place")
        vertices, faces = points, np.zeros((0, 3), np.int32)
    elif kind == ".npz":
        vertices, faces = _read_model(path)
        vertices = vertices * METRES_PER_UNIT[taken]
    else:
        vertices, faces, taken = read_surface(path, unit)
    size = float(np.abs(vertices).max(initial=0.0))
    if len(vertices) and np.isfinite(size) and not size <= MAX_COORDINATE:
        raise InputError(
            f"{path}: reaches {size:g} m from the origin; at most {MAX_COORDINATE:g} m can"
        )
    return MeshOrPoints(vertices, faces, taken)


def _read_table(path: Path) -> Floats:
    """The columns x, y and z of a table, found as `palpate rebuild` finds them."""
    points, left_out = read_positions(path)
    if left_out:
        raise InputError(f"{path}: holds {left_out[0].removeprefix('left out ')}")
    return points


def _read_model(path: Path) -> tuple[Floats, NDArray[np.int32]]:
    """Vertices, m, and faces of a model as a run or `palpate.save` leaves it."""
    data = read_bounded(path, MAX_MESH_BYTES)
    with as_input_errors(path):
        arrays = read_npz(data)
    if FORM_KEY in arrays and "vertices" not in arrays:
        mesh = load(path).final_mesh  # as fine as meshes are by themselves
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
    """A closed surface with its normals outside."""
    if not len(shape.faces):
        return shape
    found = geometry.solidity(shape.vertices, shape.faces)
    if found.watertight and found.volume < 0.0:
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
    found = geometry.align(surface.samples.points, truth) if aligned else None
    if found is not None:
        moved = Pose.from_array(found.pose).to_outer(solid.vertices)
        surface = geometry.prepare_surface(moved, solid.faces)
    distances = geometry.compare_surfaces(truth, surface)
    volumes = [geometry.solidity(one.vertices, one.faces) for one in (solid, wanted)]
    closed = all(one.watertight and one.volume != 0.0 for one in volumes)
    return {
        **_alignment_figures(found, None if found is None else found.pose),
        "chamfer_m": distances.chamfer,
        "mean_m": None,
        "rms_m": distances.rms,
        "p95_m": distances.p95,
        "hausdorff_m": distances.hausdorff,
        "normal_deg": distances.normal_deg,
        "volume_error": volumes[0].volume / volumes[1].volume - 1.0 if closed else None,
        "sampling_floor_m": geometry.facet_sag(wanted.vertices, wanted.faces),
        "points": None,
    }


def _prepared(path: Path, shape: MeshOrPoints) -> geometry.PreparedSurface:
    with as_input_errors(path):
        return geometry.prepare_surface(shape.vertices, shape.faces)


def _against_points(
    surface: geometry.PreparedSurface, points: Floats, aligned: bool
) -> ScoreRecord:
    found = geometry.align(points, surface) if aligned else None
    moved = points if found is None else Pose.from_array(found.pose).to_outer(points)
    distances = geometry.nearest_points(surface.search, moved).distances
    return {
        **_alignment_figures(
            found, None if found is None else Pose.from_array(found.pose).inverse().array
        ),
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


def _alignment_figures(found: geometry.Alignment | None, pose: Floats | None) -> ScoreRecord:
    """What the alignment says; `pose` is the model's in the reference's frame."""
    return {
        "aligned": found is not None,
        "pose": None if pose is None else pose.tolist(),
        "alignment_rms_m": found and found.rms,
        "alignment_converged": found and found.converged,
        "alignment_ambiguous": found and found.ambiguous,
    }


class MeshOrPoints(NamedTuple):
    """A surface or points, in m."""

    vertices: Floats  # (n, 3)
    faces: NDArray[np.int32]  # (m, 3); none for points
    unit: str  # As which the file was read


def score_text(scored: ScoreRecord) -> str:
    """The figures of a score; lengths in mm."""
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
    *place, i, j, k, w = scored["pose"]
    turn = math.degrees(2.0 * math.atan2(math.hypot(i, j, k), abs(w)))
    place, rest = (
        ", ".join(f"{1000.0 * v:.3f}" for v in place),
        millimetres(scored["alignment_rms_m"]),
    )
    lines = titled("aligned", f"model moved by ({place}) mm, turned by {turn:.2f} deg; rms {rest}")
    if not scored["alignment_converged"]:
        lines += titled("warning", "the alignment had not come to rest")
    if scored["alignment_ambiguous"]:
        lines += titled("warning", "another pose fits as well: it looks alike from there")
    return lines


def _distance_lines(scored: ScoreRecord) -> list[str]:
    first = "mean" if scored["one_sided"] else "chamfer"
    named = {first: f"{first}_m", "rms": "rms_m", "p95": "p95_m", "worst": "hausdorff_m"}
    parts = (f"{name} {millimetres(scored[key])}" for name, key in named.items())
    lines = titled("distance", *parts)
    if scored["one_sided"]:
        told = f"from {scored['points']} points to the model, not back: "
        return lines + titled("one-sided", told + "what the points do not cover is not judged")
    volume = scored["volume_error"]
    rest = (
        f"sampling floor {millimetres(scored['sampling_floor_m'])}",
        f"normals {scored['normal_deg']:.1f} deg",
        "volume not known" if volume is None else f"volume {100.0 * volume:+.2f} %",
    )
    return lines + titled("", *rest)
