"""Objects, goals and graphs that the tests of nodes share."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.frames import pad_rotation, pose_of
from palpate.launch.graph import Entry, Graph
from palpate.messages.types import LogRecord, NodeStatus, SensorInfo, World
from palpate.nodes.object import ObjectSpec, PoseSpec, SuperquadricSpec
from palpate.nodes.sensor import SensorSpec, info_of
from palpate.nodes.wiring import Wiring

RADIUS = 0.03


class Ears:
    """A watcher that keeps what it hears."""

    def __init__(self) -> None:
        self.messages: list[tuple[str, object]] = []
        self.records: list[LogRecord] = []

    def ready(self, seconds: float) -> None:
        assert seconds >= 0.0

    def heard(self, topic: str, message: object) -> None:
        self.messages.append((topic, message))

    def log(self, record: LogRecord) -> None:
        self.records.append(record)

    def tick(self, statuses: Mapping[str, NodeStatus]) -> None:
        assert statuses

    def of(self, topic: str) -> list[Any]:
        """All messages of a topic."""
        return [message for heard, message in self.messages if heard == topic]


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
