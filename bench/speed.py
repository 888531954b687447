"""Accuracy and speed of whole runs, and their times by node, step and wait.

Scenes run as a user runs them, in processes of their own. This checkout and an older one run in
turns, so that they meet the same load of the machine. Processor times are sums over all processes
of a run.
"""

from __future__ import annotations

import ctypes
import json
import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cache, partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from palpate.bench.loop import InProcessLoop, LoopNode, contour_goal, touching_nodes
from palpate.bench.table import Figure, Row, at_most, figure, figure_of, in_turns
from palpate.launch.files.source_map import InputError
from palpate.messages.recording import RecordedMessage, open_recording
from palpate.nodes import reconstructor, simulator, tracer
from palpate.nodes.specs.objects import ObjectSpec, PoseSpec, SuperquadricSpec
from palpate.nodes.specs.sensors import SensorSpec

SCENES = (
    *("vase", "sphere", "box", "cylinder", "egg", "twisted", "hyperquadric", "dented", "bottle"),
    *("oblique", "notched", "gem", "from_mesh", "worn_sensor"),
)
TIMES = ("wall", "cpu", "first", "last")  # Names of times in `TimedRun`
PR_SET_CHILD_SUBREAPER = 36  # Of prctl: orphaned processes become children of this one


@dataclass(frozen=True, slots=True, kw_only=True)
class SceneSettings:
    """Which scenes run how often, and what is demanded of each."""

    scenes: tuple[str, ...] = SCENES
    n_turns: int = 3  # runs of each scene
    max_chamfer: float = 0.2  # [% of the height] Chamfer distance
    max_contours: int = 15  # of a scene


@dataclass(frozen=True, slots=True, kw_only=True)
class TouchSettings:
    """A ball that is touched by square arrays, and what a touch may cost."""

    sides: tuple[int, ...] = (8, 16, 32, 64)  # taxels along a side
    n_repeats: int = 7  # contours that are traced with each array
    ball_radius: float = 0.03  # [m]
    approach: float = 0.02  # [m] outside of the ball, where tracing starts
    array_width: float = 16e-3  # [m]
    max_time: float = 1.5  # [ms] of a touch with 16 x 16 taxels
    max_ratio: float = 3.0  # time of a touch with 32 x 32 taxels / with 16 x 16


@dataclass(frozen=True, slots=True, kw_only=True)
class RunGrowthSettings:
    """Numbers of touches and fingers of a run, and the power of its processor time."""

    touches: tuple[int, ...] = (100, 300, 1000, 3000, 10_000)  # wanted, of one finger
    fingers: tuple[int, ...] = (1, 2, 3, 4, 5)  # of runs with the default planner
    touches_per_slice: float = 18.0  # roughly; converts wanted touches to slices
    max_fitted: int = 4000  # touches of the longest run to which the power is fitted
    max_power: float = 1.1  # of processor time over touches; 1: proportional


QUICK_SCENES = SceneSettings(scenes=("vase", "egg", "worn_sensor"), n_turns=1)
QUICK_TOUCHES = TouchSettings(sides=(8, 16), n_repeats=2)
QUICK_RUNS = RunGrowthSettings(touches=(100, 300), fingers=(1, 2))
# By topic: the change of the number of fingers at work, and what is awaited if none is.
EVENTS: Mapping[str, tuple[int, str]] = {
    "/hand/goal": (0, "hand"),
    "/hand/contacts": (0, "planner"),
    "/model/goal": (0, "model"),
    "/plan/done": (0, "final model"),
    "/model/coarse": (0, "planner"),
    "/model/shape": (0, "planner"),
    "/contour/goal": (1, ""),
    "/probe/goal": (1, ""),
    "/contour/traced": (-1, "planner"),
    "/probe/traced": (-1, "planner"),
}


class TimedRun(NamedTuple):
    """One run of a scene; times in [s]."""

    summary: Mapping[str, Any]
    wall: float  # From the command to its exit
    cpu: float  # Processor time of all processes
    first: float  # From the command to the first touch
    last: float  # From the last touch to the exit
    rate: float  # Touches a second between the first and the last
    waits: Mapping[str, float]  # Times without a finger at work, by what was awaited
    nodes: Mapping[str, float]  # Processor time by node
    steps: Mapping[str, float]  # Processor time by step


