"""Taxels that have broken, and stay so."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np

from palpate.core.plugins import Range, check_ranges
from palpate.core.touch.pipeline import Fingertip, KeyedRandom, Phase, SimulatedTouch, Stage


@dataclass(frozen=True, slots=True, kw_only=True)
class DeadTaxels:
    """Some taxels always read 0, others always the same wrong value, drawn once for the finger.

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
