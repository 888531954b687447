"""Objects, goals and graphs that the tests of nodes share."""

from __future__ import annotations

import random
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.poses import IDENTITY_POSE, pad_rotation, pose_of, transform_points
from palpate.launch.graph import Graph
from palpate.launch.node_kinds import Entry
from palpate.messages.codec import encode
from palpate.messages.types.catalogue import LogRecord, NodeStatus
from palpate.messages.types.model import ModelGoal, ShapeModel, Superquadric
from palpate.messages.types.motion import (
    Contour,
    ContourGoal,
    FingerClock,
    GraspContacts,
    GraspGoal,
    Probe,
    ProbeGoal,
)
from palpate.messages.types.world import SensorInfo, World
from palpate.nodes.planner import NODE, Params
from palpate.nodes.planning.phases import State
from palpate.nodes.runtime.node import Wiring, resolved
from palpate.nodes.runtime.testing import example
from palpate.nodes.specs.objects import ObjectSpec, PoseSpec, SuperquadricSpec
from palpate.nodes.specs.sensors import SensorSpec, info_of

RADIUS = 0.03
TOP = 0.1
TOUCHES = 20
Said = list[tuple[str, Any]]


class Ears:
    """A watcher that keeps what it hears."""

    def __init__(self) -> None:
        self.messages: list[tuple[str, object]] = []
        self.records: list[LogRecord] = []

    def ready(self, seconds: float) -> None:
        assert seconds >= 0.0

    def received(self, topic: str, message: object) -> None:
        self.messages.append((topic, message))

    def log(self, record: LogRecord) -> None:
        self.records.append(record)

    def tick(self, statuses: Mapping[str, NodeStatus]) -> None:
        assert statuses

    def of(self, topic: str) -> list[Any]:
        """All messages of a topic."""
        return [message for received, message in self.messages if received == topic]


@pytest.fixture
def ears() -> Ears:
    return Ears()


@pytest.fixture
def ball() -> ObjectSpec:
    """A ball of 60 mm that stands on height 0."""
    return ObjectSpec(
        superquadric=SuperquadricSpec(size=(RADIUS,) * 3, exponents=(1.0, 1.0)),
        pose=PoseSpec(position=(0.0, 0.0, RADIUS)),
    )


@pytest.fixture
def info() -> SensorInfo:
    return info_of(SensorSpec(), noise=0.0)


@pytest.fixture
def world() -> World:
    return World(platform=0.0, reach=0.15, fingers=1, seed=0)


@pytest.fixture
def sideways() -> Callable[[float], Floats]:
    """Pose of a pad that looks at the axis from the +x side, at a height."""

    def pose(height: float) -> Floats:
        return pose_of(np.array([0.1, 0.0, height]), pad_rotation(0.0, 0.0))

    return pose


@pytest.fixture
def exploration() -> Callable[..., tuple[Wiring, ...]]:
    """Wirings of the whole loop without recorder: object, number of contours, and budget."""

    def wirings(spec: ObjectSpec, contours: int, **budget: int) -> tuple[Wiring, ...]:
        planner = {"planner": "uniform", "settings": {"count": contours}, **budget}
        params = {"simulator": {"object": spec}, "planner": planner}
        kinds = ["simulator", "filter", "curvature", "tracer", "planner"]
        kinds += ["reconstructor", "evaluator"]
        entries = tuple(Entry(name=kind, params=_plain(params.get(kind, {}))) for kind in kinds)
        return Graph(entries, ends="evaluator").wirings()

    return wirings


def _plain(params: dict[str, Any]) -> dict[str, Any]:
    import msgspec

    plain: dict[str, Any] = msgspec.to_builtins(params, builtin_types=(bytes,))
    return plain


