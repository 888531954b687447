"""How often and how much publishers send, and how long it takes to arrive.

Copies may be lost on the way to a tool. The number and the time that a message carries are its
publisher's, so a lost one makes no rate wrong; arrival counts for delays alone. Printed as by ros2.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from palpate.core import Floats
from palpate.launch.processes import RunCard
from palpate.messages import HEADER_SIZE
from palpate.tools.introspection.topics import TapMessage, TapSubscription, Topic

PRINT_INTERVAL = 1.0  # Figures are printed this often, s
Integers = NDArray[np.int64]
WINDOW = 10_000  # Messages over which a figure is taken, unless the user says otherwise


class RateMonitor:
    """Figures of some topics, each publisher by itself, over so many messages."""

    def __init__(
        self, topics: Sequence[Topic], window: int, say: RateText, echo: Callable[[str], None]
    ) -> None:
        self._say, self._echo = say, echo
        self._rates = {(one.name, node): Rates(window) for one in topics for node in one.publishers}
        self._several = len(topics) > 1
        self._crowds = {one.name for one in topics if len(one.publishers) > 1}
        self._printed: dict[tuple[str, str], int] = {}

    def run(self, card: RunCard, topics: Sequence[Topic], duration: float | None) -> None:
        """Measure until the graph ends, the time is over, or Ctrl-C."""
        with TapSubscription(card, topics) as taps:
            due = time.monotonic() + PRINT_INTERVAL
            for batch in taps.batches(duration):
                for received in batch:
                    self._rates[received.topic, received.publisher].add(received)
                if time.monotonic() >= due:
                    due += PRINT_INTERVAL
                    self.print(last=False)
        self.print(last=True)

    def print(self, *, last: bool) -> None:
        """Say what is new, and of what nothing comes; at the last only what was not printed."""
        for (topic, node), rates in self._rates.items():
            news = rates.last != self._printed.get((topic, node))
            label = f"{topic} of {node}" if topic in self._crowds else topic
            text = self._say(rates) if news else None
            self._printed[topic, node] = rates.last
            if text is not None:
                self._echo(f"{label}\n{text}" if self._several or self._crowds else text)
            elif not rates.received and (news or not last):
                self._echo(f"no messages on {label}")
            elif news:
                self._echo(f"only one message on {label}")
            elif not last:
                self._echo(f"no new messages on {label}")


class Statistics(NamedTuple):
    """What at least one figure is like."""

    mean: float
    least: float
    most: float
    deviation: float  # Standard deviation

    @classmethod
    def of(cls, values: Floats) -> Statistics:
        """Mean, extremes and standard deviation."""
        return cls(*(float(v) for v in (values.mean(), values.min(), values.max(), values.std())))


class Rates:
    """The last messages of one publisher on one topic: `window` at most, at least 2."""

    def __init__(self, window: int = WINDOW) -> None:
        self.last = -1
        """Number of the latest message; -1 before the first."""
        # Of each its number, when it was sent and when it came, ns, and its size, bytes.
        self._kept: deque[tuple[int, int, int, int]] = deque(maxlen=window)

    def add(self, received: TapMessage) -> None:
        """Take note of a message; they come in the order of their numbers."""
        header = received.header
        if header.seq <= self.last:
            # A node that was started again counts what it publishes of itself from 0 once more.
            self._kept.clear()
        self.last = header.seq
        size = len(received.topic.encode()) + 1 + HEADER_SIZE + len(received.body)
        self._kept.append((header.seq, header.sent_ns, received.came_ns, size))

    @property
    def received(self) -> int:
        """Messages in the window."""
        return len(self._kept)

    @property
    def sent(self) -> int:
        """Messages that were sent within the window, received or not."""
        return self._kept[-1][0] - self._kept[0][0] + 1 if self._kept else 0

    def rate(self) -> float | None:
        """Messages a second, received or not; None of fewer than two."""
        if self.received < 2:
            return None
        return (self.sent - 1) / (1e-9 * (self._kept[-1][1] - self._kept[0][1]))

    def periods(self) -> Statistics | None:
        """Times between neighbouring messages, s; None if no two neighbours were received."""
        steps = np.diff(self._columns()[:2])
        next_to = steps[0] == 1
        return Statistics.of(1e-9 * steps[1, next_to]) if next_to.any() else None

    def sizes(self) -> Statistics | None:
        """Sizes of the frames on the wire, bytes; None before the first."""
        return Statistics.of(self._columns()[3].astype(float)) if self._kept else None

    def delays(self) -> Statistics | None:
        """Times from sending to the tool's taking, s; None before the first."""
        _, sent, came, _ = self._columns()
        return Statistics.of(1e-9 * (came - sent)) if self._kept else None

    def bandwidth(self) -> float | None:
        """Bytes a second, what was not received taken for as large as the rest; or None."""
        rate, sizes = self.rate(), self.sizes()
        return None if rate is None or sizes is None else rate * sizes.mean

    def _columns(self) -> Integers:
        return np.array(self._kept, np.int64).reshape(-1, 4).T


def rate_text(rates: Rates) -> str | None:
    """How often it sends."""
    rate, periods = rates.rate(), rates.periods()
    if rate is None:
        return None
    if periods is None:
        missing = f"no two neighbouring messages came {_window(rates)}"
        return f"average rate: {rate:.3f}\n\t{missing}"
    return f"average rate: {rate:.3f}\n\t{_times(periods, rates)}"


def bandwidth_text(rates: Rates) -> str | None:
    """How much it sends."""
    bandwidth, sizes = rates.bandwidth(), rates.sizes()
    if bandwidth is None or sizes is None:
        return None
    mean, least, most = (_bytes(size) for size in sizes[:3])
    return (
        f"{_bytes(bandwidth)}/s from {rates.received} messages\n"
        f"\tMessage size mean: {mean} min: {least} max: {most} {_window(rates)}"
    )


def _bytes(size: float) -> str:
    for unit, name in ((1e6, "MB"), (1e3, "KB")):
        if size >= unit:
            return f"{size / unit:.2f} {name}"
    return f"{size:.0f} B"


def delay_text(rates: Rates) -> str | None:
    """How long its messages are on their way to the tool."""
    if (delays := rates.delays()) is None:
        return None
    return f"average delay: {delays.mean:.6f}\n\t{_times(delays, rates)}"


def _times(times: Statistics, rates: Rates) -> str:
    spread = f"min: {times.least:.6f}s max: {times.most:.6f}s std dev: {times.deviation:.6f}s"
    return f"{spread} {_window(rates)}"


def _window(rates: Rates) -> str:
    missed = rates.sent - rates.received
    return f"window: {rates.received}" + (f" ({missed} sent, but not received)" if missed else "")


RateText = Callable[[Rates], str | None]  # Lines about one publisher; None if too little has come
