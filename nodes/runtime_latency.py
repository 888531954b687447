"""How long a node's handlers take: quantiles over a whole run in a fixed amount of memory."""

from __future__ import annotations

import math

_STEP = math.log(1.05)
_BINS = 512


class Latency:
    """Counts durations in bins that grow by 5 %, so that a quantile is right to 2.5 %."""

    def __init__(self) -> None:
        self.count = 0
        """Durations counted so far."""
        self._bins = [0] * _BINS

    def add(self, nanoseconds: int) -> None:
        """Count one duration."""
        micro = nanoseconds * 1e-3
        place = int(math.log(micro) / _STEP) + 1 if micro > 1.0 else 0
        self._bins[min(place, _BINS - 1)] += 1
        self.count += 1

    def quantile(self, share: float) -> float:
        """Duration that this share of all stays below, us; 0 if there is none yet."""
        rest = share * self.count
        for place, number in enumerate(self._bins):
            rest -= number
            if number and rest <= 0:
                return math.exp((place - 0.5) * _STEP)
        return 0.0
