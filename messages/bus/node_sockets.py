"""The sockets of one node, and one function that waits for all of them.

On its tap a node publishes its status and log, and copies of its messages for tools. The tap may
lose messages, so that a stopped or slow tool cannot block the graph. Copies are sent only while a
tool subscribes to them. The last messages of latched topics are kept for late tools, which request
them by `LATCHED_MARK`. All earlier messages are requested by `PAST_MARK`, in batches.
"""

from __future__ import annotations

import time
from collections import Counter, deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from itertools import count, islice
from pathlib import Path
from types import MappingProxyType

import zmq

from palpate.messages.bus.control import ControlClient
from palpate.messages.bus.message_log import Cause, MessageLog, SendTimes
from palpate.messages.bus.publisher import Publisher
from palpate.messages.bus.sockets import (
    DEFAULT_SOCKETS,
    Addresses,
    Socket,
    SocketContext,
    SocketSettings,
    bind,
    connect,
    received,
)
from palpate.messages.bus.subscriber import Received, Subscriber
from palpate.messages.codec import Header, encode, pack_frame, schema_hash, split_frame
from palpate.messages.types import ALL_KEPT, LATCHED, TYPES, LogRecord, NodeStatus

STATUS_TOPIC, LOG_TOPIC = "/node/status", "/log"
TAP_DEPTH = 64  # messages in the queue of a tap; a slower tool loses messages
LATCHED_DEPTH = TAP_DEPTH // 2  # messages of a latched topic that a late tool receives
PAST_BATCH = TAP_DEPTH // 2  # earlier messages that are sent at one request
LATCHED_MARK = b"\x02"  # before a topic: messages that were latched before the subscription
PAST_MARK = b"\x03"  # before a topic: earlier messages on request


class Tap:
    """The lossy publisher of one node."""

    def __init__(
        self,
        context: zmq.Context[Socket],
        endpoint: str,
        *,
        run: int,
        epoch: int,
        latched: Mapping[str, int] = MappingProxyType({}),  # numbers kept by topic
        past: MessageLog | None = None,  # of published messages
    ) -> None:
        self.run, self.epoch = run, epoch
        self._past = past
        self._latched = {_prefix(topic): deque[bytes](maxlen=n) for topic, n in latched.items()}
        self._published: Counter[str] = Counter()
        self._wanted: set[bytes] = set()
        self._mirroring = False
        self.socket = context.socket(zmq.XPUB)
        self.socket.setsockopt(zmq.SNDHWM, TAP_DEPTH)
        self.socket.setsockopt(zmq.XPUB_VERBOSE, 1)  # notices of all subscribers
        bind(self.socket, endpoint)

    def refresh(self) -> bool:
        """Handle subscriptions, and send requested messages; returns whether a tool has joined."""
        has_begun = False
        while (notice := received(self.socket)) is not None:
            has_begun |= notice.startswith(b"\x01")
            if notice[1:].startswith(LATCHED_MARK):
                for frame in self._latched.get(notice[2:], ()) if notice[0] else ():
                    self.socket.send(LATCHED_MARK + frame, zmq.DONTWAIT)
                continue
            if notice[1:].startswith(PAST_MARK):
                if notice[0]:
                    self._send_past(*notice[2:].partition(b"\0")[::2])
                continue
            change = self._wanted.add if notice.startswith(b"\x01") else self._wanted.discard
            change(notice[1:])
        self._mirroring = not self._wanted <= {_prefix(STATUS_TOPIC), _prefix(LOG_TOPIC)}
        return has_begun

    def _send_past(self, topic: bytes, wanted: bytes) -> None:
        """Send earlier messages of a topic from a number on, and an end mark."""
        number = wanted.partition(b".")[0]
        if self._past is None or not (0 < len(number) < 20 and number.isdigit()):
            return
        frames = self._past.since(topic.decode(errors="replace"), int(number))
        for frame in islice(frames, PAST_BATCH):
            self.socket.send(PAST_MARK + frame, zmq.DONTWAIT)
        self.socket.send(PAST_MARK + topic + b"\0", zmq.DONTWAIT)

    def publish(self, message: NodeStatus | LogRecord) -> None:
        """Send the node's own status or log record, if a tool subscribes to it."""
        topic = STATUS_TOPIC if isinstance(message, NodeStatus) else LOG_TOPIC
        seq, robot_time = self._published[topic], getattr(message, "robot_time", 0.0)
        self._published[topic] += 1
        schema = schema_hash(type(message))
        header = Header(self.run, self.epoch, seq, time.monotonic_ns(), robot_time, schema)
        self.socket.send(pack_frame(topic, header, encode(message)), zmq.DONTWAIT)

    def keep(self, frame: bytes) -> None:
        """Keep a copy of a reliable frame for late tools, if its topic is latched."""
        if (
            self._latched
            and (latched := self._latched.get(frame[: frame.index(0) + 1])) is not None
        ):
            latched.append(frame)

    def mirror(self, frame: bytes) -> None:
        """Send a copy of a reliable frame, if a tool subscribes; keep it if it is latched."""
        self.keep(frame)
        if self._mirroring:
            self.socket.send(frame, zmq.DONTWAIT)

    def close(self) -> None:
        """Close at once."""
        self.socket.close(0)


