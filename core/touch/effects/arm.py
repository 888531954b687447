"""Effects of the arm: errors of its pose, backlash and compliance.

Of all effects, they limit the accuracy of a contour most.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, ClassVar

from palpate.core.arrays import Floats
from palpate.core.plugins import Range, Ranged
from palpate.core.touch.pipeline import Fingertip, KeyedRandom, Phase, SimulatedTouch, Stage


@dataclass(frozen=True, slots=True, kw_only=True)
class PoseError(Ranged):
    """The arm is not quite where its encoders say.

    A shift and a turn of the pad, ``T <- T (b + s, exp(w))``, drawn afresh for each touch.

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
            touch.actual = touch.actual.turned(shift, [rotation * angle for angle in turn])

        return Stage(apply)


@dataclass(frozen=True, slots=True, kw_only=True)
class ArmBacklash(Ranged):
    """Play in the arm's gears: where the pad stands depends on where it came from.

    The play operator on each world axis, ``y <- max(x - b/2, min(x + b/2, y))``.

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
        """The stage for one finger; its state is the pad's last start, (3,) [m]."""
        half = 0.5 * self.width

        def apply(touch: SimulatedTouch, state: Floats | None) -> Floats:
            wanted = touch.actual.position
            if state is None:
                return wanted
            start = state.clip(wanted - half, wanted + half)
            touch.actual = touch.actual._replace(position=start)
            return start

        return Stage(apply)


@dataclass(frozen=True, slots=True, kw_only=True)
class ArmCompliance(Ranged):
    """The arm bends under the force of a touch, and its encoders do not see it.

    The arm advances by ``F / k`` after the pad has stopped, along the pad's own z axis.

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
        deflection_per_pressure = finger.pad.pitch**2 / self.stiffness

        def apply(touch: SimulatedTouch, state: None) -> None:
            deflection = deflection_per_pressure * float(touch.pressure.sum())
            touch.believed = touch.believed.advanced(deflection)

        return Stage(apply)
