"""The topics of a running graph, its messages by the taps, how often they come and how late.

Copies may be lost on the way to a tool, but never hold anybody up. The number and the time that a
message carries are its publisher's, so a lost one makes no rate wrong; arrival counts for delays
alone. Printed as by ros2.
"""

from __future__ import annotations

import json
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack
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

TAP_DEPTH = 1000  # Most copies that wait for the tool, of each node
TICK = 0.1  # A tool gets to do something else this often, s
ALIVE_CHECK = 0.5  # Whether the graph still runs is looked at this often, s
_BATCH = 256  # Most copies that are taken from one node before it is another's turn
# Topics on which every node speaks of itself, received by the launcher.
STATUS_TOPICS = {STATUS_TOPIC: NodeStatus, LOG_TOPIC: LogRecord}
PRINT_INTERVAL = 1.0  # Figures are printed this often, s
Integers = NDArray[np.int64]
WINDOW = 10_000  # Messages over which a figure is taken, unless the user says otherwise


class TapMessage(NamedTuple):
    """One copy of a message."""

    topic: str
    publisher: str  # Name of the node that sent it
    header: Header
    body: bytes
    lost: int  # Messages of this publisher and topic sent since the last copy, and not received
    came_ns: int  # Monotonic clock when the tool took it, ns


class SequenceTracker:
    """The order of one publisher's messages on one topic, of which some are missing.

    A publisher that is started again counts `anew`, or goes on after repeating itself.
    """

    def __init__(self, *, anew: bool) -> None:
        self._anew = anew
        self._epoch, self._seq = -1, -1

    def place(self, header: Header) -> int | None:
        """How many messages are missing before this one; None if it is no news."""
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
    """Copies of what a running graph publishes, or has `latched` before, on some topics."""

    def __init__(self, card: RunCard, topics: Iterable[Topic], *, latched: bool = False) -> None:
        self._card = card
        self._run = int(card.run, 16)
        self._sockets = SocketContext(card.key)
        self._interrupts = ExitStack()
        self._ends: Callable[[], bool] = lambda: False
        self._poller = zmq.Poller()
        self._readers: dict[zmq.Socket[bytes], tuple[str, TapReader]] = {}
        self._orders: dict[tuple[str, str], SequenceTracker] = {}
        for node, names in taps_of(card, topics).items():
            reader = TapReader(
                self._sockets.context, [card.taps[node]], names, TAP_DEPTH, latched=latched
            )
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
        self, duration: float | None = None, tick: float = TICK
    ) -> Iterator[list[TapMessage]]:
        """What has come, every `tick`, s; ends with the graph, the duration, s, or Ctrl-C."""
        now = time.monotonic()
        until = None if duration is None else now + duration
        look = now + ALIVE_CHECK
        while (until is None or now < until) and not self._ends():
            yield self.take(tick if until is None else min(tick, until - now))
            now = time.monotonic()
            if now >= look:
                look = now + ALIVE_CHECK
                if not is_running(self._card):
                    yield from iter(lambda: self.take(0.0), [])
                    return

    def take(self, patience: float) -> list[TapMessage]:
        """What has come by now, or comes within the patience, s; no more than some of it."""
        received = []
        for socket, _ in self._poller.poll(round(patience * 1000)):
            node, reader = self._readers[socket]
            for topic, header, body in islice(iter(reader.receive, None), _BATCH):
                order = self._orders.get((node, topic))
                lost = order.place(header) if order and header.run == self._run else None
                if lost is not None:
                    now = time.monotonic_ns()
                    received.append(TapMessage(topic, node, header, body, lost, now))
        return received


def taps_of(card: RunCard, topics: Iterable[Topic]) -> dict[str, list[str]]:
    """Node to those of the topics that its tap carries."""
    found: dict[str, list[str]] = {}
    for topic in topics:
        for publisher in topic.publishers:
            found.setdefault(publisher, []).append(topic.name)
    return found


def is_running(card: RunCard) -> bool:
    """Whether a graph still runs; on one machine its sockets lie where its card does."""
    local = card.tools.startswith("ipc://")
    home = Path(card.tools.removeprefix("ipc://")).parent.parent if local else None
    return any(one.run == card.run for one in running_graphs(home))


class Topic(NamedTuple):
    """One topic of a running graph."""

    name: str  # As it is on the wire
    type: str  # Name of its message type; empty if the graph does not say
    publishers: tuple[str, ...]  # Who publish it: one, or all where nodes speak of themselves
    subscribers: tuple[str, ...]  # The nodes that receive it
    schema: str = ""  # JSON schema of a type that palpate does not have, if the graph tells it


def topics_of(card: RunCard) -> dict[str, Topic]:
    """The topics of a running graph by name, sorted."""
    schemas, found = card.schemas, dict[str, Topic]()
    for name, publisher in card.publishers.items():
        kind, to = card.topics.get(name, ""), card.subscribers(name)
        found[name] = Topic(name, kind, (publisher,), to, schemas.get(kind, ""))
    everybody = tuple(one.name for one in card.nodes)
    for name, cls in STATUS_TOPICS.items():
        found[name] = Topic(name, cls.__name__, everybody, (LAUNCHER,))
    return dict(sorted(found.items()))


def find_topics(card: RunCard, names: Sequence[str]) -> list[Topic]:
    """The topics of these names, each once; raises ValueError if nobody publishes one of them."""
    return list(dict.fromkeys(find_topic(card, name) for name in names))


def find_topic(card: RunCard, name: str) -> Topic:
    """The topic of this name, whose slash may lack; raises ValueError if nobody publishes it."""
    known = topics_of(card)
    wanted = name if name.startswith("/") else f"/{name}"
    if wanted not in known:
        raise ValueError(f"nobody publishes {wanted}; {hint(wanted, known)}")
    return known[wanted]


def type_of(topic: Topic) -> type:
    """The message type of a topic, palpate's own or made from the schema that its graph tells.

    Raises ValueError if it is not known here, or the schema is none of a message type.
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
    """Figures of some topics, each publisher by itself, over so many messages.

    Without `say` all of them are printed as one object of JSON a line.
    """

    def __init__(
        self,
        topics: Sequence[Topic],
        window: int,
        say: RateText | None,
        echo: Callable[[str], None],
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
            text = self._say(rates) if self._say and news else None
            self._printed[topic, node] = rates.last
            if self._say is None:
                if news or not last:
                    self._echo(json.dumps({"topic": topic, "publisher": node, **rates.figures()}))
            elif text is not None:
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
        self.last = -1  # Number of the latest message; -1 before the first
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

    def figures(self) -> dict[str, Any]:
        """All that is known, ready for JSON."""
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
    """How often it sends."""
    rate, periods = rates.rate(), rates.periods()
    if rate is None:
        return None
    missing = f"no two neighbouring messages came {_window(rates)}"
    return f"average rate: {rate:.3f}\n\t{_times(periods, rates) if periods else missing}"


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
