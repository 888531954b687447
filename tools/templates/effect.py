"""Template of an effect: mains hum in the electronics. Make it yours.

List it in a scene, and start palpate in the folder of this file:

    effects:
      - template:Template: {size: 5.0e-6}

Other places to act in, what a touch holds and what a finger knows:
`palpate.effects`. For random numbers take
`palpate.effects.KeyedRandom`: they belong to this effect alone, and to the touch's number.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, ClassVar

from palpate.core.plugins import Range, check_ranges
from palpate.effects import Fingertip, Phase, SimulatedTouch, Stage


@dataclass(frozen=True, slots=True, kw_only=True)
class Template:
    """A hum, ``v + size sin(2 pi frequency t)``, the same in all taxels of a touch."""

    phase: ClassVar = Phase.SIGNAL

    size: Annotated[float, Range(0.0, 1e-3, "m")] = 5e-6  # Amplitude, as compression
    frequency: Annotated[float, Range(0.0, 1e3, "Hz")] = 50.0  # Frequency

    def __post_init__(self) -> None:
        check_ranges(self)

    def prepare(self, finger: Fingertip) -> Stage:
        """The stage for one finger: called once. What can be computed before is computed here."""
        size, turning = self.size, 2.0 * math.pi * self.frequency

        def apply(touch: SimulatedTouch, state: None) -> None:
            # Called for every touch, misses too. Replace arrays, do not write into them. What
            # has to be remembered until the next touch is returned, and comes back as state.
            touch.reading = touch.reading + size * math.sin(turning * touch.time)

        return Stage(apply)
