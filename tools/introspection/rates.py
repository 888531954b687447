"""How often and how much publishers send, and how long it takes to arrive.

Copies may be lost on the way to a tool. The number and the time that a message carries are its
publisher's, so a lost one makes no rate wrong; arrival counts for delays alone. Printed as `ros2
topic` prints them.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from palpate.launch.processes import RunCard
from palpate.messages import HEADER_SIZE
from palpate.tools.introspection.topics import TapMessage, TapSubscription, Topic

PRINT_INTERVAL = 1.0  # Figures are printed this often, s
WINDOW = 10_000  # Messages over which a figure is taken, unless the user says otherwise


class RateMonitor:
    """Figures of some topics, each publisher by itself.

    `topics`: what is measured; `window`: messages over which a figure is taken; `say`: figures of
    one publisher to lines; `echo`: takes some lines.
    """

    def __init__(
        self, topics: Sequence[Topic], window: int, say: RateText, echo: Callable[[str], None]
    ) -> None:
        self._say, self._echo = say, echo
        self._rates = {(one.name, node): Rates(window) for one in topics for node in one.publishers}
        self._several = len(topics) > 1
        self._crowds = {one.name for one in topics if len(one.publishers) > 1}
        self._said: dict[tuple[str, str], int] = {}

    def run(self, card: RunCard, topics: Sequence[Topic], duration: float | None) -> None:
        """Measure until the graph ends, the time is over, or Ctrl-C."""
        with TapSubscription(card, topics) as hearing:
            due = time.monotonic() + PRINT_INTERVAL
            for batch in hearing.batches(duration):
                for heard in batch:
                    self._rates[heard.topic, heard.publisher].add(heard)
                if time.monotonic() >= due:
                    due += PRINT_INTERVAL
                    self.print(last=False)
        self.print(last=True)

    def print(self, *, last: bool) -> None:
        """Say what is new, and of what nothing comes; at the last only what was not printed."""
        for (topic, node), rates in self._rates.items():
            news = rates.last != self._said.get((topic, node))
            label = f"{topic} of {node}" if topic in self._crowds else topic
            text = self._say(rates) if news else None
            self._said[topic, node] = rates.last
            if text is not None:
                self._echo(f"{label}\n{text}" if self._several or self._crowds else text)
            elif not rates.heard and (news or not last):
                self._echo(f"no messages on {label}")
            elif news:
                self._echo(f"only one message on {label}")
            elif not last:
                self._echo(f"no new messages on {label}")


class Statistics(NamedTuple):
    """What some figures are like."""

    mean: float
    least: float
    most: float
    deviation: float  # Standard deviation


class Rates:
    """The last messages of one publisher on one topic.

    `window`: how many messages are looked at, at most; at least 2.
    """

    def __init__(self, window: int = WINDOW) -> None:
        self.last = -1
        """Number of the latest message; -1 before the first."""
        self._seqs: deque[int] = deque(maxlen=window)
        self._sent: deque[int] = deque(maxlen=window)
        self._came: deque[int] = deque(maxlen=window)
        self._sizes: deque[int] = deque(maxlen=window)

    def add(self, heard: TapMessage) -> None:
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
        self._sizes.append(len(heard.topic.encode()) + 1 + HEADER_SIZE + len(heard.body))

    @property
    def heard(self) -> int:
        """Messages in the window."""
        return len(self._seqs)

    @property
    def sent(self) -> int:
        """Messages that were sent within the window, received or not."""
        return self._seqs[-1] - self._seqs[0] + 1 if self._seqs else 0

    def rate(self) -> float | None:
        """Messages a second, received or not; None of fewer than two."""
        if self.heard < 2:
            return None
        return (self._seqs[-1] - self._seqs[0]) / (1e-9 * (self._sent[-1] - self._sent[0]))

    def periods(self) -> Statistics | None:
        """Times between neighbouring messages, s; None if no two neighbours were received."""
        times = np.diff(np.array(self._sent, np.int64))
        next_to = np.diff(np.array(self._seqs, np.int64)) == 1
        return statistics_of(1e-9 * times[next_to]) if next_to.any() else None

    def sizes(self) -> Statistics | None:
        """Sizes of the frames on the wire, bytes; None before the first."""
        return statistics_of(np.array(self._sizes, float)) if self._sizes else None

    def delays(self) -> Statistics | None:
        """Times from sending to the tool's taking, s; None before the first."""
        if not self._sent:
            return None
        return statistics_of(
            1e-9 * (np.array(self._came, np.int64) - np.array(self._sent, np.int64))
        )

    def bandwidth(self) -> float | None:
        """Bytes a second, what was not received taken for as large as the rest; or None."""
        rate, sizes = self.rate(), self.sizes()
        return None if rate is None or sizes is None else rate * sizes.mean


def statistics_of(values: np.ndarray[Any, np.dtype[np.floating[Any]]]) -> Statistics:
    """Mean, extremes and standard deviation of at least one value."""
    return Statistics(
        float(values.mean()), float(values.min()), float(values.max()), float(values.std())
    )


def rate_text(rates: Rates) -> str | None:
    """How often it sends."""
    rate, periods = rates.rate(), rates.periods()
    if rate is None:
        return None
    text = f"average rate: {rate:.3f}"
    if periods is None:
        return f"{text}\n\tno two neighbouring messages came {_window(rates)}"
    return (
        f"{text}\n\tmin: {periods.least:.6f}s max: {periods.most:.6f}s "
        f"std dev: {periods.deviation:.6f}s {_window(rates)}"
    )


def bandwidth_text(rates: Rates) -> str | None:
    """How much it sends."""
    bandwidth, sizes = rates.bandwidth(), rates.sizes()
    if bandwidth is None or sizes is None:
        return None
    mean, least, most = (_bytes(size) for size in sizes[:3])
    return (
        f"{_bytes(bandwidth)}/s from {rates.heard} messages\n"
        f"\tMessage size mean: {mean} min: {least} max: {most} {_window(rates)}"
    )


def _bytes(size: float) -> str:
    for unit, name in ((1e6, "MB"), (1e3, "KB")):
        if size >= unit:
            return f"{size / unit:.2f} {name}"
    return f"{size:.0f} B"


def delay_text(rates: Rates) -> str | None:
    """How long its messages are on their way to the tool."""
    delays = rates.delays()
    if delays is None:
        return None
    return (
        f"average delay: {delays.mean:.6f}\n\tmin: {delays.least:.6f}s max: {delays.most:.6f}s "
        f"std dev: {delays.deviation:.6f}s {_window(rates)}"
    )


def _window(rates: Rates) -> str:
    missed = rates.sent - rates.heard
    return f"window: {rates.heard}" + (f" ({missed} sent, but not received)" if missed else "")


# Some lines about one publisher; None if too little has come to say anything.
RateText = Callable[[Rates], str | None]
