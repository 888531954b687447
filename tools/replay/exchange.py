"""Replayed nodes, and the messages between them: recorded ones, and those published now.

The k-th message that a replayed node publishes on a topic replaces the k-th that it published when
recorded. If it publishes fewer, its subscribers receive fewer; if it publishes more, they receive
the rest after all recorded messages.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import count
from operator import itemgetter
from typing import NamedTuple

import numpy as np

from palpate.core.plugins import code_place
from palpate.launch.node_kinds import search_current_folder
from palpate.messages import Header, schema_hash
from palpate.messages.bus import Received
from palpate.messages.recording import RecordedMessage, Recording
from palpate.messages.types import ParameterEvent
from palpate.nodes.runtime.composed import MessageQueue
from palpate.nodes.runtime.node import (
    Finished,
    Node,
    RecordedNode,
    Wiring,
    load_node,
    recorded_nodes,
)
from palpate.nodes.runtime.work import ContractError, NodeWork, Outgoing
from palpate.tools.replay.comparison import TopicComparison

OWN_PACKAGE = "palpate."  # other modules are imported only if the user names the node


class Shortage(NamedTuple):
    """A topic of which replayed nodes received fewer or more messages than recorded."""

    topic: str
    publisher: str
    subscribers: tuple[str, ...]
    fewer: int  # recorded messages that were not published again
    more: int  # published messages beyond the recorded ones


@dataclass(slots=True)
class _Link:
    """A topic that a replayed node publishes and replayed nodes receive."""

    publisher: str
    # Messages published before the recorded ones that they replace; numbered over all topics.
    waiting: deque[tuple[int, Outgoing]] = field(default_factory=deque)
    owed: int = 0  # recorded messages whose replacements are not published yet
    received: int = 0  # messages that subscribers have received
    more: int = 0  # messages received after all recorded ones


class MessageExchange:
    """Replayed nodes, and the messages between them."""

    def __init__(self, players: Sequence[ReplayedNode]) -> None:
        self._players = players
        self._subscribers: dict[str, list[ReplayedNode]] = {}
        for player in players:
            for topic in player.subscriptions:
                self._subscribers.setdefault(topic, []).append(player)
        self._links = {
            topic: _Link(player.name)
            for player in players
            for topic in player.publications
            if topic in self._subscribers
        }
        self._publishers = {
            topic: publisher for player in players for topic, publisher in player.publishers.items()
        }
        self._queue = MessageQueue(self._subscribers)
        self._numbers = count()
        self._ended = False

    def begin(self) -> None:
        """Start the nodes."""
        for player in self._players:
            self._take(player.begin())

    def receive(self, kept: RecordedMessage) -> None:
        """Take the next recorded message; raises ValueError if it is of another version."""
        for player in self._players:
            player.check(kept)
            player.record_published(kept)
        link = self._links.get(kept.topic)
        if link is None or kept.outside:
            seq = kept.seq if link is None else link.received
            header = Header(kept.run, kept.epoch, seq, kept.sent_ns, 0.0, kept.schema, kept.outside)
            self._send(kept.topic, header, kept.body)
            if link is not None:
                link.received += 1
        elif link.waiting:
            self._pass_on(link, link.waiting.popleft()[1])
        else:
            link.owed += 1
        self._deliver()

    def end(self) -> None:
        """Hand over messages published beyond the recorded ones, until there are no more."""
        self._ended = True
        rest = [numbered for link in self._links.values() for numbered in link.waiting]
        for link in self._links.values():
            link.waiting.clear()
        self._take(parcel for _, parcel in sorted(rest, key=itemgetter(0)))
        self._deliver()

    def shortages(self) -> tuple[Shortage, ...]:
        """Topics of which fewer or more messages were received than recorded."""
        names = {
            topic: tuple(node.name for node in self._subscribers[topic]) for topic in self._links
        }
        return tuple(
            Shortage(topic, link.publisher, names[topic], link.owed, link.more)
            for topic, link in self._links.items()
            if link.owed or link.more
        )

    def _take(self, published: Iterable[Outgoing]) -> None:
        for parcel in published:
            link = self._links.get(parcel.topic)
            if link is None:
                continue
            if not (link.owed or self._ended):
                link.waiting.append((next(self._numbers), parcel))
                continue
            link.owed, link.more = max(link.owed - 1, 0), link.more + (not link.owed)
            self._pass_on(link, parcel)

    def _pass_on(self, link: _Link, parcel: Outgoing) -> None:
        header = Header(0, 0, link.received, 0, parcel.robot_time, parcel.schema)
        link.received += 1
        self._send(parcel.topic, header, parcel.body)

    def _send(self, topic: str, header: Header, body: bytes) -> None:
        if topic in self._subscribers:
            self._queue.put(topic, Received(self._publishers[topic], topic, header, body))

    def _deliver(self) -> None:
        while (taken := self._queue.take()) is not None:
            _, player, arrival = taken
            self._take(player.receive(arrival))


class ReplayedNode:
    """A replayed node; raises ValueError if it was recorded with topics that it no longer has."""

    def __init__(self, chosen: ReplayNode, changes: Iterable[ParameterEvent] = ()) -> None:
        node, wiring = chosen
        self.name = wiring.name
        try:
            self._work = NodeWork(node, wiring.params, wiring, changes)
        except ContractError as error:
            raise ValueError(f"{error}; it was recorded with another version of it") from None
        # Its exception, in words; after that it receives and publishes no more.
        self.failure = ""
        self.first = ""  # its first difference, in words
        # Types of received and of published messages, by topic.
        self.subscriptions = {edge.topic: node.inputs[edge.local][0] for edge in wiring.inputs}
        published = {topic: node.outputs[local] for local, topic in wiring.outputs.items()}
        self.publications = {topic: TopicComparison(topic, cls) for topic, cls in published.items()}
        self._types = published | self.subscriptions
        self.publishers = {edge.topic: edge.publisher for edge in wiring.inputs}

    def begin(self) -> list[Outgoing]:
        """Start the node; returns what it publishes."""
        return self._run(self._work.begin)

    def receive(self, arrival: Received) -> list[Outgoing]:
        """Hand it one message; returns what it publishes."""
        return [] if self.failure else self._run(lambda: self._work.take(arrival))

    def check(self, kept: RecordedMessage) -> None:
        """Raise ValueError if a message of one of its topics is of another version."""
        cls = self._types.get(kept.topic)
        if cls is not None and kept.schema != schema_hash(cls):
            raise ValueError(
                f"{kept.topic} was recorded with another version of {cls.__name__} "
                f"(schema {kept.schema:08x}, now {schema_hash(cls):08x})"
            )

    def record_published(self, kept: RecordedMessage) -> None:
        """Take a recorded message for comparison, if the node published it."""
        if kept.topic in self.publications and not kept.outside:
            comparison = self.publications[kept.topic]
            comparison.recorded(kept.body)
            self.first = self.first or comparison.first

    def end(self, *, closed: bool) -> None:
        """Count messages published only then or only now, if the recording is complete."""
        for comparison in self.publications.values():
            comparison.end(closed=closed)
            self.first = self.first or comparison.first

    def _run(self, act: Callable[[], list[Outgoing | Finished]]) -> list[Outgoing]:
        try:
            published = act()
        except Exception as error:  # a failure of the node is reported in words
            text, place = " ".join(str(error).split()), code_place(error)
            self.failure = f"{type(error).__name__} {self._work.doing}: {text}"
            self.failure += f" ({place})" if place is not None and place.is_own else ""
            for comparison in self.publications.values():
                comparison.fall_silent()
            return []
        parcels = [parcel for parcel in published if isinstance(parcel, Outgoing)]
        for topic, body, *_ in parcels:
            self.publications[topic].add_published(body)
            self.first = self.first or self.publications[topic].first
        return parcels


class ReplayNode(NamedTuple):
    """A node that is run again."""

    node: Node
    wiring: Wiring  # its edges in the recorded graph, and its parameters


def choose_nodes(recording: Recording, names: Sequence[str]) -> tuple[ReplayNode, ...]:
    """Load nodes by name, or all that can be replayed exactly if none is named.

    A node with one publisher besides its needs is replayed exactly; messages of two publishers may
    have arrived in another order. Raises ValueError if the recording does not describe its graph, a
    node is unknown, a sink, cannot be loaded or has other parameters now, or no node can be
    replayed exactly.
    """
    if not recording.graph:
        raise ValueError(f"recording {recording.path} does not say which nodes made it")
    known = {recorded.name: recorded for recorded in recorded_nodes(recording.graph)}
    for name in names:
        if name not in known:
            raise ValueError(f"recording {recording.path} has no node {name!r}; it has {[*known]}")
    chosen = []
    for recorded in [known[name] for name in dict.fromkeys(names)] or known.values():
        if not recorded.module.startswith(OWN_PACKAGE):
            if not names:
                continue
            search_current_folder(f"{recorded.module}:NODE")
        node = load_node(recorded.module)
        if isinstance(node, Node) and (names or _is_exact(recorded, node, recording)):
            chosen.append(ReplayNode(node, recorded.wiring(node.params)))
        elif names:
            text = "neither subscribes nor publishes: there is nothing to compare"
            raise ValueError(f"{recorded.name} {text}")
    if not chosen:
        raise ValueError(f"recording {recording.path} has no node that can be replayed exactly")
    return tuple(chosen)


def _is_exact(recorded: RecordedNode, node: Node, recording: Recording) -> bool:
    """Whether the recorded order is certainly the order in which the node received."""
    received = [edge for edge in recorded.inputs if recording.counts.get(edge.topic)]
    return len({edge.publisher for edge in received if edge.local not in node.needs}) <= 1


def in_order_of_sending(recording: Recording) -> Iterator[RecordedMessage]:
    """Messages in the order of sending; those of the same time in the order of arrival.

    Processes of one machine share the clock, so no effect comes before its cause. Raises ValueError
    if the recording cannot be read, or loses messages while it is read.
    """
    sent = np.fromiter((kept.sent_ns for kept in recording.messages()), np.uint64)
    turns = iter(np.argsort(sent, kind="stable").tolist())
    early: dict[int, RecordedMessage] = {}
    turn = next(turns, None)
    for index, kept in enumerate(recording.messages()):
        early[index] = kept
        while turn in early:
            yield early.pop(turn)
            turn = next(turns, None)
        if turn is None:
            return
    if turn is not None:
        raise ValueError(f"recording {recording.path} became shorter while it was read")
