from __future__ import annotations

from pathlib import Path

import pytest
import zmq

from palpate.messages.bus.place import Place
from palpate.messages.bus.station import Station


def place(folder: Path) -> Place:
    return Place(
        run=1,
        epoch=0,
        depth=1,
        endpoints={name: f"ipc://{folder}/{name}" for name in "ab"},
        taps={name: f"ipc://{folder}/tap_{name}" for name in "ab"},
        control=f"ipc://{folder}/control",
    )


def ring(folder: Path) -> tuple[Station, Station]:
    where = place(folder)
    return (
        Station("a", where, hears={"b": ["/b"]}, says={"/a": ("b",)}),
        Station("b", where, hears={"a": ["/a"]}, says={"/b": ("a",)}),
    )


def test_two_stations_that_hear_each_other_get_in_step(tmp_path: Path) -> None:
    stations = ring(tmp_path)
    for _ in range(1000):
        for station in stations:
            station.wait(1)
            station.take_in()
        if all(station.subscriber.in_step for station in stations):
            break
    stations[0].send("/a", b"body", robot_time=0.0, schema=1)
    assert stations[1].wait(5000) == (True, False)
    arrival = stations[1].receive()
    assert arrival is not None and arrival.body == b"body"
    assert not stations[1].waiting and stations[1].receive() is None
    for station in stations:
        station.line.socket.close(0)
        station.close()


def test_what_was_taken_in_comes_first(tmp_path: Path) -> None:
    a, b = ring(tmp_path)
    b.send("/b", b"0", robot_time=0.0, schema=1)
    while not a.waiting:
        b.wait(1)
        a.wait(1)
        a.take_in()
    b.send("/b", b"1", robot_time=0.0, schema=1)
    assert a.subscriber.socket.poll(5000)
    heard = [a.receive(), a.receive()]
    assert [one.body for one in heard if one is not None] == [b"0", b"1"]
    for station in (a, b):
        station.line.socket.close(0)
        station.close()


def test_an_address_that_cannot_be_bound_is_an_error(tmp_path: Path) -> None:
    where = place(tmp_path / "nowhere")
    with pytest.raises(zmq.ZMQError):
        Station("a", where, hears={}, says={})
