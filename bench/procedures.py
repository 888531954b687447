"""All exploratory procedures on the same objects, by the same sensor: what each gives, and costs.

A table in Markdown, an object a line: the true error of the solid, root mean square, or what was
found where there is no solid; touches, contacts of the hand with them; robot time. Beside an error
stands the object's sampling floor. Places and taxels have noise unless the object is tried without.
"""

from __future__ import annotations

import math
import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from palpate.bench.table import Figure, Row, figure_of
from palpate.core.geometry import close_rings, compare_surfaces, prepare_surface
from palpate.core.splines import coons_surface
from palpate.launch.files.source_map import SourceMapped
from palpate.launch.launch_source import EXPLORE, PROCEDURES, find_launch_file
from palpate.launch.printing import counted
from palpate.launch.progress import Display
from palpate.launch.run import Run, perform, plan_run
from palpate.launch.run_directory import RECORDING
from palpate.launch.scene import find_scene
from palpate.messages import decode
from palpate.messages.recording import open_recording
from palpate.messages.types import TYPES, Contour, Truth

OBJECTS = (
    *("block", "wedge", "box", "gem", "cone", "cylinder", "amphora", "sphere", "egg"),
    *("bottle", "vase", "cup"),
)
QUICK_OBJECTS = ("block", "cone")
SLICES, COONS = "slices", "coons"  # The exploration in slices, and Coons patches over its contours
# A place that is off by 0.1 mm along each axis, taxels by 10 um.
NOISE = [{"pose_error": {"sigma": 1e-4}}, {"gaussian_noise": {"sigma": 1e-5}}]
MERIDIANS = 48
MOST_TOUCHES = 400  # Of an exploration in slices


class Cell(NamedTuple):
    """What one procedure came to on one object."""

    text: str
    error: float | None  # Root mean square, m; None without a solid
    touches: int
    seconds: float  # Of robot time


def procedure_rows(quick: bool) -> Iterator[Row | str]:
    """The table; two objects if quick."""
    names = (SLICES, COONS, *PROCEDURES)
    yield f"| object | floor | {' | '.join(names)} |"
    yield f"|---|---|{'---|' * len(names)}"
    for scene in QUICK_OBJECTS if quick else OBJECTS:
        with tempfile.TemporaryDirectory(prefix="palpate-bench-") as folder:
            cells, floor = _explored(scene, Path(folder) / SLICES)
            for name in PROCEDURES:
                cells[name] = _performed(scene, name, Path(folder) / name)
        texts = " | ".join(cells[name].text for name in names)
        numbers = tuple(one for name in names for one in _figures(name, cells[name]))
        line = f"| {scene} | {1e3 * floor:.3f} | {texts} |"
        yield Row(scene, texts, numbers=numbers, text=line)


def _figures(name: str, cell: Cell) -> Iterator[Figure]:
    if cell.error is not None:
        yield figure_of(1e3 * cell.error, "mm", name=f"{name} rms")
    yield figure_of(cell.touches, name=f"{name} touches")
    yield figure_of(cell.seconds, "s", kind="error", name=f"{name} robot time")


def _explored(scene: str, out: Path) -> tuple[dict[str, Cell], float]:
    """The exploration in slices, Coons patches over what it traced, and the sampling floor, m."""
    run = _run(EXPLORE, scene, out, {"planner.most_touches": MOST_TOUCHES})
    summary = run.summary
    spent = int(summary["touches"]), float(summary["robot_time_s"])
    cells = {SLICES: _cell(summary["rms_m"], *spent)}
    error = _coons_error(out / RECORDING)
    cells[COONS] = _cell(error, *spent, "no patches")
    return cells, float(summary["sampling_floor_m"])


def _performed(scene: str, name: str, out: Path) -> Cell:
    run = _run(find_launch_file(Path(name)), scene, out)
    summary, told = run.summary, run.summary["procedure"]
    spent = int(summary["touches"]) + int(summary["contacts"]), float(summary["robot_time_s"])
    return _cell(summary["rms_m"], *spent, _without_solid(told))


def _without_solid(told: dict[str, Any]) -> str:
    """What was found where there is no solid, in a few words."""
    if told["status"] != "done":
        return str(told["status"])
    if "apex_error_m" in told:
        return f"axis ±{told['axis_error_deg']:.2f}°, apex ±{1e3 * told['apex_error_m']:.1f} mm"
    words = {"holes": "hole", "cavities": "cavity", "open_ends": "open end"}
    found = {key: int(told[key]) for key in words if told.get(key)}
    every = (counted(n, words[key], key.replace("_", " ")) for key, n in found.items())
    return ", ".join(every) or "no opening"


def _cell(error: float | None, touches: int, seconds: float, otherwise: str = "no solid") -> Cell:
    found = otherwise if error is None else f"{1e3 * error:.3f} mm"
    return Cell(f"{found}; {touches}; {seconds:.0f} s", error, touches, seconds)


def _run(file: Path, scene: str, out: Path, settings: Mapping[str, Any] = {}) -> Run:
    args = {
        "scene": SourceMapped(str(find_scene(scene)), "scene"),
        "scene.effects": SourceMapped(NOISE, "noise"),
    }
    given = {name: SourceMapped(value, name) for name, value in settings.items()}
    plan = plan_run(file, args, given, name=scene, out=out)
    return perform(plan, composed=True, display=Display())


def _coons_error(recording: Path) -> float | None:
    """Root mean square distance of Coons patches over the traced contours, m; None without."""
    kept: dict[str, list[Any]] = {Contour.__name__: [], Truth.__name__: []}
    for message in open_recording(recording).messages():
        if message.type in kept:
            kept[message.type].append(decode(TYPES[message.type], message.body))
    traced = [one for one in kept[Contour.__name__] if one.status == "closed"]
    if len(traced) < 2:
        return None
    traced.sort(key=lambda one: one.height)
    surface = coons_surface([one.points for one in traced], MERIDIANS)
    ends = [one.mean(axis=0) for one in (surface[0], surface[-1])]
    vertices, faces = close_rings(ends[0], surface, ends[1])
    (true,) = kept[Truth.__name__]
    truth = prepare_surface(true.vertices, true.faces)
    rms = compare_surfaces(truth, prepare_surface(vertices, faces)).rms
    return rms if math.isfinite(rms) and np.isfinite(vertices).all() else None
