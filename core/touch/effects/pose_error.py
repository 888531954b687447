"""The arm is not quite where its encoders say."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.plugins import Range, check_ranges
from palpate.core.touch.pipeline import Fingertip, KeyedRandom, Phase, SimulatedTouch, Stage


@dataclass(frozen=True, slots=True, kw_only=True)
class PoseError:
    """A shift and a turn of the pad, ``T <- T (b + s, exp(w))``, drawn afresh for each touch.

    Shift ``s ~ N(0, sigma^2)`` and turn ``w ~ N(0, rotation^2)`` on each axis of the pad's own
    frame, about the middle of its face, which therefore moves by ``s`` alone. The bias ``b``
    stays for the whole run, as that of a wrongly measured fingertip does. The exponential of
    the turn is exact. Engineering values of an arm of the PUMA's class; this is what limits
    the accuracy of a contour, long before the array does.
    """

    phase: ClassVar = Phase.AIM

    # Standard deviation of the shift on each axis: repeatability of an industrial arm.
    sigma: Annotated[float, Range(0.0, 5e-3, "m")] = 0.1e-3
    # Standard deviation of the turn about each axis: 0.1 mm over an arm's last link.
    rotation: Annotated[float, Range(0.0, 10.0, "deg")] = 0.05
    # Standard deviation, on each axis, of the shift that is drawn once; 0 for a fingertip whose
    # place on the arm is known.
    bias: Annotated[float, Range(0.0, 5e-3, "m")] = 0.0

    def __post_init__(self) -> None:
        check_ranges(self)

    def prepare(self, finger: Fingertip) -> Stage:
        """The stage for one finger."""
        draws, sigma = KeyedRandom(finger, "pose_error"), self.sigma
        rotation = math.radians(self.rotation)
        bx, by, bz = (self.bias * draws.once().standard_normal(3)).tolist()

        def apply(touch: SimulatedTouch, state: None) -> None:
            sx, sy, sz, *turn = draws.of_touch(touch.number).standard_normal(6).tolist()
            shift = (bx + sigma * sx, by + sigma * sy, bz + sigma * sz)
            touch.actual = _moved(touch.actual, shift, [rotation * angle for angle in turn])

        return Stage(apply)


def _moved(pose: Floats, shift: tuple[float, float, float], turn: list[float]) -> Floats:
    """A pose shifted, and turned by a rotation vector, in its own frame."""
    px, py, pz, x, y, z, w = pose.tolist()
    a, b, c = shift
    # v + 2 q x (q x v + w v), the rotation of the shift by the quaternion.
    u, v, t = y * c - z * b + w * a, z * a - x * c + w * b, x * b - y * a + w * c
    position = (
        px + a + 2 * (y * t - z * v),
        py + b + 2 * (z * u - x * t),
        pz + c + 2 * (x * v - y * u),
    )
    angle = math.hypot(*turn)
    scale = math.sin(0.5 * angle) / angle if angle > 0.0 else 0.5
    a, b, c = (scale * part for part in turn)
    d = math.cos(0.5 * angle)
    turned = (
        w * a + x * d + y * c - z * b,
        w * b - x * c + y * d + z * a,
        w * c + x * b - y * a + z * d,
        w * d - x * a - y * b - z * c,
    )
    length = math.hypot(*turned)
    return np.array((*position, *(part / length for part in turned)))


EFFECT = PoseError
