"""Nodes of several fingers as plain calls in this process, to time their handlers alone."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from itertools import product
from typing import Any, NamedTuple

import numpy as np

from palpate.core.poses import IDENTITY_POSE
from palpate.messages.types import ContourGoal
from palpate.nodes import curvature, filter, simulator
from palpate.nodes.runtime.composed import MessageQueue
from palpate.nodes.runtime.node import Finished, Node, Outputs

ALL_FINGERS = 0  # A message of no single finger


class LoopNode(NamedTuple):
    """A node of one finger."""

    finger: int  # From 1
    node: Node
    params: Any  # Instance of the node's own parameter type


class InProcessLoop:
    """Nodes as plain calls, without a codec between them: the time of their handlers alone.

    `nodes`: what each publishes reaches the nodes of its finger, a shared topic those of all.
    """

    def __init__(self, nodes: Sequence[LoopNode]) -> None:
        self._nodes = tuple(nodes)
        subscribers = defaultdict[tuple[int, str], list[int]](list)
        for i, one in enumerate(nodes):
            for edge in product((ALL_FINGERS, one.finger), one.node.inputs):
                subscribers[edge].append(i)
        self._queue = MessageQueue(subscribers)
        started = [one.node.start(one.params) for one in nodes]
        self._states: list[Any] = [state for state, _ in started]
        self._last: dict[str, Any] = {}
        for one, (_, outputs) in zip(nodes, started, strict=True):
            self._send(one, outputs)
        self._deliver()

    def publish(self, topic: str, message: object) -> dict[str, Any]:
        """Publish to all fingers, and run until it is quiet; the last message of each topic."""
        self._last = {topic: message}
        self._queue.put((ALL_FINGERS, topic), message)
        return self._deliver()

    def _deliver(self) -> dict[str, Any]:
        while (found := self._queue.take()) is not None:
            (_, topic), i, message = found
            one = self._nodes[i]
            _, handler = one.node.inputs[topic]
            self._states[i], outputs = handler(one.params, self._states[i], message)
            self._send(one, outputs)
        return self._last

    def _send(self, one: LoopNode, outputs: Outputs) -> None:
        for topic, message in (out for out in outputs if not isinstance(out, Finished)):
            self._last[topic] = message
            finger = ALL_FINGERS if topic in one.node.shared else one.finger
            self._queue.put((finger, topic), message)


def touching_nodes(simulated: simulator.Params, finger: int = 1) -> list[LoopNode]:
    """Simulator, filter and curvature of a finger, in this order."""
    return [
        LoopNode(finger, simulator.NODE, simulated),
        LoopNode(finger, filter.NODE, filter.Params()),
        LoopNode(finger, curvature.NODE, curvature.Params()),
    ]


def contour_goal(height: float, radius: float) -> ContourGoal:
    """A level contour about the z axis, at a height and begun at a distance from it, m."""
    return ContourGoal(
        id=0,
        finger=1,
        frame=IDENTITY_POSE,
        height=height,
        centre=np.zeros(2),
        radius=radius,
        gap=0.0,
        not_before=0.0,
        most_touches=None,
        not_after=None,
    )
