"""The line from the fingertip: late, lossy, and sometimes a frame comes twice."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, ClassVar

from palpate.core.plugins import Range, Ranged
from palpate.core.touch.pipeline import Fingertip, KeyedRandom, Phase, SimulatedTouch, Stage


@dataclass(frozen=True, slots=True, kw_only=True)
class Transport(Ranged):
    """A frame takes ``latency``; a lost one is asked for again after ``timeout``.

    Reads are repeated, not touches: the finger stays where it is until a frame has arrived, and
    every frame of a touch is the same. Losses are independent, so their number is geometric, ``P(n)
    = drop^n (1 - drop)``. A frame may also arrive twice; its copies bear the same number, and a
    subscriber must take only one. Engineering values of a serial line. It costs robot time and no
    accuracy: that the pad creeps on while a frame is waited for is left out.
    """

    phase: ClassVar = Phase.LINK

    # From the frame's being taken to its arrival: 256 pings of 20 us, one after the other.
    latency: Annotated[float, Range(0.0, 10.0, "s")] = 0.005
    drop: Annotated[float, Range(0.0, 0.9, "1")] = 0.01  # Probability that a frame is lost
    timeout: Annotated[float, Range(0.0, 60.0, "s")] = 0.1  # How long a frame is waited for
    # Probability that a frame arrives twice.
    duplicate: Annotated[float, Range(0.0, 1.0, "1")] = 0.01

    def prepare(self, finger: Fingertip) -> Stage:
        """The stage for one finger."""
        draws, latency, timeout = KeyedRandom(finger, "transport"), self.latency, self.timeout
        duplicate = self.duplicate
        per_loss = 1.0 / math.log(self.drop) if self.drop > 0.0 else 0.0

        def apply(touch: SimulatedTouch, state: None) -> None:
            loss, twice = draws.of_touch(touch.number).random(2).tolist()
            # The largest n with 1 - loss <= drop^n: geometric, by one draw for any number.
            lost = int(math.log1p(-loss) * per_loss)
            touch.time += latency + lost * timeout
            touch.copies = 2 if twice < duplicate else 1

        return Stage(apply)
