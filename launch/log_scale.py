"""Log scales: their ends and their round ticks, the same in text and in charts."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

MIN_VALUE = 1e-9  # smaller values are drawn here, in any unit
MIN_SPAN = 1.5  # highest over lowest value of a scale
FREE_ENDS = 1.12  # factor between the extreme values and the ends of their scale
MIN_TICK_GAP = 0.6  # of the mean distance of the largest number of ticks
STEPS = ((1.0,), (1.0, 3.0), (1.0, 2.0, 5.0), (1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0),
         tuple(n / 2.0 for n in range(2, 20)))  # fmt: skip


class LogScale(NamedTuple):
    """A log scale from its lowest to its highest value."""

    low: float
    high: float

    def share(self, value: float) -> float:
        """Where a value lies: 0 at the low end, 1 at the high one."""
        return math.log(max(value, MIN_VALUE) / self.low) / math.log(self.high / self.low)

    def ticks(self, most: int) -> list[float]:
        """As many round values as there may be, none too near to its neighbour."""
        powers = range(math.floor(math.log10(self.low)), math.ceil(math.log10(self.high)) + 1)
        best: list[float] = []
        for steps in STEPS:
            found = [step * 10.0**power for power in powers for step in steps]
            found = [value for value in found if self.low <= value <= self.high]
            if steps == STEPS[0]:
                best = found[:: math.ceil(len(found) / most) or 1]
            best = found if len(best) < len(found) <= most else best
        kept: list[float] = []
        for value in best:
            if not kept or self.share(value) - self.share(kept[-1]) >= MIN_TICK_GAP / most:
                kept.append(value)
        return kept


def log_scale(values: Sequence[float]) -> LogScale:
    """The scale on which all values have room."""
    low, high = (max(MIN_VALUE, pick(values)) for pick in (min, max))
    widen = math.sqrt(max(MIN_SPAN / (high / low), 1.0)) * FREE_ENDS
    return LogScale(low / widen, high * widen)
