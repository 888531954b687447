"""The zero of each taxel wanders."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.plugins import Range, Ranged
from palpate.core.touch.pipeline import Fingertip, KeyedRandom, Phase, SimulatedTouch, Stage


@dataclass(frozen=True, slots=True, kw_only=True)
class Drift(Ranged):
    """A random walk of each taxel's zero, ``o <- o + N(0, rate^2 dt)``, from 0 on.

    ``dt`` is the robot time since the touch before, so after ``t`` seconds the zero has a standard
    deviation of ``rate sqrt(t)``, however many touches there were. An engineering value: 17 um in
    five minutes. It matters in long runs without a new zero.
    """

    phase: ClassVar = Phase.SIGNAL

    # Standard deviation of the zero after one second.
    rate: Annotated[float, Range(0.0, 1e-4, "m/sqrt(s)")] = 1e-6

    def prepare(self, finger: Fingertip) -> Stage:
        """The stage for one finger; its state is the time of a touch, s, and the zeros, m."""
        draws, rate = KeyedRandom(finger, "drift"), self.rate
        size = (finger.pad.rows, finger.pad.cols)

        def apply(touch: SimulatedTouch, state: tuple[float, Floats]) -> tuple[float, Floats]:
            before, zeros = state
            step = rate * math.sqrt(touch.time - before)
            zeros = zeros + step * draws.of_touch(touch.number).standard_normal(size)
            touch.reading = touch.reading + zeros
            return touch.time, zeros

        return Stage(apply, (0.0, np.zeros(size)))
