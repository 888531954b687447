from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import pytest
import zmq

from palpate.messages.bus.node_sockets import NodeSockets
from palpate.messages.bus.sockets import Addresses


def place(folder: Path) -> Addresses:
    return Addresses(
        run=1,
        epoch=0,
        depth=1,
        endpoints={name: f"ipc://{folder}/{name}" for name in "ab"},
        taps={name: f"ipc://{folder}/tap_{name}" for name in "ab"},
        control=f"ipc://{folder}/control",
        tools=f"ipc://{folder}/tools",
        journals={name: f"{folder}/journal_{name}" for name in "ab"},
        times={name: f"{folder}/times_{name}" for name in "ab"},
        pasts={name: f"{folder}/past_{name}" for name in "ab"},
    )


def ring(folder: Path) -> tuple[NodeSockets, NodeSockets]:
    where = place(folder)
    return (
        NodeSockets("a", where, subscriptions={"b": ["/b"]}, publications={"/a": ("b",)}),
        NodeSockets("b", where, subscriptions={"a": ["/a"]}, publications={"/b": ("a",)}),
    )


def turn(stations: tuple[NodeSockets, NodeSockets], until: Callable[[], bool]) -> None:
    deadline = time.monotonic() + 10
    while not until():
        assert time.monotonic() < deadline, "nothing came of it"
        for station in stations:
            station.wait(1)
            station.take_in()


@pytest.fixture
def stations(tmp_path: Path) -> Iterator[tuple[NodeSockets, NodeSockets]]:
    made = ring(tmp_path)
    yield made
    for station in made:
        # Nobody is there to take its last words.
        station.line.socket.close(0)
        station.close()


def test_two_nodes_that_receive_each_other_get_in_step(stations: tuple[NodeSockets, NodeSockets]):
    a, b = stations
    turn(stations, lambda: a.subscriber.in_step and b.subscriber.in_step)
    a.send("/a", b"body", robot_time=0.0, schema=1)
    turn(stations, lambda: b.waiting)
    arrival = b.receive()
    assert arrival is not None and arrival.body == b"body"
    assert not b.waiting and b.receive() is None


def test_what_was_taken_in_comes_first(stations: tuple[NodeSockets, NodeSockets]):
    a, b = stations
    turn(stations, lambda: a.subscriber.in_step and b.subscriber.in_step)
    b.send("/b", b"0", robot_time=0.0, schema=1)
    turn(stations, lambda: a.waiting)
    b.send("/b", b"1", robot_time=0.0, schema=1)
    assert a.subscriber.socket.poll(5000)
    received = [a.receive(), a.receive()]
    assert [one.body for one in received if one is not None] == [b"0", b"1"]


def test_waiting_tells_messages_from_words(stations: tuple[NodeSockets, NodeSockets]):
    a, b = stations
    turn(stations, lambda: a.subscriber.in_step and b.subscriber.in_step)
    assert a.wait(0) == (False, False)
    b.send("/b", b"0", robot_time=0.0, schema=1)
    assert a.subscriber.socket.poll(5000)
    assert a.wait(0) == (True, False)


def test_an_address_that_cannot_be_bound_is_an_error(tmp_path: Path):
    where = replace(place(tmp_path), endpoints=place(tmp_path / "nowhere").endpoints)
    with pytest.raises(zmq.ZMQError):
        NodeSockets("a", where, subscriptions={}, publications={})
