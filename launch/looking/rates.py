"""How often and how much a publisher sends: by its own numbers and times, never by arrival.

Copies may be lost on the way to a tool. The number and the time that a message carries are its
publisher's, so a lost one makes no rate wrong.
"""

from __future__ import annotations

from collections import deque
from typing import Any, NamedTuple

import numpy as np

from palpate.launch.looking.hearing import Heard
from palpate.messages.header import SIZE

WINDOW = 10_000
"""Messages over which a figure is taken, unless the user says otherwise."""


class Spread(NamedTuple):
    """What some figures are like."""

    mean: float
    least: float
    most: float
    deviation: float
    """Standard deviation."""


class Rates:
    """The last messages of one publisher on one topic.

    Parameters
    ----------
    window : int
        How many messages are looked at, at most; at least 2.
    """

    def __init__(self, window: int = WINDOW) -> None:
        self.last = -1
        """Number of the latest message; -1 before the first."""
        self._seqs: deque[int] = deque(maxlen=window)
        self._sent: deque[int] = deque(maxlen=window)
        self._came: deque[int] = deque(maxlen=window)
        self._sizes: deque[int] = deque(maxlen=window)

    def add(self, heard: Heard) -> None:
        """Take note of a message; they come in the order of their numbers."""
        header = heard.header
        if self._seqs and header.seq <= self._seqs[-1]:
            # A node that was started again counts what it says of itself from 0 once more.
            for kept in (self._seqs, self._sent, self._came, self._sizes):
                kept.clear()
        self.last = header.seq
        self._seqs.append(header.seq)
        self._sent.append(header.sent_ns)
        self._came.append(heard.came_ns)
        self._sizes.append(len(heard.topic.encode()) + 1 + SIZE + len(heard.body))

    @property
    def heard(self) -> int:
        """Messages in the window."""
        return len(self._seqs)

    @property
    def sent(self) -> int:
        """Messages that were sent within the window, heard or not."""
        return self._seqs[-1] - self._seqs[0] + 1 if self._seqs else 0

    def rate(self) -> float | None:
        """Messages a second, heard or not; None of fewer than two."""
        if self.heard < 2:
            return None
        return (self._seqs[-1] - self._seqs[0]) / (1e-9 * (self._sent[-1] - self._sent[0]))

    def periods(self) -> Spread | None:
        """Times between neighbouring messages, s; None if no two neighbours were heard."""
        times = np.diff(np.array(self._sent, np.int64))
        next_to = np.diff(np.array(self._seqs, np.int64)) == 1
        return spread(1e-9 * times[next_to]) if next_to.any() else None

    def sizes(self) -> Spread | None:
        """Sizes of the frames on the wire, bytes; None before the first."""
        return spread(np.array(self._sizes, float)) if self._sizes else None

    def delays(self) -> Spread | None:
        """Times from sending to the tool's taking, s; None before the first."""
        if not self._sent:
            return None
        return spread(1e-9 * (np.array(self._came, np.int64) - np.array(self._sent, np.int64)))

    def bandwidth(self) -> float | None:
        """Bytes a second, those that were not heard taken for as large as the others; or None."""
        rate, sizes = self.rate(), self.sizes()
        return None if rate is None or sizes is None else rate * sizes.mean


def spread(values: np.ndarray[Any, np.dtype[np.floating[Any]]]) -> Spread:
    """Mean, extremes and standard deviation of at least one value."""
    return Spread(
        float(values.mean()), float(values.min()), float(values.max()), float(values.std())
    )
