"""Play in the arm's gears: where the pad stands depends on where it came from."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar

from palpate.core.arrays import Floats
from palpate.core.plugins import Range, Ranged
from palpate.core.touch.pipeline import Fingertip, Phase, SimulatedTouch, Stage


@dataclass(frozen=True, slots=True, kw_only=True)
class ArmBacklash(Ranged):
    """The play operator on each world axis, ``y <- max(x - b/2, min(x + b/2, y))``.

    ``x`` is where the arm goes, ``y`` where the pad starts: it stays behind by half the width, and
    does not move at all until the arm has turned back by the whole of it. The play begins in its
    middle. A rate-independent hysteresis: Visintin, *Differential models of hysteresis*, 1994. The
    approach itself is taken to be free of it: it always goes the same way, and takes up the same
    play. It matters where contours are traced to and fro.
    """

    phase: ClassVar = Phase.AIM

    # Way that the arm must turn back before the pad follows: an engineering value.
    width: Annotated[float, Range(0.0, 5e-3, "m")] = 0.05e-3

    def prepare(self, finger: Fingertip) -> Stage:
        """The stage for one finger; its state is where the pad last started, (3,), m."""
        half = 0.5 * self.width

        def apply(touch: SimulatedTouch, state: Floats | None) -> Floats:
            wanted = touch.actual[:3]
            if state is None:
                return wanted.copy()
            touch.actual = touch.actual.copy()
            touch.actual[:3] = state.clip(wanted - half, wanted + half)
            return touch.actual[:3].copy()

        return Stage(apply)
