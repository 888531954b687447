"""The tap: what a node publishes about itself, and copies of its messages for tools.

The tap may lose messages, and so nobody who listens to it can hold up the graph: a tool that is
stopped or slow is simply left out. Copies are made only while somebody wants them.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Iterable

import zmq

from palpate.messages.bus.sockets import bind, connect
from palpate.messages.bus.subscriber import RECONNECT_MS
from palpate.messages.codec import Header, encode, pack_frame, schema_hash, split_frame
from palpate.messages.types import LogRecord, NodeStatus

STATUS_TOPIC, LOG_TOPIC = "/node/status", "/log"
TAP_DEPTH = 64  # Messages that a slow tool may lag behind before it loses some


class Tap:
    """The lossy outlet of one node."""

    def __init__(
        self,
        context: zmq.Context[zmq.Socket[bytes]],  # Where the socket lives
        endpoint: str,  # Address to bind
        *,
        run: int,  # Number of the run and of the node's start
        epoch: int,
    ) -> None:
        self.run, self.epoch = run, epoch
        self._published: Counter[str] = Counter()
        self._wanted: set[bytes] = set()
        self._mirroring = False
        self.socket = context.socket(zmq.XPUB)
        self.socket.setsockopt(zmq.SNDHWM, TAP_DEPTH)
        bind(self.socket, endpoint)

    def refresh(self) -> None:
        """Take note of who listens."""
        while True:
            try:
                notice = self.socket.recv(zmq.DONTWAIT)
            except zmq.Again:
                break
            change = self._wanted.add if notice.startswith(b"\x01") else self._wanted.discard
            change(notice[1:])
        own = {_prefix(STATUS_TOPIC), _prefix(LOG_TOPIC)}
        self._mirroring = not self._wanted <= own

    def publish(self, message: NodeStatus | LogRecord) -> None:
        """Send the node's own word, if anybody listens."""
        topic = STATUS_TOPIC if isinstance(message, NodeStatus) else LOG_TOPIC
        cls, seq = type(message), self._published[topic]
        self._published[topic] += 1
        time_ns = time.monotonic_ns()
        robot_time = getattr(message, "robot_time", 0.0)
        header = Header(self.run, self.epoch, seq, time_ns, robot_time, schema_hash(cls))
        self.socket.send(pack_frame(topic, header, encode(message)), zmq.DONTWAIT)

    def mirror(self, frame: bytes) -> None:
        """Send a copy of a reliable frame, if anybody wants copies."""
        if self._mirroring:
            self.socket.send(frame, zmq.DONTWAIT)

    def close(self) -> None:
        """Close at once."""
        self.socket.close(0)


class TapReader:
    """Listens to the taps of several nodes."""

    def __init__(
        self,
        context: zmq.Context[zmq.Socket[bytes]],  # Where the socket lives
        endpoints: Iterable[str],  # Addresses of the taps
        topics: Iterable[str],  # Topics to subscribe to
        depth: int = TAP_DEPTH,  # Most messages in the queue from one tap
    ) -> None:
        self.socket = context.socket(zmq.SUB)
        self.socket.setsockopt(zmq.RCVHWM, depth)
        self.socket.setsockopt(zmq.RECONNECT_IVL, RECONNECT_MS)
        for topic in topics:
            self.socket.subscribe(_prefix(topic))
        for endpoint in endpoints:
            connect(self.socket, endpoint)

    def receive(self) -> tuple[str, Header, bytes] | None:
        """Topic, header and body of the next message; None if there is none.

        Raises ValueError if what arrived is not a frame.
        """
        try:
            frame = self.socket.recv(zmq.DONTWAIT)
        except zmq.Again:
            return None
        return split_frame(frame)

    def close(self) -> None:
        """Close at once."""
        self.socket.close(0)


def _prefix(topic: str) -> bytes:
    return topic.encode() + b"\0"
