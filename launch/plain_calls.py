"""Nodes as plain calls, in one process and without a bus: for measuring what they cost.

A touch is deterministic and its loop is short; where only the loop from goal to contour is
wanted, neither a launch file nor a socket is.
"""

from __future__ import annotations

from collections import deque
from typing import Any, NamedTuple

import numpy as np
from msgspec.structs import replace

from palpate.core.frames import IDENTITY
from palpate.messages.types import Contour, ContourGoal
from palpate.nodes import curvature, filter, simulator, tracer
from palpate.nodes.node import Finished, Node, Outputs

APPROACH = 0.02
"""The finger comes from this far outside of the object, m."""

EVERY = 0
"""A message of no single finger: all hear it."""


class Seat(NamedTuple):
    """A node of one finger."""

    finger: int
    """The finger, from 1."""
    node: Node
    """What it does."""
    params: Any
    """Instance of the node's own parameter type."""


class Said(NamedTuple):
    """A message under way."""

    finger: int
    """The finger whose nodes hear it, or `EVERY`."""
    topic: str
    """As the nodes call it."""
    message: object
    """What was said."""


class Loop:
    """Simulator, filter, curvature and tracer of each finger: each hearing what the others say.

    Parameters
    ----------
    simulated : simulator.Params
        Object, sensor, effects and seed.
    filtered : filter.Params
        How frames are cleaned.
    fingers : int
        How many fingers there are.
    """

    def __init__(
        self,
        simulated: simulator.Params,
        filtered: filter.Params | None = None,
        fingers: int = 1,
    ) -> None:
        self._seats = [
            seat
            for finger in range(1, fingers + 1)
            for seat in (
                Seat(finger, simulator.NODE, replace(simulated, finger=finger, fingers=fingers)),
                Seat(finger, filter.NODE, filtered or filter.Params()),
                Seat(finger, curvature.NODE, curvature.Params()),
                Seat(finger, tracer.NODE, tracer.Params(finger=finger)),
            )
        ]
        self._states: list[Any] = []
        first: list[Said] = []
        for seat in self._seats:
            state, outputs = seat.node.start(seat.params)
            self._states.append(state)
            first += _said(seat, outputs)
        self._deliver(first)

    def trace(self, height: float, radius: float, number: int = 0, finger: int = 1) -> Contour:
        """Trace the slice at a height about the world's axis; radius of the object there, m."""
        goal = ContourGoal(
            id=number,
            finger=finger,
            frame=IDENTITY,
            height=height,
            centre=np.zeros(2),
            radius=radius + APPROACH,
            not_before=0.0,
        )
        said = self._deliver([Said(EVERY, "/contour/goal", goal)])
        contour = said["/contour/traced"]
        assert isinstance(contour, Contour)
        return contour

    def _deliver(self, first: list[Said]) -> dict[str, object]:
        """Hand every message to who hears its topic, first in, first out; the last of each."""
        waiting, last = deque(first), dict[str, object]()
        while waiting:
            said = waiting.popleft()
            last[said.topic] = said.message
            for i, seat in enumerate(self._seats):
                if said.topic in seat.node.inputs and said.finger in (EVERY, seat.finger):
                    _, handler = seat.node.inputs[said.topic]
                    self._states[i], outputs = handler(seat.params, self._states[i], said.message)
                    waiting += _said(seat, outputs)
        return last


def _said(seat: Seat, outputs: Outputs) -> list[Said]:
    said = [one for one in outputs if not isinstance(one, Finished)]
    shared = seat.node.shared
    return [Said(EVERY if t in shared else seat.finger, t, message) for t, message in said]
