"""How good and how fast whole runs are, and what takes the time: nodes, steps, waits.

Scenes run as a user runs them, in processes of their own; with an older checkout beside this one
both take turns, so that whatever else the machine does, both meet the same. Processor times are of
all processes of a run together.
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
from dataclasses import replace
from functools import cache, partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from palpate.bench.loop import InProcessLoop, LoopNode, contour_goal, touching_nodes
from palpate.bench.table import MOST_SECONDS, Figure, Row, at_most, figure, figure_of, in_turns
from palpate.launch.files.source_map import InputError
from palpate.messages.recording import RecordedMessage, open_recording
from palpate.nodes import reconstructor, simulator, tracer
from palpate.nodes.specs.objects import ObjectSpec, PoseSpec, SuperquadricSpec
from palpate.nodes.specs.sensors import SensorSpec

SCENES = (
    *("vase", "sphere", "box", "cylinder", "egg", "twisted", "hyperquadric", "dented", "bottle"),
    *("oblique", "notched", "gem", "from_mesh", "worn_sensor"),
)
MOST_CHAMFER, MOST_CONTOURS = 0.2, 15  # Of the object's height, %
TIMES = ("wall", "cpu", "first", "last")  # Of a run, by their names in `Timed`
QUICK_SCENES = ("vase", "egg", "worn_sensor")
TURNS, QUICK_TURNS = 3, 1
TOUCHES, QUICK_TOUCHES = (100, 300, 1000, 3000, 10_000), (100, 300)
OF_A_SLICE = 18.0  # Touches that one takes, about
SQUARES, FINGERS = (8, 16, 32, 64), (1, 2, 3, 4, 5)  # Taxels along an edge, and fingers
MOST_TOUCH, MOST_WIDE = 1.5, 3.0  # ms of a touch, and times as much with 32 x 32 taxels
STEEPEST = 1.1  # Power of the touches with which the processor time of a run may go
BALL, APPROACH = 0.03, 0.02  # Radius, and how far off a finger begins, m
REPEATS = 7
MOST_FITTED = 4000  # Touches up to which the power is told
MOST_ENDING = 1.0  # For which processes that were left behind are waited, s
_SUBREAPER = 36  # Of prctl: processes whose parents have ended become ours

# By how many more fingers are at work from a message on, and what is waited for if none is.
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


class Timed(NamedTuple):
    """One run of a scene; times in s."""

    summary: Mapping[str, Any]  # Of the run
    wall: float  # From the command to its exit
    cpu: float  # Of all processes
    first: float  # From the command to the first touch
    last: float  # From the last touch to the exit
    rate: float  # Touches a second between the first and the last
    waits: Mapping[str, float]  # In which no finger was at work, by what was waited for
    nodes: Mapping[str, float]  # Processor time by node
    steps: Mapping[str, float]  # And by step


def scene_rows(quick: bool, *, against: Path | None = None) -> Iterator[SceneSpeed | Row | str]:
    """The shipped scenes, or a few; against an older checkout if one is given."""
    if against is not None and not (against / "palpate" / "__main__.py").is_file():
        raise InputError(f"{against}: --against must be a checkout of palpate, with its sources")
    told = ("chamfer", "floor", "touches", "per s", "wall s", "cpu s", "first s", "last s")
    heads = (*told, *(("cpu x", "wall x") if against is not None else ()))
    yield f"{'scene':<13}" + "".join(f"{one:>9}" for one in heads)
    ratios: list[float] = []
    for scene in QUICK_SCENES if quick else SCENES:
        calls = {"now": partial(run_timed, scene)}
        if against is not None:
            calls["older"] = partial(run_timed, scene, tree=against)
        if scene == SCENES[0]:
            in_turns(calls, 1)  # Its sources are compiled then, which does not count
        found = in_turns(calls, QUICK_TURNS if quick else TURNS)
        speed = SceneSpeed(scene, found["now"], found.get("older", []))
        yield speed
        ratios += [speed.ratio("cpu")] if against is not None else []
    if ratios:
        mean = float(np.exp(np.mean(np.log(ratios))))
        yield figure("processor time over the older one, geometric mean", mean, kind="time")


class SceneSpeed(NamedTuple):
    """One scene, run several times."""

    name: str  # Of the scene
    runs: Sequence[Timed]
    older: Sequence[Timed]  # Of the older checkout, in turns with these

    @property
    def holds(self) -> bool:
        """Whether it meets every demand."""
        return not self.missed

    @property
    def missed(self) -> list[str]:
        """Demands that it misses, in words."""
        every = [one.summary for one in self.runs]
        checks = {
            "chamfer": self._percent("chamfer_m") <= MOST_CHAMFER,
            "contours": all(one["contours"] <= MOST_CONTOURS for one in every),
            "lost": all(one["gaps"] == one["duplicates"] == 0 for one in every),
            "not watertight": all(one["watertight"] for one in every),
            "has handles": all(one["genus"] == 0 for one in every),
            "not repeatable": len({one["mesh_sha256"] for one in every}) == 1,
        }
        return [name for name, holds in checks.items() if not holds]

    def _percent(self, key: str) -> float:
        """Of the object's height, %."""
        summary = self.runs[0].summary
        return 100.0 * float(summary[key] / summary["size_m"])

    @property
    def figures(self) -> Sequence[Figure]:
        """Its times, and where they went; and how good the solid is."""
        units = {**dict.fromkeys(TIMES, "s"), "rate": "/s"}
        every = {name: [getattr(one, name) for one in self.runs] for name in units}
        found = [
            figure_of(statistics.median(values), units[name], repeats=values, name=name)
            for name, values in every.items()
        ]
        summary = self.runs[0].summary
        found.append(figure_of(1e3 * summary["chamfer_m"], "mm", name="chamfer"))
        found += [figure_of(int(summary[key]), name=key) for key in ("contours", "touches")]
        for kind in ("waits", "nodes", "steps"):
            found += [figure_of(value, "s", name=name) for name, value in self._parts(kind).items()]
        for name in ("cpu", "wall") if self.older else ():
            found.append(figure_of(self.ratio(name), "x", kind="time", name=f"{name} over older"))
        return found

    def ratio(self, name: str) -> float:
        """Of medians, to those of the older checkout."""
        return median_of(self.runs, name) / median_of(self.older, name)

    def _parts(self, kind: str) -> dict[str, float]:
        """Medians of all that is told by name, the largest first."""
        told = [getattr(one, kind) for one in self.runs]
        names = dict.fromkeys(name for one in told for name in one)
        parts = [(name, statistics.median(one.get(name, 0.0) for one in told)) for name in names]
        return dict(sorted(parts, key=lambda part: -part[1]))

    def __str__(self) -> str:
        cells = [f"{self._percent(key):.3f} %" for key in ("chamfer_m", "sampling_floor_m")]
        cells.append(str(self.runs[0].summary["touches"]))
        for name, form in (("rate", ".0f"), *((one, ".2f") for one in TIMES)):
            cells.append(f"{median_of(self.runs, name):{form}}")
        cells += [f"{self.ratio(name):.2f}" for name in ("cpu", "wall") if self.older]
        missed = "  MISSED " + ", ".join(self.missed) if self.missed else ""
        lines = [f"{self.name:<13}" + "".join(f"{cell:>9}" for cell in cells) + missed]
        for kind in ("nodes", "steps", "waits"):
            told = [f"{name} {value:.2f}" for name, value in self._parts(kind).items()]
            lines.append(f"  {kind:<6}" + ", ".join(told[:9]))
        return "\n".join(lines)


