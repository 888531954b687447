"""The topics of a running graph, copies of their messages, and their rates and delays.

Copies may be lost on the way to a tool, but never delay a node. A message carries the number and
time of its publisher, so lost copies do not change a rate; only delays depend on the arrival.
Output has the form of that of ros2.
"""

from __future__ import annotations

import json
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import zmq
from numpy.typing import NDArray

from palpate.core.arrays import Floats
from palpate.launch.files.source_map import hint
from palpate.launch.processes.fork_server import until_ctrl_c
from palpate.launch.processes.registry import RunCard, running_graphs
from palpate.messages import HEADER_SIZE, Header, codec_of, decode, type_of_schema
from palpate.messages.bus import LAUNCHER, LOG_TOPIC, STATUS_TOPIC, SocketContext, TapReader
from palpate.messages.types import TYPES, LogRecord, NodeStatus

# Topics on which all nodes report their own state to the launcher.
STATUS_TOPICS = {STATUS_TOPIC: NodeStatus, LOG_TOPIC: LogRecord}
Integers = NDArray[np.int64]


@dataclass(frozen=True, slots=True, kw_only=True)
class TapSettings:
    """How a tool receives copies of the messages of a graph."""

    queue_length: int = 1000  # copies from one node that wait for the tool; beyond it they are lost
    batch: int = 256  # most copies taken from a node before the next node's turn
    tick: float = 0.1  # [s] between two batches
    alive_interval: float = 0.5  # [s] between two checks whether the graph still runs


TAPS = TapSettings()


class TapMessage(NamedTuple):
    """One copy of a message."""

    topic: str
    publisher: str  # name of the node that sent it
    header: Header
    body: bytes
    lost: int  # messages of this publisher and topic that were sent since the last copy, and lost
    came_ns: int  # monotonic clock when the tool took it [ns]


class SequenceTracker:
    """Counts missing messages of one publisher on one topic.

    `anew`: whether a restarted publisher counts from 0, else it repeats its messages and continues.
    """

    def __init__(self, *, anew: bool) -> None:
        self._anew = anew
        self._epoch, self._seq = -1, -1

    def place(self, header: Header) -> int | None:
        """Number of messages missing before this one; None if it is a repetition."""
        if header.epoch < self._epoch:
            return None
        if self._seq < 0 or (self._anew and header.epoch > self._epoch):
            self._seq = header.seq - 1
        self._epoch = header.epoch
        if header.seq <= self._seq:
            return None
        missing, self._seq = header.seq - self._seq - 1, header.seq
        return missing


class TapSubscription:
    """Copies of messages of a running graph on some topics.

    `latched`: whether latched messages from before are received as well.
    """

    def __init__(
        self,
        card: RunCard,
        topics: Iterable[Topic],
        *,
        latched: bool = False,
        settings: TapSettings = TAPS,
    ) -> None:
        self._card, self._settings = card, settings
        self._run = int(card.run, 16)
        self._sockets = SocketContext(card.key)
        self._interrupts = ExitStack()
        self._ends: Callable[[], bool] = lambda: False
        self._poller = zmq.Poller()
        self._readers: dict[zmq.Socket[bytes], tuple[str, TapReader]] = {}
        self._orders: dict[tuple[str, str], SequenceTracker] = {}
        for node, names in taps_of(card, topics).items():
            depth, context = settings.queue_length, self._sockets.context
            reader = TapReader(context, [card.taps[node]], names, depth, latched=latched)
            self._readers[reader.socket] = node, reader
            self._poller.register(reader.socket, zmq.POLLIN)
            for name in names:
                self._orders[node, name] = SequenceTracker(anew=name in STATUS_TOPICS)

    def __enter__(self) -> TapSubscription:
        self._ends = self._interrupts.enter_context(until_ctrl_c())
        return self

    def __exit__(self, *error: object) -> None:
        self._interrupts.close()
        for _, reader in self._readers.values():
            reader.close()
        self._sockets.close()

    def batches(
        self, duration: float | None = None, tick: float | None = None
    ) -> Iterator[list[TapMessage]]:
        """New copies, every `tick` [s]; ends with the graph, the `duration` [s], or Ctrl-C."""
        now = time.monotonic()
        until = None if duration is None else now + duration
        tick, interval = tick or self._settings.tick, self._settings.alive_interval
        look = now + interval
        while (until is None or now < until) and not self._ends():
            yield self.take(tick if until is None else min(tick, until - now))
            now = time.monotonic()
            if now >= look:
                look = now + interval
                if not is_running(self._card):
                    yield from iter(lambda: self.take(0.0), [])
                    return

    def take(self, timeout: float) -> list[TapMessage]:
        """Some copies that have come, or come before the timeout [s]."""
        received = []
        for socket, _ in self._poller.poll(round(timeout * 1000)):
            node, reader = self._readers[socket]
            for topic, header, body in islice(iter(reader.receive, None), self._settings.batch):
                order = self._orders.get((node, topic))
                lost = order.place(header) if order and header.run == self._run else None
                if lost is not None:
                    now = time.monotonic_ns()
                    received.append(TapMessage(topic, node, header, body, lost, now))
        return received


