"""Nodes as plain calls, in one process and without a bus: for measuring what they cost.

A touch is deterministic and its loop is short; where only the loop from goal to contour is
wanted, neither a launch file nor a socket is.
"""

from __future__ import annotations

from collections import deque
from typing import Any

import numpy as np

from palpate.core.frames import IDENTITY
from palpate.messages.types import Contour, ContourGoal
from palpate.nodes import curvature, filter, simulator, tracer
from palpate.nodes.node import Finished, Outputs

APPROACH = 0.02
"""The finger comes from this far outside of the object, m."""


_NODES = (simulator.NODE, filter.NODE, curvature.NODE, tracer.NODE)


class Loop:
    """Simulator, filter, curvature and tracer: each hearing what the others say.

    Parameters
    ----------
    simulated : simulator.Params
        Object, sensor, effects and seed.
    filtered : filter.Params
        How frames are cleaned.
    """

    def __init__(self, simulated: simulator.Params, filtered: filter.Params | None = None):
        params = (simulated, filtered or filter.Params(), curvature.Params(), tracer.Params())
        self._nodes = tuple(zip(_NODES, params, strict=True))
        started = [node.start(given) for node, given in self._nodes]
        self._states: list[Any] = [state for state, _ in started]
        self._deliver([said for _, outputs in started for said in _messages(outputs)])

    def trace(self, height: float, radius: float, number: int = 0) -> Contour:
        """Trace the slice at a height about the world's axis; radius of the object there, m."""
        goal = ContourGoal(
            id=number,
            finger=1,
            frame=IDENTITY,
            height=height,
            centre=np.zeros(2),
            radius=radius + APPROACH,
            not_before=0.0,
        )
        said = self._deliver([("/contour/goal", goal)])
        contour = said["/contour/traced"]
        assert isinstance(contour, Contour)
        return contour

    def _deliver(self, first: list[tuple[str, object]]) -> dict[str, object]:
        """Hand every message to who hears its topic, first in, first out; the last of each."""
        waiting, said = deque(first), dict[str, object]()
        while waiting:
            topic, message = waiting.popleft()
            said[topic] = message
            for i, (node, params) in enumerate(self._nodes):
                if topic in node.inputs:
                    _, handler = node.inputs[topic]
                    self._states[i], outputs = handler(params, self._states[i], message)
                    waiting += _messages(outputs)
        return said


def _messages(outputs: Outputs) -> list[tuple[str, object]]:
    return [said for said in outputs if not isinstance(said, Finished)]
