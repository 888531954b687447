"""What nodes report of themselves, the sockets on which they do, and how the launcher judges it."""

from __future__ import annotations

import resource
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import zmq

from palpate.messages import bus, decode, schema_hash
from palpate.messages.types import TYPES, LogRecord, NodeStatus
from palpate.nodes.runtime.work import failure_records

# A node without a sign of life for this long, and for as long as it declared that its work may
# take, is mentioned in the log, s.
SILENCE = 5.0
# Open files of the launcher by itself, and for each node: a pipe to and from its process, and the
# connections of its control, its tap and its topics.
LAUNCHER_FILES, NODE_FILES = 24, 5
RETRY = 0.2  # A node that has not answered is asked again after this long, s


def open_files_needed(nodes: int) -> int:
    """Files that the launcher of so many nodes has open at once, sockets and pipes among them."""
    return LAUNCHER_FILES + NODE_FILES * nodes


def check_open_files(nodes: int) -> None:
    """Have the system allow as many open files as a graph needs; ValueError if it does not."""
    needed = open_files_needed(nodes)
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    if soft == resource.RLIM_INFINITY or soft >= needed:
        return
    if hard != resource.RLIM_INFINITY and hard < needed:
        raise ValueError(
            f"a graph of {nodes} nodes needs {needed} open files, the system allows {hard}: raise "
            f"it with ulimit -n {needed}, or run it with --composed"
        )
    resource.setrlimit(resource.RLIMIT_NOFILE, (needed, hard))


class NodeStatusTable:
    """The nodes of one graph, as they have reported so far."""

    def __init__(self, names: Sequence[str], declared: Mapping[str, float] = {}) -> None:
        """`declared`: by name, how long a node says that its work may take, s."""
        self.statuses: dict[str, NodeStatus] = {}  # The latest counters of each node
        self.ready: set[str] = set()  # Nodes of which all inputs are in step
        self.exiting: set[str] = set()  # Nodes that have put away what they held
        self.failed: dict[str, str] = {}  # Nodes that have failed, and of what
        self._alive = dict.fromkeys(names, time.monotonic())
        self._mentioned: set[str] = set()
        self._patience = {name: max(SILENCE, declared.get(name, 0.0)) for name in names}

    def receive(self, name: str, word: bus.ControlMessage) -> list[LogRecord]:
        """Take a node's report about itself; returns what is worth a line in the log.

        Raises ValueError if the node's counters cannot be read.
        """
        kind = word["kind"]
        if name not in self._alive:
            raise ValueError(f"{name!r} reported, which is not in the graph")
        self._alive[name] = time.monotonic()
        self._mentioned.discard(name)
        if kind == "ready":
            self.ready.add(name)
        elif kind == "exiting":
            self.exiting.add(name)
            self.statuses[name] = decode(NodeStatus, word["status"])
        elif kind == "failed":
            self.failed[name] = str(word["text"])
            return failure_records(name, self.failed[name], str(word["trace"]))
        return []

    def left(self, name: str) -> str | None:
        """A node's process has ended; what it failed of, if it told."""
        self.ready.discard(name)
        self._alive[name] = time.monotonic()
        return self.failed.pop(name, None)

    def silence(self, name: str, now: float) -> float:
        """Time since the last report of a node, s."""
        return now - self._alive[name]

    def silent(self, now: float) -> list[LogRecord]:
        """Lines for the log about nodes that have been silent for long, once each."""
        lines = []
        for name, when in self._alive.items():
            silent = now - when > self._patience[name]
            if silent and name not in self._mentioned and name not in self.exiting:
                self._mentioned.add(name)
                doing = "is still working" if name in self.ready else "is still starting"
                text = f"{name} {doing}, or hangs: no sign of life for {self._patience[name]:g} s"
                lines.append(_log_record(name, "warning", text))
        return lines


def _log_record(node: str, level: str, text: str) -> LogRecord:
    return LogRecord(node=node, level=level, text=text, robot_time=0.0)  # type: ignore[arg-type]


class Edge(NamedTuple):
    """One subscriber of one topic."""

    subscriber: str
    publisher: str
    topic: str


@dataclass(frozen=True, slots=True)
class MessageCounts:
    """One node's answer."""

    sent: dict[str, int]  # Messages sent on each topic
    consumed: dict[tuple[str, str], int]  # Messages consumed, by publisher and topic
    waits: tuple[str, ...] = ()  # Topics without whose first message the node handles nothing else
    can_publish: bool = False  # Whether it may publish of its own yet: nothing need move for long


