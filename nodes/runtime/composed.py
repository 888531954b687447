"""All nodes of a graph in one process, the same bytes between them; and how a graph ended.

Bodies are encoded and decoded here too, so that no handler can write into another's arrays.
Each edge is first in, first out; which edge comes next is free, and a seeded schedule that
draws it at random finds every dependence on the order of two publishers. A replay, which hands
over recorded messages at their places, and a bench, which leaves the codec out, share the queue.
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

TICK_PERIOD = 0.1  # Time between two calls of the watcher's tick, s
TopicT = TypeVar("TopicT")
SubscriberT = TypeVar("SubscriberT")


class MessageQueue(Generic[TopicT, SubscriberT]):
    """What is under way in one process: each edge, a topic to a subscriber, first in, first out.

    Which edge comes next is the order of sending, or drawn.
    """

    def __init__(
        self, subscribers: Mapping[TopicT, Sequence[SubscriberT]], draw: random.Random | None = None
    ) -> None:
        self._subscribers, self._draw = subscribers, draw
        self._edges: dict[tuple[TopicT, SubscriberT], deque[Any]] = {}
        self._order: deque[tuple[TopicT, SubscriberT]] = deque()

    def put(self, topic: TopicT, message: Any) -> None:
        """Send a message to all who listen."""
        for subscriber in self._subscribers.get(topic, ()):
            self._edges.setdefault((topic, subscriber), deque()).append(message)
            if self._draw is None:
                self._order.append((topic, subscriber))

    def take(self) -> tuple[TopicT, SubscriberT, Any] | None:
        """Topic, subscriber and message of what is handed over next; None when all is quiet."""
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
    """Run a graph in this process until it is quiet.

    The node `ends` is the one whose Finished ends it; the watcher receives the topics, as on the
    wire, of `watch`. `schedule` is the seed of a random schedule; None hands messages over in the
    order in which they were sent. A node that raises ends the graph as ``died``.
    """
    composition = Composition(wirings, watch, watcher, schedule)
    with ExitStack() as closing:
        try:
            for name, work in composition.open():
                closing.callback(work.close)
                composition.works[name] = work
            # Several threads round otherwise; what was imported with the nodes is limited too.
            closing.enter_context(threadpool_limits(limits=1))
            composition.begin()
            watcher.ready(0.0)
            while composition.deliver():
                pass
        except KeyboardInterrupt:
            return composition.ending("interrupted", "interrupted by Ctrl-C")
        except Exception as error:  # The edge of the nodes: whatever it was must be told in words.
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
    """The edges between the nodes and what is under way on them; arguments as `run_composed`."""

    def __init__(
        self,
        wirings: Sequence[Wiring],
        watch: Sequence[str],
        watcher: Watcher,
        schedule: int | None,
    ) -> None:
        self.works: dict[str, Work] = {}  # The nodes, by name
        self.finished: dict[str, str] = {}  # Reason of each node that has published Finished
        self.doing = "starting"  # What was last begun, in words
        self._wirings = {wiring.name: wiring for wiring in wirings}
        self._types: dict[str, type] = {}
        subscribers: dict[str, list[str]] = {}
        for wiring in wirings:
            for one in wiring.inputs:
                subscribers.setdefault(one.topic, []).append(wiring.name)
        draw = None if schedule is None else random.Random(schedule)
        self._queue = MessageQueue(subscribers, draw)
        self._watch, self._watcher = set(watch), watcher
        self._sent: dict[str, dict[str, int]] = {name: {} for name in self._wirings}
        self._cpu = dict.fromkeys(self._wirings, 0.0)
        self._paces = {one.name: RobotPace(one.rate) for one in wirings if one.rate}
        self._next_tick = time.monotonic() + TICK_PERIOD

    def open(self) -> Sequence[tuple[str, Work]]:
        """Make the nodes, sinks first: they must receive everything."""
        made: list[tuple[str, Work]] = []
        for name, wiring in self._wirings.items():
            self.doing = name
            node = load_node(wiring.module)
            import_module(wiring.module)
            if isinstance(node, Node):
                self._types |= {wire: node.outputs[local] for local, wire in wiring.outputs.items()}
                made.append((name, NodeWork(node, wiring.params, wiring)))
            elif isinstance(node, Source):
                made.append((name, SourceWork(node, wiring.params, wiring)))
                publications = node.outputs(wiring.params)
                self._types |= {wire: publications[local] for local, wire in wiring.outputs.items()}
            else:
                made.insert(0, (name, SinkWork(node, wiring.params, wiring)))
        return made

    def begin(self) -> None:
        """Start every node."""
        for name, work in self.works.items():
            self._publish(name, work.begin)
        for pace in self._paces.values():
            pace.start(time.monotonic())

    def deliver(self) -> bool:
        """Hand over one message; False when none is left."""
        if (found := self._queue.take()) is None:
            return self._ask_sources()
        _, name, arrival = found
        self._publish(name, lambda: self.works[name].take(arrival))
        self._tick()
        return True

    def _tick(self) -> None:
        if time.monotonic() >= self._next_tick:
            self._next_tick = time.monotonic() + TICK_PERIOD
            self._watcher.tick(self.statuses())

    def statuses(self) -> dict[str, NodeStatus]:
        """Counters of all nodes; of the processor's time, what handling their messages took."""
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
        """What is left to say."""
        return Ending(status=status, reason=reason, statuses=self.statuses())  # type: ignore[arg-type]

    def _ask_sources(self) -> bool:
        """Have a source publish what it has next, when nothing else is left to do."""
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
        for one in published:
            if isinstance(one, Finished):
                self.finished.setdefault(name, one.reason)
            else:
                self._send(name, one)

    def _hold(self, pace: RobotPace, published: Iterable[Outgoing | Finished]) -> None:
        """Wait for the robot time of what acting on the world has come to."""
        while (left := pace.wait(published, time.monotonic())) > 0.0:
            time.sleep(min(left, TICK_PERIOD))
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
    """What is left to say when all nodes have stopped."""

    # ``finished``: the ending node said so and every message was consumed. ``died``: a node failed.
    # ``stalled``: all quiet without an end. ``interrupted``: somebody pressed Ctrl-C.
    status: Literal["finished", "died", "stalled", "interrupted"]
    reason: str  # One sentence: the reason of Finished, who died of what, or who waits for whom
    # The last counters of each node.
    statuses: Mapping[str, NodeStatus] = field(default_factory=dict)
    gaps: int = 0  # Missing messages over all reliable topics
    duplicates: int = 0  # Messages that came twice over all reliable topics
    # How often each node was started again, of those that were.
    restarts: Mapping[str, int] = field(default_factory=dict)


class Watcher:
    """Receives what the launcher receives, while the graph runs; of itself it keeps nothing."""

    def ready(self, seconds: float) -> None:
        """All nodes are up and joined, this long after the launch began."""

    def received(self, topic: str, message: object) -> None:
        """A message on one of the topics that were asked for."""

    def log(self, record: LogRecord) -> None:
        """A node has something to say."""

    def tick(self, statuses: Mapping[str, NodeStatus]) -> None:
        """Called some ten times a second with the latest counters; may draw."""
