"""Effects of electronics and transport: gains, drift, noise, dead taxels, steps, late frames.

Constant patterns are drawn once for a finger, noise anew for each touch.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.plugins import Range, Ranged, check_ranges
from palpate.core.touch.pipeline import Fingertip, KeyedRandom, Phase, SimulatedTouch, Stage


@dataclass(frozen=True, slots=True, kw_only=True)
class GainOffset(Ranged):
    """No two taxels are alike.

    A gain and an offset of each taxel, ``v <- (1 + g) v + o``, drawn once for the finger.

    ``g ~ N(0, sigma_gain^2)`` and ``o ~ N(0, sigma_offset^2)``. Engineering values of an array that
    was not calibrated; a calibration removes most of both. They matter as a pattern that stays the
    same in every frame, and that no average over touches removes.
    """

    phase: ClassVar = Phase.SIGNAL

    # Standard deviation of the gain about 1.
    sigma_gain: Annotated[float, Range(0.0, 0.3, "1")] = 0.03
    # Standard deviation of the offset.
    sigma_offset: Annotated[float, Range(0.0, 1e-3, "m")] = 10e-6

    def prepare(self, finger: Fingertip) -> Stage:
        """The stage for one finger."""
        drawn = KeyedRandom(finger, "gain_offset").once()
        drawn_gain, drawn_offset = drawn.standard_normal((2, finger.pad.rows, finger.pad.cols))
        gain, offset = 1.0 + self.sigma_gain * drawn_gain, self.sigma_offset * drawn_offset

        def apply(touch: SimulatedTouch, state: None) -> None:
            touch.reading = gain * touch.reading + offset

        return Stage(apply)


@dataclass(frozen=True, slots=True, kw_only=True)
class Drift(Ranged):
    """The zero of each taxel wanders.

    A random walk of each taxel's zero, ``o <- o + N(0, rate^2 dt)``, from 0 on.

    ``dt`` is the robot time since the touch before, so after ``t`` seconds the zero has a standard
    deviation of ``rate sqrt(t)``, however many touches there were. An engineering value: 17 um in
    five minutes. It matters in long runs without a new zero.
    """

    phase: ClassVar = Phase.SIGNAL

    # Standard deviation of the zero after one second.
    rate: Annotated[float, Range(0.0, 1e-4, "m/sqrt(s)")] = 1e-6

    def prepare(self, finger: Fingertip) -> Stage:
        """The stage for one finger; its state is the time of a touch [s] and the zeros [m]."""
        draws, rate = KeyedRandom(finger, "drift"), self.rate
        size = (finger.pad.rows, finger.pad.cols)

        def apply(touch: SimulatedTouch, state: tuple[float, Floats]) -> tuple[float, Floats]:
            before, zeros = state
            step = rate * math.sqrt(touch.time - before)
            zeros = zeros + step * draws.of_touch(touch.number).standard_normal(size)
            touch.reading = touch.reading + zeros
            return touch.time, zeros

        return Stage(apply, (0.0, np.zeros(size)))


@dataclass(frozen=True, slots=True, kw_only=True)
class GaussianNoise(Ranged):
    """Noise of the electronics: jitter of the echo's arrival.

    White normal noise, ``v + N(0, sigma^2)``: independent in each taxel and touch.

    A jitter of the time of flight of ``s`` seconds is a noise of ``v s / 2`` metres: 20 ns, an
    array of the 1990s, are 10 um at 1000 m/s; 2 ns, a modern one, 1 um. Both are engineering
    values; the jitter of an echo goes as 1 / (2 pi f sqrt(SNR)).
    """

    phase: ClassVar = Phase.SIGNAL

    # Standard deviation of one taxel's reading.
    sigma: Annotated[float, Range(0.0, 1e-3, "m")] = 10e-6

    def prepare(self, finger: Fingertip) -> Stage:
        """The stage for one finger."""
        draws, sigma = KeyedRandom(finger, "gaussian_noise"), self.sigma
        shape = (finger.pad.rows, finger.pad.cols)

        def apply(touch: SimulatedTouch, state: None) -> None:
            noise = draws.of_touch(touch.number).standard_normal(shape)
            touch.reading = touch.reading + sigma * noise

        return Stage(apply, noise=sigma)


@dataclass(frozen=True, slots=True, kw_only=True)
class SaltAndPepper(Ranged):
    """Now and then a taxel reads nothing, or everything.

    Impulses: with probability ``rate`` a taxel reads 0 or full scale, either as likely.

    Full scale is the compression at which the pad bottoms. Independent in each taxel and touch. An
    engineering value for lost and false echoes. It is the noise that the median filter is for
    (Fung, 1999, 3.4.2); a single impulse that is taken for the surface is an error of millimetres.
    """

    phase: ClassVar = Phase.SIGNAL

    # Probability for one taxel in one touch: two or three of 256.
    rate: Annotated[float, Range(0.0, 1.0, "1")] = 0.01

    def prepare(self, finger: Fingertip) -> Stage:
        """The stage for one finger."""
        pad, draws, rate = finger.pad, KeyedRandom(finger, "salt_and_pepper"), self.rate
        size, full_scale = (pad.rows, pad.cols), pad.saturation * pad.thickness

        def apply(touch: SimulatedTouch, state: None) -> None:
            drawn = draws.of_touch(touch.number).random(size)
            struck = (drawn < rate).nonzero()
            reading = touch.reading.copy()
            reading[struck] = np.where(drawn[struck] < 0.5 * rate, 0.0, full_scale)
            touch.reading = reading

        return Stage(apply)


@dataclass(frozen=True, slots=True, kw_only=True)
class DeadTaxels:
    """Taxels that have broken, and stay so.

    Some taxels always read 0, others always the same wrong value, drawn once for the finger.

    Each taxel is dead with probability ``rate`` or stuck with probability ``stuck``; a stuck one
    reads a value from 0 to full scale, at which the pad bottoms. Engineering values. Single dead
    taxels are bridged by their neighbours; clusters, and stuck ones, are not.
    """

    phase: ClassVar = Phase.SIGNAL

    # Probability that a taxel is dead: two or three of 256.
    rate: Annotated[float, Range(0.0, 1.0, "1")] = 0.01
    # Probability that it is stuck; most faults are broken wires, which read 0.
    stuck: Annotated[float, Range(0.0, 1.0, "1")] = 0.0

    def __post_init__(self) -> None:
        check_ranges(self)
        if self.rate + self.stuck > 1.0:
            both = self.rate + self.stuck
            raise ValueError(f"rate and stuck are {both:g} together; expected 0 to 1")

    def prepare(self, finger: Fingertip) -> Stage:
        """The stage for one finger."""
        pad, rate, stuck = finger.pad, self.rate, self.stuck
        fate, level = KeyedRandom(finger, "dead_taxels").once().random((2, pad.rows, pad.cols))
        works = fate >= rate + stuck
        level = np.where(fate < rate, 0.0, pad.saturation * pad.thickness * level)

        def apply(touch: SimulatedTouch, state: None) -> None:
            touch.reading = np.where(works, touch.reading, level)

        return Stage(apply)


@dataclass(frozen=True, slots=True, kw_only=True)
class Quantisation:
    """Electronics count: a time in ticks of a clock, a force in steps of a converter.

    Readings are rounded to whole steps.

    A clock of ``f`` Hz times the echo, so what is left of the thickness is rounded to ``v / (2
    f)``, (1.1). A converter of ``n`` bits rounds the compression to ``D / 2^n``, its full scale
    being the thickness. Either adds an error of ``step / sqrt(12)`` (Widrow, 1956), as long as the
    noise before it is not much smaller than a step. Give one of the two; with neither it is a clock
    of 100 MHz.
    """

    phase: ClassVar = Phase.SIGNAL
    # [Hz] without a clock or bits: 5 um at 1000 m/s. 20 MHz, of the 1990s, are 25 um.
    default_clock: ClassVar = 100e6

    # Frequency of the clock that counts the time of flight.
    clock: Annotated[float | None, Range(1e5, 1e12, "Hz")] = None
    bits: Annotated[int | None, Range(1, 32, "1")] = None  # Bits of the converter

    def __post_init__(self) -> None:
        check_ranges(self)
        if self.clock is not None and self.bits is not None:
            raise ValueError(
                f"clock is {self.clock:g} Hz and bits is {self.bits}; expected one of the two"
            )

    def prepare(self, finger: Fingertip) -> Stage:
        """The stage for one finger. Raises ValueError for a clock if the array sends no times."""
        calibration = finger.calibration
        if self.bits is not None:
            step, whole = calibration.thickness / 2**self.bits, 0.0
        elif calibration.signal == "time":
            step = calibration.sound_speed / (2.0 * (self.clock or self.default_clock))
            whole = calibration.thickness  # at a time of 0, from which ticks are counted
        else:
            raise ValueError(
                f"quantisation by a clock needs an array of times, and the array's signal is "
                f"{calibration.signal}; expected bits"
            )

        def apply(touch: SimulatedTouch, state: None) -> None:
            touch.reading = whole + step * np.rint((touch.reading - whole) * (1.0 / step))

        return Stage(apply, noise=step / math.sqrt(12.0))


@dataclass(frozen=True, slots=True, kw_only=True)
class Transport(Ranged):
    """The line from the fingertip: late, lossy, and sometimes a frame comes twice.

    A frame takes ``latency``; a lost one is asked for again after ``timeout``.

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
