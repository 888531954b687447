"""All that one node has on the bus: its sockets, and one place to wait for them.

By the tap a node publishes what it says of itself, and copies of its messages for tools. The tap
may lose messages, so that nobody who subscribes to it can hold up the graph: a tool that is
stopped or slow is left out. Copies are made only while somebody wants them; of latched topics the
last are kept, for those who come late and ask for them by a name of their own, `LATCHED_MARK`.
Who wants all that was published before asks for it by `PAST_MARK`, a little at a time.
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
from palpate.messages.bus.sockets import Addresses, Socket, SocketContext, bind, connect, received
from palpate.messages.bus.subscriber import RECONNECT_MS, Received, Subscriber
from palpate.messages.codec import Header, encode, pack_frame, schema_hash, split_frame
from palpate.messages.types import ALL_KEPT, LATCHED, TYPES, LogRecord, NodeStatus

STATUS_TOPIC, LOG_TOPIC = "/node/status", "/log"
TAP_DEPTH = 64  # Messages that a slow tool may lag behind before it loses some
LATCHED_DEPTH = TAP_DEPTH // 2  # Most messages of a latched topic that a late tool receives
LATCHED_MARK = b"\x02"  # Before a topic: what was latched before the subscription
PAST_MARK = b"\x03"  # Before a topic: what is sent once more to who asks for it
PAST_BATCH = TAP_DEPTH // 2  # Most messages that are sent once more at one request


class Tap:
    """The lossy outlet of one node."""

    def __init__(
        self,
        context: zmq.Context[Socket],
        endpoint: str,
        *,
        run: int,
        epoch: int,
        latched: Mapping[str, int] = MappingProxyType({}),  # Topic to how many messages count
        past: MessageLog | None = None,  # What was published before
    ) -> None:
        self.run, self.epoch = run, epoch
        self._past = past
        self._latched = {_prefix(topic): deque[bytes](maxlen=n) for topic, n in latched.items()}
        self._published: Counter[str] = Counter()
        self._wanted: set[bytes] = set()
        self._mirroring = False
        self.socket = context.socket(zmq.XPUB)
        self.socket.setsockopt(zmq.SNDHWM, TAP_DEPTH)
        self.socket.setsockopt(zmq.XPUB_VERBOSE, 1)  # The second who asks is late, too
        bind(self.socket, endpoint)

    def refresh(self) -> bool:
        """Take note of who listens; who asks for what is latched gets it.

        Returns whether anybody has begun to listen.
        """
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
        """Send messages of a topic from a number on once more, and a mark behind them."""
        number = wanted.partition(b".")[0]
        if self._past is None or not (0 < len(number) < 20 and number.isdigit()):
            return
        frames = self._past.since(topic.decode(errors="replace"), int(number))
        for frame in islice(frames, PAST_BATCH):
            self.socket.send(PAST_MARK + frame, zmq.DONTWAIT)
        self.socket.send(PAST_MARK + topic + b"\0", zmq.DONTWAIT)

    def publish(self, message: NodeStatus | LogRecord) -> None:
        """Send the node's own word, if anybody listens."""
        topic = STATUS_TOPIC if isinstance(message, NodeStatus) else LOG_TOPIC
        seq, robot_time = self._published[topic], getattr(message, "robot_time", 0.0)
        self._published[topic] += 1
        schema = schema_hash(type(message))
        header = Header(self.run, self.epoch, seq, time.monotonic_ns(), robot_time, schema)
        self.socket.send(pack_frame(topic, header, encode(message)), zmq.DONTWAIT)

    def keep(self, frame: bytes) -> None:
        """Keep a copy of a reliable frame for those who come late, if its topic is latched."""
        if self._latched and (kept := self._latched.get(frame[: frame.index(0) + 1])) is not None:
            kept.append(frame)

    def mirror(self, frame: bytes) -> None:
        """Send a copy of a reliable frame, if anybody wants copies; keep it if it is latched."""
        self.keep(frame)
        if self._mirroring:
            self.socket.send(frame, zmq.DONTWAIT)

    def close(self) -> None:
        """Close at once."""
        self.socket.close(0)


class TapReader:
    """Listens to the taps of several nodes."""

    def __init__(
        self,
        context: zmq.Context[Socket],
        endpoints: Iterable[str],
        topics: Iterable[str],
        depth: int = TAP_DEPTH,  # Most messages in the queue from one tap
        *,
        latched: bool = False,  # Whether what was latched before is wanted, too
    ) -> None:
        self.socket = context.socket(zmq.SUB)
        self.socket.setsockopt(zmq.RCVHWM, depth)
        self.socket.setsockopt(zmq.RECONNECT_IVL, RECONNECT_MS)
        for topic in topics:
            self.socket.subscribe(_prefix(topic))
            if latched:
                self.socket.subscribe(LATCHED_MARK + _prefix(topic))
        for endpoint in endpoints:
            connect(self.socket, endpoint)

    def receive(self) -> tuple[str, Header, bytes] | None:
        """Topic, header and body of the next message; None if there is none.

        Raises ValueError if what arrived is not a frame.
        """
        frame = received(self.socket)
        return None if frame is None else split_frame(frame.removeprefix(LATCHED_MARK))

    def close(self) -> None:
        """Close at once."""
        self.socket.close(0)


