"""Nodes of several fingers as plain calls in this process, to measure only their handlers."""

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

ALL_FINGERS = 0  # In place of a finger's number, in messages to all fingers


class LoopNode(NamedTuple):
    """A node of one finger."""

    finger: int  # From 1
    node: Node
    params: Any  # Instance of the node's own parameter type


class InProcessLoop:
    """Nodes as plain calls, without a codec between them.

    `nodes`: messages of each reach the nodes of its finger, those on a shared topic all nodes.
    """

    def __init__(self, nodes: Sequence[LoopNode]) -> None:
        self._nodes = tuple(nodes)
        subscribers = defaultdict[tuple[int, str], list[int]](list)
        for i, node in enumerate(nodes):
            for edge in product((ALL_FINGERS, node.finger), node.node.inputs):
                subscribers[edge].append(i)
        self._queue = MessageQueue(subscribers)
        started = [node.node.start(node.params) for node in nodes]
        self._states: list[Any] = [state for state, _ in started]
        self._last: dict[str, Any] = {}
        for node, (_, outputs) in zip(nodes, started, strict=True):
            self._send(node, outputs)
        self._deliver()

    def publish(self, topic: str, message: object) -> dict[str, Any]:
        """Publish to all fingers, run until no message is left; return the last of each topic."""
        self._last = {topic: message}
        self._queue.put((ALL_FINGERS, topic), message)
        return self._deliver()

    def _deliver(self) -> dict[str, Any]:
        while (delivery := self._queue.take()) is not None:
            (_, topic), i, message = delivery
            node = self._nodes[i]
            _, handler = node.node.inputs[topic]
            self._states[i], outputs = handler(node.params, self._states[i], message)
            self._send(node, outputs)
        return self._last

    def _send(self, node: LoopNode, outputs: Outputs) -> None:
        for topic, message in (out for out in outputs if not isinstance(out, Finished)):
            self._last[topic] = message
            finger = ALL_FINGERS if topic in node.node.shared else node.finger
            self._queue.put((finger, topic), message)


def touching_nodes(simulated: simulator.Params, finger: int = 1) -> list[LoopNode]:
    """Simulator, filter and curvature nodes of a finger, in this order."""
    return [
        LoopNode(finger, simulator.NODE, simulated),
        LoopNode(finger, filter.NODE, filter.Params()),
        LoopNode(finger, curvature.NODE, curvature.Params()),
    ]


def contour_goal(height: float, radius: float) -> ContourGoal:
    """Goal of a level contour about the z axis, at a height and from a starting radius [m]."""
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