class TerminationDetector:
    """Rounds of counting everybody by name, and what went over the edges between them."""

    def __init__(self, names: Sequence[str], edges: Sequence[Edge]) -> None:
        self.round = 0  # Number of the round
        self._names, self._edges = tuple(names), tuple(edges)
        self._counts: dict[str, MessageCounts] = {}
        self._last: dict[str, MessageCounts] | None = None
        self._since, self._equal, self._due = 0.0, 0, 0.0

    def forget(self) -> None:
        """Begin anew: what was counted before does not matter any more."""
        self.round += 1
        self._counts, self._last, self._equal, self._due = {}, None, 0, 0.0

    def drop(self, name: str) -> None:
        """Count somebody no more, who has died and is done without."""
        self._names = tuple(one for one in self._names if one != name)
        kept = (one for one in self._edges if name not in (one.subscriber, one.publisher))
        self._edges = tuple(kept)
        self.forget()

    def to_ask(self, now: float) -> list[str]:
        """Names of those who are to be asked now."""
        if now < self._due:
            return []
        self._due = now + RETRY
        return [name for name in self._names if name not in self._counts]

    def answer(
        self, name: str, round_: int, count: MessageCounts, now: float, pause: float
    ) -> None:
        """Take a node's answer; when it is the last of its round, the next is due after a pause."""
        if round_ != self.round or name not in self._names:
            return
        self._counts[name] = count
        if len(self._counts) < len(self._names):
            return
        if self._counts != self._last:
            self._equal, self._since = 0, now
        self._equal += 1
        self._last, self._counts = self._counts, {}
        self.round += 1
        self._due = now + pause

    @property
    def settled(self) -> bool:
        """Whether nothing is on its way: two rounds are equal, and all that was sent consumed."""
        return self._equal > 1 and not self.unconsumed()

    def still_for(self, now: float) -> float:
        """Time for which nothing has been sent or consumed, s; 0 if a source may speak yet."""
        can_publish = any(count.can_publish for count in (self._last or {}).values())
        if self._equal < 2 or (can_publish and not self.unconsumed()):
            return 0.0
        return now - self._since

    def unconsumed(self) -> list[tuple[Edge, int, int]]:
        """Edges on which more was sent than consumed, with both numbers, from the last round."""
        return [entry for entry in self._traffic() if entry[1] != entry[2]]

    def complaints(self) -> list[str]:
        """Who waits for what, as far as counting can tell."""
        needs = [
            f"{name} needs {', '.join(count.waits)} before anything else"
            for name, count in (self._last or {}).items()
            if count.waits
        ]
        missing = [
            f"{edge.subscriber} has consumed {consumed} of {sent} on {edge.topic} "
            f"from {edge.publisher}"
            for edge, sent, consumed in self.unconsumed()
        ]
        silent = [
            f"{edge.subscriber} has received nothing on {edge.topic} ({edge.publisher})"
            for edge, sent, _ in self._traffic()
            if sent == 0
        ]
        return needs + missing + silent

    def _traffic(self) -> list[tuple[Edge, int, int]]:
        counts = self._last or {}
        entries = []
        for edge in self._edges:
            if edge.publisher in counts and edge.subscriber in counts:
                sent = counts[edge.publisher].sent.get(edge.topic, 0)
                consumed = counts[edge.subscriber].consumed.get((edge.publisher, edge.topic), 0)
                entries.append((edge, sent, consumed))
        return entries


class LauncherSockets:
    """The launcher's sockets; `sources` are the topics that it subscribes to, by publisher."""

    def __init__(self, place: bus.Addresses, sources: Mapping[str, Sequence[str]]) -> None:
        self._wires = bus.SocketContext(place.key)
        context = self._wires.context
        self.line = bus.ControlServer(context, place.control)
        self.tools = bus.ControlServer(context, place.tools, accepts=bus.FROM_TOOLS)
        self.subscriber = bus.Subscriber(
            context,
            name=bus.LAUNCHER,
            run=place.run,
            epoch=0,
            sources=sources,
            endpoints=place.endpoints,
            depth=place.depth,
        )
        self.taps = bus.TapReader(
            context, place.taps.values(), (bus.STATUS_TOPIC, bus.LOG_TOPIC), place.depth
        )
        # Messages received, by publisher and topic.
        self.consumed: Counter[tuple[str, str]] = Counter()
        self._types: dict[int, type] = {}
        self._poller = zmq.Poller()
        for one in (self.line, self.tools, self.subscriber, self.taps):
            self._poller.register(one.socket, zmq.POLLIN)

    def __enter__(self) -> LauncherSockets:
        return self

    def __exit__(self, *_: object) -> None:
        self.subscriber.close()
        self.taps.close()
        self.line.close()
        self.tools.close()
        self._wires.close()

    def watch(self, sentinel: int) -> None:
        """Also wake when this process ends."""
        self._poller.register(sentinel, zmq.POLLIN)

    def unwatch(self, sentinel: int) -> None:
        """Do not wake for this process any more."""
        self._poller.unregister(sentinel)

    def wait(self, timeout_ms: int) -> list[int]:
        """Wait until something arrives or a process ends; returns the sentinels of such."""
        return [who for who, _ in self._poller.poll(timeout_ms) if isinstance(who, int)]

    def receive(self) -> tuple[str, object] | None:
        """Topic and message of what has arrived next on the topics, or None."""
        arrival = self.subscriber.receive()
        if arrival is None:
            return None
        self.consumed[arrival.publisher, arrival.topic] += 1
        cls = self._type_of(arrival.topic, arrival.header.schema)
        return arrival.topic, decode(cls, arrival.body)

    def receive_tap(self) -> object | None:
        """What a node tells of itself, or None."""
        tapped = self.taps.receive()
        if tapped is None:
            return None
        topic, header, body = tapped
        return decode(self._type_of(topic, header.schema), body)

    def _type_of(self, topic: str, schema: int) -> type:
        if not self._types:
            self._types = {schema_hash(cls): cls for cls in TYPES.values()}
        if schema not in self._types:
            raise ValueError(f"{topic} carries a type that the launcher does not know")
        return self._types[schema]
