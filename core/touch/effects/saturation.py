"""A taxel that is pressed too hard reads no more than that."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np

from palpate.core.plugins import Range, Ranged
from palpate.core.touch.pipeline import Fingertip, Phase, SimulatedTouch, Stage


@dataclass(frozen=True, slots=True, kw_only=True)
class Saturation(Ranged):
    """Compression and pressure are clipped, ``c <- min(c, share D)``, and the touch bottomed.

    The pad's own saturation, which every finger has, stops the move; this is the limit of what the
    array can follow, and may lie below it. The pressure falls in the same proportion as the
    compression. An engineering value. It matters where a press is deep: on corners, which lose
    their tips, and after a wrong guess of the surface.
    """

    phase: ClassVar = Phase.PAD

    # Largest compression that is measured, as a share of the thickness: rubber cannot be squeezed
    # to nothing.
    share: Annotated[float, Range(0.1, 0.95, "1")] = 0.8

    def prepare(self, finger: Fingertip) -> Stage:
        """The stage for one finger."""
        limit = self.share * finger.pad.thickness

        def apply(touch: SimulatedTouch, state: None) -> None:
            compression = touch.compression
            if compression.max() <= limit:
                return
            touch.pressure = touch.pressure * (limit / np.maximum(compression, limit))
            touch.compression = np.minimum(compression, limit)
            if touch.outcome == "hit":
                touch.outcome = "bottomed"

        return Stage(apply)
