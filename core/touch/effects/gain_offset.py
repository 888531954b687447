"""No two taxels are alike."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar

from palpate.core.plugins import Range, Ranged
from palpate.core.touch.pipeline import Fingertip, KeyedRandom, Phase, SimulatedTouch, Stage


@dataclass(frozen=True, slots=True, kw_only=True)
class GainOffset(Ranged):
    """A gain and an offset of each taxel, ``v <- (1 + g) v + o``, drawn once for the finger.

    ``g ~ N(0, sigma_gain^2)`` and ``o ~ N(0, sigma_offset^2)``. Engineering values of an array that
    was not calibrated; a calibration removes most of both. They matter as a pattern that stays the
    same in every frame, and that no average over touches removes.
    """

    phase: ClassVar = Phase.SIGNAL

    # Standard deviation of the gain about 1.
    sigma_gain: Annotated[float, Range(0.0, 0.3, "1")] = 0.03
    # Standard deviation of the offset.
    sigma_offset: Annotated[float, Range(0.0, 1e-3, "m")] = 10e-6

    def prepare(self, finger: Fingertip) -> Stage:
        """The stage for one finger."""
        drawn = KeyedRandom(finger, "gain_offset").once()
        drawn_gain, drawn_offset = drawn.standard_normal((2, finger.pad.rows, finger.pad.cols))
        gain, offset = 1.0 + self.sigma_gain * drawn_gain, self.sigma_offset * drawn_offset

        def apply(touch: SimulatedTouch, state: None) -> None:
            touch.reading = gain * touch.reading + offset

        return Stage(apply)
