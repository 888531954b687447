"""Rubber gives way while it is held, and comes back slowly when it is let go."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.plugins import Range, Ranged
from palpate.core.touch.pipeline import Fingertip, Phase, SimulatedTouch, Stage


@dataclass(frozen=True, slots=True, kw_only=True)
class Creep(Ranged):
    """The standard linear solid: ``q' = -q / tau + c'``, and ``(1 - b) c + b q`` is measured.

    A share ``b`` of the answer relaxes while the pad is held, and is missing in the next touch if
    the pad had no time to recover. Solved in closed form for what a touch does: free, pressed at a
    constant rate, as long in every taxel as in the deepest, held, let go at once, and free on its
    way back. A free face reads nothing, never less. The pressure falls in the same proportion.
    Christensen, *Theory of viscoelasticity*, 1982; the values are engineering values. It matters
    after short rests and short dwells: a tenth of the depth is the largest error of a contour next
    to the arm's.
    """

    phase: ClassVar = Phase.PAD

    # The share ``b`` that relaxes: that of a filled silicone.
    share: Annotated[float, Range(0.0, 0.9, "1")] = 0.10
    tau: Annotated[float, Range(1e-3, 1e4, "s")] = 0.5  # Time constant of relaxation and recovery

    def prepare(self, finger: Fingertip) -> Stage:
        """The stage for one finger; its state is q at the end of the touch, (rows, cols), m."""
        share, tau = self.share, self.tau

        def apply(touch: SimulatedTouch, state: Floats) -> Floats:
            compression = touch.compression
            until_frame = touch.rest + touch.loading + touch.dwell
            branch = state * math.exp(-until_frame / tau)
            branch += compression * _left(touch.loading, touch.dwell, tau)
            answer = np.maximum((1.0 - share) * compression + share * branch, 0.0)
            ratio = np.divide(answer, compression, out=answer.copy(), where=compression > 0.0)
            touch.pressure, touch.compression = touch.pressure * ratio, answer
            way_back = touch.time - touch.previous - until_frame
            return (branch - compression) * math.exp(-way_back / tau)

        return Stage(apply, np.zeros((finger.pad.rows, finger.pad.cols)))


def _left(loading: float, dwell: float, tau: float) -> float:
    """What is left of q at the frame, as a share of the compression, of a pad at rest before."""
    ramp = loading / tau
    rise = -math.expm1(-ramp) / ramp if ramp > 0.0 else 1.0
    return rise * math.exp(-dwell / tau)
