"""The arm is not quite where its encoders say."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, ClassVar

from palpate.core.plugins import Range, Ranged
from palpate.core.poses import turned_pose
from palpate.core.touch.pipeline import Fingertip, KeyedRandom, Phase, SimulatedTouch, Stage


@dataclass(frozen=True, slots=True, kw_only=True)
class PoseError(Ranged):
    """A shift and a turn of the pad, ``T <- T (b + s, exp(w))``, drawn afresh for each touch.

    Shift ``s ~ N(0, sigma^2)`` and turn ``w ~ N(0, rotation^2)`` on each axis of the pad's own
    frame, about the middle of its face, which therefore moves by ``s`` alone. The bias ``b`` stays
    for the whole run, as that of a wrongly measured fingertip does. The exponential of the turn is
    exact. Engineering values of an arm of the PUMA's class; this is what limits the accuracy of a
    contour, long before the array does.
    """

    phase: ClassVar = Phase.AIM

    # Standard deviation of the shift on each axis: repeatability of an industrial arm.
    sigma: Annotated[float, Range(0.0, 5e-3, "m")] = 0.1e-3
    # Standard deviation of the turn about each axis: 0.1 mm over an arm's last link.
    rotation: Annotated[float, Range(0.0, 10.0, "deg")] = 0.05
    # Standard deviation, on each axis, of the shift that is drawn once; 0 for a fingertip whose
    # place on the arm is known.
    bias: Annotated[float, Range(0.0, 5e-3, "m")] = 0.0

    def prepare(self, finger: Fingertip) -> Stage:
        """The stage for one finger."""
        draws, sigma = KeyedRandom(finger, "pose_error"), self.sigma
        rotation = math.radians(self.rotation)
        bx, by, bz = (self.bias * draws.once().standard_normal(3)).tolist()

        def apply(touch: SimulatedTouch, state: None) -> None:
            sx, sy, sz, *turn = draws.of_touch(touch.number).standard_normal(6).tolist()
            shift = (bx + sigma * sx, by + sigma * sy, bz + sigma * sz)
            touch.actual = turned_pose(touch.actual, shift, [rotation * angle for angle in turn])

        return Stage(apply)
