"""One whole exploration in this process.

Its scene is written, what it publishes is kept, its side is rebuilt and judged.
"""

from __future__ import annotations

import json
import tempfile
import time
from collections import deque
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from palpate.bench.objects import EXPLORED_HEIGHT, ExploreObject
from palpate.bench.table import SilentWatcher
from palpate.core import (
    Floats,
    Ints,
    compose_poses,
    inverse_pose,
    pose_of,
    rotations_from_vectors,
    split_pose,
    transform_points,
)
from palpate.core.explore.planners import END_SHARE
from palpate.core.geometry import nearest_points, prepare_surface
from palpate.core.rebuild import reconstruct
from palpate.launch import EXPLORE, plan_run
from palpate.launch.files import SourceMapped, write_mesh
from palpate.messages.types import (
    Contour,
    ContourGoal,
    GraspContacts,
    PlanDone,
    Score,
    ShapeModel,
    TactileFrame,
    Truth,
)
from palpate.nodes import curvature, filter, simulator
from palpate.nodes.runtime import Ending, Finished, Node, Outputs, run_composed

KEPT_TYPES = (Contour, ContourGoal, GraspContacts, PlanDone, Score, ShapeModel, TactileFrame, Truth)
MOVE_TRAVEL, MOVE_APPROACH = 1, 3  # Places in a touch's `move`
EXACT: tuple[Mapping[str, Any], ...] = ()
# The default noise: a place that is off by 0.1 mm along each axis, taxels by 10 um.
NOISY: tuple[Mapping[str, Any], ...] = (
    {"pose_error": {"sigma": 1e-4}},
    {"gaussian_noise": {"sigma": 1e-5}},
)
NOISES = {"exact": EXACT, "noise": NOISY}
FEATURE = 3.0e-3  # What may stay unfelt, m
MESH = "object.ply"
USABLE = ("closed", "occluded")
LEAST_POINTS = 8
WORST = 100.0  # Error where nothing can be rebuilt, %


class Explored(NamedTuple):
    """What an exploration came to."""

    ending: Ending  # How the graph ended
    truth: Truth  # The object
    contours: tuple[Contour, ...]  # In the order in which they were traced
    reasons: tuple[str, ...]  # Why each slice was asked for, in the order in which they were
    models: tuple[ShapeModel, ...]  # In the order in which they were rebuilt
    scores: tuple[Score, ...]  # Of the models
    done: PlanDone  # What the planner published in the end
    touches: int  # Of all fingers, searching and probing included
    travel: float  # Way of the fingers: between the touches, to the surface and back, m
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


