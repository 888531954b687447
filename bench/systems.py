"""The system of 1999 and palpate, both as graphs, on the same objects with and without noise.

Objects are four shipped scenes and stand-ins for the two examples of chapter 5, 80 mm high.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Literal, NamedTuple

from palpate.bench.table import Row, figure_of
from palpate.bench.thesis import FIRST, SECOND, Example
from palpate.core.shapes import Mesh
from palpate.launch.launch_source import SYSTEMS
from palpate.tools.exploration import explore

SCENES, QUICK_SCENES = ("vase", "egg", "block", "bottle"), ("vase",)
EXAMPLES: tuple[Example, ...] = (FIRST, SECOND)
EXAMPLE_SIZE = "80mm"
Noise = Literal["none", "default"]
NOISES: dict[str, Noise] = {"exact": "none", "noise": "default"}
HEAD = f"{'':<34}{'touches':>9}{'robot':>9}{'compute':>9}{'rms':>11}{'bound':>11}{'ratio':>8}"


class SystemRun(NamedTuple):
    """Costs and error of a run."""

    touches: int
    robot: float  # Robot time [s]
    compute: float  # Processor time of all nodes [s]
    rms: float  # Root mean square error of the solid [m]
    bound: float | None  # That the system states of the error [m]


def system_rows(quick: bool) -> Iterator[Row | str]:
    """Touches, times, error and bound of each system; last, its error over palpate's."""
    yield HEAD
    shapes: dict[str, str | Mesh] = {name: name for name in (QUICK_SCENES if quick else SCENES)}
    if not quick:
        shapes |= {example.name: example.mesh(121, 180) for example in EXAMPLES}
    for name, shape in shapes.items():
        for noise, option in NOISES.items():
            runs = {system: _run(shape, system, option) for system in SYSTEMS}
            for system, run in runs.items():
                yield _row(f"{name}, {noise}: {system}", run, run.rms / runs["palpate"].rms)


def _run(shape: str | Mesh, system: str, noise: Noise) -> SystemRun:
    size = None if isinstance(shape, str) else EXAMPLE_SIZE
    with tempfile.TemporaryDirectory() as folder:
        run = explore(
            shape,
            system=system,
            noise=noise,
            size=size,
            out=Path(folder) / "run",
            composed=True,
            progress=False,
        )
        summary: Any = run.summary
    return SystemRun(
        summary["touches"],
        summary["robot_time_s"],
        summary["compute_s"],
        summary["rms_m"],
        summary["rms_bound_95_m"],
    )


def _row(name: str, run: SystemRun, ratio: float) -> Row:
    bound = "" if run.bound is None else f"{1e3 * run.bound:.3f} mm"
    lengths = f"{1e3 * run.rms:>8.3f} mm{bound:>11}"
    times = f"{run.robot:>7.0f} s{run.compute:>7.1f} s"
    return Row(
        name,
        lengths,
        numbers=(
            figure_of(run.touches, name="touches"),
            figure_of(run.robot, "s", kind="error", name="robot time"),
            figure_of(run.compute, "s", name="compute"),
            figure_of(1e3 * run.rms, "mm", name="rms"),
        ),
        text=f"{name:<34}{run.touches:>9}{times}{lengths}{ratio:>8.1f}",
    )
