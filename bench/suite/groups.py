"""``palpate bench``: what it measures, by name; and the shipped scenes from start to exit.

Each scene is run as a user runs it, in a fresh interpreter. The command line finds the verb by
name.
"""

from __future__ import annotations

import json
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import click

from palpate.bench.table import named, run_groups

SCENES = (
    *("vase", "sphere", "box", "cylinder", "egg", "twisted", "hyperquadric", "dented", "bottle"),
    *("oblique", "notched", "gem", "from_mesh", "worn_sensor"),
)
REPEATS = 5
MOST_SECONDS = 300.0  # A run that takes longer has hung, s
MOST_CHAMFER = 0.2  # Of the object's height, %
MOST_CONTOURS = 15
MOST_WALL = 15.0  # From start to exit, s
LEAST_RATE = 300.0  # Touches per second
SCENE_LINE = "{:<12}{:>9}{:>9}{:>9}{:>8}{:>6}{:>8}{:>5}  {}"

EXPLORE, BUS, REBUILD = "palpate.bench.explore", "palpate.bench.bus", "palpate.bench.rebuild"
SHAPES, TOUCH = "palpate.bench.shapes", "palpate.bench.touch"
# Groups of each bench: ``module:function`` by name, each imported at its turn; the quickest first.
BENCHES: Mapping[str, Mapping[str, str]] = {
    "scenes": {"scenes": f"{__name__}:scene_rows"},
    "explore": {
        "tracing": f"{EXPLORE}.tracing:tracing_rows",
        "grasp": f"{EXPLORE}.grasping:grasp_rows",
        "planners": f"{EXPLORE}.planners:planner_rows",
        "whole": f"{EXPLORE}.explorations:exploration_rows",
        "tilted": f"{EXPLORE}.explorations:tilted_rows",
        "directions": f"{EXPLORE}.explorations:direction_rows",
        "fingers": f"{EXPLORE}.explorations:finger_rows",
        "planners_whole": f"{EXPLORE}.planners:whole_planner_rows",
        "calibration": f"{EXPLORE}.explorations:calibration_rows",
        "peer": "palpate.bench.explore.gp_explorer:gp_rows",
    },
    "bus": {
        "losses": f"{BUS}.losses:loss_rows",
        "hops": f"{BUS}.cost:hop_rows",
        "reliability": f"{BUS}.losses:reliability_rows",
        "start": f"{BUS}.start:start_rows",
        "locked": f"{BUS}.cost:lock_rows",
        "introspection": f"{BUS}.cost:introspection_rows",
        "fuzz": "palpate.bench.fuzz.trials:fuzz_rows",
    },
    "touch": {
        "frames": f"{TOUCH}.frames:touch_rows",
        "costs": f"{TOUCH}.frames:cost_rows",
    },
    "effects": {"effects": f"{TOUCH}.frames:effect_rows"},
    "curvature": {"curvature": f"{TOUCH}.curvature:curvature_rows"},
    "shapes": {
        "recovery": f"{SHAPES}:recovery_rows",
        "splines": f"{SHAPES}:spline_rows",
        "curves": f"{SHAPES}:curve_rows",
        "models": f"{SHAPES}:model_rows",
    },
    "rebuild": {
        "peers": f"{REBUILD}.comparison:peer_rows",
        "contours": f"{REBUILD}.contours:contour_rows",
        "taxels": f"{REBUILD}.contours:taxel_rows",
        "disorder": f"{REBUILD}.comparison:disorder_rows",
        "band": f"{REBUILD}.contours:band_rows",
        "thesis": f"{REBUILD}.comparison:thesis_rows",
    },
    "house": {"house": "palpate.bench.house:house_rows"},
}
# What draws the pictures of a bench into a folder.
FIGURES: Mapping[str, tuple[str, ...]] = {
    "curvature": ("palpate.bench.suite.figures:write_curvature_figures",),
    "shapes": ("palpate.bench.suite.figures:write_shape_figures",),
    "rebuild": (
        "palpate.bench.suite.figures:write_peer_figures",
        "palpate.bench.suite.figures:write_thesis_figures",
    ),
}


BENCH_HELP = """Measure one of nine things, here and now.

\b
scenes     the shipped scenes from start to end: accuracy and time
explore    tracing, grasps and planners; whole explorations of sixteen objects, and whether
           what a run says of its error is so; takes hours without --quick or --only
bus        the message bus alone: losses, latency, a million messages among stalls and deaths,
           start, lock between machines, tools; and damaged messages and files, of which none may
           do more than be refused
touch      one touch: frames a second, the error of cast and curvature, and what single calls cost
effects    each effect: its cost, and the error of a contour that it causes
curvature  filters and estimators against noise and impulses
shapes     superquadrics, splines and other models: exactness, recoveries, costs
rebuild    solids from contours: errors over those of lofts, radial functions and the
           thesis on eight objects, disorder, outliers, confidence and costs
house      palpate itself: lines and files, and how many files one frame, one rebuild and one
           plan run through; the sizes alone with --quick
"""