class TapReader:
    """Receives from the taps of several nodes."""

    def __init__(
        self,
        context: zmq.Context[Socket],
        endpoints: Iterable[str],
        topics: Iterable[str],
        depth: int = TAP_DEPTH,  # maximum number of messages in the queue from one tap
        *,
        latched: bool = False,  # whether earlier latched messages are requested
        settings: SocketSettings = DEFAULT_SOCKETS,
    ) -> None:
        self.socket = context.socket(zmq.SUB)
        self.socket.setsockopt(zmq.RCVHWM, depth)
        self.socket.setsockopt(zmq.RECONNECT_IVL, settings.reconnect_ms)
        for topic in topics:
            self.socket.subscribe(_prefix(topic))
            if latched:
                self.socket.subscribe(LATCHED_MARK + _prefix(topic))
        for endpoint in endpoints:
            connect(self.socket, endpoint)

    def receive(self) -> tuple[str, Header, bytes] | None:
        """Topic, header and body of the next message; None if there is none.

        Raises ValueError if it is no frame.
        """
        frame = received(self.socket)
        return None if frame is None else split_frame(frame.removeprefix(LATCHED_MARK))

    def close(self) -> None:
        """Close at once."""
        self.socket.close(0)


class PastReader:
    """Requests earlier messages of one node by its tap, without blocking the graph."""

    def __init__(
        self,
        context: zmq.Context[Socket],
        endpoint: str,
        topics: Iterable[str],
        settings: SocketSettings = DEFAULT_SOCKETS,
    ) -> None:
        self._request, self._numbers = b"", count()
        self.socket = context.socket(zmq.SUB)
        self.socket.setsockopt(zmq.RECONNECT_IVL, settings.reconnect_ms)
        for topic in topics:
            self.socket.subscribe(PAST_MARK + _prefix(topic))
        connect(self.socket, endpoint)

    def ask(self, topic: str, seq: int) -> None:
        """Request at most `PAST_BATCH` messages of a topic from a number on."""
        if self._request:
            self.socket.unsubscribe(self._request)
        # Requests are numbered, since a repeated subscription is not sent.
        self._request = PAST_MARK + _prefix(topic) + b"%d.%d" % (seq, next(self._numbers))
        self.socket.subscribe(self._request)

    def receive(self) -> tuple[str, tuple[Header, bytes] | None] | None:
        """A topic and its next message, or the topic and None after the last requested message.

        None if nothing has arrived. Raises ValueError if it is no frame.
        """
        frame = received(self.socket)
        if frame is None:
            return None
        if frame.endswith(b"\0") and frame.count(b"\0") == 1:
            return frame[1:-1].decode(errors="replace"), None
        topic, header, body = split_frame(frame.removeprefix(PAST_MARK))
        return topic, (header, body)

    def close(self) -> None:
        """Close at once."""
        self.socket.close(0)


def _prefix(topic: str) -> bytes:
    return topic.encode() + b"\0"


