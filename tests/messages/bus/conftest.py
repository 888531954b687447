from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import zmq

from palpate.messages.bus.message_log import MessageLog, SendTimes
from palpate.messages.bus.publisher import Publisher
from palpate.messages.bus.subscriber import Received, Subscriber


class Bench:
    """Publishers and subscribers in one thread, each turned by hand."""

    def __init__(self, context: zmq.Context[Any], folder: Path) -> None:
        self.context, self._folder = context, folder
        self._made: list[Publisher | Subscriber] = []

    def publisher(self, name: str = "talker", **more: Any) -> Publisher:
        number = len(self._made)
        settings: dict[str, Any] = {
            "run": 1,
            "epoch": 0,
            "times": SendTimes(self._folder / f"times_{number}", name, ["/talk", "/more"]),
            "subscribers": {"/talk": ("hearer",), "/more": ()},
            "depth": 1000,
            "drain": lambda: None,
            "past": MessageLog(Path("/nowhere"), ["/talk", "/more"]),
        }
        endpoint = more.pop("endpoint", f"inproc://{name}")
        made = Publisher(self.context, endpoint, name=name, **{**settings, **more})
        self._made.append(made)
        return made

    def subscriber(self, *topics: str, name: str = "hearer", **more: Any) -> Subscriber:
        settings: dict[str, Any] = {
            "run": 1,
            "epoch": 0,
            "sources": {"talker": topics or ("/talk",)},
            "endpoints": {"talker": "inproc://talker"},
            "depth": 1000,
        }
        made = Subscriber(self.context, name=name, **{**settings, **more})
        self._made.append(made)
        return made

    def publish(self, publisher: Publisher, *bodies: bytes, topic: str = "/talk") -> None:
        for body in bodies:
            publisher.send(topic, body, robot_time=0.0, schema=5)

    def turn(
        self, publisher: Publisher, subscriber: Subscriber, until: Callable[[], bool]
    ) -> list[Received]:
        """Turn both ends until something is so, and all that is there has been received."""
        received: list[Received] = []
        deadline = time.monotonic() + 10
        while not until():
            assert time.monotonic() < deadline, "nothing came of it"
            publisher.socket.poll(1)
            publisher.serve()
            received += self.receive(subscriber)
        return received + self.receive(subscriber)

    def receive(self, subscriber: Subscriber) -> list[Received]:
        received = []
        while (arrival := subscriber.receive()) is not None:
            received.append(arrival)
        return received

    def close(self) -> None:
        for one in self._made:
            if isinstance(one, Publisher):
                one._times.close()
            one.socket.close(0)


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[Bench]:
    with zmq.Context() as context:
        made = Bench(context, tmp_path)
        yield made
        made.close()