@click.command("bench", help=BENCH_HELP)
@click.argument("what", type=click.Choice(list(BENCHES)), default="scenes")
@click.option("--quick", is_flag=True, help="Fewer scenes, messages or frames.")
@click.option(
    "--figures",
    type=click.Path(file_okay=False),
    help="With curvature, shapes or rebuild: write their figures here.",
)
@click.option("--only", metavar="GROUP", help="One group of figures.")
@click.option("--json", "as_json", is_flag=True, help="One JSON object a line.")
def bench_command(
    what: str, quick: bool, figures: str | None, only: str | None, as_json: bool
) -> int:
    """Measure one thing; `BENCH_HELP` says which there are."""
    groups = BENCHES[what]
    if only is not None and only not in groups:
        raise click.UsageError(f"there is no group {only!r}; there are {', '.join(groups)}")
    if figures is not None:
        if what not in FIGURES:
            raise click.UsageError(f"--figures belongs to {', '.join(FIGURES)}")
        for place in FIGURES[what]:
            named(place)(figures)
    chosen = groups if only is None else {only: groups[only]}
    return run_groups(chosen, quick=quick, as_json=as_json, echo=click.echo)


class SceneFigures(NamedTuple):
    """One scene, run once or several times."""

    scene: str  # Its name
    summary: Mapping[str, Any]  # Figures of the run with the median rate
    wall: float  # Median time from start to exit, s
    hashes: frozenset[str]  # SHA-256 of the meshes of all runs

    @property
    def missed(self) -> list[str]:
        """Demands that it misses, in words."""
        summary = self.summary
        checks = {
            "chamfer": self._percent("chamfer_m") <= MOST_CHAMFER,
            "contours": summary["contours"] <= MOST_CONTOURS,
            "wall": self.wall <= MOST_WALL,
            "per s": summary["touches_per_s"] >= LEAST_RATE,
            "lost": summary["gaps"] == summary["duplicates"] == 0,
            "not watertight": summary["watertight"],
            "has handles": summary["genus"] == 0,
            "not repeatable": len(self.hashes) == 1,
        }
        return [name for name, holds in checks.items() if not holds]

    @property
    def holds(self) -> bool:
        """Whether it meets every demand."""
        return not self.missed

    def __str__(self) -> str:
        summary = self.summary
        return SCENE_LINE.format(
            self.scene,
            f"{self._percent('chamfer_m'):.3f} %",
            f"{self._percent('sampling_floor_m'):.3f} %",
            summary["contours"],
            summary["touches"],
            f"{summary['touches_per_s']:.0f}",
            f"{self.wall:.1f} s",
            summary["gaps"] + summary["duplicates"],
            "MISSED " + ", ".join(self.missed) if self.missed else "",
        ).rstrip()

    def _percent(self, key: str) -> float:
        share: float = self.summary[key] / self.summary["size_m"]
        return 100.0 * share


def scene_rows(quick: bool) -> Iterator[SceneFigures | str]:
    """The table of scenes; one run of each if quick, else the median of 5."""
    heads = ("scene", "chamfer", "floor", "contours", "touches", "per s", "wall", "lost", "")
    yield SCENE_LINE.format(*heads).rstrip()
    for scene in SCENES:
        yield explore_shipped(scene, 1 if quick else REPEATS)


def explore_shipped(scene: str, repeats: int) -> SceneFigures:
    """Run one scene as separate processes, `repeats` times.

    Raises RuntimeError if a run fails; with what it printed.
    """
    runs = sorted((_run(scene) for _ in range(repeats)), key=lambda run: run[0]["touches_per_s"])
    wall = statistics.median(wall for _, wall in runs)
    hashes = frozenset(summary["mesh_sha256"] for summary, _ in runs)
    return SceneFigures(scene, runs[len(runs) // 2][0], wall, hashes)


def _run(scene: str) -> tuple[dict[str, Any], float]:
    with tempfile.TemporaryDirectory(prefix="palpate-bench-") as folder:
        out = Path(folder) / "run"
        command = [sys.executable, "-m", "palpate", "run", scene, "--out", str(out), "--quick"]
        began = time.perf_counter()
        done = subprocess.run(command, capture_output=True, text=True, timeout=MOST_SECONDS)
        wall = time.perf_counter() - began
        if done.returncode != 0:
            raise RuntimeError(f"{scene} ended with {done.returncode}: {done.stderr.strip()}")
        summary: dict[str, Any] = json.loads((out / "summary.json").read_text(encoding="utf-8"))
        return summary, wall
