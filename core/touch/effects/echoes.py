"""Effects of the echoes: aperture of an element, temperature, lost echoes and crosstalk.

All but the first change the received reading, before the electronics do.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal, get_args

import numpy as np

from palpate.core.arrays import Bools, Floats
from palpate.core.plugins import Range, Ranged, check_ranges
from palpate.core.touch.pad import GuardedMove, Pad, TouchOutcome, started_inside
from palpate.core.touch.pipeline import Fingertip, Phase, SimulatedTouch, Stage, record_move

Reading = Literal["mean", "max"]  # of the compressions under an element


@dataclass(frozen=True, slots=True, kw_only=True)
class Aperture:
    """A taxel sees an area, not a point.

    Each element looks along a square grid of rays, and reports their mean or their largest.

    ``c = mean(max(a - g, 0))`` or ``max(max(a - g, 0))``, with the gaps ``g`` under its area and
    the way ``a``. The move stops when the deepest element reports the asked depth, or earlier, as
    bottomed, where the pad is pressed to its saturation at any ray. A touched element is indented
    by what it reports; a free one is as far away as its nearest ray. It matters for features
    smaller than the pitch, which a single ray sees wholly or not at all.
    """

    phase: ClassVar = Phase.CAST

    # Side of an element, as a share of the pitch: elements need a gap between them.
    width: Annotated[float, Range(0.05, 1.0, "1")] = 0.8
    # Rays along a side: three resolve details between two taxels, at the cost of nine casts.
    rays: Annotated[int, Range(2, 8, "1")] = 3
    # The echo of an element's whole area is nearest to its mean; the first echo to arrive is that
    # of its largest compression.
    reading: Reading = "mean"

    def __post_init__(self) -> None:
        check_ranges(self)
        if self.reading not in get_args(Reading):
            raise ValueError(f"reading is {self.reading!r}; expected mean or max")

    def prepare(self, finger: Fingertip) -> Stage:
        """The stage for one finger."""
        pad, mean = finger.pad, self.reading == "mean"
        origins = _origins(pad, self.width, self.rays)

        def apply(touch: SimulatedTouch, state: None) -> None:
            record_move(finger, touch, _press(pad, origins, touch, mean))

        return Stage(apply)


def _origins(pad: Pad, width: float, rays: int) -> Floats:
    """Origins of the rays in the pad's frame, (rows * cols * rays^2, 3) [m], element by element.

    The transducers follow the dome under every ray.
    """
    across = ((np.arange(rays) + 0.5) / rays - 0.5) * width * pad.pitch
    x, y = (axis[:, :, None, None] for axis in pad.grid())
    x, y = np.broadcast_arrays(x + across[None, :], y + across[:, None])
    z = -(pad.thickness + 0.5 * pad.dome * (x * x + y * y))
    return np.column_stack([x.ravel(), y.ravel(), z.ravel()])


def _press(pad: Pad, origins: Floats, touch: SimulatedTouch, mean: bool) -> GuardedMove:
    """The guarded move of `palpate.core.touch.guarded_move`, with elements for taxels."""
    size, limit = (pad.rows, pad.cols), pad.saturation * pad.thickness
    position, axes = touch.actual
    reach = pad.thickness + touch.reach + limit
    ranges = touch.shape.cast(origins @ axes.T + position, axes[:, 2], reach)
    gaps = ranges.reshape(pad.rows * pad.cols, -1) - pad.thickness
    first = gaps.min(axis=1)
    nearest = float(first.min())
    if nearest < 0.0:
        return started_inside(pad, touch.actual)
    demanded = _advance_to_mean(gaps, touch.depth) if mean else nearest + touch.depth
    outcome: TouchOutcome = "miss"
    advance = touch.reach
    if nearest <= touch.reach:
        outcome = "hit" if demanded <= nearest + limit else "bottomed"
        advance = min(demanded, nearest + limit)
    indentation = advance - first
    compression = np.maximum(indentation, 0.0)
    if mean:
        compression = np.maximum(advance - gaps, 0.0).mean(axis=1)
        indentation = np.where(indentation > 0.0, compression, indentation)
    end = touch.actual.advanced(advance)
    return GuardedMove(outcome, end, compression.reshape(size), advance, indentation.reshape(size))


def _advance_to_mean(gaps: Floats, depth: float) -> float:
    """Advance [m] at which the first element's mean compression is `depth`.

    A mean ``sum(max(a - g, 0)) / n`` is the largest of the lines ``(k a - g1 - ... - gk) / n`` over
    k, with the gaps in order; so the advance to `depth` is the smallest of theirs.
    """
    count = gaps.shape[1]
    sums = np.sort(gaps, axis=1).cumsum(axis=1)
    return float(((count * depth + sums) / np.arange(1, count + 1)).min())


@dataclass(frozen=True, slots=True, kw_only=True)
class Temperature(Ranged):
    """Sound is slower in a warm pad, and the decoder does not know.

    The speed of sound is ``v = v0 + a dT``, and ``dT = rise (1 - exp(-t / warm_up))``.

    The decoder keeps the nominal ``v0`` in (1.1): from an echo after ``2 (D - c) / v`` it takes ``D
    - (D - c) v0 / v``. If the undeformed pad was timed at the same temperature, the error of the
    thickness cancels and ``c v0 / v`` is left. Values of silicone rubber, as published for
    underwater acoustics. Without a new zero, 5 K are 46 um at 3 mm, the same on every taxel.
    """

    phase: ClassVar = Phase.ECHO

    # How much warmer than at its calibration the pad becomes: a room in the sun.
    rise: Annotated[float, Range(-40.0, 80.0, "K")] = 5.0
    # Time constant of the rise, from the beginning of the run; 0 if it happened before.
    warm_up: Annotated[float, Range(0.0, 1e5, "s")] = 0.0
    # Change of the speed of sound with temperature: -3 in silicone.
    coefficient: Annotated[float, Range(-10.0, 10.0, "m/s/K")] = -3.0
    # Whether the undeformed pad was timed again at the temperature of each touch.
    rezeroed: bool = False

    def prepare(self, finger: Fingertip) -> Stage:
        """The stage for one finger; ValueError without times, or if sound lost half its speed."""
        calibration = finger.calibration
        if calibration.signal != "time":
            raise ValueError(
                f"temperature changes the time of an echo, and the array's signal is "
                f"{calibration.signal}; expected time"
            )
        nominal, change = calibration.sound_speed, self.coefficient * self.rise
        if nominal + change <= 0.5 * nominal:
            raise ValueError(
                f"rise times coefficient is {change:g} m/s; expected more than "
                f"{-0.5 * nominal:g} m/s, half the speed of sound in the pad"
            )
        zero = 0.0 if self.rezeroed else calibration.thickness
        warm_up = self.warm_up

        def apply(touch: SimulatedTouch, state: None) -> None:
            warmed = -math.expm1(-touch.time / warm_up) if warm_up > 0.0 else 1.0
            ratio = nominal / (nominal + change * warmed)
            touch.reading = ratio * touch.reading + (1.0 - ratio) * zero

        return Stage(apply)


@dataclass(frozen=True, slots=True, kw_only=True)
class EchoLoss(Ranged):
    """A steep face throws the echo past the transducer.

    An echo of amplitude ``exp(-(theta / angle)^2)`` below the threshold is lost.

    ``theta`` is the slope of the pressed face against the undeformed one: central differences of
    the compression, one-sided at the border. Such a taxel reads as untouched, 0. The Gaussian
    stands for the main lobe of a transducer (Kinsler and others, *Fundamentals of acoustics*,
    2000); its width is an engineering value. It matters on corners, on edges and at the rim of
    strongly curved surfaces, which a real array may not see at all.
    """

    phase: ClassVar = Phase.ECHO

    # Slope at which the amplitude has fallen to 1/e: for elements of a few wavelengths.
    angle: Annotated[float, Range(1.0, 60.0, "deg")] = 15.0
    # Smallest amplitude that is received, as a share of a level face's: 20 dB down. 0 for all.
    threshold: Annotated[float, Range(0.0, 1.0, "1")] = 0.1

    def prepare(self, finger: Fingertip) -> Stage:
        """The stage for one finger. Raises ValueError if the array sends no times."""
        signal = finger.calibration.signal
        if signal != "time":
            raise ValueError(
                f"echo_loss is of arrays that listen to echoes, and the array's signal is "
                f"{signal}; expected time"
            )
        if self.threshold == 0.0:
            return Stage(_keep_all)
        steepest = math.radians(self.angle) * math.sqrt(-math.log(self.threshold))
        if steepest >= 0.5 * math.pi:
            return Stage(_keep_all)
        largest = (2.0 * finger.pad.pitch * math.tan(steepest)) ** 2

        def apply(touch: SimulatedTouch, state: None) -> None:
            lost = _steeper(touch.compression, largest)
            touch.reading = np.where(lost, 0.0, touch.reading)

        return Stage(apply)


def _keep_all(touch: SimulatedTouch, state: None) -> None:
    """No echo is lost, not even from a vertical face."""


def _steeper(height: Floats, largest: float) -> Bools:
    """Taxels where the squared difference over two taxels exceeds `largest`."""
    across, down = np.empty_like(height), np.empty_like(height)
    np.subtract(height[:, 2:], height[:, :-2], out=across[:, 1:-1])
    across[:, 0] = 2.0 * (height[:, 1] - height[:, 0])
    across[:, -1] = 2.0 * (height[:, -1] - height[:, -2])
    np.subtract(height[2:], height[:-2], out=down[1:-1])
    down[0] = 2.0 * (height[1] - height[0])
    down[-1] = 2.0 * (height[-1] - height[-2])
    steeper: Bools = across * across + down * down > largest
    return steeper


@dataclass(frozen=True, slots=True, kw_only=True)
class Crosstalk(Ranged):
    """Neighbouring elements pick up each other's signal.

    Each taxel takes a share of its four neighbours, ``v <- (1 - 4 a) v + a sum(neighbours)``.

    A taxel at the border has fewer neighbours, and keeps what it would have given to the others:
    ``(1 - 3 a) v`` or, in a corner, ``(1 - 2 a) v``. So a level field stays as it is and nothing is
    lost. An engineering value. It matters at edges, where it moves the border of the contact by
    some 10 um; smooth surfaces hardly show it.
    """

    phase: ClassVar = Phase.ECHO

    # The share ``a``: 30 dB between neighbours.
    share: Annotated[float, Range(0.0, 0.2, "1")] = 0.03

    def prepare(self, finger: Fingertip) -> Stage:
        """The stage for one finger."""
        share = self.share

        def apply(touch: SimulatedTouch, state: None) -> None:
            before = touch.reading
            mixed = before.copy()
            flow = share * (before[1:] - before[:-1])
            mixed[:-1] += flow
            mixed[1:] -= flow
            flow = share * (before[:, 1:] - before[:, :-1])
            mixed[:, :-1] += flow
            mixed[:, 1:] -= flow
            touch.reading = mixed

        return Stage(apply)