def scene_rows(quick: bool, *, against: Path | None = None) -> Iterator[SceneSpeed | Row | str]:
    """The shipped scenes, a few if quick; compared with an older checkout if there is one."""
    if against is not None and not (against / "palpate" / "__main__.py").is_file():
        raise InputError(f"{against}: --against must be a checkout of palpate, with its sources")
    settings = QUICK_SCENES if quick else SceneSettings()
    heads = ["chamfer", "floor", "touches", "per s", "wall s", "cpu s", "first s", "last s"]
    heads += ["cpu x", "wall x"] if against is not None else []
    yield f"{'scene':<13}" + "".join(f"{head:>9}" for head in heads)
    ratios: list[float] = []
    for scene in settings.scenes:
        calls = {"now": partial(run_timed, scene)}
        if against is not None:
            calls["older"] = partial(run_timed, scene, tree=against)
        if scene == SCENES[0]:
            in_turns(calls, 1)  # compiles the sources, which does not count
        runs = in_turns(calls, settings.n_turns)
        speed = SceneSpeed(scene, runs["now"], runs.get("older", []), settings)
        yield speed
        ratios += [speed.ratio("cpu")] if against is not None else []
    if ratios:
        mean = float(np.exp(np.mean(np.log(ratios))))
        yield figure("processor time over the older one, geometric mean", mean, kind="time")


class SceneSpeed(NamedTuple):
    """One scene, run several times."""

    name: str  # Of the scene
    runs: Sequence[TimedRun]
    older: Sequence[TimedRun]  # Of the older checkout, in turns with `runs`
    settings: SceneSettings = SceneSettings()

    @property
    def holds(self) -> bool:
        """Whether it meets all demands."""
        return not self.missed

    @property
    def missed(self) -> list[str]:
        """Demands that it misses, in words."""
        summaries = [run.summary for run in self.runs]
        checks = {
            "chamfer": self._percent("chamfer_m") <= self.settings.max_chamfer,
            "contours": all(
                summary["contours"] <= self.settings.max_contours for summary in summaries
            ),
            "lost": all(summary["gaps"] == summary["duplicates"] == 0 for summary in summaries),
            "not watertight": all(summary["watertight"] for summary in summaries),
            "has handles": all(summary["genus"] == 0 for summary in summaries),
            "not repeatable": len({summary["mesh_sha256"] for summary in summaries}) == 1,
        }
        return [name for name, holds in checks.items() if not holds]

    def _percent(self, key: str) -> float:
        """A length of the summary, % of the object's height."""
        summary = self.runs[0].summary
        return 100.0 * float(summary[key] / summary["size_m"])

    @property
    def figures(self) -> Sequence[Figure]:
        """Its times, their parts, and the accuracy of the solid."""
        units = {**dict.fromkeys(TIMES, "s"), "rate": "/s"}
        repeats = {name: [getattr(run, name) for run in self.runs] for name in units}
        figures = [
            figure_of(statistics.median(values), units[name], repeats=values, name=name)
            for name, values in repeats.items()
        ]
        summary = self.runs[0].summary
        figures.append(figure_of(1e3 * summary["chamfer_m"], "mm", name="chamfer"))
        figures += [figure_of(int(summary[key]), name=key) for key in ("contours", "touches")]
        for kind in ("waits", "nodes", "steps"):
            figures += [
                figure_of(value, "s", name=name) for name, value in self._parts(kind).items()
            ]
        for name in ("cpu", "wall") if self.older else ():
            figures.append(figure_of(self.ratio(name), "x", kind="time", name=f"{name} over older"))
        return figures

    def ratio(self, name: str) -> float:
        """Median of a figure / median of the older checkout."""
        return median_of(self.runs, name) / median_of(self.older, name)

    def _parts(self, kind: str) -> dict[str, float]:
        """Medians of the waits, nodes or steps by name, the largest first."""
        times = [getattr(run, kind) for run in self.runs]
        names = dict.fromkeys(name for by_name in times for name in by_name)
        parts = [(name, statistics.median(t.get(name, 0.0) for t in times)) for name in names]
        return dict(sorted(parts, key=lambda part: -part[1]))

    def __str__(self) -> str:
        cells = [f"{self._percent(key):.3f} %" for key in ("chamfer_m", "sampling_floor_m")]
        cells.append(str(self.runs[0].summary["touches"]))
        for name, form in (("rate", ".0f"), *((name, ".2f") for name in TIMES)):
            cells.append(f"{median_of(self.runs, name):{form}}")
        cells += [f"{self.ratio(name):.2f}" for name in ("cpu", "wall") if self.older]
        missed = "  MISSED " + ", ".join(self.missed) if self.missed else ""
        lines = [f"{self.name:<13}" + "".join(f"{cell:>9}" for cell in cells) + missed]
        for kind in ("nodes", "steps", "waits"):
            parts = [f"{name} {value:.2f}" for name, value in self._parts(kind).items()]
            lines.append(f"  {kind:<6}" + ", ".join(parts[:9]))
        return "\n".join(lines)


