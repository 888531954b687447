"""A steep face throws the echo past the transducer."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np

from palpate.core.arrays import Bools, Floats
from palpate.core.plugins import Range, Ranged
from palpate.core.touch.pipeline import Fingertip, Phase, SimulatedTouch, Stage


@dataclass(frozen=True, slots=True, kw_only=True)
class EchoLoss(Ranged):
    """An echo of amplitude ``exp(-(theta / angle)^2)`` below the threshold is lost.

    ``theta`` is the slope of the pressed face against the undeformed one: central differences of
    the compression, one-sided at the border. Such a taxel reads as untouched, 0. The Gaussian
    stands for the main lobe of a transducer (Kinsler and others, *Fundamentals of acoustics*,
    2000); its width is an engineering value. It matters on corners, on edges and at the rim of
    strongly curved surfaces, which a real array may not see at all.
    """

    phase: ClassVar = Phase.ECHO

    # Slope at which the amplitude has fallen to 1/e: for elements of a few wavelengths.
    angle: Annotated[float, Range(1.0, 60.0, "deg")] = 15.0
    # Smallest amplitude that is received, as a share of a level face's: 20 dB down. 0 for all.
    threshold: Annotated[float, Range(0.0, 1.0, "1")] = 0.1

    def prepare(self, finger: Fingertip) -> Stage:
        """The stage for one finger. Raises ValueError if the array sends no times."""
        signal = finger.calibration.signal
        if signal != "time":
            raise ValueError(
                f"echo_loss is of arrays that listen to echoes, and the array's signal is "
                f"{signal}; expected time"
            )
        if self.threshold == 0.0:
            return Stage(_keep_all)
        steepest = math.radians(self.angle) * math.sqrt(-math.log(self.threshold))
        if steepest >= 0.5 * math.pi:
            return Stage(_keep_all)
        largest = (2.0 * finger.pad.pitch * math.tan(steepest)) ** 2

        def apply(touch: SimulatedTouch, state: None) -> None:
            lost = _steeper(touch.compression, largest)
            touch.reading = np.where(lost, 0.0, touch.reading)

        return Stage(apply)


def _keep_all(touch: SimulatedTouch, state: None) -> None:
    """Even a face on edge is received."""


def _steeper(height: Floats, largest: float) -> Bools:
    """Where the squared difference over two taxels is larger than `largest`."""
    across, down = np.empty_like(height), np.empty_like(height)
    np.subtract(height[:, 2:], height[:, :-2], out=across[:, 1:-1])
    across[:, 0] = 2.0 * (height[:, 1] - height[:, 0])
    across[:, -1] = 2.0 * (height[:, -1] - height[:, -2])
    np.subtract(height[2:], height[:-2], out=down[1:-1])
    down[0] = 2.0 * (height[1] - height[0])
    down[-1] = 2.0 * (height[-1] - height[-2])
    steeper: Bools = across * across + down * down > largest
    return steeper
