"""Log scales: their ends and their round ticks, shared by text and charts."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

MIN_VALUE = 1e-9  # smaller values, which may be 0, are drawn here, in any unit
TICK_STEPS = ((1.0,), (1.0, 3.0), (1.0, 2.0, 5.0), (1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0),
         tuple(n / 2.0 for n in range(2, 20)))  # fmt: skip


class LogScale(NamedTuple):
    """A log scale from its lowest to its highest value."""

    low: float
    high: float

    def share(self, value: float) -> float:
        """Position of a value: 0 at the low end, 1 at the high end."""
        return math.log(max(value, MIN_VALUE) / self.low) / math.log(self.high / self.low)

    def ticks(self, max_ticks: int, min_gap: float = 0.6) -> list[float]:
        """At most `max_ticks` round values.

        Neighbours are at least `min_gap` apart, as a fraction of the scale over `max_ticks`.
        """
        powers = range(math.floor(math.log10(self.low)), math.ceil(math.log10(self.high)) + 1)
        best: list[float] = []
        for steps in TICK_STEPS:
            ticks = [step * 10.0**power for power in powers for step in steps]
            ticks = [value for value in ticks if self.low <= value <= self.high]
            if steps == TICK_STEPS[0]:
                best = ticks[:: math.ceil(len(ticks) / max_ticks) or 1]
            best = ticks if len(best) < len(ticks) <= max_ticks else best
        kept: list[float] = []
        for value in best:
            if not kept or self.share(value) - self.share(kept[-1]) >= min_gap / max_ticks:
                kept.append(value)
        return kept


def log_scale(values: Sequence[float], min_ratio: float = 1.5, margin: float = 1.12) -> LogScale:
    """A scale that contains all values.

    The extreme values differ by a factor of at least `min_ratio`, and lie a factor `margin` inside
    the ends of the scale.
    """
    low, high = (max(MIN_VALUE, pick(values)) for pick in (min, max))
    widening = math.sqrt(max(min_ratio / (high / low), 1.0)) * margin
    return LogScale(low / widening, high * widening)
