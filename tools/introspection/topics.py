"""The topics of a running graph, and its messages by the taps.

Those are copies, which may be lost, but never hold anybody up.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import NamedTuple

import zmq

from palpate.launch.files import hint
from palpate.launch.processes import RunCard, running_graphs, until_ctrl_c
from palpate.messages import Header
from palpate.messages.bus import LAUNCHER, LOG_TOPIC, STATUS_TOPIC, SocketContext, TapReader
from palpate.messages.types import TYPES, LogRecord, NodeStatus

TAP_DEPTH = 1000  # Most copies that wait for the tool, of each node
TICK = 0.1  # A tool gets to do something else this often, s
ALIVE_CHECK = 0.5  # Whether the graph still runs is looked at this often, s
_BATCH = 256  # Most copies that are taken from one node before it is another's turn
# Topics on which every node speaks of itself, received by the launcher.
STATUS_TOPICS = {STATUS_TOPIC: NodeStatus, LOG_TOPIC: LogRecord}


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
    """Copies of what a running graph publishes on some topics."""

    def __init__(self, card: RunCard, topics: Iterable[Topic]) -> None:
        self._card = card
        self._run = int(card.run, 16)
        self._sockets = SocketContext(card.key)
        self._interrupts = ExitStack()
        self._ends: Callable[[], bool] = lambda: False
        self._poller = zmq.Poller()
        self._readers: dict[zmq.Socket[bytes], tuple[str, TapReader]] = {}
        self._orders: dict[tuple[str, str], SequenceTracker] = {}
        for node, names in taps_of(card, topics).items():
            reader = TapReader(self._sockets.context, [card.taps[node]], names, TAP_DEPTH)
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

    def batches(self, duration: float | None = None) -> Iterator[list[TapMessage]]:
        """What has come, ten times a second; ends with the graph, the duration, s, or Ctrl-C."""
        now = time.monotonic()
        until = None if duration is None else now + duration
        look = now + ALIVE_CHECK
        while (until is None or now < until) and not self._ends():
            yield self.take(TICK if until is None else min(TICK, until - now))
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
            for _ in range(_BATCH):
                frame = reader.receive()
                if frame is None:
                    break
                topic, header, body = frame
                order = self._orders.get((node, topic))
                if order is None or header.run != self._run:
                    continue
                lost = order.place(header)
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


def topics_of(card: RunCard) -> dict[str, Topic]:
    """The topics of a running graph by name, sorted."""
    types, publishers = card.topics, card.publishers
    found = {
        name: Topic(name, types.get(name, ""), (publisher,), card.subscribers(name))
        for name, publisher in publishers.items()
    }
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
    """The message type of a topic; raises ValueError if this palpate does not know it."""
    if topic.type not in TYPES:
        what = f"the type {topic.type!r}" if topic.type else "a type that its graph does not name"
        raise ValueError(f"{topic.name} carries {what}, which is not known here; --raw shows bytes")
    return TYPES[topic.type]
