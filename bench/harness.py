"""One whole exploration in this process: writes its scene and keeps what it publishes."""

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
# The default noise: standard deviations [m] of a pose along each axis, and of a taxel.
NOISY: Noise = ({"pose_error": {"sigma": 1e-4}}, {"gaussian_noise": {"sigma": 1e-5}})
NOISES = {"exact": EXACT, "noise": NOISY}
MESH = "object.ply"


class Explored(NamedTuple):
    """Result of an exploration; tuples are in the order of publication."""

    truth: Truth  # The object
    contours: tuple[Contour, ...]
    models: tuple[ShapeModel, ...]
    scores: tuple[Score, ...]  # Of the models
    estimates: tuple[PlanEstimate, ...]  # The planner's, of the models
    done: PlanDone  # The planner's last message
    touches: int  # Number of touches of all fingers, searching and probing included
    wall: float  # Elapsed time [s]

    @property
    def score(self) -> Score:
        """The score of the last model."""
        return self.scores[-1]

    @property
    def percent(self) -> float:
        """Root mean square error of the last model, % of the object's height."""
        return percent_of(self.score)

    @property
    def bound(self) -> float | None:
        """Bound of that error that the run states, % of the object's height."""
        bound = self.done.rms_bound_95
        return None if bound is None else 100.0 * bound / self.score.size

    @property
    def held(self) -> bool | None:
        """Whether the error is at most the stated bound; None if no bound is stated."""
        return None if self.bound is None else self.percent <= self.bound


class MessageCollector(Watcher):
    """Keeps published messages by type; tactile frames are only counted."""

    def __init__(self) -> None:
        self.kept: dict[type, list[Any]] = defaultdict(list)
        self.touches = 0  # Number of touches of all fingers

    def received(self, topic: str, message: object) -> None:
        """Keep a message, or count a frame."""
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
    """Explore an object with all nodes in this process and without a recording.

    Arguments as of `write_scene`; `fingers` is that of the launch file. Raises RuntimeError if the
    exploration does not finish with a model that is scored.
    """
    with tempfile.TemporaryDirectory(prefix="palpate-bench-") as folder:
        return explore_scene(write_scene(Path(folder), target, noise, demand, seed, moved), fingers)


def explore_scene(
    scene: Path, fingers: int = 1, settings: Mapping[str, Any] = {}, out: Path | None = None
) -> Explored:
    """Explore the scene in a file, as `explore_object`. `out`: by default beside the file."""
    start, collector = time.perf_counter(), MessageCollector()
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
        time.perf_counter() - start,
    )


def compose_scene(
    scene: Path,
    types: Iterable[type],
    watcher: Watcher,
    fingers: int = 1,
    settings: Mapping[str, Any] = {},
    out: Path | None = None,
    *,
    is_scored: bool = True,
) -> None:
    """Run the graph that explores a scene, in this process; the watcher receives these types.

    Raises RuntimeError if it does not finish. Without scores no node reports the end: the graph
    has then finished when no message is left.
    """
    values = {"scene": str(scene), "fingers": fingers, "record": False}
    args = {name: SourceMapped(value, name) for name, value in values.items()}
    overrides = {name: SourceMapped(value, name) for name, value in settings.items()}
    plan = plan_run(EXPLORE, args, overrides, name=scene.stem, out=out or scene.parent / "run")
    types_by_topic = {
        topic: name for wiring in plan.wirings for topic, name in wiring.types.items()
    }
    names = {cls.__name__ for cls in types}
    watch = tuple(topic for topic, name in types_by_topic.items() if name in names)
    wirings = [wiring for wiring in plan.wirings if is_scored or wiring.name != plan.ends]
    ending = run_composed(wirings, ends=plan.ends, watch=watch, watcher=watcher)
    if ending.status != ("finished" if is_scored else "stalled"):
        raise RuntimeError(f"the exploration {ending.status}: {ending.reason}")


def percent_of(score: Score) -> float:
    """Root mean square error, % of the object's height."""
    return 100.0 * score.rms / score.size


class Demand(NamedTuple):
    """What is asked of an exploration, by its keys in a scene."""

    planner: str = "predicted"  # Name of the planner
    tolerance: float = 0.002 * EXPLORED_HEIGHT  # [m] root mean square error
    settings: Mapping[str, Any] = {}  # Of the planner
    axis: tuple[float, float, float] | None = None  # Normal of the slices; None: the object's axis
    feature: float | None = 3.0e-3  # [m] largest untouched feature; None: from the tolerance
    underside: str = "flat"  # "flat" if it is taken for flat, "known" if it is to be touched
    turns: int = 1  # How often it may be turned over


def write_scene(
    folder: Path,
    target: ExploreObject,
    noise: Noise,
    demand: Demand,
    seed: int = 0,
    moved: Floats | None = None,
) -> Path:
    """Write a scene with one object, and a mesh file for an object that is a mesh or a radius.

    `seed`: of everything random. `moved` (7,): pose of the object's own frame in the world [m].
    Returns the scene's file in the folder.
    """
    if callable(target) or isinstance(target, Mesh):
        write_mesh(folder / MESH, *(mesh_of_radius(target) if callable(target) else target))
        solid: dict[str, Any] = {"mesh": {"file": MESH, "unit": "m"}}
    else:
        solid = dict(target)
    if moved is not None:
        position = solid.get("pose", {}).get("position", [0.0, 0.0, 0.0])
        pose = (Pose.from_array(moved) @ Pose(np.array(position), np.eye(3))).array
        solid["pose"] = {"position": pose[:3].tolist(), "rotation": pose[3:].tolist()}
    scene = {"object": solid, "effects": list(noise), "explore": demand._asdict(), "seed": seed}
    path = folder / "scene.yaml"
    path.write_text(json.dumps(scene), encoding="utf-8")  # JSON is YAML too
    return path
