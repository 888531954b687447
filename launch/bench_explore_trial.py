"""One whole exploration in this process, and everything that was heard of it."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from palpate.core.arrays import Floats
from palpate.launch.bench_explore_scene import Demand, write_scene
from palpate.launch.explore_objects import ExploreObject
from palpate.launch.launch_path import EXPLORE
from palpate.launch.located import Located
from palpate.launch.run import plan_run
from palpate.messages.types import (
    Contour,
    ContourGoal,
    GraspContacts,
    LogRecord,
    NodeStatus,
    PlanDone,
    Score,
    ShapeModel,
    TactileFrame,
    Truth,
)
from palpate.nodes.composed import run_composed
from palpate.nodes.ending import Ending

HEARD = (Contour, ContourGoal, GraspContacts, PlanDone, Score, ShapeModel, TactileFrame, Truth)
TRAVEL, APPROACH = 1, 3
"""Places in a touch's `move`."""


class Explored(NamedTuple):
    """What an exploration came to."""

    ending: Ending
    """How the graph ended."""
    truth: Truth
    """The object."""
    contours: tuple[Contour, ...]
    """In the order in which they were traced."""
    reasons: tuple[str, ...]
    """Why each slice was asked for, in the order in which they were."""
    models: tuple[ShapeModel, ...]
    """In the order in which they were rebuilt."""
    scores: tuple[Score, ...]
    """Of the models."""
    done: PlanDone
    """What the planner said in the end."""
    touches: int
    """Of all fingers, searching and probing included."""
    travel: float
    """Way of the fingers: between the touches, to the surface and back, m."""
    wall: float
    """Time on this computer, s."""

    @property
    def score(self) -> Score:
        """Of the last model."""
        return self.scores[-1]

    @property
    def percent(self) -> float:
        """Root mean square error of the last model, % of the object's height."""
        return percent_of(self.score)

    @property
    def bound(self) -> float | None:
        """What the run states of that error, % of the object's height."""
        return None if self.done.bound is None else 100.0 * self.done.bound / self.score.size

    @property
    def held(self) -> bool | None:
        """Whether the error is below what the run states; None if it states nothing."""
        return None if self.bound is None else self.percent <= self.bound


class Ears:
    """A watcher that keeps what it hears, by type."""

    def __init__(self) -> None:
        self.heard_of: dict[type, list[Any]] = {kind: [] for kind in HEARD}
        """The messages of each type, in their order."""
        self.touches = 0
        """Touches of all fingers."""
        self.travel = 0.0
        """Way of the fingers and of the hand, m."""

    def ready(self, seconds: float) -> None:
        """All nodes are up."""

    def heard(self, topic: str, message: object) -> None:
        """Keep a message; of a touch, only its way."""
        if isinstance(message, (TactileFrame, GraspContacts)):
            self.touches += isinstance(message, TactileFrame)
            self.travel += way_of(message.move)
        else:
            self.heard_of[type(message)].append(message)

    def log(self, record: LogRecord) -> None:
        """A node has something to say: not of interest."""

    def tick(self, statuses: Mapping[str, NodeStatus]) -> None:
        """Time has gone by."""


def explore_object(
    target: ExploreObject,
    noise: tuple[Mapping[str, Any], ...],
    demand: Demand,
    *,
    seed: int = 0,
    fingers: int = 1,
    moved: Floats | None = None,
) -> Explored:
    """Explore an object, all nodes in this process, nothing recorded.

    Arguments as of `write_scene`; `fingers` is the launch file's.

    Raises
    ------
    RuntimeError
        If the exploration does not come to its end with a model that could be measured.
    """
    with tempfile.TemporaryDirectory(prefix="palpate-bench-") as folder:
        scene = write_scene(Path(folder), target, noise, demand, seed, moved)
        return explore_scene(scene, fingers)


def explore_scene(scene: Path, fingers: int = 1) -> Explored:
    """Explore the scene in a file; as `explore_object`."""
    args = {"scene": str(scene), "fingers": fingers, "record": False}
    plan = plan_run(
        EXPLORE,
        {name: Located(value, name) for name, value in args.items()},
        {},
        name=scene.stem,
        out=scene.parent / "run",
    )
    ears = Ears()
    said = {topic: name for wiring in plan.wirings for topic, name in wiring.types.items()}
    names = {cls.__name__ for cls in HEARD}
    hear = tuple(topic for topic, name in said.items() if name in names)
    began = time.perf_counter()
    ending = run_composed(plan.wirings, ends=plan.ends, hear=hear, watcher=ears)
    return _explored(ending, ears, time.perf_counter() - began)


def _explored(ending: Ending, ears: Ears, wall: float) -> Explored:
    heard = ears.heard_of
    if ending.status != "finished" or not heard[Score]:
        raise RuntimeError(f"the exploration {ending.status}: {ending.reason}")
    return Explored(
        ending,
        heard[Truth][0],
        tuple(heard[Contour]),
        tuple(goal.reason for goal in heard[ContourGoal]),
        tuple(heard[ShapeModel]),
        tuple(heard[Score]),
        heard[PlanDone][-1],
        ears.touches,
        ears.travel,
        wall,
    )


def way_of(move: Floats) -> float:
    """Way of a finger for one touch, m: to its start, to the surface and back."""
    return float(move[TRAVEL] + 2.0 * move[APPROACH])


def percent_of(score: Score) -> float:
    """Root mean square error, % of the object's height."""
    return 100.0 * score.rms / score.size


def first_within(scores: Iterable[Score], percent: float) -> int | None:
    """Contours of the first model whose error is at most this, %; None if none is."""
    return next((one.contours for one in scores if percent_of(one) <= percent), None)
