"""The arm bends under the force of a touch, and its encoders do not see it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar

from palpate.core.plugins import Range, Ranged
from palpate.core.poses import advanced_pose
from palpate.core.touch.pipeline import Fingertip, Phase, SimulatedTouch, Stage


@dataclass(frozen=True, slots=True, kw_only=True)
class ArmCompliance(Ranged):
    """The arm goes on by ``F / k`` after the pad has stopped, along the pad's own z axis.

    The move is stopped by the compression of the pad, so the touch itself is as it would be with a
    stiff arm; but the encoders say that the pad went farther than it did. The force ``F`` is the
    sum of the pressures. It matters for hard pads and weak arms: all errors point into the object,
    so that it is rebuilt too thin.
    """

    phase: ClassVar = Phase.ARM

    # Of the arm at the fingertip: an engineering value for a light arm.
    stiffness: Annotated[float, Range(1e3, 1e8, "N/m")] = 20e3

    def prepare(self, finger: Fingertip) -> Stage:
        """The stage for one finger."""
        way_per_pressure = finger.pad.pitch**2 / self.stiffness

        def apply(touch: SimulatedTouch, state: None) -> None:
            bent = way_per_pressure * float(touch.pressure.sum())
            touch.believed = advanced_pose(touch.believed, bent)

        return Stage(apply)
