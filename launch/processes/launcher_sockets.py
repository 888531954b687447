"""The launcher's sockets: nodes, tools, some topics, the taps, and the ends of the processes."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence

import zmq

from palpate.messages import decode, schema_hash
from palpate.messages.bus import (
    FROM_TOOLS,
    LAUNCHER,
    LOG_TOPIC,
    STATUS_TOPIC,
    Addresses,
    ControlServer,
    SocketContext,
    Subscriber,
    TapReader,
)
from palpate.messages.types import TYPES


class LauncherSockets:
    """The launcher's sockets.

    Parameters
    ----------
    place : Place
        Addresses of the run.
    sources : mapping of str to sequence of str
        Name of each publisher to the topics that the launcher hears from it.
    """

    def __init__(self, place: Addresses, sources: Mapping[str, Sequence[str]]) -> None:
        self._wires = SocketContext(place.key)
        context = self._wires.context
        self.line = ControlServer(context, place.control)
        self.tools = ControlServer(context, place.tools, accepts=FROM_TOOLS)
        self.ears = Subscriber(
            context,
            name=LAUNCHER,
            run=place.run,
            epoch=0,
            sources=sources,
            endpoints=place.endpoints,
            depth=place.depth,
        )
        self.taps = TapReader(context, place.taps.values(), (STATUS_TOPIC, LOG_TOPIC), place.depth)
        self.consumed: Counter[tuple[str, str]] = Counter()
        """Messages heard, by publisher and topic."""
        self._types: dict[int, type] = {}
        self._poller = zmq.Poller()
        for socket in (self.line.socket, self.tools.socket, self.ears.socket, self.taps.socket):
            self._poller.register(socket, zmq.POLLIN)

    def __enter__(self) -> LauncherSockets:
        return self

    def __exit__(self, *_: object) -> None:
        self.ears.close()
        self.taps.close()
        self.line.close()
        self.tools.close()
        self._wires.close()

    def watch(self, sentinel: int) -> None:
        """Also wake when this process ends."""
        self._poller.register(sentinel, zmq.POLLIN)

    def unwatch(self, sentinel: int) -> None:
        """Do not wake for this process any more."""
        self._poller.unregister(sentinel)

    def wait(self, timeout_ms: int) -> list[int]:
        """Wait until something arrives or a process ends; returns the sentinels of such."""
        return [who for who, _ in self._poller.poll(timeout_ms) if isinstance(who, int)]

    def receive(self) -> tuple[str, object] | None:
        """Topic and message of what has arrived next on the topics, or None."""
        arrival = self.ears.receive()
        if arrival is None:
            return None
        self.consumed[arrival.publisher, arrival.topic] += 1
        return arrival.topic, decode(
            self._type_of(arrival.topic, arrival.header.schema), arrival.body
        )

    def receive_tap(self) -> object | None:
        """What a node has said about itself, or None."""
        heard = self.taps.receive()
        if heard is None:
            return None
        topic, header, body = heard
        return decode(self._type_of(topic, header.schema), body)

    def _type_of(self, topic: str, schema: int) -> type:
        if not self._types:
            self._types = {schema_hash(cls): cls for cls in TYPES.values()}
        if schema not in self._types:
            raise ValueError(f"{topic} carries a type that the launcher does not know")
        return self._types[schema]
