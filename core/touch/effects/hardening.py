"""Rubber stiffens as it is squeezed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np

from palpate.core.plugins import Range, Ranged
from palpate.core.touch.pipeline import Fingertip, Phase, SimulatedTouch, Stage

LARGEST_STRAIN = 0.98  # The law goes to infinity at a strain of 1, where nothing of the pad is left


@dataclass(frozen=True, slots=True, kw_only=True)
class Hardening(Ranged):
    """Pressure grows faster than (1.2) has it: ``p <- p (1 + h s^2 / (1 - s))``.

    ``s = c / D`` is the strain. The factor is 1 to first order and has its pole where the pad would
    have no thickness left. An engineering form: nearly linear below a strain of 0.3, as rubber is
    (Treloar, *The physics of rubber elasticity*, 1975), and steep above 0.7. Times of flight show
    it only through a compliant arm; forces show it directly.
    """

    phase: ClassVar = Phase.PAD

    # The factor ``h``: 1 adds half the pressure at a strain of one half.
    strength: Annotated[float, Range(0.0, 10.0, "1")] = 1.0

    def prepare(self, finger: Fingertip) -> Stage:
        """The stage for one finger."""
        strength, per_thickness = self.strength, 1.0 / finger.pad.thickness

        def apply(touch: SimulatedTouch, state: None) -> None:
            strain = np.minimum(touch.compression * per_thickness, LARGEST_STRAIN)
            touch.pressure = touch.pressure * (1.0 + strength * strain * strain / (1.0 - strain))

        return Stage(apply)
