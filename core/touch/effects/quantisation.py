"""Electronics count: a time in ticks of a clock, a force in steps of a converter."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np

from palpate.core.plugins import Range, check_ranges
from palpate.core.touch.pipeline import Fingertip, Phase, SimulatedTouch, Stage

CLOCK = 100e6  # Of a scene that says neither, Hz: 5 um at 1000 m/s. 20 MHz, of the 1990s, are 25.


@dataclass(frozen=True, slots=True, kw_only=True)
class Quantisation:
    """Readings are rounded to whole steps.

    A clock of ``f`` Hz times the echo, so what is left of the thickness is rounded to ``v / (2
    f)``, (1.1). A converter of ``n`` bits rounds the compression to ``D / 2^n``, its full scale
    being the thickness. Either adds an error of ``step / sqrt(12)`` (Widrow, 1956), as long as the
    noise before it is not much smaller than a step. Give one of the two; with neither it is a clock
    of 100 MHz.
    """

    phase: ClassVar = Phase.SIGNAL

    # Frequency of the clock that counts the time of flight.
    clock: Annotated[float | None, Range(1e5, 1e12, "Hz")] = None
    bits: Annotated[int | None, Range(1, 32, "1")] = None  # Bits of the converter

    def __post_init__(self) -> None:
        check_ranges(self)
        if self.clock is not None and self.bits is not None:
            raise ValueError(
                f"clock is {self.clock:g} Hz and bits is {self.bits}; expected one of the two"
            )

    def prepare(self, finger: Fingertip) -> Stage:
        """The stage for one finger. Raises ValueError if a clock is to count what is not a time."""
        calibration = finger.calibration
        if self.bits is not None:
            step, whole = calibration.thickness / 2**self.bits, 0.0
        elif calibration.signal == "time":
            step = calibration.sound_speed / (2.0 * (self.clock or CLOCK))
            whole = calibration.thickness  # a time of 0, from which the ticks are counted
        else:
            raise ValueError(
                f"quantisation by a clock needs an array of times, and the array's signal is "
                f"{calibration.signal}; expected bits"
            )

        def apply(touch: SimulatedTouch, state: None) -> None:
            touch.reading = whole + step * np.rint((touch.reading - whole) * (1.0 / step))

        return Stage(apply, noise=step / math.sqrt(12.0))
