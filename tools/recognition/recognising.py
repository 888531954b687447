"""Which of the stored objects a run has touched, or none of them."""

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
    OBJECTS,
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
) -> RecognitionRecord:
    """What the surface in a run directory or a mesh file is of, by stable names.

    `objects`: a database of one's own. Where its objects are not learned yet, that is done, `say`
    is told, and what was learned is written beside it. Raises InputError if a file cannot be read,
    or holds no closed surface.
    """
    vertices, faces, uncertainty = _surface(path, unit)
    database = load_objects(objects or OBJECTS)
    models = load_models(database) or _learned(database, say)
    with as_input_errors(path):
        features = recognition.feature_vector(recognition.describe(vertices, faces))
    uncertainty = math.hypot(uncertainty, geometry.facet_sag(vertices, faces))
    found = recognition.recognise(features, models, uncertainty)
    other = found.runner_up if found.name != recognition.NONE else found.nearest
    told = (found.nearest, *([found.runner_up] if found.runner_up else []))
    titles = {name: database.entries[name].title for name in told}
    apart = recognition.differences(features, models, other, uncertainty) if other else []
    return {
        "run": str(path),
        "recognised": found.name != recognition.NONE,
        "object": found.name,
        "title": titles.get(found.name),
        "probability": found.probabilities[found.name],
        "nearest": found.nearest,
        "runner_up": found.runner_up,
        "runner_up_probability": found.probabilities.get(found.runner_up or ""),
        "distance": found.distance,
        "limit": found.limit,
        "uncertainty_m": uncertainty,
        "compared_with": other,
        "differences": [_told(one) for one in apart[:3]],  # The largest
        "probabilities": found.probabilities,
        "titles": titles,
    }


def _surface(path: Path, unit: str | None) -> tuple[np.ndarray, np.ndarray, float]:
    """Vertices (n, 3), m, faces (m, 3), and how uncertain the surface is, m."""
    mesh = find_run_mesh(path)
    if mesh == path:
        vertices, faces, _ = read_mesh(path, unit)
        return vertices, faces, recognition.MatchingSettings().uncertainty
    vertices, faces, _ = read_mesh(mesh, unit or "m")
    told = read_summary(path) if mesh.with_name(SUMMARY).is_file() else {}
    bound = told.get("rms_bound_95_m")
    known = bound if isinstance(bound, float) and 0.0 < bound < math.inf else 0.0
    return vertices, faces, max(known, recognition.MatchingSettings().uncertainty)


def _learned(database: ObjectDatabase, say: Callable[[str], object]) -> recognition.ObjectModels:
    models = learn_models(database, lambda name: say(f"learning {name}"))
    try:
        say(f"written to {write_models(database, models)}")
    except (OSError, InputError) as error:  # a folder that is not ours: learned in vain
        say(f"not kept: {error}")
        return models
    return load_models(database) or models  # as it is read from now on, rounded


def _told(one: recognition.Difference) -> dict[str, Any]:
    values = (math.exp(v) if "log" in one.kind else v for v in (one.measured, one.stored))
    measured, stored = (SCALES.get(one.kind, 1.0) * value for value in values)
    return {
        "feature": one.name,
        "measured": measured,
        "stored": stored,
        "unit": UNITS.get(one.kind, ""),
        "deviations": one.deviations,
    }


def recognition_text(found: RecognitionRecord) -> str:
    """The answer for a person."""
    titles, name, other = found["titles"], found["object"], found["runner_up"]
    known, near, chance = found["recognised"], found["nearest"], _percent(found["probability"])
    what = f"{name} ({titles[name]})" if known else name
    lines = titled("object", f"{what}, probability {chance}")
    if not known:
        lines += titled("nearest", f"{near} ({titles[near]})")
    if other is not None:
        chance = _percent(found["runner_up_probability"])
        lines += titled("runner-up", f"{other} ({titles[other]}), probability {chance}")
    lines += titled("told apart" if known else "reason", _reason(found))
    return "\n".join(lines)


def _reason(found: RecognitionRecord) -> str:
    told = "; ".join(
        f"{one['feature']} {_value(one['measured'], one['unit'])}, not "
        f"{_value(one['stored'], one['unit'])}"
        for one in found["differences"]
    )
    if found["recognised"]:
        return told or "there is no other object"
    return (
        f"its distance from {found['nearest']} is {found['distance']:.3g}, where 99 in 100 copies "
        f"are within {found['limit']:.3g}: {told}"
    )


def _value(value: float, unit: str) -> str:
    return f"{value:.3g} {unit}".rstrip()


def _percent(share: float) -> str:
    return f"{100.0 * share:.3g} %" if share >= 1e-5 else "less than 0.001 %"