class MessageCollector(SilentWatcher):
    """Keeps what is published, by type."""

    def __init__(self) -> None:
        self.messages_of: dict[type, list[Any]] = {kind: [] for kind in KEPT_TYPES}
        self.touches = 0  # Of all fingers
        self.travel = 0.0  # Way of the fingers and of the hand, m

    def received(self, topic: str, message: object) -> None:
        """Keep a message; of a touch, only its way."""
        if isinstance(message, (TactileFrame, GraspContacts)):
            self.touches += isinstance(message, TactileFrame)
            self.travel += path_length(message.move)
        else:
            self.messages_of[type(message)].append(message)


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

    Raises RuntimeError if the exploration does not come to its end with a model that could be
    measured.
    """
    with tempfile.TemporaryDirectory(prefix="palpate-bench-") as folder:
        scene = write_scene(Path(folder), target, noise, demand, seed, moved)
        return explore_scene(scene, fingers)


def explore_scene(scene: Path, fingers: int = 1) -> Explored:
    """Explore the scene in a file; as `explore_object`."""
    args = {"scene": str(scene), "fingers": fingers, "record": False}
    plan = plan_run(
        EXPLORE,
        {name: SourceMapped(value, name) for name, value in args.items()},
        {},
        name=scene.stem,
        out=scene.parent / "run",
    )
    collector = MessageCollector()
    types = {topic: name for wiring in plan.wirings for topic, name in wiring.types.items()}
    names = {cls.__name__ for cls in KEPT_TYPES}
    watch = tuple(topic for topic, name in types.items() if name in names)
    began = time.perf_counter()
    ending = run_composed(plan.wirings, ends=plan.ends, watch=watch, watcher=collector)
    return _explored(ending, collector, time.perf_counter() - began)


def _explored(ending: Ending, collector: MessageCollector, wall: float) -> Explored:
    kept = collector.messages_of
    if ending.status != "finished" or not kept[Score]:
        raise RuntimeError(f"the exploration {ending.status}: {ending.reason}")
    return Explored(
        ending,
        kept[Truth][0],
        tuple(kept[Contour]),
        tuple(goal.reason for goal in kept[ContourGoal]),
        tuple(kept[ShapeModel]),
        tuple(kept[Score]),
        kept[PlanDone][-1],
        collector.touches,
        collector.travel,
        wall,
    )


def path_length(move: Floats) -> float:
    """Way of a finger for one touch, m: to its start, to the surface and back."""
    return float(move[MOVE_TRAVEL] + 2.0 * move[MOVE_APPROACH])


def first_within(scores: Iterable[Score], percent: float) -> int | None:
    """Contours of the first model whose error is at most this, %; None if none is."""
    return next((one.contours for one in scores if percent_of(one) <= percent), None)


def percent_of(score: Score) -> float:
    """Root mean square error, % of the object's height."""
    return 100.0 * score.rms / score.size


class Demand(NamedTuple):
    """What is asked of an exploration."""

    planner: str = "predicted"  # Name of the rule
    tolerance: float = 0.002 * EXPLORED_HEIGHT  # Root mean square error, m
    settings: Mapping[str, Any] = {}  # The rule's numbers
    # Along which it is sliced; None for the object's own axis.
    axis: tuple[float, float, float] | None = None

    def keys(self) -> dict[str, Any]:
        """Its keys in a scene."""
        return {
            "planner": self.planner,
            "tolerance": self.tolerance,
            "feature": FEATURE,
            "settings": dict(self.settings),
            "axis": None if self.axis is None else list(self.axis),
        }


def write_scene(
    folder: Path,
    target: ExploreObject,
    noise: tuple[Mapping[str, Any], ...],
    demand: Demand,
    seed: int = 0,
    moved: Floats | None = None,
) -> Path:
    """A scene with one object.

    `folder`: where it is written; the object's mesh too, if it has one. `target`: what stands
    there. `noise`: effects, as scenes list them. `demand`: what is asked of the exploration.
    `seed`: of all that is random. `moved` (7,): pose of the object's own frame in the world, m.
    Returns the scene's file.
    """
    solid = dict(target.solid or {})
    if target.solid is None:
        write_mesh(folder / MESH, *target.mesh())
        solid["mesh"] = {"file": MESH, "unit": "m"}
    if moved is not None:
        place = solid.get("pose", {}).get("position", [0.0, 0.0, 0.0])
        found = compose_poses(moved, pose_of(np.array(place), np.eye(3)))
        solid["pose"] = {"position": found[:3].tolist(), "rotation": found[3:].tolist()}
    scene = {"object": solid, "effects": list(noise), "explore": demand.keys(), "seed": seed}
    path = folder / "scene.yaml"
    path.write_text(json.dumps(scene), encoding="utf-8")  # JSON is YAML too
    return path


def leaning(degrees: float, away: float, lift: float) -> Floats:
    """Pose (7,) of an object that leans about the y axis and stands beside the world's, m."""
    turn = np.array([[0.0, np.radians(degrees), 0.0]])
    return pose_of(np.array([away, 0.0, lift]), rotations_from_vectors(turn)[0])