def taps_of(card: RunCard, topics: Iterable[Topic]) -> dict[str, list[str]]:
    """Names of topics by the node that publishes them."""
    by_node: dict[str, list[str]] = {}
    for topic in topics:
        for publisher in topic.publishers:
            by_node.setdefault(publisher, []).append(topic.name)
    return by_node


def is_running(card: RunCard) -> bool:
    """Whether a graph still runs; on one machine its sockets are in the folder of its card."""
    local = card.tools.startswith("ipc://")
    home = Path(card.tools.removeprefix("ipc://")).parent.parent if local else None
    return any(running.run == card.run for running in running_graphs(home))


class Topic(NamedTuple):
    """One topic of a running graph."""

    name: str  # as on the wire
    type: str  # name of its message type; empty if unknown
    publishers: tuple[str, ...]  # one node, or all nodes for a topic of `STATUS_TOPICS`
    subscribers: tuple[str, ...]
    schema: str = ""  # JSON schema of a type that palpate does not have, if known


def topics_of(card: RunCard) -> dict[str, Topic]:
    """The topics of a running graph by name, sorted."""
    schemas, topics = card.schemas, dict[str, Topic]()
    for name, publisher in card.publishers.items():
        kind, to = card.topics.get(name, ""), card.subscribers(name)
        topics[name] = Topic(name, kind, (publisher,), to, schemas.get(kind, ""))
    all_nodes = tuple(node.name for node in card.nodes)
    for name, cls in STATUS_TOPICS.items():
        topics[name] = Topic(name, cls.__name__, all_nodes, (LAUNCHER,))
    return dict(sorted(topics.items()))


def find_topics(card: RunCard, names: Sequence[str]) -> list[Topic]:
    """Topics by name, each once; raises ValueError if a topic has no publisher."""
    return list(dict.fromkeys(find_topic(card, name) for name in names))


def find_topic(card: RunCard, name: str) -> Topic:
    """A topic by name, with or without a slash; raises ValueError if it has no publisher."""
    known = topics_of(card)
    wanted = name if name.startswith("/") else f"/{name}"
    if wanted not in known:
        raise ValueError(f"no node publishes {wanted}; {hint(wanted, known)}")
    return known[wanted]


def type_of(topic: Topic) -> type:
    """The message type of a topic, of palpate or made from the schema in its graph.

    Raises ValueError if it is unknown here, or the schema is not that of a message type.
    """
    if topic.type not in TYPES and topic.schema:
        return type_of_schema(topic.schema)
    if topic.type not in TYPES:
        what = f"the type {topic.type!r}" if topic.type else "a type that its graph does not name"
        raise ValueError(f"{topic.name} carries {what}, which is not known here; --raw shows bytes")
    return TYPES[topic.type]


def message_of(topic: Topic, header: Header, body: bytes) -> Any:
    """A message of a topic; raises ValueError if it is not of the topic's type."""
    cls = type_of(topic)
    if header.schema != codec_of(cls).hash:
        raise ValueError(
            f"{topic.name} carries a {topic.type} with other fields than this palpate knows: "
            "the graph was started by another version"
        )
    return decode(cls, body)


class RateMonitor:
    """Prints figures of some topics, for each publisher, over a window of messages.

    Without `say` all figures are printed, as one JSON object a line. `interval` between prints [s].
    """

    def __init__(
        self,
        topics: Sequence[Topic],
        window: int,
        say: RateText | None,
        echo: Callable[[str], None],
        interval: float = 1.0,
    ) -> None:
        self._say, self._echo, self._interval = say, echo, interval
        pairs = [(topic.name, node) for topic in topics for node in topic.publishers]
        self._rates = {pair: Rates(window) for pair in pairs}
        self._several = len(topics) > 1
        self._shared = {topic.name for topic in topics if len(topic.publishers) > 1}
        self._printed: dict[tuple[str, str], int] = {}

    def run(self, card: RunCard, topics: Sequence[Topic], duration: float | None) -> None:
        """Measure until the graph ends, the time is over, or Ctrl-C."""
        with TapSubscription(card, topics) as taps:
            due = time.monotonic() + self._interval
            for batch in taps.batches(duration):
                for received in batch:
                    self._rates[received.topic, received.publisher].add(received)
                if time.monotonic() >= due:
                    due += self._interval
                    self.print(last=False)
        self.print(last=True)

    def print(self, *, last: bool) -> None:
        """Print new figures, and topics without messages; at the `last` call only new ones."""
        for (topic, node), rates in self._rates.items():
            is_new = rates.last != self._printed.get((topic, node))
            label = f"{topic} of {node}" if topic in self._shared else topic
            text = self._say(rates) if self._say and is_new else None
            self._printed[topic, node] = rates.last
            if self._say is None:
                if is_new or not last:
                    self._echo(json.dumps({"topic": topic, "publisher": node, **rates.figures()}))
            elif text is not None:
                self._echo(f"{label}\n{text}" if self._several or self._shared else text)
            elif not rates.received and (is_new or not last):
                self._echo(f"no messages on {label}")
            elif is_new:
                self._echo(f"only one message on {label}")
            elif not last:
                self._echo(f"no new messages on {label}")