class NodeSockets:
    """The sockets of one node.

    Raises zmq.ZMQError if an address cannot be bound, or no more files can be opened.
    """

    def __init__(
        self,
        name: str,  # of the node
        place: Addresses,
        *,
        subscriptions: Mapping[str, Sequence[str]],  # topics by publisher
        publications: Mapping[str, tuple[str, ...]],  # names of subscribers by topic
        persistent: bool = False,  # whether published messages survive the node's death
        types: Mapping[str, str] = MappingProxyType({}),  # known message types by topic
        settings: SocketSettings = DEFAULT_SOCKETS,
    ) -> None:
        self._settings = settings
        wanted = [topic for topic, subscribers in publications.items() if subscribers]
        past = MessageLog(
            Path(place.pasts[name]),
            wanted,
            silent=[topic for topic in publications if topic not in wanted],
            persistent=persistent,
            epoch=place.epoch,
        )
        self._wires = SocketContext(place.key)
        # Times are not needed without subscribers, or where frames are kept with their times.
        times = SendTimes(Path(place.times[name]), name, () if persistent else wanted)
        self._inbox: deque[Received] = deque()
        self._poller, self._blocked = zmq.Poller(), zmq.Poller()
        # Called while a subscriber's queue is full, so that a waiting node does not seem to hang.
        self.while_blocked: Callable[[], None] = lambda: None
        latched = {
            topic: LATCHED_DEPTH if TYPES[kind] in ALL_KEPT else 1
            for topic, kind in types.items()
            if TYPES.get(kind) in LATCHED
        }
        try:
            again = place.going and not persistent
            self._open(name, place, subscriptions, publications, past, times, latched, again=again)
        except zmq.ZMQError:
            self._wires.destroy()
            times.close()
            raise
        for topic, number in latched.items():  # messages of an earlier start
            for frame in past.since(topic, max(past.count(topic) - number, 0)):
                self.tap.keep(frame)
        # The publisher's descriptor wakes when its queue is no longer full.
        self._blocked.register(self.subscriber.socket, zmq.POLLIN)
        self._blocked.register(self.publisher.socket.getsockopt(zmq.FD), zmq.POLLIN)
        for socket in (self.subscriber.socket, self.publisher.socket, self.line.socket):
            self._poller.register(socket, zmq.POLLIN)

    def _open(
        self,
        name: str,
        place: Addresses,
        subscriptions: Mapping[str, Sequence[str]],
        publications: Mapping[str, tuple[str, ...]],
        past: MessageLog,
        times: SendTimes,
        latched: Mapping[str, int],
        *,
        again: bool,
    ) -> None:
        context, run, epoch, depth = self._wires.context, place.run, place.epoch, place.depth
        settings = self._settings
        self.line = ControlClient(context, place.control, name=name, settings=settings)
        self.subscriber = Subscriber(
            context,
            name=name,
            run=run,
            epoch=epoch,
            sources=subscriptions,
            endpoints=place.endpoints,
            depth=depth,
            settings=settings,
        )
        self.publisher = Publisher(
            context,
            place.endpoints[name],
            name=name,
            run=run,
            epoch=epoch,
            subscribers=publications,
            depth=depth,
            drain=self._drain,
            past=past,
            times=times,
            again=again,
            ahead_ns=place.ahead_ns,
            settings=settings,
        )
        tap = place.taps[name]
        self.tap = Tap(context, tap, run=run, epoch=epoch, latched=latched, past=past)

    @property
    def waiting(self) -> bool:
        """Whether the inbox has messages."""
        return bool(self._inbox)

    def wait(self, timeout_ms: int) -> tuple[bool, bool]:
        """Wait until something arrives, and answer nodes that join.

        Returns whether there are messages, and whether there are control messages of the launcher.
        """
        has_messages = has_control = False
        for socket, _ in self._poller.poll(timeout_ms):
            if socket is self.subscriber.socket:
                has_messages = True
            elif socket is self.line.socket:
                has_control = True
            else:
                self.publisher.serve()
        return has_messages, has_control

    def receive(self) -> Received | None:
        """The next message in the order of arrival; None if there is none. It never waits."""
        return self._inbox.popleft() if self._inbox else self._received()

    def take_in(self) -> None:
        """Move all messages that have arrived into the inbox."""
        while (arrival := self._received()) is not None:
            self._inbox.append(arrival)

    def give_back(self, arrivals: Iterable[Received]) -> None:
        """Put messages back at the front of the inbox."""
        self._inbox.extendleft(reversed(list(arrivals)))

    def send(
        self,
        topic: str,
        body: bytes,
        robot_time: float,
        schema: int,
        outlives: bool = False,
        outside: bool = False,
    ) -> None:
        """Publish a message, with a copy for the tap.

        Raises BlockedError if a subscriber's queue stays full for too long.
        """
        marks = {"outlives": outlives, "outside": outside}
        self.tap.mirror(self.publisher.send(topic, body, robot_time, schema, **marks))

    def answer(self, published: Sequence[tuple[str, bytes, float, int]], cause: Cause) -> None:
        """Keep and publish all answers to one message, with copies for the tap.

        Raises BlockedError if a subscriber's queue stays full for too long.
        """
        for frame in self.publisher.answer(published, cause):
            self.tap.mirror(frame)

    def close(self) -> None:
        """Close all sockets, the subscriber first, since it needs no more messages."""
        self.subscriber.close()
        self.publisher.close(self._settings.linger_ms)
        self.tap.close()
        self.line.close()
        self._wires.close()

    def _received(self) -> Received | None:
        arrival = self.subscriber.receive()
        if arrival is not None and arrival.header.sent_ns > self.publisher.latest_ns:
            self.publisher.latest_ns = arrival.header.sent_ns
        return arrival

    def _drain(self) -> None:
        self._blocked.poll(self._settings.blocked_poll_ms)
        self.take_in()
        self.while_blocked()
