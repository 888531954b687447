"""One whole exploration in this process: its scene is written, and what it publishes is kept."""

from __future__ import annotations

import json
import tempfile
import time
from collections import defaultdict
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from palpate.bench.explored import EXPLORED_HEIGHT, ExploreObject, mesh_of_radius
from palpate.core.arrays import Floats
from palpate.core.poses import Pose
from palpate.core.shapes import Mesh
from palpate.launch.files.mesh_file import write_mesh
from palpate.launch.files.source_map import SourceMapped
from palpate.launch.launch_source import EXPLORE
from palpate.launch.run import plan_run
from palpate.messages.types import (
    Contour,
    PlanDone,
    PlanEstimate,
    Score,
    ShapeModel,
    TactileFrame,
    Truth,
)
from palpate.nodes.runtime.composed import Watcher, run_composed

KEPT_TYPES = (Contour, PlanDone, PlanEstimate, Score, ShapeModel, TactileFrame, Truth)
Noise = tuple[Mapping[str, Any], ...]  # Effects, as scenes list them
EXACT: Noise = ()
# The default noise: a place that is off by 0.1 mm along each axis, taxels by 10 um.
NOISY: Noise = ({"pose_error": {"sigma": 1e-4}}, {"gaussian_noise": {"sigma": 1e-5}})
NOISES = {"exact": EXACT, "noise": NOISY}
FEATURE = 3.0e-3  # What may stay untouched, m
MESH = "object.ply"


class Explored(NamedTuple):
    """What an exploration came to; what there are several of stands in the order it was made."""

    truth: Truth  # The object
    contours: tuple[Contour, ...]
    models: tuple[ShapeModel, ...]
    scores: tuple[Score, ...]  # Of the models
    estimates: tuple[PlanEstimate, ...]  # What the planner published of them
    done: PlanDone  # What the planner published in the end
    touches: int  # Of all fingers, searching and probing included
    wall: float  # Time on this computer, s

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
        bound = self.done.rms_bound_95
        return None if bound is None else 100.0 * bound / self.score.size

    @property
    def held(self) -> bool | None:
        """Whether the error is below what the run states; None if it states nothing."""
        return None if self.bound is None else self.percent <= self.bound


class MessageCollector(Watcher):
    """Keeps what is published, by type; of tactile frames only how many there were."""

    def __init__(self) -> None:
        self.kept: dict[type, list[Any]] = defaultdict(list)
        self.touches = 0  # Of all fingers

    def received(self, topic: str, message: object) -> None:
        """Keep a message; of a frame, that there was one."""
        if isinstance(message, TactileFrame):
            self.touches += 1
        else:
            self.kept[type(message)].append(message)


def explore_object(
    target: ExploreObject,
    noise: Noise,
    demand: Demand,
    *,
    seed: int = 0,
    fingers: int = 1,
    moved: Floats | None = None,
) -> Explored:
    """Explore an object, all nodes in this process, nothing recorded.

    Arguments as of `write_scene`; `fingers` is the launch file's. Raises RuntimeError if the
    exploration does not come to its end with a model that could be measured.
    """
    with tempfile.TemporaryDirectory(prefix="palpate-bench-") as folder:
        return explore_scene(write_scene(Path(folder), target, noise, demand, seed, moved), fingers)


def explore_scene(
    scene: Path, fingers: int = 1, settings: Mapping[str, Any] = {}, out: Path | None = None
) -> Explored:
    """Explore the scene in a file; as `explore_object`. `out`: beside the file if left out."""
    began, collector = time.perf_counter(), MessageCollector()
    compose_scene(scene, KEPT_TYPES, collector, fingers, settings, out)
    kept = collector.kept
    if not kept[Score]:
        raise RuntimeError("the exploration finished without a score")
    return Explored(
        kept[Truth][0],
        tuple(kept[Contour]),
        tuple(kept[ShapeModel]),
        tuple(kept[Score]),
        tuple(kept[PlanEstimate]),
        kept[PlanDone][-1],
        collector.touches,
        time.perf_counter() - began,
    )


def compose_scene(
    scene: Path,
    types: Iterable[type],
    watcher: Watcher,
    fingers: int = 1,
    settings: Mapping[str, Any] = {},
    out: Path | None = None,
    *,
    scored: bool = True,
) -> None:
    """Run the graph that explores a scene, in this process; the watcher receives these types.

    Raises RuntimeError if it does not come to its end. Where nothing is to be scored, nobody says
    that it has: it is over when all is quiet.
    """
    values = {"scene": str(scene), "fingers": fingers, "record": False}
    args = {name: SourceMapped(value, name) for name, value in values.items()}
    given = {name: SourceMapped(value, name) for name, value in settings.items()}
    plan = plan_run(EXPLORE, args, given, name=scene.stem, out=out or scene.parent / "run")
    known = {topic: name for wiring in plan.wirings for topic, name in wiring.types.items()}
    names = {cls.__name__ for cls in types}
    watch = tuple(topic for topic, name in known.items() if name in names)
    wirings = [one for one in plan.wirings if scored or one.name != plan.ends]
    ending = run_composed(wirings, ends=plan.ends, watch=watch, watcher=watcher)
    if ending.status != ("finished" if scored else "stalled"):
        raise RuntimeError(f"the exploration {ending.status}: {ending.reason}")


def percent_of(score: Score) -> float:
    """Root mean square error, % of the object's height."""
    return 100.0 * score.rms / score.size


class Demand(NamedTuple):
    """What is asked of an exploration, by its keys in a scene."""

    planner: str = "predicted"  # Name of the rule
    tolerance: float = 0.002 * EXPLORED_HEIGHT  # Root mean square error, m
    settings: Mapping[str, Any] = {}  # The rule's numbers
    axis: tuple[float, float, float] | None = None  # Along which it is sliced; None: the object's
    feature: float | None = FEATURE  # What may stay untouched, m; None if the tolerance says
    underside: str = "flat"  # What it stands on: flat, or to be known
    turns: int = 1  # Times that it may be turned over


def write_scene(
    folder: Path,
    target: ExploreObject,
    noise: Noise,
    demand: Demand,
    seed: int = 0,
    moved: Floats | None = None,
) -> Path:
    """A scene with one object, and its mesh if it is given as one or by its radius.

    `seed`: of all that is random. `moved` (7,): pose of the object's own frame in the world, m.
    Returns the scene's file in the folder.
    """
    if callable(target) or isinstance(target, Mesh):
        write_mesh(folder / MESH, *(mesh_of_radius(target) if callable(target) else target))
        solid: dict[str, Any] = {"mesh": {"file": MESH, "unit": "m"}}
    else:
        solid = dict(target)
    if moved is not None:
        place = solid.get("pose", {}).get("position", [0.0, 0.0, 0.0])
        found = (Pose.from_array(moved) @ Pose(np.array(place), np.eye(3))).array
        solid["pose"] = {"position": found[:3].tolist(), "rotation": found[3:].tolist()}
    scene = {"object": solid, "effects": list(noise), "explore": demand._asdict(), "seed": seed}
    path = folder / "scene.yaml"
    path.write_text(json.dumps(scene), encoding="utf-8")  # JSON is YAML too
    return path
