"""All nodes of a graph in one process, and the ending of a graph.

Messages are encoded and decoded as between processes, so that no handler can write into another's
arrays. Each edge is first in, first out. The next edge is arbitrary: a seeded random schedule finds
dependences on the order of two publishers. Replays and benches share the queue.
"""

from __future__ import annotations

import random
import time
from collections import deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from importlib import import_module
from typing import Any, Generic, Literal, TypeVar

from threadpoolctl import threadpool_limits

from palpate.messages import Header, decode
from palpate.messages.bus import Received
from palpate.messages.types import LogRecord, NodeStatus
from palpate.nodes.runtime.node import Finished, Node, Source, Wiring, load_node
from palpate.nodes.runtime.sources import RobotPace, SourceWork, Work
from palpate.nodes.runtime.work import (
    NodeWork,
    Outgoing,
    SinkWork,
    failure_records,
    failure_text,
    failure_trace,
)

TopicT = TypeVar("TopicT")
SubscriberT = TypeVar("SubscriberT")


class MessageQueue(Generic[TopicT, SubscriberT]):
    """Messages in one process: each edge, from a topic to a subscriber, is first in, first out.

    The next edge is that of the oldest message, or random with `draw`.
    """

    def __init__(
        self, subscribers: Mapping[TopicT, Sequence[SubscriberT]], draw: random.Random | None = None
    ) -> None:
        self._subscribers, self._draw = subscribers, draw
        self._edges: dict[tuple[TopicT, SubscriberT], deque[Any]] = {}
        self._order: deque[tuple[TopicT, SubscriberT]] = deque()

    def put(self, topic: TopicT, message: Any) -> None:
        """Send a message to all subscribers."""
        for subscriber in self._subscribers.get(topic, ()):
            self._edges.setdefault((topic, subscriber), deque()).append(message)
            if self._draw is None:
                self._order.append((topic, subscriber))

    def take(self) -> tuple[TopicT, SubscriberT, Any] | None:
        """The next topic, subscriber and message; None if there is none."""
        if not self._edges:
            return None
        edge = self._order.popleft() if self._draw is None else self._draw.choice([*self._edges])
        message = self._edges[edge].popleft()
        if not self._edges[edge]:
            del self._edges[edge]
        return *edge, message


def run_composed(
    wirings: Sequence[Wiring],
    *,
    ends: str,
    watch: Sequence[str],
    watcher: Watcher,
    schedule: int | None = None,
) -> Ending:
    """Run a graph in this process until no message is left.

    `ends`: node whose Finished ends it. `watch`: topics on the wire that the watcher receives.
    `schedule`: seed of a random schedule; None handles messages in the order of sending. A node
    that raises an exception ends the graph as ``died``.
    """
    composition = Composition(wirings, watch, watcher, schedule)
    with ExitStack() as closing:
        try:
            for name, work in composition.open():
                closing.callback(work.close)
                composition.works[name] = work
            # Several threads would change rounding; libraries imported with the nodes are included.
            closing.enter_context(threadpool_limits(limits=1))
            composition.begin()
            watcher.ready(0.0)
            while composition.deliver():
                pass
        except KeyboardInterrupt:
            return composition.ending("interrupted", "interrupted by Ctrl-C")
        except Exception as error:  # any exception of a node is reported
            text = failure_text(composition.doing, error)
            name = composition.doing.split()[0]
            for record in failure_records(name, text, failure_trace(error)):
                watcher.log(record)
            return composition.ending("died", text)
    reason = composition.finished.get(ends)
    if reason is None:
        return composition.ending("stalled", f"all is quiet, and {ends} has not finished")
    return composition.ending("finished", reason)


