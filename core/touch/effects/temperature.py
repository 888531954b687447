"""Sound is slower in a warm pad, and the decoder does not know."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, ClassVar

from palpate.core.plugins import Range, Ranged
from palpate.core.touch.pipeline import Fingertip, Phase, SimulatedTouch, Stage


@dataclass(frozen=True, slots=True, kw_only=True)
class Temperature(Ranged):
    """The speed of sound is ``v = v0 + a dT``, and ``dT = rise (1 - exp(-t / warm_up))``.

    The decoder goes on with the nominal ``v0`` in (1.1): from an echo after ``2 (D - c) / v`` it
    takes ``D - (D - c) v0 / v``. If the undeformed pad was timed at the same temperature, the error
    of the thickness cancels and ``c v0 / v`` is left. Values of silicone rubber, as published for
    underwater acoustics. Without a new zero, 5 K are 46 um at 3 mm, the same on every taxel.
    """

    phase: ClassVar = Phase.ECHO

    # How much warmer than at its calibration the pad becomes: a room in the sun.
    rise: Annotated[float, Range(-40.0, 80.0, "K")] = 5.0
    # Time constant of the rise, from the beginning of the run; 0 if it happened before.
    warm_up: Annotated[float, Range(0.0, 1e5, "s")] = 0.0
    # Change of the speed of sound with temperature: -3 in silicone.
    coefficient: Annotated[float, Range(-10.0, 10.0, "m/s/K")] = -3.0
    # Whether the undeformed pad was timed again at the temperature of each touch.
    rezeroed: bool = False

    def prepare(self, finger: Fingertip) -> Stage:
        """The stage for one finger.

        Raises ValueError if the array sends no times, or sound would lose half its speed or more.
        """
        calibration = finger.calibration
        if calibration.signal != "time":
            raise ValueError(
                f"temperature changes the time of an echo, and the array's signal is "
                f"{calibration.signal}; expected time"
            )
        nominal, change = calibration.sound_speed, self.coefficient * self.rise
        if nominal + change <= 0.5 * nominal:
            raise ValueError(
                f"rise times coefficient is {change:g} m/s; expected more than "
                f"{-0.5 * nominal:g} m/s, half the speed of sound in the pad"
            )
        zero = 0.0 if self.rezeroed else calibration.thickness
        warm_up = self.warm_up

        def apply(touch: SimulatedTouch, state: None) -> None:
            warmed = -math.expm1(-touch.time / warm_up) if warm_up > 0.0 else 1.0
            ratio = nominal / (nominal + change * warmed)
            touch.reading = ratio * touch.reading + (1.0 - ratio) * zero

        return Stage(apply)
