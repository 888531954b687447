"""The receiving end of reliable topics: each message arrives once, in the order of sending."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import zmq

from palpate.messages.bus import handshake
from palpate.messages.bus.sockets import DEFAULT_SOCKETS, Socket, SocketSettings, connect, received
from palpate.messages.codec import Header, split_frame


class Received(NamedTuple):
    """A message that has arrived."""

    publisher: str  # name of the sending node
    topic: str  # on the wire
    header: Header
    body: bytes  # encoded


@dataclass(slots=True)
class _Edge:
    publisher: str
    topic: str
    wanted: int = 0  # next sequence
    newest: int = -1  # largest sequence that arrived after a gap; -1 if none
    in_step: bool = False  # whether all earlier messages have been resent


class Subscriber:
    """Receives reliable topics of several publishers.

    A frame is accepted if it has the epoch of its publisher's greeting, and the next sequence of
    its topic. A smaller sequence is a duplicate. A larger one is early while earlier messages are
    being resent, and a gap after that.
    """

    def __init__(
        self,
        context: zmq.Context[Socket],
        *,
        name: str,  # of the subscribing node
        run: int,
        epoch: int,  # number of earlier starts of the node
        sources: Mapping[str, Sequence[str]],  # topics by publisher
        endpoints: Mapping[str, str],  # addresses by publisher
        depth: int,  # maximum number of messages in the queue from one publisher
        settings: SocketSettings = DEFAULT_SOCKETS,
    ) -> None:
        self.name, self.run, self.epoch = name, run, epoch
        self.duplicates = 0  # number of repeated messages, which are dropped
        self.early = 0  # number of early messages, which are dropped and resent in order
        edges = [_Edge(source, topic) for source, topics in sources.items() for topic in topics]
        self._edges = {edge.topic: edge for edge in edges}
        self._of = {source: [self._edges[topic] for topic in sources[source]] for source in sources}
        self._greeted: dict[str, int] = {}
        self._cursors: dict[str, list[bytes]] = {}
        self.socket = context.socket(zmq.SUB)
        self.socket.setsockopt(zmq.RCVHWM, depth)
        self.socket.setsockopt(zmq.RECONNECT_IVL, settings.reconnect_ms)
        # The topics come before the calls, so that nothing is missed after a greeting.
        for topic in self._edges:
            self.socket.subscribe(topic.encode() + b"\0")
        for source in sources:
            connect(self.socket, endpoints[source])
            self.socket.subscribe(handshake.join_call(name, epoch, source))

    def skip(self, topic: str, wanted: int) -> None:
        """Request a topic from a sequence on; only before anything is received."""
        self._edges[topic].wanted = wanted

    @property
    def in_step(self) -> bool:
        """Whether all earlier messages of all topics have been received."""
        return all(edge.in_step for edge in self._edges.values())

    @property
    def gaps(self) -> int:
        """Number of missing messages."""
        return sum(self.missing.values())

    @property
    def missing(self) -> dict[str, int]:
        """Numbers of missing messages by topic; complete topics are left out."""
        lacks = {topic: edge.newest + 1 - edge.wanted for topic, edge in self._edges.items()}
        return {topic: number for topic, number in lacks.items() if number > 0}

    def receive(self) -> Received | None:
        """The next message; None if none has arrived. It never waits.

        Raises ValueError if a frame is malformed, of another run, or on a topic without
        subscription.
        """
        while (frame := received(self.socket)) is not None:
            own: bytes | None = frame
            if frame.startswith(b"@"):
                own = self._handle_reply(handshake.read_reply(frame))
            arrival = None if own is None else self._accepted(own)
            if arrival is not None:
                return arrival
        return None

    def close(self) -> None:
        """Close at once, without waiting for subscriptions to publishers that have gone."""
        self.socket.close(0)

    def _accepted(self, frame: bytes) -> Received | None:
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
        """Continue the handshake; returns a frame that was resent."""
        if answer.kind == handshake.RESENT:
            return answer.rest
        if answer.kind == handshake.GREETING:
            self._send_cursors(answer.publisher, handshake.read_epoch(answer.rest))
            return None
        topic = answer.rest.decode(errors="replace")
        if topic in self._edges:
            self._edges[topic].in_step = True
        return None

    def _send_cursors(self, source: str, epoch: int) -> None:
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
