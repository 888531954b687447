"""Now and then a taxel reads nothing, or everything."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np

from palpate.core.plugins import Range, Ranged
from palpate.core.touch.pipeline import Fingertip, KeyedRandom, Phase, SimulatedTouch, Stage


@dataclass(frozen=True, slots=True, kw_only=True)
class SaltAndPepper(Ranged):
    """Impulses: with probability ``rate`` a taxel reads 0 or full scale, either as likely.

    Full scale is the compression at which the pad bottoms. Independent in each taxel and touch. An
    engineering value for lost and false echoes. It is the noise that the median filter is for
    (Fung, 1999, 3.4.2); a single impulse that is taken for the surface is an error of millimetres.
    """

    phase: ClassVar = Phase.SIGNAL

    # Probability for one taxel in one touch: two or three of 256.
    rate: Annotated[float, Range(0.0, 1.0, "1")] = 0.01

    def prepare(self, finger: Fingertip) -> Stage:
        """The stage for one finger."""
        pad, draws, rate = finger.pad, KeyedRandom(finger, "salt_and_pepper"), self.rate
        size, full_scale = (pad.rows, pad.cols), pad.saturation * pad.thickness

        def apply(touch: SimulatedTouch, state: None) -> None:
            drawn = draws.of_touch(touch.number).random(size)
            struck = (drawn < rate).nonzero()
            reading = touch.reading.copy()
            reading[struck] = np.where(drawn[struck] < 0.5 * rate, 0.0, full_scale)
            touch.reading = reading

        return Stage(apply)
