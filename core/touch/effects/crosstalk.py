"""Neighbouring elements pick up each other's signal."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar

from palpate.core.plugins import Range, Ranged
from palpate.core.touch.pipeline import Fingertip, Phase, SimulatedTouch, Stage


@dataclass(frozen=True, slots=True, kw_only=True)
class Crosstalk(Ranged):
    """Each taxel takes a share of its four neighbours, ``v <- (1 - 4 a) v + a sum(neighbours)``.

    A taxel at the border has fewer neighbours, and keeps what it would have given to the others:
    ``(1 - 3 a) v`` or, in a corner, ``(1 - 2 a) v``. So a level field stays as it is and nothing is
    lost. An engineering value. It matters at edges, where it moves the border of the contact by
    some 10 um; smooth surfaces hardly show it.
    """

    phase: ClassVar = Phase.ECHO

    # The share ``a``: 30 dB between neighbours.
    share: Annotated[float, Range(0.0, 0.2, "1")] = 0.03

    def prepare(self, finger: Fingertip) -> Stage:
        """The stage for one finger."""
        share = self.share

        def apply(touch: SimulatedTouch, state: None) -> None:
            before = touch.reading
            mixed = before.copy()
            flow = share * (before[1:] - before[:-1])
            mixed[:-1] += flow
            mixed[1:] -= flow
            flow = share * (before[:, 1:] - before[:, :-1])
            mixed[:, :-1] += flow
            mixed[:, 1:] -= flow
            touch.reading = mixed

        return Stage(apply)