class Cylinder:
    """Answers every goal as an upright cylinder would, each finger after its own time."""

    def __init__(self, status: Callable[[ContourGoal], str] = lambda goal: "closed") -> None:
        self.status = status
        self.clocks: dict[int, float] = {}
        self.contacts = 6

    def answers(self, topic: str, goal: Any) -> Said:
        if topic == "/hand/goal":
            return [("/hand/contacts", self.contacts_of(goal))]
        if topic == "/probe/goal":
            return [("/probe/traced", self.probe_of(goal))]
        if topic == "/contour/goal":
            return [("/contour/traced", self.contour_of(goal))]
        if topic == "/model/goal":
            return [self.model_of(goal)]
        return []

    def spend(self, goal: Any, seconds: float) -> float:
        begun = max(goal.not_before, self.clocks.get(goal.finger, 0.0))
        self.clocks[goal.finger] = begun + seconds
        return self.clocks[goal.finger]

    def left(self, goal: ContourGoal | ProbeGoal) -> int:
        """Touches that still end within the goal's limits, each after about a second."""
        now = max(goal.not_before, self.clocks.get(goal.finger, 0.0))
        left = TOUCHES if goal.not_after is None else int((goal.not_after - now) / 1.2)
        most = goal.most_touches if isinstance(goal, ContourGoal) else None
        return max(left if most is None else min(left, most), 0)

    def contacts_of(self, goal: GraspGoal) -> GraspContacts:
        turn = 2.0 * np.pi * (np.arange(self.contacts) + 0.1 * goal.number) / max(self.contacts, 1)
        rim = np.column_stack([np.cos(turn), np.sin(turn), np.zeros(self.contacts)])
        height = 0.01 + 0.08 * ((7 * goal.number) % 11) / 11.0
        return example(
            GraspContacts,
            number=goal.number,
            points=RADIUS * rim + [0.0, 0.0, height],
            normals=rim,
            fingers=np.arange(self.contacts, dtype=np.int32),
            move=np.array([0.0, 0.0, 0.0, 0.0, -1.0]),
            robot_time=8.0 * (goal.number + 1),
        )

    def probe_of(self, goal: ProbeGoal) -> Probe:
        at = goal.pose[:2]
        hit = bool(np.hypot(*at) < RADIUS)
        return Probe(
            id=goal.id,
            finger=goal.finger,
            outcome="hit" if hit else "miss",
            point=np.array([*at, TOP]),
            normal=np.array([0.0, 0.0, 1.0]),
            touches=min(self.left(goal), 1),
            robot_time=self.spend(goal, 2.0 * min(self.left(goal), 1)),
        )

    def contour_of(self, goal: ContourGoal) -> Contour:
        status: Any = self.status(goal)
        left = self.left(goal)
        if left < TOUCHES:
            status = "budget"
        count = 90 if status in ("closed", "occluded") else 0
        turn = 2.0 * np.pi * np.arange(count) / 90
        rim = np.column_stack([np.cos(turn), np.sin(turn), np.zeros(count)])
        return example(
            Contour,
            id=goal.id,
            finger=goal.finger,
            frame=goal.frame,
            height=goal.height,
            points=transform_points(goal.frame, RADIUS * rim + [0.0, 0.0, goal.height]),
            normals=rim,
            curvature=np.zeros(count),
            contact_low=np.full(count, goal.height - 4e-3),
            contact_high=np.full(count, goal.height + 4e-3),
            status=status,
            touches=min(left, TOUCHES),
            robot_time=self.spend(goal, min(left / TOUCHES, 1.0) * (20.0 + goal.finger)),
        )

    def model_of(self, goal: ModelGoal) -> tuple[str, Any]:
        if not goal.contours:
            return "/model/coarse", example(
                Superquadric,
                number=goal.number,
                size=np.array([RADIUS, RADIUS, 0.5 * TOP]),
                exponents=np.array([0.1, 1.0]),
                pose=np.array([0.0, 0.0, 0.5 * TOP, 0.0, 0.0, 0.0, 1.0]),
                residual=1e-5,
                residuals=np.zeros(self.contacts * goal.closings),
                rank=11,
            )
        return "/model/shape", example(
            ShapeModel,
            number=goal.number,
            contours=goal.contours,
            probes=goal.probes,
            vertices=np.zeros((3, 3)),
            faces=np.zeros((1, 3), np.int32),
            frame=IDENTITY_POSE,
            deviation=1e-5,
            uncertainty_height=np.array([0.0, TOP]),
            uncertainty=np.full(2, 1e-5),
            touches=goal.touches,
            robot_time=goal.robot_time,
        )


@pytest.fixture
def cylinder() -> type[Cylinder]:
    """An upright cylinder of 60 by 100 mm that answers the planner."""
    return Cylinder


@pytest.fixture
def explored(info: SensorInfo) -> Callable[..., Said]:
    """Everything that the planner says, each goal answered at once or in any order."""

    def published(
        params: Params,
        world: World,
        shape: Cylinder | None = None,
        order: random.Random | None = None,
    ) -> Said:
        return everything_published(params, info, world, shape or Cylinder(), order)

    return published


def everything_published(
    params: Params,
    info: SensorInfo,
    world: World,
    shape: Cylinder,
    order: random.Random | None = None,
) -> Said:
    """Everything that the planner says, each goal answered at once or in any order."""
    state, _ = NODE.start(params)
    published: Said = []
    waiting: Said = [("/touch/info", info), ("/world", world)]
    while waiting:
        # Messages of one publisher on one topic keep their order; others may overtake.
        fronts: dict[tuple[str, int], int] = {}
        for i, (topic, message) in enumerate(waiting):
            fronts.setdefault((topic, getattr(message, "finger", 0)), i)
        place = order.choice(sorted(fronts.values())) if order and state.world else 0
        topic, message = waiting.pop(place)
        state, outputs = NODE.inputs[topic][1](params, state, message)
        assert encode(message)
        for one in ((to, resolved(message)) for to, message in outputs):
            published.append(one)
            answers = shape.answers(*one)
            waiting += answers
            if world.fingers > 1:
                waiting += [
                    ("/finger/clock", FingerClock(finger=m.finger, robot_time=m.robot_time))
                    for _, m in answers
                    if isinstance(m, (Contour, Probe))
                ]
    assert isinstance(state, State)
    return published
