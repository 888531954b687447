"""All exploratory procedures on the same objects with the same sensor: results and costs.

A table in Markdown with a line for each object: the true root mean square error of the solid, or
the finding of a procedure without a solid; touches, including contacts of the hand; robot time. The
second column is the sampling floor of the errors. Poses and taxels have the default noise.
"""

from __future__ import annotations

import math
import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from palpate.bench.harness import NOISY
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


class Cell(NamedTuple):
    """Result of one procedure on one object."""

    text: str
    error: float | None  # Root mean square [m]; None without a solid
    touches: int
    robot_time: float  # [s]


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
        numbers = tuple(number for name in names for number in _figures(name, cells[name]))
        line = f"| {scene} | {1e3 * floor:.3f} | {texts} |"
        yield Row(scene, texts, numbers=numbers, text=line)


def _figures(name: str, cell: Cell) -> Iterator[Figure]:
    if cell.error is not None:
        yield figure_of(1e3 * cell.error, "mm", name=f"{name} rms")
    yield figure_of(cell.touches, name=f"{name} touches")
    yield figure_of(cell.robot_time, "s", kind="error", name=f"{name} robot time")


def _explored(scene: str, out: Path, max_touches: int = 400) -> tuple[dict[str, Cell], float]:
    """The exploration in slices, Coons patches over its contours, and the sampling floor [m]."""
    run = _run(EXPLORE, scene, out, {"planner.most_touches": max_touches})
    summary = run.summary
    costs = int(summary["touches"]), float(summary["robot_time_s"])
    cells = {SLICES: _cell(summary["rms_m"], *costs)}
    error = _coons_error(out / RECORDING)
    cells[COONS] = _cell(error, *costs, "no patches")
    return cells, float(summary["sampling_floor_m"])


def _performed(scene: str, name: str, out: Path) -> Cell:
    run = _run(find_launch_file(Path(name)), scene, out)
    summary, result = run.summary, run.summary["procedure"]
    costs = int(summary["touches"]) + int(summary["contacts"]), float(summary["robot_time_s"])
    return _cell(summary["rms_m"], *costs, _without_solid(result))


def _without_solid(result: dict[str, Any]) -> str:
    """The finding of a procedure without a solid, in a few words."""
    if result["status"] != "done":
        return str(result["status"])
    if "apex_error_m" in result:
        return f"axis ±{result['axis_error_deg']:.2f}°, apex ±{1e3 * result['apex_error_m']:.1f} mm"
    words = {"holes": "hole", "cavities": "cavity", "open_ends": "open end"}
    counts = {key: int(result[key]) for key in words if result.get(key)}
    openings = (counted(n, words[key], key.replace("_", " ")) for key, n in counts.items())
    return ", ".join(openings) or "no opening"


def _cell(error: float | None, touches: int, robot_time: float, finding: str = "no solid") -> Cell:
    result = finding if error is None else f"{1e3 * error:.3f} mm"
    return Cell(f"{result}; {touches}; {robot_time:.0f} s", error, touches, robot_time)


def _run(file: Path, scene: str, out: Path, settings: Mapping[str, Any] = {}) -> Run:
    args = {
        "scene": SourceMapped(str(find_scene(scene)), "scene"),
        "scene.effects": SourceMapped(list(NOISY), "noise"),
    }
    overrides = {name: SourceMapped(value, name) for name, value in settings.items()}
    plan = plan_run(file, args, overrides, name=scene, out=out)
    return perform(plan, composed=True, display=Display())


def _coons_error(recording: Path, n_meridians: int = 48) -> float | None:
    """Root mean square error [m] of Coons patches over traced contours; None if there are none."""
    kept: dict[str, list[Any]] = {Contour.__name__: [], Truth.__name__: []}
    for message in open_recording(recording).messages():
        if message.type in kept:
            kept[message.type].append(decode(TYPES[message.type], message.body))
    traced = [contour for contour in kept[Contour.__name__] if contour.status == "closed"]
    if len(traced) < 2:
        return None
    traced.sort(key=lambda contour: contour.height)
    surface = coons_surface([contour.points for contour in traced], n_meridians)
    ends = [ring.mean(axis=0) for ring in (surface[0], surface[-1])]
    vertices, faces = close_rings(ends[0], surface, ends[1])
    (true,) = kept[Truth.__name__]
    truth = prepare_surface(true.vertices, true.faces)
    rms = compare_surfaces(truth, prepare_surface(vertices, faces)).rms
    return rms if math.isfinite(rms) and np.isfinite(vertices).all() else None
