"""The memory of every node of a whole graph over ten thousand touches.

A feeder (`NODE`) takes the tracer's place: it touches as fast as it is answered, repeatedly from
the same sides, and never finishes a contour, so that nothing is rebuilt.
"""

from __future__ import annotations

import multiprocessing
import tempfile
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
from msgspec import Struct

from palpate.bench.bus import finished
from palpate.bench.effects import touch_goals
from palpate.bench.table import Row, at_most, figure
from palpate.core.arrays import Floats
from palpate.launch.files.source_map import SourceMapped
from palpate.launch.launch_source import EXPLORE
from palpate.launch.launcher import launch
from palpate.launch.run import plan_run
from palpate.launch.scene import find_scene
from palpate.messages.types import SurfacePatch, TouchGoal
from palpate.nodes import tracer
from palpate.nodes.runtime.composed import Watcher
from palpate.nodes.runtime.node import Finished, Node, Outputs

SCENE = "vase"
TAXEL_BYTES = 3 * 8 + 3 * 8 + 4  # Of a touched taxel: position, normal, and number of its touch
MB = float(1 << 20)
FEEDER = "tracer"  # The node whose place the feeder takes


@dataclass(frozen=True, slots=True, kw_only=True)
class MemorySettings:
    """How long memory is watched, and how much it may grow."""

    n_touches: int = 10_000  # of the run
    warm_share: float = 0.2  # fraction of the touches, the first, that are ignored: caches fill
    max_growth: float = 1.0  # [MB] per 1,000 touches, beyond the touched taxels


QUICK_MEMORY = MemorySettings(n_touches=2_000)


class FeederParams(Struct, frozen=True, kw_only=True):
    """What the feeder does."""

    touches: int  # Number of touches after which it finishes
    n_sides: int = 60  # Different touches, which are repeated
    touches_per_goal: int = 20
    height: float = 0.05  # [m] added to the touches, to the middle of the object


@cache
def _side_goals(n_sides: int) -> list[TouchGoal]:
    return list(touch_goals(n_sides))


def _next_touch(params: FeederParams, number: int, _: object) -> tuple[int, Outputs]:
    if number == params.touches:
        return number, [Finished(f"{number} touches")]
    side = _side_goals(params.n_sides)[number % params.n_sides]
    pose = side.pose + params.height * np.eye(7)[2]
    goal, touch = divmod(number, params.touches_per_goal)
    return number + 1, [("/finger/goal", replace(side, pose=pose, goal=goal, touch=touch))]


NODE = Node(
    params=FeederParams,
    start=lambda params: (0, []),
    inputs={
        name: (
            type_,
            _next_touch if name in ("/world", "/touch/patch") else lambda p, s, _: (s, []),
        )
        for name, (type_, _) in tracer.NODE.inputs.items()
    },
    outputs=tracer.NODE.outputs,
    needs=tracer.NODE.needs,
)


def memory_rows(quick: bool) -> Iterator[Row]:
    """Growth of the memory of each node of a recorded graph; fewer touches if quick."""
    settings = QUICK_MEMORY if quick else MemorySettings()
    watcher = watch_memory(settings.n_touches)
    growths = {
        name: growth_per_1000(np.array(samples), settings.warm_share)
        for name, samples in watcher.samples.items()
    }
    for name, growth in sorted(growths.items()):
        yield figure(f"memory of {name}, MB per 1,000 touches", growth, ".3f", " MB")
    needed = 1000.0 * TAXEL_BYTES * watcher.taxels / settings.n_touches / MB
    yield figure("of that, what was touched, for the models", needed, ".3f", " MB")
    total, most = sum(growths.values()) - needed, settings.max_growth
    yield at_most("all nodes, beyond what was touched", total, most, ".3f", " MB")


def growth_per_1000(samples: Floats, warm_share: float) -> float:
    """Slope of memory over touches (n, 2) by least squares, per 1,000 touches.

    Samples before `warm_share` of the touches are left out.
    """
    late = samples[samples[:, 0] >= warm_share * samples[-1, 0]]
    return 1000.0 * float(np.polyfit(late[:, 0], late[:, 1], 1)[0])


def watch_memory(touches: int) -> MemoryWatcher:
    """Run a recorded graph with a feeder, and watch the memory of its nodes."""
    with tempfile.TemporaryDirectory(prefix="palpate-bench-") as folder:
        args = {"scene": SourceMapped(str(find_scene(SCENE)), "scene")}
        plan = plan_run(EXPLORE, args, {}, name="memory", out=Path(folder) / "run")
        feeder = FeederParams(touches=touches)
        wirings = [
            replace(wiring, module=__name__, params=feeder) if wiring.name == FEEDER else wiring
            for wiring in plan.wirings
        ]
        run_dir, watcher = plan.folder.path, MemoryWatcher()
        run_dir.mkdir()
        watch = ["/touch/patch"]
        ending = launch(wirings, ends=FEEDER, watch=watch, watcher=watcher, run_dir=run_dir)
        finished(ending, "the graph")
    return watcher


class MemoryWatcher(Watcher):
    """Keeps the memory of each node, and counts touches and touched taxels."""

    def __init__(self) -> None:
        # By node: the number of touches so far and the node's own memory [MB]
        self.samples: dict[str, list[tuple[int, float]]] = defaultdict(list)
        self.touches = self.taxels = 0

    def received(self, topic: str, message: object) -> None:
        """Count a touch and its taxels."""
        assert isinstance(message, SurfacePatch)
        self.touches += 1
        self.taxels += int(np.count_nonzero(message.mask))

    def tick(self, statuses: object) -> None:
        """Sample the memory of each node except the feeder."""
        for child in multiprocessing.active_children() if self.touches else ():
            if child.name != FEEDER and (memory := own_memory(child.pid or 0)):
                self.samples[child.name].append((self.touches, memory))


def own_memory(pid: int) -> float:
    """Anonymous memory of a process [MB]; 0 if it has ended."""
    path = Path(f"/proc/{pid}/status")
    lines = path.read_text("ascii").splitlines() if path.exists() else []
    return sum(int(line.split()[1]) for line in lines if line.startswith("RssAnon:")) * 1024 / MB