def median_of(runs: Sequence[TimedRun], name: str) -> float:
    """Median of a figure of several runs."""
    return float(statistics.median(getattr(run, name) for run in runs))


def run_timed(
    scene: str, *options: str, tree: Path | None = None, timeout: float = 3600.0
) -> TimedRun:
    """Run a scene, by default of this checkout, else of that in `tree`.

    Raises RuntimeError, with what it printed, if it fails.
    """
    with tempfile.TemporaryDirectory(prefix="palpate-bench-") as folder:
        out = Path(folder) / "run"
        command = [sys.executable, "-P", "-m", "palpate", "run", scene, "--out", str(out)]
        spent, start = _children_cpu(), time.monotonic_ns()
        done = subprocess.run(
            [*command, "--quiet", *options],
            cwd=folder,
            env=_environment(tree),
            capture_output=True,
            text=True,
            timeout=timeout,
        )
        end = time.monotonic_ns()
        if done.returncode not in (0, 1):  # 1 is a missed demand
            raise RuntimeError(f"{scene} ended with {done.returncode}: {done.stderr.strip()}")
        cpu = _children_cpu() - spent
        summary = json.loads((out / "summary.json").read_text(encoding="utf-8"))
        messages = list(open_recording(out / "topics.mcap").messages())
    touched = [m.sent_ns for m in messages if m.topic.endswith("/touch/patch")]
    return TimedRun(
        summary=summary,
        wall=1e-9 * (end - start),
        cpu=cpu,
        first=1e-9 * (touched[0] - start),
        last=1e-9 * (end - touched[-1]),
        rate=len(touched) / max(1e-9 * (touched[-1] - touched[0]), 1e-9),
        waits=waits_of(messages),
        nodes={name: float(node["cpu_s"]) for name, node in summary["nodes"].items()},
        steps=summary["steps"],
    )


def _environment(tree: Path | None) -> dict[str, str]:
    """Environment of a run: sources of neither checkout are compiled again at each start."""
    environment = dict(os.environ) | {"PYTHONPYCACHEPREFIX": _bytecode().name}
    environment.pop("PYTHONDONTWRITEBYTECODE", None)
    return environment | ({} if tree is None else {"PYTHONPATH": str(tree.resolve())})


@cache
def _bytecode() -> tempfile.TemporaryDirectory[str]:
    """Folder of compiled sources, which exists until this process ends."""
    return tempfile.TemporaryDirectory(prefix="palpate-bytecode-")


def _children_cpu(max_wait: float = 1.0) -> float:
    """Processor time [s] of all ended descendants of this process.

    Waits at most `max_wait` [s] for those that a run left behind.
    """
    if sys.platform == "linux":  # includes those whose parents did not wait for them
        ctypes.CDLL(None).prctl(PR_SET_CHILD_SUBREAPER, 1)
    deadline = time.monotonic() + max_wait
    with suppress(ChildProcessError):
        while time.monotonic() < deadline:
            if os.waitpid(-1, os.WNOHANG) == (0, 0):
                time.sleep(0.01)
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def waits_of(messages: Sequence[RecordedMessage]) -> dict[str, float]:
    """Times [s] without a finger at work, by what was awaited."""
    waits: dict[str, float] = {}
    n_busy, awaited, since = 0, "start", 0
    for message in sorted(messages, key=lambda message: message.sent_ns):
        topic = "/" + "/".join(message.topic.split("/")[-2:])
        if topic not in EVENTS:
            continue
        if not n_busy and since:
            waits[awaited] = waits.get(awaited, 0.0) + 1e-9 * (message.sent_ns - since)
        change, awaited = EVENTS[topic]
        n_busy, since = n_busy + change, message.sent_ns
    return waits


