"""Reports of nodes about themselves, the launcher's sockets for them, and counting of messages."""

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


@dataclass(frozen=True, slots=True, kw_only=True)
class SupervisionSettings:
    """Times in the supervision of the processes of a graph."""

    tick_period: float = 0.1  # between two calls of the watcher [s]
    max_batch: int = 64  # messages of nodes that are received before tools are answered again
    silence_limit: float = 5.0  # after which a silent node is logged; or its timeout, if longer [s]
    answer_time: float = 0.2  # after which a node without an answer is asked again [s]
    count_pause: float = 0.5  # between two rounds of counting messages [s]
    final_count_pause: float = 0.01  # the same once the graph has finished [s]
    stall_time: float = 3.0  # without any message, after which a graph has stalled [s]
    report_time: float = 3.0  # that the report of a failure may take after the exit [s]
    stop_time: float = 30.0  # that nodes have to save their work, before the run fails [s]


DEFAULT_SUPERVISION = SupervisionSettings()


def open_files_needed(n_nodes: int, launcher_files: int = 24, files_per_node: int = 5) -> int:
    """Number of open files, sockets and pipes of the launcher.

    For each node these are pipes to and from its process, and the connections of its control, tap
    and topics.
    """
    return launcher_files + files_per_node * n_nodes


def check_open_files(nodes: int) -> None:
    """Raise the limit of open files to what a graph needs; ValueError if that is not allowed."""
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
    """Reports of the nodes of one graph.

    `timeouts`: by name, the time that a node declares that its work may take [s]. A node that is
    silent for longer than that and than `silence_limit` [s] is logged.
    """

    def __init__(
        self,
        names: Sequence[str],
        timeouts: Mapping[str, float] = {},
        silence_limit: float = DEFAULT_SUPERVISION.silence_limit,
    ) -> None:
        self.statuses: dict[str, NodeStatus] = {}  # the last counters of each node
        self.ready: set[str] = set()  # nodes whose inputs are all connected
        self.exiting: set[str] = set()  # nodes that have saved their work
        self.failed: dict[str, str] = {}  # failures by node
        self._alive = dict.fromkeys(names, time.monotonic())
        self._mentioned: set[str] = set()
        self._limits = {name: max(silence_limit, timeouts.get(name, 0.0)) for name in names}

    def receive(self, name: str, word: bus.ControlMessage) -> list[LogRecord]:
        """Take a node's report about itself; returns records for the log.

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
        """Take note of the end of a node's process; returns the failure that it reported."""
        self.ready.discard(name)
        self._alive[name] = time.monotonic()
        return self.failed.pop(name, None)

    def silence(self, name: str, now: float) -> float:
        """Time since the last report of a node [s]."""
        return now - self._alive[name]

    def silent(self, now: float) -> list[LogRecord]:
        """Records for the log about nodes that are silent for too long, once each."""
        lines = []
        for name, when in self._alive.items():
            is_silent = now - when > self._limits[name]
            if is_silent and name not in self._mentioned and name not in self.exiting:
                self._mentioned.add(name)
                doing = "is still working" if name in self.ready else "is still starting"
                text = f"{name} {doing}, or hangs: no sign of life for {self._limits[name]:g} s"
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
    """Numbers of messages of one node."""

    sent: dict[str, int]  # by topic
    consumed: dict[tuple[str, str], int]  # by publisher and topic
    waits: tuple[str, ...] = ()  # topics that the node needs before it handles other messages
    can_publish: bool = False  # whether a source may still publish, however long it is quiet


class TerminationDetector:
    """Rounds of counting the messages of all nodes, which show that a graph is done or stalled.

    A node that has not answered is asked again after `answer_time` [s].
    """

    def __init__(
        self,
        names: Sequence[str],
        edges: Sequence[Edge],
        answer_time: float = DEFAULT_SUPERVISION.answer_time,
    ) -> None:
        self.round = 0  # number of the round
        self._answer_time = answer_time
        self._names, self._edges = tuple(names), tuple(edges)
        self._counts: dict[str, MessageCounts] = {}
        self._last: dict[str, MessageCounts] | None = None
        self._since, self._equal, self._due = 0.0, 0, 0.0

    def forget(self) -> None:
        """Begin a new round, and discard all counts."""
        self.round += 1
        self._counts, self._last, self._equal, self._due = {}, None, 0, 0.0

    def drop(self, name: str) -> None:
        """Leave out a node that has died, and its edges."""
        self._names = tuple(other for other in self._names if other != name)
        self._edges = tuple(
            edge for edge in self._edges if name not in (edge.subscriber, edge.publisher)
        )
        self.forget()

    def to_ask(self, now: float) -> list[str]:
        """Names of the nodes that are to be asked now."""
        if now < self._due:
            return []
        self._due = now + self._answer_time
        return [name for name in self._names if name not in self._counts]

    def answer(
        self, name: str, round_: int, count: MessageCounts, now: float, pause: float
    ) -> None:
        """Take a node's answer; after the last one of a round the next is due after `pause` [s]."""
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
        """Whether no message is underway: two rounds are equal, and all sent messages consumed."""
        return self._equal > 1 and not self.unconsumed()

    def still_for(self, now: float) -> float:
        """Time without sent or consumed messages [s]; 0 if a source may still publish."""
        can_publish = any(count.can_publish for count in (self._last or {}).values())
        if self._equal < 2 or (can_publish and not self.unconsumed()):
            return 0.0
        return now - self._since

    def unconsumed(self) -> list[tuple[Edge, int, int]]:
        """Edges of the last round with fewer messages consumed than sent, with both numbers."""
        return [entry for entry in self._traffic() if entry[1] != entry[2]]

    def complaints(self) -> list[str]:
        """Sentences about missing messages, by the counts."""
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
    """The launcher's sockets; `sources`: the topics to which it subscribes, by publisher."""

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
        # Numbers of messages received, by publisher and topic.
        self.consumed: Counter[tuple[str, str]] = Counter()
        self._types: dict[int, type] = {}
        self._poller = zmq.Poller()
        for reader in (self.line, self.tools, self.subscriber, self.taps):
            self._poller.register(reader.socket, zmq.POLLIN)

    def __enter__(self) -> LauncherSockets:
        return self

    def __exit__(self, *_: object) -> None:
        self.subscriber.close()
        self.taps.close()
        self.line.close()
        self.tools.close()
        self._wires.close()

    def watch(self, sentinel: int) -> None:
        """Also wake when the process of this sentinel ends."""
        self._poller.register(sentinel, zmq.POLLIN)

    def unwatch(self, sentinel: int) -> None:
        """Do not wake for this sentinel any more."""
        self._poller.unregister(sentinel)

    def wait(self, timeout_ms: int) -> list[int]:
        """Wait for a message or the end of a process; returns the sentinels of ended processes."""
        return [who for who, _ in self._poller.poll(timeout_ms) if isinstance(who, int)]

    def receive(self) -> tuple[str, object] | None:
        """The next message on the topics, with its topic; None if there is none."""
        arrival = self.subscriber.receive()
        if arrival is None:
            return None
        self.consumed[arrival.publisher, arrival.topic] += 1
        cls = self._type_of(arrival.topic, arrival.header.schema)
        return arrival.topic, decode(cls, arrival.body)

    def receive_tap(self) -> object | None:
        """The next status or log record of a node; None if there is none."""
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
