"""Publishers and subscribers in one thread, each turned by hand."""

import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import zmq

from palpate.messages.bus import MessageLog, Publisher, Received, SendTimes, Subscriber


class Wires:
    """All ends of a test, and what each subscriber has received."""

    def __init__(self, context: zmq.Context[Any], folder: Path) -> None:
        self.context, self.folder = context, folder
        self.heard: dict[str, list[Received]] = defaultdict(list)
        self._publishers: list[Publisher] = []
        self._subscribers: list[Subscriber] = []

    def publisher(self, name: str = "talker", *, endpoint: str = "", **more: Any) -> Publisher:
        number = len(self._publishers)
        settings: dict[str, Any] = {
            "run": 1,
            "epoch": 0,
            "times": SendTimes(self.folder / f"times_{number}", name, ["/talk", "/more"]),
            "subscribers": {"/talk": ("hearer",), "/more": ()},
            "depth": 1000,
            "drain": lambda: None,
            "past": MessageLog(Path("/nowhere"), ["/talk", "/more"]),
        }
        where = endpoint or f"inproc://{name}"
        made = Publisher(self.context, where, name=name, **{**settings, **more})
        self._publishers.append(made)
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
        self._subscribers.append(made)
        return made

    def joined(self, *topics: str, **more: Any) -> tuple[Publisher, Subscriber]:
        """A publisher and its subscriber, in step."""
        publisher, subscriber = self.publisher(**more), self.subscriber(*topics)
        self.turn(lambda: subscriber.in_step)
        return publisher, subscriber

    def publish(self, publisher: Publisher, *bodies: bytes, topic: str = "/talk") -> None:
        for body in bodies:
            publisher.send(topic, body, robot_time=0.0, schema=5)

    def receive(self) -> None:
        """Take in all that has arrived."""
        for subscriber in self._subscribers:
            while (arrival := subscriber.receive()) is not None:
                self.heard[subscriber.name].append(arrival)

    def turn(self, until: Callable[[], bool]) -> None:
        """Turn all ends until something is so, and all that is there has been received."""
        deadline = time.monotonic() + 10.0
        while not until():
            assert time.monotonic() < deadline, f"not reached; received {dict(self.heard)}"
            for publisher in self._publishers:
                if not publisher.socket.closed:
                    publisher.serve()
            for hearer in self._subscribers:
                hearer.socket.poll(1)
            self.receive()
        self.receive()

    def seqs(self, name: str = "hearer") -> list[int]:
        """Numbers of the messages that a subscriber has received."""
        self.receive()
        return [arrival.header.seq for arrival in self.heard[name]]

    def close(self) -> None:
        for publisher in self._publishers:
            if not publisher.socket.closed:
                publisher.close(0)
        for hearer in self._subscribers:
            hearer.close()


@pytest.fixture
def wires(tmp_path: Path) -> Iterator[Wires]:
    with zmq.Context() as context:
        made = Wires(context, tmp_path)
        yield made
        made.close()
