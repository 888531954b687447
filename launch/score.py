"""A solid measured against a CAD model or against measured points."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.core.frames import inverse, transform
from palpate.core.measure.align import Alignment, align
from palpate.core.measure.distance import Prepared, compare, prepare
from palpate.core.measure.facet_sag import facet_sag
from palpate.core.measure.nearest import nearest_points
from palpate.core.measure.self_intersection import self_intersection
from palpate.core.measure.solidity import Solidity, solidity
from palpate.launch.located import InputError
from palpate.launch.score_files import Shape, read_shape

OTHER_SIZE = 5.0
"""Times as large or as small: one of the units is probably wrong."""

Scored = Mapping[str, Any]


def score(
    model: Path,
    reference: Path,
    *,
    unit: str | None = None,
    reference_unit: str | None = None,
    aligned: bool = False,
) -> Scored:
    """Distances between a model and what it should be, by stable names.

    Parameters
    ----------
    model : Path
        A surface.
    reference : Path
        A surface, or points; against points the distances are one-sided.
    unit, reference_unit : str, optional
        Units of their coordinates; see `read_shape`.
    aligned : bool
        Move the model onto the reference first, rigidly.

    Raises
    ------
    InputError
        If a file cannot be read or does not hold what it must.
    """
    solid = _outwards(read_shape(model, unit))
    wanted = _outwards(read_shape(reference, reference_unit))
    if not len(solid.faces):
        raise InputError(f"{model}: holds points; the model must be a surface")
    surface = _prepared(model, solid)
    shared = {
        "model": str(model),
        "reference": str(reference),
        "unit": solid.unit,
        "reference_unit": wanted.unit,
        "one_sided": not len(wanted.faces),
        **_size(solid, wanted),
        **_solid(solid),
    }
    if len(wanted.faces):
        return {**shared, **_against_surface(surface, solid, reference, wanted, aligned)}
    return {**shared, **_against_points(surface, wanted.vertices, aligned)}


def _outwards(shape: Shape) -> Shape:
    """A closed surface with its normals outside."""
    if not len(shape.faces):
        return shape
    found = solidity(shape.vertices, shape.faces)
    if found.watertight and found.volume < 0.0:
        return shape._replace(faces=np.ascontiguousarray(shape.faces[:, ::-1]))
    return shape


def _against_surface(
    surface: Prepared, solid: Shape, reference: Path, wanted: Shape, aligned: bool
) -> Scored:
    truth = _prepared(reference, wanted)
    found = align(surface.samples.points, truth) if aligned else None
    if found is not None:
        moved = transform(found.pose, solid.vertices)
        surface = prepare(moved, solid.faces)
    distances = compare(truth, surface)
    volumes = [solidity(one.vertices, one.faces) for one in (solid, wanted)]
    closed = all(one.watertight and one.volume != 0.0 for one in volumes)
    return {
        **_alignment(found, None if found is None else found.pose),
        "chamfer_m": distances.chamfer,
        "mean_m": None,
        "rms_m": distances.rms,
        "p95_m": distances.p95,
        "hausdorff_m": distances.hausdorff,
        "normal_deg": distances.normal_deg,
        "volume_error": volumes[0].volume / volumes[1].volume - 1.0 if closed else None,
        "sampling_floor_m": facet_sag(wanted.vertices, wanted.faces),
        "points": None,
    }


def _against_points(surface: Prepared, points: NDArray[np.float64], aligned: bool) -> Scored:
    found = align(points, surface) if aligned else None
    moved = points if found is None else transform(found.pose, points)
    distances = nearest_points(surface.search, moved).distances
    return {
        **_alignment(found, None if found is None else inverse(found.pose)),
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


def _prepared(path: Path, shape: Shape) -> Prepared:
    try:
        return prepare(shape.vertices, shape.faces)
    except ValueError as error:
        raise InputError(f"{path}: {error}") from None


def _solid(solid: Shape) -> Scored:
    found: Solidity = solidity(solid.vertices, solid.faces)
    return {
        "watertight": found.watertight,
        "components": found.components,
        "genus": found.genus,
        "self_intersections": self_intersection(solid.vertices, solid.faces).count,
    }


def _size(solid: Shape, wanted: Shape) -> Scored:
    """Height of the reference, and whether the two are of one order."""
    diagonals = [float(np.linalg.norm(np.ptp(one.vertices, axis=0))) for one in (solid, wanted)]
    alike = max(diagonals) <= OTHER_SIZE * min(diagonals)
    return {"size_m": float(np.ptp(wanted.vertices[:, 2])), "same_order_of_size": alike}


def _alignment(found: Alignment | None, pose: NDArray[np.float64] | None) -> Scored:
    """What the alignment says; `pose` is the model's in the reference's frame."""
    return {
        "aligned": found is not None,
        "pose": None if pose is None else [float(value) for value in pose],
        "alignment_rms_m": None if found is None else found.rms,
        "alignment_converged": None if found is None else found.converged,
        "alignment_ambiguous": None if found is None else found.ambiguous,
    }