class Composition:
    """Nodes of one process and the messages between them; arguments as of `run_composed`.

    The watcher is called every `tick_period` [s].
    """

    def __init__(
        self,
        wirings: Sequence[Wiring],
        watch: Sequence[str],
        watcher: Watcher,
        schedule: int | None,
        tick_period: float = 0.1,
    ) -> None:
        self.works: dict[str, Work] = {}  # nodes by name
        self.finished: dict[str, str] = {}  # reasons of nodes that have published Finished
        self.doing = "starting"  # last activity, in words
        self._tick_period = tick_period
        self._wirings = {wiring.name: wiring for wiring in wirings}
        self._types: dict[str, type] = {}
        subscribers: dict[str, list[str]] = {}
        for wiring in wirings:
            for edge in wiring.inputs:
                subscribers.setdefault(edge.topic, []).append(wiring.name)
        draw = None if schedule is None else random.Random(schedule)
        self._queue = MessageQueue(subscribers, draw)
        self._watch, self._watcher = set(watch), watcher
        self._sent: dict[str, dict[str, int]] = {name: {} for name in self._wirings}
        self._cpu = dict.fromkeys(self._wirings, 0.0)
        self._paces = {w.name: RobotPace(w.rate) for w in wirings if w.rate}
        self._next_tick = time.monotonic() + tick_period

    def open(self) -> Sequence[tuple[str, Work]]:
        """Make the nodes, with sinks first, which must receive all messages."""
        works: list[tuple[str, Work]] = []
        for name, wiring in self._wirings.items():
            self.doing = name
            node = load_node(wiring.module)
            import_module(wiring.module)
            if isinstance(node, Node):
                self._types |= {wire: node.outputs[local] for local, wire in wiring.outputs.items()}
                works.append((name, NodeWork(node, wiring.params, wiring)))
            elif isinstance(node, Source):
                works.append((name, SourceWork(node, wiring.params, wiring)))
                publications = node.outputs(wiring.params)
                self._types |= {wire: publications[local] for local, wire in wiring.outputs.items()}
            else:
                works.insert(0, (name, SinkWork(node, wiring.params, wiring)))
        return works

    def begin(self) -> None:
        """Start all nodes."""
        for name, work in self.works.items():
            self._publish(name, work.begin)
        for pace in self._paces.values():
            pace.start(time.monotonic())

    def deliver(self) -> bool:
        """Handle one message; False if none is left."""
        if (item := self._queue.take()) is None:
            return self._ask_sources()
        _, name, arrival = item
        self._publish(name, lambda: self.works[name].take(arrival))
        self._tick()
        return True

    def _tick(self) -> None:
        if time.monotonic() >= self._next_tick:
            self._next_tick = time.monotonic() + self._tick_period
            self._watcher.tick(self.statuses())

    def statuses(self) -> dict[str, NodeStatus]:
        """Counters of all nodes; processor time is that of their handlers."""
        return {
            name: NodeStatus(
                node=name,
                state="running",
                messages=work.latency.count,
                sent=sum(self._sent[name].values()),
                gaps=0,
                duplicates=0,
                p50=work.latency.quantile(0.5),
                p99=work.latency.quantile(0.99),
                cpu=self._cpu[name],
                steps=dict(work.steps.seconds),
            )
            for name, work in self.works.items()
        }

    def ending(self, status: str, reason: str) -> Ending:
        """The ending with the last counters."""
        return Ending(status=status, reason=reason, statuses=self.statuses())  # type: ignore[arg-type]

    def _ask_sources(self) -> bool:
        """Let a source publish its next message; False if no source has any."""
        for name, work in self.works.items():
            if not isinstance(work, SourceWork):
                continue
            try:
                left = work.wait()
            finally:
                self.doing = f"{name} {work.doing}"
            if left is not None:
                time.sleep(left)
                if work.wait() == 0.0:
                    self._publish(name, lambda work=work: [work.publish_next()])  # type: ignore[misc]
                return True
        return False

    def _publish(self, name: str, act: Callable[[], Iterable[Outgoing | Finished]]) -> None:
        work, began = self.works[name], time.thread_time()
        try:
            published = [*act()]
        finally:
            self.doing = f"{name} {work.doing}"
            self._cpu[name] += time.thread_time() - began
        if name in self._paces:
            self._hold(self._paces[name], published)
        for output in published:
            if isinstance(output, Finished):
                self.finished.setdefault(name, output.reason)
            else:
                self._send(name, output)

    def _hold(self, pace: RobotPace, published: Iterable[Outgoing | Finished]) -> None:
        """Wait until the robot time of messages."""
        while (left := pace.wait(published, time.monotonic())) > 0.0:
            time.sleep(min(left, self._tick_period))
            self._tick()

    def _send(self, name: str, parcel: Outgoing) -> None:
        topic, body, robot_time, schema = parcel[:4]
        seq = self._sent[name].get(topic, 0)
        self._sent[name][topic] = seq + 1
        header = Header(0, 0, seq, time.monotonic_ns(), robot_time, schema)
        self._queue.put(topic, Received(name, topic, header, body))
        if topic in self._watch:
            self._watcher.received(topic, decode(self._types[topic], body))


@dataclass(frozen=True, slots=True, kw_only=True)
class Ending:
    """The ending of a graph, after all nodes have stopped."""

    # ``finished``: the ending node has finished and all messages are consumed. ``died``: a node
    # failed. ``stalled``: no message is left before the end. ``interrupted``: Ctrl-C or a signal.
    status: Literal["finished", "died", "stalled", "interrupted"]
    reason: str  # one sentence: the reason of Finished, the failure, or the missing messages
    # The last counters of each node.
    statuses: Mapping[str, NodeStatus] = field(default_factory=dict)
    gaps: int = 0  # number of missing messages of all reliable topics
    duplicates: int = 0  # number of repeated messages of all reliable topics
    # Numbers of restarts of nodes that were restarted.
    restarts: Mapping[str, int] = field(default_factory=dict)


class Watcher:
    """Receives messages and counters of a running graph; this base class ignores them."""

    def ready(self, seconds: float) -> None:
        """Take the time from the launch until all nodes were joined [s]."""

    def received(self, topic: str, message: object) -> None:
        """Take a message on one of the watched topics."""

    def log(self, record: LogRecord) -> None:
        """Take a log record of a node."""

    def tick(self, statuses: Mapping[str, NodeStatus]) -> None:
        """Take the latest counters, about ten times a second."""
