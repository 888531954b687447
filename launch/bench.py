"""Explore the shipped scenes and say what came of it: accuracy, cost, and what was lost.

Each scene is run as a user runs it, from a fresh interpreter to its exit.
"""

from __future__ import annotations

import json
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

SCENES = (
    "vase",
    "sphere",
    "box",
    "cylinder",
    "egg",
    "twisted",
    "hyperquadric",
    "dented",
    "bottle",
    "oblique",
    "notched",
    "gem",
    "from_mesh",
    "worn_sensor",
)
REPEATS = 5
MOST_SECONDS = 300.0
"""A run that takes longer has hung, s."""

MOST_CHAMFER = 0.2
"""Of the object's height, %."""
MOST_CONTOURS = 15
MOST_WALL = 15.0
"""From start to exit, s."""
LEAST_RATE = 300.0
"""Touches per second."""

Echo = Callable[[str], None]


class Outcome(NamedTuple):
    """One scene, run once or several times."""

    scene: str
    """Its name."""
    summary: Mapping[str, Any]
    """Figures of the run with the median rate."""
    wall: float
    """Median time from start to exit, s."""
    hashes: frozenset[str]
    """SHA-256 of the meshes of all runs."""


def bench(*, quick: bool, echo: Echo = print) -> int:
    """Print the table of scenes and that of the bus.

    Parameters
    ----------
    quick : bool
        One run of each scene and few messages; else 5 runs and many.
    echo : callable
        Takes one line.

    Returns
    -------
    int
        0 if every demand is met, else 1.
    """
    repeats = 1 if quick else REPEATS
    echo(_line("scene", "chamfer", "floor", "contours", "touches", "per s", "wall", "lost", ""))
    missed = False
    for scene in SCENES:
        outcome = explore(scene, repeats)
        faults = faults_of(outcome)
        missed = missed or bool(faults)
        echo(_row(outcome, faults))
    return int(missed)


def explore(scene: str, repeats: int) -> Outcome:
    """Run one scene as separate processes, `repeats` times.

    Raises
    ------
    RuntimeError
        If a run fails; with what it said.
    """
    runs = [_run(scene) for _ in range(repeats)]
    runs.sort(key=lambda run: run[0]["touches_per_s"])
    return Outcome(
        scene,
        runs[len(runs) // 2][0],
        statistics.median(wall for _, wall in runs),
        frozenset(summary["mesh_sha256"] for summary, _ in runs),
    )


def faults_of(outcome: Outcome) -> list[str]:
    """Demands that a scene misses, in words."""
    summary = outcome.summary
    checks = {
        "chamfer": _percent(summary) <= MOST_CHAMFER,
        "contours": summary["contours"] <= MOST_CONTOURS,
        "wall": outcome.wall <= MOST_WALL,
        "per s": summary["touches_per_s"] >= LEAST_RATE,
        "lost": summary["gaps"] == summary["duplicates"] == 0,
        "not watertight": summary["watertight"],
        "has handles": summary["genus"] == 0,
        "not repeatable": len(outcome.hashes) == 1,
    }
    return [name for name, holds in checks.items() if not holds]


def _run(scene: str) -> tuple[dict[str, Any], float]:
    with tempfile.TemporaryDirectory(prefix="palpate-bench-") as folder:
        out = Path(folder) / "run"
        command = [sys.executable, "-m", "palpate", "run", scene, "--out", str(out), "--quiet"]
        began = time.perf_counter()
        done = subprocess.run(command, capture_output=True, text=True, timeout=MOST_SECONDS)
        wall = time.perf_counter() - began
        if done.returncode != 0:
            raise RuntimeError(f"{scene} ended with {done.returncode}: {done.stderr.strip()}")
        summary: dict[str, Any] = json.loads((out / "summary.json").read_text(encoding="utf-8"))
        return summary, wall


def _percent(summary: Mapping[str, Any], key: str = "chamfer_m") -> float:
    share: float = summary[key] / summary["size_m"]
    return 100.0 * share


def _row(outcome: Outcome, faults: Sequence[str]) -> str:
    summary = outcome.summary
    return _line(
        outcome.scene,
        f"{_percent(summary):.3f} %",
        f"{_percent(summary, 'sampling_floor_m'):.3f} %",
        str(summary["contours"]),
        str(summary["touches"]),
        f"{summary['touches_per_s']:.0f}",
        f"{outcome.wall:.1f} s",
        str(summary["gaps"] + summary["duplicates"]),
        "MISSED " + ", ".join(faults) if faults else "",
    )


def _line(*cells: str) -> str:
    widths = (12, 9, 9, 9, 8, 6, 8, 5)
    parts = [f"{cells[0]:<{widths[0]}}"]
    parts += [f"{cell:>{width}}" for cell, width in zip(cells[1:8], widths[1:], strict=True)]
    return ("".join(parts) + "  " + cells[8]).rstrip()
