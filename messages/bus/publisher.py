"""The sending end of a node's reliable topics.

Nothing that is sent is ever dropped: a full queue makes the sender wait, and while it waits it
takes in what others send to it, so that two nodes that send to each other cannot lock up.
Everything sent is kept, for those who join late. Its time is later than that of all that the
node has sent or received, so that times order effects behind their causes, on several machines
too (L. Lamport, Comm. ACM 21 (7), 1978). A publisher that starts again sends to each subscriber
what that one still lacks, with the times of the first time.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence

import zmq

from palpate.messages.bus import handshake
from palpate.messages.bus.message_log import Cause, MessageLog, SendTimes
from palpate.messages.bus.sockets import Socket, bind, received
from palpate.messages.codec import Header, pack_frame

SEND_TIMEOUT = 10.0  # A sender gives up after its queue has been full for this long, s
ZERO_COPY_BYTES = 1 << 16  # Frames of so many bytes are handed over without a copy


class BlockedError(RuntimeError):
    """A subscriber does not take its messages."""


class Publisher:
    """Sends one node's reliable topics."""

    def __init__(
        self,
        context: zmq.Context[Socket],
        endpoint: str,  # Address to bind
        *,
        name: str,  # Who sends, in which run, after how many starts
        run: int,
        epoch: int,
        # Every topic, with the names of its known subscribers
        subscribers: Mapping[str, tuple[str, ...]],
        depth: int,  # Most messages in the queue to one subscriber
        # Takes in what has arrived, waiting for a moment; called while a queue is full
        drain: Callable[[], None],
        past: MessageLog,  # Where what was published is kept
        times: SendTimes,  # Where it is put down when
        # Whether it publishes once more what an earlier start had, until `go_live`
        again: bool = False,
        patience: float = SEND_TIMEOUT,  # Longest wait for a full queue, s
        ahead_ns: int = 0,  # How far the launcher's clock is ahead of this machine's, ns
    ) -> None:
        self.name, self.run, self.epoch = name, run, epoch
        self.blocked = 0  # How often a queue was full
        # Time of the latest message sent or received, ns: the next one is sent later
        self.latest_ns = past.latest_ns
        self._subscribers = dict(subscribers)
        self.past, self._times = past, times  # What was published, and when
        self._drain, self._patience, self._ahead_ns = drain, patience, ahead_ns
        self._lacks: dict[tuple[bytes, str], int] | None = {} if again else None
        self.socket = context.socket(zmq.XPUB)
        self.socket.setsockopt(zmq.XPUB_NODROP, 1)
        self.socket.setsockopt(zmq.SNDHWM, depth)
        bind(self.socket, endpoint)

    @property
    def sent(self) -> dict[str, int]:
        """Number of messages sent on each topic."""
        return self.past.counts

    def send(
        self,
        topic: str,
        body: bytes,
        robot_time: float,
        schema: int,
        *,
        outlives: bool = False,
        outside: bool = False,
    ) -> bytes:
        """Send one message to all subscribers of the topic, and return its frame.

        Before `go_live`, to those alone who have asked for it. What `outlives` this start of the
        node is not made again by the next; what comes from `outside` a tool had it publish.

        Raises KeyError if the topic is not one of this publisher's; BlockedError if a subscriber's
        queue stays full for longer than the patience.
        """
        seq = self.past.count(topic)
        sent_ns = self._time(topic, seq)
        header = Header(self.run, self.epoch, seq, sent_ns, robot_time, schema, outside)
        frame = pack_frame(topic, header, body)
        self.past.add(topic, frame, outlives=outlives)
        if self._lacks is None:
            self._put(frame, topic)
            return frame
        for call in self._lacking(topic, seq):
            self._put(handshake.resent_frame(call, frame), topic)
        return frame

    def answer(
        self, published: Sequence[tuple[str, bytes, float, int]], cause: Cause
    ) -> list[bytes]:
        """Send all that answers one message, in its order, once all is kept; returns the frames.

        Raises KeyError, BlockedError as `send` does.
        """
        counts, frames = Counter[str](), []
        for topic, body, robot_time, schema in published:
            seq = self.past.count(topic) + counts[topic]
            header = Header(self.run, self.epoch, seq, self._time(topic, seq), robot_time, schema)
            frames.append((topic, pack_frame(topic, header, body)))
            counts[topic] += 1
        self.past.answer(frames, cause)
        for topic, frame in frames:
            self._put(frame, topic)
        return [frame for _, frame in frames]

    def was_published(self, topic: str) -> bool:
        """Whether an earlier start had published the message that comes next on a topic."""
        return self._times.before(topic, self.past.count(topic)) is not None

    def promise(self, topic: str, make: Callable[[], bytes], schema: int) -> None:
        """Have a message made and sent if it is a new one, or if somebody lacks it, now or later.

        Raises KeyError, BlockedError as `send` does.
        """
        seq = self.past.count(topic)
        if not self.was_published(topic):
            self.send(topic, make(), 0.0, schema, outlives=True)
            return
        header = Header(self.run, self.epoch, seq, self._time(topic, seq), 0.0, schema)
        self.past.promise(topic, lambda: pack_frame(topic, header, make()))
        for call in self._lacking(topic, seq):
            (frame,) = self.past.since(topic, seq)
            self._put(handshake.resent_frame(call, frame), topic)

    def go_live(self) -> None:
        """All that had been published is published again: from here on all receive at once."""
        lacks, self._lacks = self._lacks, None
        for call, topic in lacks or ():
            self._put(handshake.in_step_notice(call, topic), topic)

    def serve(self) -> None:
        """Answer all who have asked to join."""
        while (notice := received(self.socket)) is not None:
            request = handshake.read_request(notice)
            if request is not None and request.publisher == self.name:
                self._answer(request)

    def close(self, linger: int) -> None:
        """Close, giving what is still queued this long to leave, ms."""
        self.socket.close(linger)
        self.past.close()
        self._times.close()

    def _lacking(self, topic: str, seq: int) -> list[bytes]:
        """Calls of those who wait for a message while what had been published is again."""
        lacks = (self._lacks or {}).items()
        return [call for (call, asked), wanted in lacks if asked == topic and seq >= wanted]

    def _time(self, topic: str, seq: int) -> int:
        before = self._times.before(topic, seq)
        if before is not None:
            self.latest_ns = max(before, self.latest_ns)
            return before
        self.latest_ns = max(time.monotonic_ns() + self._ahead_ns, self.latest_ns + 1)
        self._times.note(topic, self.latest_ns)
        return self.latest_ns

    def _answer(self, request: handshake.JoinRequest) -> None:
        if request.epoch is None:
            greeting = handshake.greeting(request.call, self.epoch)
            self._put(greeting, "the greeting of a joining node")
            return
        # A subscriber that reconnects says its old cursors again; those of an earlier start
        # of this node carry that start's epoch.
        if request.epoch != self.epoch or request.topic not in self._subscribers:
            return
        for frame in self.past.since(request.topic, request.wanted):
            self._put(handshake.resent_frame(request.call, frame), request.topic)
        if self._lacks is None:
            self._put(handshake.in_step_notice(request.call, request.topic), request.topic)
        else:
            published = self.past.count(request.topic)
            self._lacks[request.call, request.topic] = max(request.wanted, published)

    def _put(self, frame: bytes, topic: str) -> None:
        copy = len(frame) < ZERO_COPY_BYTES
        try:
            self.socket.send(frame, zmq.DONTWAIT, copy=copy)
        except zmq.Again:
            self.blocked += 1
            self._put_when_free(frame, topic, copy)

    def _put_when_free(self, frame: bytes, topic: str, copy: bool) -> None:
        deadline = time.monotonic() + self._patience
        while time.monotonic() < deadline:
            self._drain()
            # Looking at its state is what makes the socket notice that a place has come free.
            self.socket.getsockopt(zmq.EVENTS)
            try:
                self.socket.send(frame, zmq.DONTWAIT, copy=copy)
            except zmq.Again:
                continue
            return
        blockers = " or ".join(self._subscribers.get(topic, ())) or "a subscriber"
        raise BlockedError(
            f"{self.name} could not send {topic} for {self._patience:g} s: "
            f"{blockers} does not take its messages"
        )
