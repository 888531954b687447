"""All that one node has on the bus: its sockets, and one place to wait for them."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path

import zmq

from palpate.messages.bus.control import ControlClient
from palpate.messages.bus.message_log import Cause, MessageLog, SendTimes
from palpate.messages.bus.publisher import Publisher
from palpate.messages.bus.sockets import Addresses, SocketContext
from palpate.messages.bus.subscriber import Received, Subscriber
from palpate.messages.bus.tap import Tap

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
    ) -> None:
        self._past = MessageLog(
            Path(place.pasts[name]),
            [topic for topic, listeners in publications.items() if listeners],
            silent=[topic for topic, listeners in publications.items() if not listeners],
            persistent=persistent,
            epoch=place.epoch,
        )
        self._wires = SocketContext(place.key)
        # What has no subscriber is not published again, and what is kept carries its times itself.
        timed = [topic for topic, listeners in publications.items() if listeners and not persistent]
        self._times = SendTimes(Path(place.times[name]), name, timed)
        self._inbox: deque[Received] = deque()
        self._poller, self._blocked = zmq.Poller(), zmq.Poller()
        # Called now and then while a listener's queue is full: who waits for it does not hang
        self.while_blocked: Callable[[], None] = lambda: None
        try:
            self._open(
                name, place, subscriptions, publications, again=place.going and not persistent
            )
        except zmq.ZMQError:
            self._wires.destroy()
            self._times.close()
            raise

    def _open(
        self,
        name: str,
        place: Addresses,
        subscriptions: Mapping[str, Sequence[str]],
        publications: Mapping[str, tuple[str, ...]],
        *,
        again: bool,
    ) -> None:
        context = self._wires.context
        run, epoch, depth = place.run, place.epoch, place.depth
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
            listeners=publications,
            depth=depth,
            drain=self._drain,
            past=self._past,
            times=self._times,
            again=again,
            ahead_ns=place.ahead_ns,
        )
        self.tap = Tap(context, place.taps[name], run=run, epoch=epoch)
        # The publisher by its descriptor: it wakes when a place in a queue has come free.
        self._blocked.register(self.subscriber.socket, zmq.POLLIN)
        self._blocked.register(self.publisher.socket.getsockopt(zmq.FD), zmq.POLLIN)
        for socket in (self.subscriber.socket, self.publisher.socket, self.line.socket):
            self._poller.register(socket, zmq.POLLIN)

    @property
    def waiting(self) -> bool:
        """Whether messages lie in the inbox."""
        return bool(self._inbox)

    def wait(self, timeout_ms: int) -> tuple[bool, bool]:
        """Wait until something arrives; answer those who join.

        Returns
        -------
        received, told : bool
            Whether messages, and words of the launcher, are there to be taken.
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

    def send(self, topic: str, body: bytes, *, robot_time: float, schema: int) -> None:
        """Publish a message, with a copy for the tap.

        Raises BlockedError if a listener's queue stays full for too long.
        """
        frame = self.publisher.send(topic, body, robot_time=robot_time, schema=schema)
        self.tap.mirror(frame)

    def answer(self, published: Sequence[tuple[str, bytes, float, int]], cause: Cause) -> None:
        """Publish all that answers one message, once it is kept, with copies for the tap.

        Raises BlockedError if a listener's queue stays full for too long.
        """
        for frame in self.publisher.answer(published, cause):
            self.tap.mirror(frame)

    def close(self) -> None:
        """Close everything, the hearing end first: what is still sent to it is not wanted."""
        self.subscriber.close()
        self.publisher.close(LINGER_MS)
        self.tap.close()
        self.line.close()
        self._wires.close()

    def _received(self) -> Received | None:
        arrival = self.subscriber.receive()
        if arrival is not None:
            self.publisher.latest_ns = max(self.publisher.latest_ns, arrival.header.sent_ns)
        return arrival

    def _drain(self) -> None:
        self._blocked.poll(_BLOCKED_POLL_MS)
        self.take_in()
        self.while_blocked()
