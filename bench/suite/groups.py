"""What `palpate bench` measures, by name.

Groups of figures, and the shipped scenes from start to exit.

Each scene is run as a user runs it, in a fresh interpreter; a group yields its rows one at a
time.
"""

from __future__ import annotations

import json
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from palpate.bench.explore import (
    TRACING_GROUPS,
    calibration_rows,
    direction_rows,
    exploration_rows,
    finger_rows,
    grasp_rows,
    planner_rows,
    tilted_rows,
    whole_planner_rows,
)
from palpate.bench.peers import gp_rows
from palpate.bench.rebuild import (
    band_rows,
    contour_rows,
    disorder_rows,
    peer_rows,
    taxel_rows,
    thesis_rows,
)
from palpate.bench.shapes import curve_rows, model_rows, recovery_rows, spline_rows
from palpate.bench.table import Group, Row

# What ``palpate bench explore`` measures, the quickest first.
EXPLORE_GROUPS: Mapping[str, tuple[Group, ...]] = {
    "tracing": TRACING_GROUPS,
    "grasp": (grasp_rows,),
    "planners": (planner_rows,),
    "whole": (exploration_rows,),
    "tilted": (tilted_rows,),
    "directions": (direction_rows,),
    "fingers": (finger_rows,),
    "planners_whole": (whole_planner_rows,),
    "calibration": (calibration_rows,),
    "peer": (gp_rows,),
}
# What ``palpate bench rebuild`` measures.
REBUILD_GROUPS: tuple[Group, ...] = (
    *(peer_rows, contour_rows, taxel_rows),
    *(disorder_rows, band_rows, thesis_rows),
)
# What ``palpate bench shapes`` measures.
SHAPE_GROUPS: tuple[Group, ...] = (recovery_rows, spline_rows, curve_rows, model_rows)
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
MOST_SECONDS = 300.0  # A run that takes longer has hung, s
MOST_CHAMFER = 0.2  # Of the object's height, %
MOST_CONTOURS = 15
MOST_WALL = 15.0  # From start to exit, s
LEAST_RATE = 300.0  # Touches per second
Echo = Callable[[str], None]


def bench_explore(
    *,
    quick: bool,
    only: str | None = None,
    as_json: bool = False,
    echo: Callable[[str], None] = print,
) -> int:
    """Print figures, each as soon as it is known.

    Parameters
    ----------
    quick : bool
        Fewer objects and runs.
    only : str or None
        One group; all of them if left out.
    as_json : bool
        One JSON object a line, with the group's name.
    echo : callable
        Takes one line.

    Returns
    -------
    int
        0 if every demand is met, else 1.
    """
    missed = False
    for name in EXPLORE_GROUPS if only is None else (only,):
        if not as_json:
            echo(f"-- {name}")
        for group in EXPLORE_GROUPS[name]:
            for row in group(quick):
                missed = missed or not row.holds
                echo(_json(name, row) if as_json else str(row))
    return int(missed)


def _json(group: str, row: Row) -> str:
    return json.dumps({"group": group, **row._asdict()})


class SceneFigures(NamedTuple):
    """One scene, run once or several times."""

    scene: str  # Its name
    summary: Mapping[str, Any]  # Figures of the run with the median rate
    wall: float  # Median time from start to exit, s
    hashes: frozenset[str]  # SHA-256 of the meshes of all runs


def bench_scenes(*, quick: bool, echo: Echo = print) -> int:
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
        outcome = explore_shipped(scene, repeats)
        faults = missed_by_scene(outcome)
        missed = missed or bool(faults)
        echo(_row(outcome, faults))
    return int(missed)


def explore_shipped(scene: str, repeats: int) -> SceneFigures:
    """Run one scene as separate processes, `repeats` times.

    Raises
    ------
    RuntimeError
        If a run fails; with what it said.
    """
    runs = [_run(scene) for _ in range(repeats)]
    runs.sort(key=lambda run: run[0]["touches_per_s"])
    return SceneFigures(
        scene,
        runs[len(runs) // 2][0],
        statistics.median(wall for _, wall in runs),
        frozenset(summary["mesh_sha256"] for summary, _ in runs),
    )


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


def missed_by_scene(outcome: SceneFigures) -> list[str]:
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


def _row(outcome: SceneFigures, faults: Sequence[str]) -> str:
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


def _percent(summary: Mapping[str, Any], key: str = "chamfer_m") -> float:
    share: float = summary[key] / summary["size_m"]
    return 100.0 * share


def _losses(quick: bool) -> Iterator[Row]:
    from palpate.bench.bus import loss_rows

    return loss_rows(quick)


def _hops(quick: bool) -> Iterator[Row]:
    from palpate.bench.bus import hop_rows

    return hop_rows(quick)


def _reliability(quick: bool) -> Iterator[Row]:
    from palpate.bench.bus import reliability_rows

    return iter(reliability_rows(quick))


def _start(quick: bool) -> Iterator[Row]:
    from palpate.bench.bus import start_rows

    return start_rows(2 if quick else 7)


def _locked(quick: bool) -> Iterator[Row]:
    from palpate.bench.bus import lock_rows

    return lock_rows(500 if quick else 2000)


def _introspection(quick: bool) -> Iterator[Row]:
    from palpate.bench.bus import TURNS, introspection_rows

    return iter(introspection_rows(2 if quick else TURNS))


def _fuzz(quick: bool) -> Iterator[Row]:
    from palpate.bench.fuzz import fuzz_rows

    return fuzz_rows(quick)


# Groups of figures, by name.
BUS_GROUPS: dict[str, Group] = {
    "losses": _losses,
    "hops": _hops,
    "reliability": _reliability,
    "start": _start,
    "locked": _locked,
    "looking": _introspection,
    "damage": _fuzz,
}
