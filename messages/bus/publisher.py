"""The sending end of a node's reliable topics.

No message is ever dropped: a sender waits while a queue is full, and receives messages meanwhile,
so that two nodes that send to each other cannot deadlock. All messages are kept for subscribers
that join late. The time of a message is later than that of all messages that the node has sent or
received, so that effects are later than their causes, also on several machines (L. Lamport, Comm.
ACM 21 (7), 1978). A restarted publisher sends each subscriber only the messages that this lacks,
with their first times.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence

import zmq

from palpate.messages.bus import handshake
from palpate.messages.bus.message_log import Cause, MessageLog, SendTimes
from palpate.messages.bus.sockets import DEFAULT_SOCKETS, Socket, SocketSettings, bind, received
from palpate.messages.codec import Header, pack_frame


class BlockedError(RuntimeError):
    """A subscriber does not take its messages."""


class Publisher:
    """Sends one node's reliable topics."""

    def __init__(
        self,
        context: zmq.Context[Socket],
        endpoint: str,  # address to bind
        *,
        name: str,  # of the publishing node
        run: int,
        epoch: int,  # number of earlier starts of the node
        subscribers: Mapping[str, tuple[str, ...]],  # names by topic
        depth: int,  # maximum number of messages in the queue to one subscriber
        drain: Callable[[], None],  # receives messages for a moment; called while a queue is full
        past: MessageLog,  # of published messages
        times: SendTimes,  # of published messages
        again: bool = False,  # whether it repeats the messages of an earlier start, until `go_live`
        ahead_ns: int = 0,  # by which the launcher's clock is ahead of this machine's [ns]
        settings: SocketSettings = DEFAULT_SOCKETS,
    ) -> None:
        self.name, self.run, self.epoch = name, run, epoch
        self.blocked = 0  # how often a queue was full
        # Time of the latest message sent or received [ns]: the next one is sent later.
        self.latest_ns = past.latest_ns
        self._subscribers = dict(subscribers)
        self.past, self._times = past, times
        self._drain, self._settings, self._ahead_ns = drain, settings, ahead_ns
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

        Before `go_live` only subscribers that lack the message get it. `outlives`: the next start
        of the node does not make the message again. `outside`: it was requested by a tool.

        Raises KeyError if the topic is not one of this publisher; BlockedError if a subscriber's
        queue stays full for longer than `send_timeout` of the settings.
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
        """Keep all answers to one message, then send them in order; returns the frames.

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
        """Whether an earlier start published the next message of a topic."""
        return self._times.before(topic, self.past.count(topic)) is not None

    def promise(self, topic: str, make: Callable[[], bytes], schema: int) -> None:
        """Make and send a message if it is new, or if a subscriber lacks it now or later.

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
        """End the repetition of an earlier start: all subscribers receive from now on."""
        lacks, self._lacks = self._lacks, None
        for call, topic in lacks or ():
            self._put(handshake.in_step_notice(call, topic), topic)

    def serve(self) -> None:
        """Answer all requests to join."""
        while (notice := received(self.socket)) is not None:
            request = handshake.read_request(notice)
            if request is not None and request.publisher == self.name:
                self._answer(request)

    def close(self, linger_ms: int) -> None:
        """Close; queued messages have `linger_ms` to leave."""
        self.socket.close(linger_ms)
        self.past.close()
        self._times.close()

    def _lacking(self, topic: str, seq: int) -> list[bytes]:
        """Calls of subscribers that lack a message while an earlier start is repeated."""
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
        # A subscriber that reconnects repeats its cursors; those to an earlier start of this node
        # have the epoch of that start.
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
        copy = len(frame) < self._settings.zero_copy_size
        try:
            self.socket.send(frame, zmq.DONTWAIT, copy=copy)
        except zmq.Again:
            self.blocked += 1
            self._put_when_free(frame, topic, copy)

    def _put_when_free(self, frame: bytes, topic: str, copy: bool) -> None:
        timeout = self._settings.send_timeout
        deadline = time.monotonic() + timeout
        while time.monotonic() < deadline:
            self._drain()
            # Reading its events makes the socket notice that its queue is no longer full.
            self.socket.getsockopt(zmq.EVENTS)
            try:
                self.socket.send(frame, zmq.DONTWAIT, copy=copy)
            except zmq.Again:
                continue
            return
        blockers = " or ".join(self._subscribers.get(topic, ())) or "a subscriber"
        raise BlockedError(
            f"{self.name} could not send {topic} for {timeout:g} s: "
            f"{blockers} does not take its messages"
        )
