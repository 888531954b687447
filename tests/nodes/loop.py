"""Nodes as plain calls in one process: what one publishes is handed to those who subscribe."""

from __future__ import annotations

from collections import deque
from typing import Any, NamedTuple

import numpy as np
from msgspec.structs import replace

from palpate.core.arrays import Floats
from palpate.core.poses import Pose, pad_rotation
from palpate.core.steps import no_steps
from palpate.nodes import curvature, filter, simulator, tracer
from palpate.nodes.runtime.node import Deferred, Finished, Node, Outputs
from palpate.nodes.specs.objects import ObjectSpec, PoseSpec, SuperquadricSpec

Published = list[tuple[str, Any]]
RADIUS = 0.03  # Of the ball [m]


def ball_spec(radius: float = RADIUS, middle: tuple[float, ...] | None = None) -> ObjectSpec:
    """A ball, which stands on height 0 unless it is said where its middle is."""
    solid = SuperquadricSpec(size=(radius,) * 3, exponents=(1.0, 1.0))
    return ObjectSpec(superquadric=solid, pose=PoseSpec(position=middle or (0.0, 0.0, radius)))


def sideways(height: float) -> Floats:
    """Pose of a pad that faces the z axis from the +x side."""
    return Pose(np.array([0.1, 0.0, height]), pad_rotation(0.0, 0.0)).array


class LoopNode(NamedTuple):
    """A node of one finger."""

    node: Node
    params: Any
    finger: int = 1


class Loop:
    """Nodes that hear each other; a message that names a finger reaches that finger's nodes."""

    def __init__(self, *nodes: LoopNode) -> None:
        self._nodes = nodes
        self._states: list[Any] = []
        begun: Published = []
        for one in nodes:
            state, outputs = one.node.start(one.params)
            self._states.append(state)
            begun += sent(outputs)
        self.begun = self._deliver(deque(begun))

    def publish(self, topic: str, message: Any) -> Published:
        """The message and all that follows from it, until all is quiet."""
        return self._deliver(deque([(topic, message)]))

    def _deliver(self, waiting: deque[tuple[str, Any]]) -> Published:
        published = []
        while waiting:
            topic, message = waiting.popleft()
            published.append((topic, message))
            for i, (node, params, finger) in enumerate(self._nodes):
                if topic in node.inputs and getattr(message, "finger", finger) == finger:
                    handler = node.inputs[topic][1]
                    self._states[i], outputs = handler(params, self._states[i], message)
                    waiting.extend(sent(outputs))
        return published


def sent(outputs: Outputs) -> Published:
    """Topics and messages of what a handler returns; what takes long is made."""
    return [
        (one[0], one[1].make(no_steps) if isinstance(one[1], Deferred) else one[1])
        for one in outputs
        if not isinstance(one, Finished)
    ]


def touching(
    simulated: simulator.Params, fingers: int = 1, most_touches: int = 150, **filtered: Any
) -> Loop:
    """Simulator, filter, curvature and tracer of each finger."""
    return Loop(
        *(
            LoopNode(node, params, finger)
            for finger in range(1, fingers + 1)
            for node, params in (
                (simulator.NODE, replace(simulated, finger=finger, fingers=fingers)),
                (filter.NODE, filter.Params(**filtered)),
                (curvature.NODE, curvature.Params()),
                (tracer.NODE, tracer.Params(finger=finger, most_touches=most_touches)),
            )
        )
    )