class PastReader:
    """Asks one node for what it has published, by its tap: nobody waits for who asks."""

    def __init__(self, context: zmq.Context[Socket], endpoint: str, topics: Iterable[str]) -> None:
        self._request, self._numbers = b"", count()
        self.socket = context.socket(zmq.SUB)
        self.socket.setsockopt(zmq.RECONNECT_IVL, RECONNECT_MS)
        for topic in topics:
            self.socket.subscribe(PAST_MARK + _prefix(topic))
        connect(self.socket, endpoint)

    def ask(self, topic: str, seq: int) -> None:
        """Ask for the next messages of a topic, `PAST_BATCH` at most, from a number on."""
        if self._request:
            self.socket.unsubscribe(self._request)
        # No two requests are alike, for the second of such would not be sent.
        self._request = PAST_MARK + _prefix(topic) + b"%d.%d" % (seq, next(self._numbers))
        self.socket.subscribe(self._request)

    def receive(self) -> tuple[str, tuple[Header, bytes] | None] | None:
        """A topic and a message of it, or None behind the last that was asked for.

        None if nothing has come. Raises ValueError if what arrived is not a frame.
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


_BLOCKED_POLL_MS = 10
LINGER_MS = 1000  # At the end, messages that are still queued have this long to leave


class NodeSockets:
    """The sockets of one node.

    Raises zmq.ZMQError if an address cannot be bound, or there are no more files to be had.
    """

    def __init__(
        self,
        name: str,  # Name of the node
        place: Addresses,  # Addresses of the run
        *,
        # Name of each publisher to the topics that are subscribed to
        subscriptions: Mapping[str, Sequence[str]],
        # Each topic that the node publishes, with the names of its subscribers
        publications: Mapping[str, tuple[str, ...]],
        persistent: bool = False,  # Whether what it publishes is kept beyond the node's death
        types: Mapping[str, str] = MappingProxyType({}),  # Topic to its message type, if known
    ) -> None:
        wanted = [topic for topic, subscribers in publications.items() if subscribers]
        past = MessageLog(
            Path(place.pasts[name]),
            wanted,
            silent=[topic for topic in publications if topic not in wanted],
            persistent=persistent,
            epoch=place.epoch,
        )
        self._wires = SocketContext(place.key)
        # What has no subscriber is not published again, and what is kept carries its times itself.
        times = SendTimes(Path(place.times[name]), name, () if persistent else wanted)
        self._inbox: deque[Received] = deque()
        self._poller, self._blocked = zmq.Poller(), zmq.Poller()
        # Called now and then while a subscriber's queue is full: who waits for it does not hang
        self.while_blocked: Callable[[], None] = lambda: None
        kept = {
            topic: LATCHED_DEPTH if TYPES[kind] in ALL_KEPT else 1
            for topic, kind in types.items()
            if TYPES.get(kind) in LATCHED
        }
        try:
            again = place.going and not persistent
            self._open(name, place, subscriptions, publications, past, times, kept, again=again)
        except zmq.ZMQError:
            self._wires.destroy()
            times.close()
            raise
        for topic, number in kept.items():  # what an earlier start has published
            for frame in past.since(topic, max(past.count(topic) - number, 0)):
                self.tap.keep(frame)
        # The publisher by its descriptor: it wakes when a place in a queue has come free.
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
        self.line = ControlClient(context, place.control, name=name)
        self.subscriber = Subscriber(
            context,
            name=name,
            run=run,
            epoch=epoch,
            sources=subscriptions,
            endpoints=place.endpoints,
            depth=depth,
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
        )
        tap = place.taps[name]
        self.tap = Tap(context, tap, run=run, epoch=epoch, latched=latched, past=past)

    @property
    def waiting(self) -> bool:
        """Whether messages lie in the inbox."""
        return bool(self._inbox)

    def wait(self, timeout_ms: int) -> tuple[bool, bool]:
        """Wait until something arrives; answer those who join.

        Returns whether messages, and words of the launcher, are there to be taken.
        """
        received = told = False
        for socket, _ in self._poller.poll(timeout_ms):
            if socket is self.subscriber.socket:
                received = True
            elif socket is self.line.socket:
                told = True
            else:
                self.publisher.serve()
        return received, told

    def receive(self) -> Received | None:
        """Return the next message in the order of arrival, or None; never waits."""
        return self._inbox.popleft() if self._inbox else self._received()

    def take_in(self) -> None:
        """Move all that has arrived into the inbox."""
        while (arrival := self._received()) is not None:
            self._inbox.append(arrival)

    def give_back(self, arrivals: Iterable[Received]) -> None:
        """Have messages handed out again, before all others."""
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
        how = {"outlives": outlives, "outside": outside}
        self.tap.mirror(self.publisher.send(topic, body, robot_time, schema, **how))

    def answer(self, published: Sequence[tuple[str, bytes, float, int]], cause: Cause) -> None:
        """Publish all that answers one message, once it is kept, with copies for the tap.

        Raises BlockedError if a subscriber's queue stays full for too long.
        """
        for frame in self.publisher.answer(published, cause):
            self.tap.mirror(frame)

    def close(self) -> None:
        """Close everything, the receiving end first: what is still sent to it is not wanted."""
        self.subscriber.close()
        self.publisher.close(LINGER_MS)
        self.tap.close()
        self.line.close()
        self._wires.close()

    def _received(self) -> Received | None:
        arrival = self.subscriber.receive()
        if arrival is not None and arrival.header.sent_ns > self.publisher.latest_ns:
            self.publisher.latest_ns = arrival.header.sent_ns
        return arrival

    def _drain(self) -> None:
        self._blocked.poll(_BLOCKED_POLL_MS)
        self.take_in()
        self.while_blocked()