def touch_rows(quick: bool) -> Iterator[Row]:
    """What a touch costs in the handlers of all nodes from finger to model, by its taxels."""
    settings = QUICK_TOUCHES if quick else TouchSettings()
    calls = {side: partial(handler_seconds, side, settings) for side in settings.sides}
    seconds = in_turns(calls, settings.n_repeats)
    totals = {side: [1e3 * sum(run.values()) for run in runs] for side, runs in seconds.items()}
    best = {side: min(times) for side, times in totals.items()}
    for side, runs in seconds.items():
        by_node = min(runs, key=lambda run: sum(run.values()))
        for name, duration in by_node.items():
            yield figure(f"{name}, {side} x {side} taxels", 1e3 * duration, ".3f", " ms")
        title = f"a touch in all handlers, {side} x {side} taxels"
        yield figure(title, best[side], ".2f", " ms", repeats=totals[side])
    yield at_most("a touch, 16 x 16 taxels", best[16], settings.max_time, ".2f", " ms")
    if 32 in best:
        ratio = best[32] / best[16]
        yield at_most("32 x 32 over 16 x 16 taxels", ratio, settings.max_ratio, kind="time")


def handler_seconds(side: int, settings: TouchSettings = TouchSettings()) -> dict[str, float]:
    """Processor time [s] of a touch by node, from tracing a contour of a ball."""
    spent: dict[str, float] = {}
    radius = settings.ball_radius
    ball = ObjectSpec(
        superquadric=SuperquadricSpec(size=(radius,) * 3, exponents=(1.0, 1.0)),
        pose=PoseSpec(position=(0.0, 0.0, radius)),
    )
    sensor = SensorSpec(rows=side, cols=side, pitch=settings.array_width / side)
    nodes = touching_nodes(simulator.Params(object=ball, sensor=sensor))
    nodes.append(LoopNode(1, tracer.NODE, tracer.Params()))
    nodes.append(LoopNode(1, reconstructor.NODE, reconstructor.Params()))
    loop = InProcessLoop([_timed(node, spent) for node in nodes])
    spent.clear()
    goal = contour_goal(radius, radius + settings.approach)
    contour = loop.publish("/contour/goal", goal)["/contour/traced"]
    return {name: seconds / contour.touches for name, seconds in spent.items()}


def _timed(node: LoopNode, spent: dict[str, float]) -> LoopNode:
    """The node with handlers that add their time to the sum of its step."""
    step = node.node.step

    def timed(handler: Callable[..., Any]) -> Callable[..., Any]:
        def handle(*arguments: Any) -> Any:
            start = time.thread_time()
            result = handler(*arguments)
            spent[step] = spent.get(step, 0.0) + time.thread_time() - start
            return result

        return handle

    inputs = {topic: (kind, timed(handler)) for topic, (kind, handler) in node.node.inputs.items()}
    return node._replace(node=replace(node.node, inputs=inputs))


def growth_rows(quick: bool) -> Iterator[Row]:
    """Processor time of a whole run over its touches, and over its fingers."""
    settings = QUICK_RUNS if quick else RunGrowthSettings()
    spent: dict[int, float] = {}
    for wanted in settings.touches:
        heights = f"planner.settings={{count: {round(wanted / settings.touches_per_slice)}}}"
        run = run_timed("vase", "--set", "planner.planner=uniform", "--set", heights)
        touches = int(run.summary["touches"])
        spent[touches] = run.cpu
        yield figure(f"{touches} touches: processor time", run.cpu, ".1f", " s")
        yield figure(f"{touches} touches: touches a second", run.rate, ".0f", " /s")
    fitted = {count: cpu for count, cpu in spent.items() if count <= settings.max_fitted}
    power = float(np.polyfit(np.log(list(fitted)), np.log(list(fitted.values())), 1)[0])
    yield at_most("power of the touches", power, settings.max_power, kind="time")
    for fingers in settings.fingers:
        run = run_timed("vase", "--fingers", str(fingers))
        yield figure(f"{fingers} fingers: processor time", run.cpu, ".2f", " s")
        yield figure(f"{fingers} fingers: from start to exit", run.wall, ".2f", " s")
