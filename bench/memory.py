"""The memory of every node of a whole graph over ten thousand touches.

A feeder (`NODE`) stands in the tracer's place: it touches as fast as it is answered, over and over
from the same sides, and no contour is ever finished, so that nothing is rebuilt meanwhile.
"""

from __future__ import annotations

import multiprocessing
import tempfile
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import replace
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
from palpate.messages.types import SurfacePatch
from palpate.nodes import tracer
from palpate.nodes.runtime.composed import Watcher
from palpate.nodes.runtime.node import Finished, Node, Outputs

TOUCHES, QUICK_TOUCHES = 10_000, 2_000
SIDES, EACH = 60, 20  # Different touches, and touches of a goal
SCENE, MIDDLE = "vase", 0.05  # What is touched, and how high its middle is, m
WARM = 0.2  # Share of the touches before memory is looked at: caches fill
MOST_GROWTH = 1.0  # MB per 1,000 touches
TAXEL_BYTES = 3 * 8 + 3 * 8 + 4  # Of a touched taxel: place, normal, and number of its touch
MB = float(1 << 20)
FEEDER = "tracer"  # In whose place it stands
SIDE_GOALS = list(touch_goals(SIDES))


class FeederParams(Struct, frozen=True, kw_only=True):
    """What the feeder does."""

    touches: int  # So many, then it has finished


def _next(params: FeederParams, number: int, _: object) -> tuple[int, Outputs]:
    if number == params.touches:
        return number, [Finished(f"{number} touches")]
    side = SIDE_GOALS[number % SIDES]
    pose = side.pose + MIDDLE * np.eye(7)[2]
    goal = replace(side, pose=pose, goal=number // EACH, touch=number % EACH)
    return number + 1, [("/finger/goal", goal)]


NODE = Node(
    params=FeederParams,
    start=lambda params: (0, []),
    inputs={
        name: (type_, _next if name in ("/world", "/touch/patch") else lambda p, s, _: (s, []))
        for name, (type_, _) in tracer.NODE.inputs.items()
    },
    outputs=tracer.NODE.outputs,
    needs=tracer.NODE.needs,
)


def memory_rows(quick: bool) -> Iterator[Row]:
    """How much each node of a recorded graph grows; fewer touches if quick."""
    touches = QUICK_TOUCHES if quick else TOUCHES
    watched = watch_memory(touches)
    growths = {name: growth_per_1000(np.array(one)) for name, one in watched.samples.items()}
    for name, growth in sorted(growths.items()):
        yield figure(f"memory of {name}, MB per 1,000 touches", growth, ".3f", " MB")
    needed = 1000.0 * TAXEL_BYTES * watched.taxels / touches / MB
    yield figure("of that, what was touched, for the models", needed, ".3f", " MB")
    total = sum(growths.values()) - needed
    yield at_most("all nodes, beyond what was touched", total, MOST_GROWTH, ".3f", " MB")


def growth_per_1000(samples: Floats) -> float:
    """Slope of memory over touches (n, 2), least squares once caches are warm; per 1,000."""
    late = samples[samples[:, 0] >= WARM * samples[-1, 0]]
    return 1000.0 * float(np.polyfit(late[:, 0], late[:, 1], 1)[0])


def watch_memory(touches: int) -> MemoryWatcher:
    """A graph that records, fed so many touches, and what its nodes took."""
    with tempfile.TemporaryDirectory(prefix="palpate-bench-") as folder:
        args = {"scene": SourceMapped(str(find_scene(SCENE)), "scene")}
        plan = plan_run(EXPLORE, args, {}, name="memory", out=Path(folder) / "run")
        feeder = FeederParams(touches=touches)
        wirings = [
            replace(one, module=__name__, params=feeder) if one.name == FEEDER else one
            for one in plan.wirings
        ]
        run_dir, watcher = plan.folder.path, MemoryWatcher()
        run_dir.mkdir()
        watch = ["/touch/patch"]
        ending = launch(wirings, ends=FEEDER, watch=watch, watcher=watcher, run_dir=run_dir)
        finished(ending, "the graph")
    return watcher


class MemoryWatcher(Watcher):
    """Keeps what memory nodes take, and counts what was touched."""

    def __init__(self) -> None:
        # Touches, and a node's own memory, MB, at many moments, by the node's name
        self.samples: dict[str, list[tuple[int, float]]] = defaultdict(list)
        self.touches = self.taxels = 0

    def received(self, topic: str, message: object) -> None:
        """Count a touch and its taxels."""
        assert isinstance(message, SurfacePatch)
        self.touches += 1
        self.taxels += int(np.count_nonzero(message.mask))

    def tick(self, statuses: object) -> None:
        """Look at each node, but for the feeder."""
        for child in multiprocessing.active_children() if self.touches else ():
            if child.name != FEEDER and (memory := own_memory(child.pid or 0)):
                self.samples[child.name].append((self.touches, memory))


def own_memory(pid: int) -> float:
    """Memory of a process that no file stands behind, MB; 0 if it has ended."""
    path = Path(f"/proc/{pid}/status")
    lines = path.read_text("ascii").splitlines() if path.exists() else []
    return sum(int(line.split()[1]) for line in lines if line.startswith("RssAnon:")) * 1024 / MB
