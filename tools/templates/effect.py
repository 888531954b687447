"""Template of an effect: mains hum in the electronics. Adapt it.

List it in a scene, and start palpate in the folder of this file:

    effects:
      - template:Template: {size: 5.0e-6}

Other phases, and the fields of touches and fingers: `palpate.effects`. For random numbers use
`palpate.effects.KeyedRandom`: they depend only on this effect and on the number of the touch.
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

    size: Annotated[float, Range(0.0, 1e-3, "m")] = 5e-6  # amplitude, as compression
    frequency: Annotated[float, Range(0.0, 1e3, "Hz")] = 50.0

    def __post_init__(self) -> None:
        check_ranges(self)

    def prepare(self, finger: Fingertip) -> Stage:
        """The stage of a finger; called once, for everything that does not depend on a touch."""
        size, turning = self.size, 2.0 * math.pi * self.frequency

        def apply(touch: SimulatedTouch, state: None) -> None:
            # Called for all touches, also misses. Replace arrays, do not write into them. The
            # returned value is the state at the next touch.
            touch.reading = touch.reading + size * math.sin(turning * touch.time)

        return Stage(apply)