class Side(NamedTuple):
    """Of a true surface, between 3 and 97 % of its height."""

    points: Floats  # Spread evenly by area, (n, 3), m
    height: float  # Of the object, m

    def percent(self, vertices: Floats, faces: Ints) -> float:
        """Root mean square distance of the side from a mesh, % of the height."""
        found = nearest_points(prepare_surface(vertices, faces).search, self.points).distances
        return float(100.0 * np.sqrt((found**2).mean()) / self.height)


def side_of(truth: Truth) -> Side:
    """The side of a true surface that stands upright."""
    points = prepare_surface(truth.vertices, truth.faces).samples.points
    low = float(truth.vertices[:, 2].min())
    share = (points[:, 2] - low) / truth.height
    return Side(points[(share >= END_SHARE) & (share <= 1.0 - END_SHARE)], truth.height)


def contour_error(side: Side, contours: Sequence[Contour], *, slopes: bool) -> float:
    """Error of the side that is rebuilt from contours alone, %.

    `side`: the true one. `contours`: those without use are left out. `slopes`: with their normals;
    else from positions alone.
    """
    usable = [one for one in contours if one.status in USABLE and len(one.points) >= LEAST_POINTS]
    if len(usable) < 2:
        return WORST
    into = inverse_pose(usable[0].frame)
    _, axes = split_pose(into)
    points = [transform_points(into, one.points) for one in usable]
    normals = [one.normals @ axes.T for one in usable] if slopes else None
    try:
        mesh = reconstruct(points, normals, method="skin").mesh()
    except ValueError:  # these contours make no solid
        return WORST
    there = Side(transform_points(into, side.points), side.height)
    return there.percent(mesh.vertices, mesh.faces)


def model_error(side: Side, model: ShapeModel) -> float:
    """Error of the side of a model that was rebuilt from all touched taxels, %."""
    return side.percent(model.vertices, model.faces) if len(model.faces) else WORST


class LoopNode(NamedTuple):
    """A node of one finger."""

    finger: int  # From 1
    node: Node
    params: Any  # Instance of the node's own parameter type


class InProcessLoop:
    """Nodes as plain calls: every message goes to the nodes of its topic, first in, first out.

    `nodes`: what each publishes reaches the nodes of its finger, a shared topic those of all.
    """

    def __init__(self, nodes: Sequence[LoopNode]) -> None:
        self._nodes = tuple(nodes)
        started = [one.node.start(one.params) for one in nodes]
        self._states: list[Any] = [state for state, _ in started]
        first = [_routed(one, out) for one, (_, out) in zip(nodes, started, strict=True)]
        self._deliver([message for some in first for message in some])

    def publish(self, topic: str, message: object) -> dict[str, Any]:
        """Publish to all fingers, and run until it is quiet; the last message of each topic."""
        return self._deliver([(ALL_FINGERS, topic, message)])

    def _deliver(self, first: list[_Routed]) -> dict[str, Any]:
        waiting, last = deque(first), dict[str, Any]()
        while waiting:
            finger, topic, message = waiting.popleft()
            last[topic] = message
            for i, one in enumerate(self._nodes):
                if topic in one.node.inputs and finger in (ALL_FINGERS, one.finger):
                    _, handler = one.node.inputs[topic]
                    self._states[i], outputs = handler(one.params, self._states[i], message)
                    waiting += _routed(one, outputs)
        return last


def _routed(one: LoopNode, outputs: Outputs) -> list[_Routed]:
    sent = [out for out in outputs if not isinstance(out, Finished)]
    return [(ALL_FINGERS if t in one.node.shared else one.finger, t, body) for t, body in sent]


def touching_nodes(simulated: simulator.Params, finger: int = 1) -> list[LoopNode]:
    """Simulator, filter and curvature of a finger, in this order."""
    return [
        LoopNode(finger, simulator.NODE, simulated),
        LoopNode(finger, filter.NODE, filter.Params()),
        LoopNode(finger, curvature.NODE, curvature.Params()),
    ]


ALL_FINGERS = 0  # A message of no single finger
_Routed = tuple[int, str, object]  # Finger, topic as the nodes call it, message