def median_of(runs: Sequence[Timed], name: str) -> float:
    """Of one figure of some runs."""
    return float(statistics.median(getattr(one, name) for one in runs))


def run_timed(scene: str, *more: str, tree: Path | None = None) -> Timed:
    """Run a scene, perhaps of another checkout; RuntimeError, with what it printed, if it fails."""
    with tempfile.TemporaryDirectory(prefix="palpate-bench-") as folder:
        out = Path(folder) / "run"
        command = [sys.executable, "-P", "-m", "palpate", "run", scene, "--out", str(out)]
        # Nobody's sources are compiled anew at each start, whatever is set here.
        environment = dict(os.environ) | {"PYTHONPYCACHEPREFIX": _bytecode().name}
        environment.pop("PYTHONDONTWRITEBYTECODE", None)
        if tree is not None:
            environment["PYTHONPATH"] = str(tree.resolve())
        spent, began = _children_cpu(), time.monotonic_ns()
        done = subprocess.run(
            [*command, "--quiet", *more],
            cwd=folder,
            env=environment,
            capture_output=True,
            text=True,
            timeout=12 * MOST_SECONDS,
        )
        ended = time.monotonic_ns()
        if done.returncode not in (0, 1):  # 1 is a demand that was missed
            raise RuntimeError(f"{scene} ended with {done.returncode}: {done.stderr.strip()}")
        cpu = _children_cpu() - spent
        summary = json.loads((out / "summary.json").read_text(encoding="utf-8"))
        messages = list(open_recording(out / "topics.mcap").messages())
    touched = [one.sent_ns for one in messages if one.topic.endswith("/touch/patch")]
    return Timed(
        summary=summary,
        wall=1e-9 * (ended - began),
        cpu=cpu,
        first=1e-9 * (touched[0] - began),
        last=1e-9 * (ended - touched[-1]),
        rate=len(touched) / max(1e-9 * (touched[-1] - touched[0]), 1e-9),
        waits=waits_of(messages),
        nodes={name: float(told["cpu_s"]) for name, told in summary["nodes"].items()},
        steps=summary["steps"],
    )


@cache
def _bytecode() -> tempfile.TemporaryDirectory[str]:
    """Where the sources are kept compiled, until this process ends."""
    return tempfile.TemporaryDirectory(prefix="palpate-bytecode-")