class Statistics(NamedTuple):
    """Statistics of at least one value."""

    mean: float
    least: float  # minimum
    most: float  # maximum
    deviation: float  # standard deviation

    @classmethod
    def of(cls, values: Floats) -> Statistics:
        """Mean, extremes and standard deviation."""
        return cls(*(float(v) for v in (values.mean(), values.min(), values.max(), values.std())))


class Rates:
    """The last messages of one publisher on one topic: `window` at most, at least 2."""

    def __init__(self, window: int) -> None:
        self.last = -1  # number of the latest message; -1 before the first
        # Number, times of sending and arrival [ns], and size [bytes] of each message.
        self._kept: deque[tuple[int, int, int, int]] = deque(maxlen=window)

    def add(self, received: TapMessage) -> None:
        """Add a message; messages come in the order of their numbers."""
        header = received.header
        if header.seq <= self.last:
            # A restarted node counts its status messages from 0 again.
            self._kept.clear()
        self.last = header.seq
        size = len(received.topic.encode()) + 1 + HEADER_SIZE + len(received.body)
        self._kept.append((header.seq, header.sent_ns, received.came_ns, size))

    @property
    def received(self) -> int:
        """Number of received messages in the window."""
        return len(self._kept)

    @property
    def sent(self) -> int:
        """Number of messages sent in the window, received or not."""
        return self._kept[-1][0] - self._kept[0][0] + 1 if self._kept else 0

    def rate(self) -> float | None:
        """Messages per second, received or not; None with fewer than two."""
        if self.received < 2:
            return None
        return (self.sent - 1) / (1e-9 * (self._kept[-1][1] - self._kept[0][1]))

    def periods(self) -> Statistics | None:
        """Times between neighbouring messages [s]; None if no two neighbours were received."""
        steps = np.diff(self._columns()[:2])
        next_to = steps[0] == 1
        return Statistics.of(1e-9 * steps[1, next_to]) if next_to.any() else None

    def sizes(self) -> Statistics | None:
        """Sizes of the frames on the wire [bytes]; None before the first."""
        return Statistics.of(self._columns()[3].astype(float)) if self._kept else None

    def delays(self) -> Statistics | None:
        """Times from sending to arrival [s]; None before the first."""
        _, sent, came, _ = self._columns()
        return Statistics.of(1e-9 * (came - sent)) if self._kept else None

    def bandwidth(self) -> float | None:
        """Bytes per second, assuming lost messages of mean size; None with fewer than two."""
        rate, sizes = self.rate(), self.sizes()
        return None if rate is None or sizes is None else rate * sizes.mean

    def figures(self) -> dict[str, Any]:
        """All figures as JSON values."""
        periods, sizes, delays = self.periods(), self.sizes(), self.delays()
        return {
            "messages": self.received,
            "rate_hz": self.rate(),
            "bytes_per_s": self.bandwidth(),
            "period_s": periods and periods._asdict(),
            "size_bytes": sizes and sizes._asdict(),
            "delay_s": delays and delays._asdict(),
        }

    def _columns(self) -> Integers:
        return np.array(self._kept, np.int64).reshape(-1, 4).T


def rate_text(rates: Rates) -> str | None:
    """Text of the rate of a publisher."""
    rate, periods = rates.rate(), rates.periods()
    if rate is None:
        return None
    missing = f"no two neighbouring messages came {_window(rates)}"
    return f"average rate: {rate:.3f}\n\t{_times(periods, rates) if periods else missing}"


def bandwidth_text(rates: Rates) -> str | None:
    """Text of the bandwidth of a publisher."""
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
    """Text of the delays of a publisher."""
    if (delays := rates.delays()) is None:
        return None
    return f"average delay: {delays.mean:.6f}\n\t{_times(delays, rates)}"


def _times(times: Statistics, rates: Rates) -> str:
    spread = f"min: {times.least:.6f}s max: {times.most:.6f}s std dev: {times.deviation:.6f}s"
    return f"{spread} {_window(rates)}"


def _window(rates: Rates) -> str:
    missed = rates.sent - rates.received
    return f"window: {rates.received}" + (f" ({missed} sent, but not received)" if missed else "")


RateText = Callable[[Rates], str | None]  # lines about a publisher; None with too few messages
