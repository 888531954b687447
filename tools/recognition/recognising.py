"""Recognition of the object of a run among stored objects."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from palpate.core import geometry, recognition
from palpate.launch.files.mesh_file import read_mesh
from palpate.launch.files.source_map import InputError, as_input_errors
from palpate.launch.printing import titled
from palpate.launch.run_directory import SUMMARY, find_run_mesh, read_summary
from palpate.tools.recognition.object_database import (
    DEFAULT_LEARNING,
    OBJECTS,
    LearningSettings,
    ObjectDatabase,
    learn_models,
    load_models,
    load_objects,
    write_models,
)

UNITS = {"log volume": "ml", "log area": "cm2", "log length": "mm", "angle": "deg"}
SCALES = {"log volume": 1e6, "log area": 1e4, "log length": 1e3, "angle": 180.0 / math.pi}
RecognitionRecord = Mapping[str, Any]


def recognise(
    path: Path,
    *,
    unit: str | None = None,
    objects: Path | None = None,
    say: Callable[[str], object] = lambda text: None,
    learning: LearningSettings = DEFAULT_LEARNING,
) -> RecognitionRecord:
    """Recognise the surface in a run directory or a mesh file; returns facts by stable names.

    `objects`: file of a user's objects. If they are not learned yet, they are learned, which `say`
    reports, and their models are written beside the file. Raises InputError if a file cannot be
    read, or has no closed surface.
    """
    vertices, faces, uncertainty = _surface(path, unit)
    database = load_objects(objects or OBJECTS)
    models = load_models(database) or _learned(database, say, learning)
    with as_input_errors(path):
        features = recognition.feature_vector(recognition.describe(vertices, faces))
    uncertainty = math.hypot(uncertainty, geometry.facet_sag(vertices, faces))
    result = recognition.recognise(features, models, uncertainty)
    other = result.runner_up if result.name != recognition.NONE else result.nearest
    named = (result.nearest, *([result.runner_up] if result.runner_up else []))
    titles = {name: database.entries[name].title for name in named}
    differences = recognition.differences(features, models, other, uncertainty) if other else []
    return {
        "run": str(path),
        "recognised": result.name != recognition.NONE,
        "object": result.name,
        "title": titles.get(result.name),
        "probability": result.probabilities[result.name],
        "nearest": result.nearest,
        "runner_up": result.runner_up,
        "runner_up_probability": result.probabilities.get(result.runner_up or ""),
        "distance": result.distance,
        "limit": result.limit,
        "uncertainty_m": uncertainty,
        "compared_with": other,
        "differences": [*map(_difference_figures, differences[:3])],  # the largest
        "probabilities": result.probabilities,
        "titles": titles,
    }


def _surface(path: Path, unit: str | None) -> tuple[np.ndarray, np.ndarray, float]:
    """Vertices (n, 3) [m], faces (m, 3), and the uncertainty of the surface [m]."""
    mesh = find_run_mesh(path)
    if mesh == path:
        vertices, faces, _ = read_mesh(path, unit)
        return vertices, faces, recognition.MatchingSettings().uncertainty
    vertices, faces, _ = read_mesh(mesh, unit or "m")
    summary = read_summary(path) if mesh.with_name(SUMMARY).is_file() else {}
    bound = summary.get("rms_bound_95_m")
    known = bound if isinstance(bound, float) and 0.0 < bound < math.inf else 0.0
    return vertices, faces, max(known, recognition.MatchingSettings().uncertainty)


def _learned(
    database: ObjectDatabase, say: Callable[[str], object], settings: LearningSettings
) -> recognition.ObjectModels:
    models = learn_models(database, lambda name: say(f"learning {name}"), settings)
    try:
        say(f"written to {write_models(database, models)}")
    except (OSError, InputError) as error:  # the folder cannot be written
        say(f"not kept: {error}")
        return models
    return load_models(database) or models  # with rounded numbers, as at the next reading


def _difference_figures(difference: recognition.Difference) -> dict[str, Any]:
    kind, scale = difference.kind, SCALES.get(difference.kind, 1.0)
    values = (difference.measured, difference.stored)
    measured, stored = (scale * (math.exp(v) if "log" in kind else v) for v in values)
    return {
        "feature": difference.name,
        "measured": measured,
        "stored": stored,
        "unit": UNITS.get(kind, ""),
        "deviations": difference.deviations,
    }


def recognition_text(record: RecognitionRecord) -> str:
    """Lines about a recognised object, or about none."""
    titles, name, other = record["titles"], record["object"], record["runner_up"]
    is_known, nearest = record["recognised"], record["nearest"]
    chance, label = (
        _percent(record["probability"]),
        f"{name} ({titles[name]})" if is_known else name,
    )
    lines = titled("object", f"{label}, probability {chance}")
    if not is_known:
        lines += titled("nearest", f"{nearest} ({titles[nearest]})")
    if other is not None:
        chance = _percent(record["runner_up_probability"])
        lines += titled("runner-up", f"{other} ({titles[other]}), probability {chance}")
    lines += titled("differs" if is_known else "reason", _reason(record))
    return "\n".join(lines)


def _reason(record: RecognitionRecord) -> str:
    differences = "; ".join(
        f"{feature['feature']} {_value(feature['measured'], feature['unit'])}, not "
        f"{_value(feature['stored'], feature['unit'])}"
        for feature in record["differences"]
    )
    if record["recognised"]:
        return differences or "there is no other object"
    return (
        f"its distance from {record['nearest']} is {record['distance']:.3g}, where 99 in 100 "
        f"copies are within {record['limit']:.3g}: {differences}"
    )


def _value(value: float, unit: str) -> str:
    return f"{value:.3g} {unit}".rstrip()


def _percent(share: float) -> str:
    return f"{100.0 * share:.3g} %" if share >= 1e-5 else "less than 0.001 %"