def _children_cpu() -> float:
    """Processor time of all processes that were started from here and have ended, s."""
    if sys.platform == "linux":  # also of those whose parents did not wait for them
        ctypes.CDLL(None).prctl(_SUBREAPER, 1)
    deadline = time.monotonic() + MOST_ENDING
    with suppress(ChildProcessError):
        while time.monotonic() < deadline:
            if os.waitpid(-1, os.WNOHANG) == (0, 0):
                time.sleep(0.01)
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def waits_of(messages: Sequence[RecordedMessage]) -> dict[str, float]:
    """Times in which no finger was at work, by what was waited for, s."""
    waits: dict[str, float] = {}
    busy, waited, since = 0, "start", 0
    for one in sorted(messages, key=lambda one: one.sent_ns):
        topic = "/" + "/".join(one.topic.split("/")[-2:])
        if topic not in EVENTS:
            continue
        if not busy and since:
            waits[waited] = waits.get(waited, 0.0) + 1e-9 * (one.sent_ns - since)
        change, waited = EVENTS[topic]
        busy, since = busy + change, one.sent_ns
    return waits


def touch_rows(quick: bool) -> Iterator[Row]:
    """What a touch costs in the handlers of all nodes that have to do with it, by its taxels."""
    squares = SQUARES[:2] if quick else SQUARES
    calls = {side: partial(handler_seconds, side) for side in squares}
    found = in_turns(calls, 2 if quick else REPEATS)
    each = {side: [1e3 * sum(one.values()) for one in found[side]] for side in squares}
    least = {side: min(every) for side, every in each.items()}
    for side in squares:
        best = min(found[side], key=lambda one: sum(one.values()))
        for name, seconds in best.items():
            yield figure(f"{name}, {side} x {side} taxels", 1e3 * seconds, ".3f", " ms")
        told = f"a touch in all handlers, {side} x {side} taxels"
        yield figure(told, least[side], ".2f", " ms", repeats=each[side])
    yield at_most("a touch, 16 x 16 taxels", least[16], MOST_TOUCH, ".2f", " ms")
    if 32 in least:
        ratio = least[32] / least[16]
        yield at_most("32 x 32 over 16 x 16 taxels", ratio, MOST_WIDE, kind="time")


def handler_seconds(side: int) -> dict[str, float]:
    """Processor time of a touch by node, s: of the contour of a ball, touched by a square array."""
    spent: dict[str, float] = {}
    ball = ObjectSpec(
        superquadric=SuperquadricSpec(size=(BALL,) * 3, exponents=(1.0, 1.0)),
        pose=PoseSpec(position=(0.0, 0.0, BALL)),
    )
    sensor = SensorSpec(rows=side, cols=side, pitch=16e-3 / side)
    touching = touching_nodes(simulator.Params(object=ball, sensor=sensor))
    others = [
        LoopNode(1, tracer.NODE, tracer.Params()),
        LoopNode(1, reconstructor.NODE, reconstructor.Params()),
    ]
    loop = InProcessLoop([_timed(one, spent) for one in (*touching, *others)])
    spent.clear()
    goal = contour_goal(BALL, BALL + APPROACH)
    contour = loop.publish("/contour/goal", goal)["/contour/traced"]
    return {name: seconds / contour.touches for name, seconds in spent.items()}


def _timed(one: LoopNode, spent: dict[str, float]) -> LoopNode:
    """The node, whose handlers add what they spend to the sum of its step."""

    def timed(handler: Callable[..., Any]) -> Callable[..., Any]:
        def handle(*given: Any) -> Any:
            began = time.thread_time()
            found = handler(*given)
            spent[one.node.step] = spent.get(one.node.step, 0.0) + time.thread_time() - began
            return found

        return handle

    inputs = {topic: (kind, timed(handler)) for topic, (kind, handler) in one.node.inputs.items()}
    return one._replace(node=replace(one.node, inputs=inputs))


def growth_rows(quick: bool) -> Iterator[Row]:
    """Processor time of a whole run over its touches, and over its fingers."""
    touches = QUICK_TOUCHES if quick else TOUCHES
    spent: dict[int, float] = {}
    for most in touches:
        heights = f"planner.settings={{count: {round(most / OF_A_SLICE)}}}"
        run = run_timed("vase", "--set", "planner.planner=uniform", "--set", heights)
        made = int(run.summary["touches"])
        spent[made] = run.cpu
        yield figure(f"{made} touches: processor time", run.cpu, ".1f", " s")
        yield figure(f"{made} touches: touches a second", run.rate, ".0f", " /s")
    few = {count: cpu for count, cpu in spent.items() if count <= MOST_FITTED}
    power = float(np.polyfit(np.log(list(few)), np.log(list(few.values())), 1)[0])
    yield at_most("power of the touches", power, STEEPEST, kind="time")
    for fingers in FINGERS[:2] if quick else FINGERS:
        run = run_timed("vase", "--fingers", str(fingers))
        yield figure(f"{fingers} fingers: processor time", run.cpu, ".2f", " s")
        yield figure(f"{fingers} fingers: from start to exit", run.wall, ".2f", " s")
