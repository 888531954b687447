"""The receiving end of reliable topics: every message once, and in the order of its sending."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import zmq

from palpate.messages.bus import handshake
from palpate.messages.bus.sockets import Socket, connect, received
from palpate.messages.codec import Header, split_frame

RECONNECT_MS = 5  # A publisher that comes back is found again within this time


class Received(NamedTuple):
    """One message as it arrived."""

    publisher: str  # Name of the node that sent it
    topic: str  # Topic on the wire
    header: Header  # What the frame says before the body
    body: bytes  # The message, still encoded


@dataclass(slots=True)
class _Edge:
    publisher: str
    topic: str
    wanted: int = 0
    newest: int = -1
    in_step: bool = False


class Subscriber:
    """Receives reliable topics of several publishers.

    A frame is taken if it carries the epoch that its publisher greeted with, and the next
    sequence of its topic. A smaller sequence is a duplicate; a larger one is early, as long as
    the past is still being sent, and a gap after that.
    """

    def __init__(
        self,
        context: zmq.Context[Socket],
        *,
        name: str,  # Who receives, in which run, after how many starts
        run: int,
        epoch: int,
        # Name of each publisher to the topics that are subscribed to
        sources: Mapping[str, Sequence[str]],
        endpoints: Mapping[str, str],  # Name of each publisher to its address
        depth: int,  # Most messages in the queue from one publisher
    ) -> None:
        self.name, self.run, self.epoch = name, run, epoch
        self.duplicates = 0  # Messages that came twice and were dropped
        # Messages that came before their past, and were dropped to come again in order
        self.early = 0
        edges = [_Edge(source, topic) for source, topics in sources.items() for topic in topics]
        self._edges = {edge.topic: edge for edge in edges}
        self._of = {source: [self._edges[topic] for topic in sources[source]] for source in sources}
        self._greeted: dict[str, int] = {}
        self._cursors: dict[str, list[bytes]] = {}
        self.socket = context.socket(zmq.SUB)
        self.socket.setsockopt(zmq.RCVHWM, depth)
        self.socket.setsockopt(zmq.RECONNECT_IVL, RECONNECT_MS)
        # The topics come first: who is greeted is then sure to miss nothing from there on.
        for topic in self._edges:
            self.socket.subscribe(topic.encode() + b"\0")
        for source in sources:
            connect(self.socket, endpoints[source])
            self.socket.subscribe(handshake.join_call(name, epoch, source))

    def skip(self, topic: str, wanted: int) -> None:
        """Ask for a topic from a sequence on; before anything has been received."""
        self._edges[topic].wanted = wanted

    @property
    def in_step(self) -> bool:
        """Whether all topics have sent all of their past."""
        return all(edge.in_step for edge in self._edges.values())

    @property
    def gaps(self) -> int:
        """Messages that are missing."""
        return sum(self.missing.values())

    @property
    def missing(self) -> dict[str, int]:
        """Messages that are missing, by topic; topics that miss none are left out."""
        lacks = {topic: edge.newest + 1 - edge.wanted for topic, edge in self._edges.items()}
        return {topic: number for topic, number in lacks.items() if number > 0}

    def receive(self) -> Received | None:
        """Return the next message, or None if none has arrived; never waits.

        ValueError if a frame is malformed, of another run, or on a topic that was not asked for.
        """
        while (frame := received(self.socket)) is not None:
            own = (
                self._handle_reply(handshake.read_reply(frame)) if frame.startswith(b"@") else frame
            )
            arrival = None if own is None else self._judge(own)
            if arrival is not None:
                return arrival
        return None

    def close(self) -> None:
        """Close at once.

        Without a linger: subscriptions to a publisher that has gone would be waited for.
        """
        self.socket.close(0)

    def _judge(self, frame: bytes) -> Received | None:
        topic, header, body = split_frame(frame)
        edge = self._edges.get(topic)
        if edge is None or header.run != self.run:
            raise ValueError(
                f"{self.name} received {topic} of run {header.run}, to which it never subscribed"
            )
        if header.epoch != self._greeted.get(edge.publisher):
            self.early += 1
        elif header.seq == edge.wanted:
            edge.wanted += 1
            return Received(edge.publisher, topic, header, body)
        elif header.seq < edge.wanted:
            self.duplicates += 1
        elif edge.in_step:
            edge.newest = max(edge.newest, header.seq)
        else:
            self.early += 1
        return None

    def _handle_reply(self, answer: handshake.JoinReply) -> bytes | None:
        """Go on with the joining; a frame of the past is returned."""
        if answer.kind == handshake.RESENT:
            return answer.rest
        if answer.kind == handshake.GREETING:
            self._ask(answer.publisher, handshake.read_epoch(answer.rest))
            return None
        topic = answer.rest.decode(errors="replace")
        if topic in self._edges:
            self._edges[topic].in_step = True
        return None

    def _ask(self, source: str, epoch: int) -> None:
        if self._greeted.get(source) == epoch or source not in self._of:
            return
        self._greeted[source] = epoch
        for old in self._cursors.pop(source, ()):
            self.socket.unsubscribe(old)
        called = handshake.join_call(self.name, self.epoch, source)
        edges = self._of[source]
        cursors = [handshake.join_cursor(called, epoch, edge.topic, edge.wanted) for edge in edges]
        self._cursors[source] = cursors
        for edge, new in zip(edges, cursors, strict=True):
            edge.in_step = False
            self.socket.subscribe(new)
