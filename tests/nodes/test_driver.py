from __future__ import annotations

import itertools
import socket
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.touch.curvature import surface_patch
from palpate.nodes import curvature, driver, filter, socket_driver
from palpate.nodes.runtime.node import Finished, Timed
from palpate.nodes.runtime.testing import drive, messages_on
from palpate.nodes.specs.frames import SensorParams, sensor_info, tactile_frame
from palpate.nodes.specs.sensors import calibration_of_info

PAD: dict[str, Any] = {"sensor": {"pad": {"radius": None}}}
POSE = (0.1, 0.0, 0.0, 0.5, 0.5, 0.5, 0.5)


def ball(radius: float = 0.02, depth: float = 0.8e-3) -> Floats:
    side = (np.arange(16) - 7.5) * 1e-3
    x, y = np.meshgrid(side, side)
    image: Floats = np.maximum(depth - 0.5 * (x**2 + y**2) / radius, 0.0)
    return image


def line(image: Floats) -> str:
    return ",".join(map(repr, (*POSE, *image.ravel().tolist())))


@pytest.fixture
def table(tmp_path: Path) -> Path:
    """Three touches of a ball in a CSV file."""
    path = tmp_path / "frames.csv"
    path.write_text("\n".join(line(ball(depth=depth)) for depth in (0.4e-3, 0.6e-3, 0.8e-3)))
    return path


def test_the_frames_of_a_file_become_patches(table: Path):
    published = drive(driver.SOURCE, params={**PAD, "path": str(table)})
    images = drive(filter.NODE, published[:-2])
    patches = messages_on(drive(curvature.NODE, [*published[:1], *images]), "/touch/patch")
    assert published[-1] == Finished(f"published the 3 frames of {table}")
    assert [patch.kind for patch in patches] == ["smooth"] * 3
    for patch in patches:
        # Rounding alone: a paraboloid is a jet.
        assert (patch.k1, patch.k2) == pytest.approx((50.0, 50.0), rel=1e-6)
        # The pad's z axis, x of the world, points into the object.
        assert patch.normal == pytest.approx([-1.0, 0.0, 0.0], abs=1e-9)


def test_a_frame_is_due_at_its_time_or_at_once(table: Path):
    params = msgspec.convert({**PAD, "path": str(table), "rate": 20.0}, driver.Params)
    published = [one for one in driver.SOURCE.open(params) if isinstance(one, Timed)]
    assert [one.due for one in published] == [0.0, 0.0, 0.05, 0.1, 0.1]
    times = [one.message.robot_time for one in published[1:]]  # type: ignore[attr-defined]
    assert times == [0.0, 0.05, 0.1, 0.1]
    quick = driver.SOURCE.open(msgspec.structs.replace(params, at_once=True))
    assert [one.due for one in quick if isinstance(one, Timed)] == [0.0] * 5


def test_the_times_of_the_file_count_from_its_first_frame(table: Path):
    lines = table.read_text().splitlines()
    table.write_text("\n".join(f"{t},{one}" for t, one in zip((7.0, 7.5, 9.0), lines, strict=True)))
    params = msgspec.convert({**PAD, "path": str(table)}, driver.Params)
    published = [one for one in driver.SOURCE.open(params) if isinstance(one, Timed)]
    assert [one.due for one in published] == [0.0, 0.0, 0.5, 2.0, 2.0]


def test_a_file_that_cannot_be_published_is_refused_before_the_start(table: Path):
    params = msgspec.convert({"path": str(table), "sensor": {"rows": 12}}, driver.Params)
    with pytest.raises(ValueError, match=r"frames\.csv:1: has 263 columns; expected 199"):
        driver.SOURCE.outputs(params)
    table.write_text("x")
    missing = msgspec.structs.replace(params, path="no.csv")
    with pytest.raises(ValueError, match=r"no\.csv: cannot be read"):
        driver.SOURCE.outputs(missing)


@pytest.mark.parametrize(
    ("given", "unit"),
    [
        ({}, 1.0),
        ({"scale": 1e-3}, 1e3),
        ({"sensor": {"signal": "force"}}, 1.0),
        ({"values": "signal", "sensor": {"signal": "force"}}, 2e8 * 1e-6),
    ],
)
def test_the_numbers_mean_what_the_parameters_tell(given: dict[str, Any], unit: float):
    sensing = msgspec.convert(given, SensorParams)
    frame = tactile_frame(sensing, 0, 0.0, np.array(POSE), unit * ball())
    back = calibration_of_info(sensor_info(sensing)).decode(frame.array)
    # Lengths of 3 mm at most, through few operations: a few units in the last place of that.
    assert np.abs(back - ball()).max() <= 8 * np.finfo(float).eps * 0.003
    assert frame.outcome == "hit"


def test_numbers_in_another_unit_are_refused_before_the_start(table: Path):
    params = msgspec.convert({**PAD, "path": str(table), "scale": 1e3}, driver.Params)
    words = "frame 2: the pad is compressed by 0.788 m, but is 0.003 m thick; are the numbers in mm"
    with pytest.raises(ValueError, match=words):
        driver.SOURCE.outputs(params)


def test_times_of_flight_are_taken_as_they_come():
    sensing = msgspec.convert({"values": "signal"}, SensorParams)
    array = 2.0 * (0.003 - ball()) / 1000.0
    assert tactile_frame(sensing, 0, 0.0, np.array(POSE), array).array.tolist() == array.tolist()


def test_what_does_not_touch_misses_and_a_pad_that_is_full_has_bottomed():
    sensing = SensorParams()
    outcomes = [
        tactile_frame(sensing, 0, 0.0, np.array(POSE), image).outcome
        for image in (np.zeros((16, 16)), ball(), np.full((16, 16), 2.5e-3))
    ]
    assert outcomes == ["miss", "hit", "bottomed"]


@pytest.fixture
def server() -> Iterator[socket.socket]:
    """A server on a free port of this machine."""
    with socket.create_server(("127.0.0.1", 0)) as found:
        yield found


def port(server: socket.socket) -> str:
    return str(server.getsockname()[1])


def test_lines_become_frames_as_they_come(server: socket.socket):
    params = msgspec.convert({**PAD, "address": port(server), "rate": 4.0}, socket_driver.Params)
    published = socket_driver.SOURCE.open(params)
    assert next(published).topic == "/touch/info"  # type: ignore[union-attr]
    assert next(published) is None
    peer, _ = server.accept()
    with peer:
        assert next(published) is None
        text = line(ball())
        peer.sendall(b"x,y,z,what,ever\n" + text[:50].encode())
        assert next(published) is None
        peer.sendall(f"{text[50:]}\n\n{text}".encode())
        first = next(one for one in published if one is not None)
    rest = [one for one in published if one is not None]
    assert isinstance(first, Timed) and first.due == 0.0
    assert [one.message.touch for one in (first, *rest[:-2])] == [0, 1]  # type: ignore[union-attr]
    assert rest[0].message.robot_time == 0.25  # type: ignore[union-attr]
    assert rest[-2].message.frames == 2  # type: ignore[union-attr]
    assert rest[-1] == Finished(f"{params.address} closed the connection after 2 frames")
    image = first.message.array  # type: ignore[attr-defined]
    assert surface_patch(0.003 - 500.0 * image, 1e-3).principal == pytest.approx(
        (50.0, 50.0), rel=1e-6
    )


@pytest.mark.parametrize(
    ("sent", "words"),
    [
        (b"1,2,3\n", "frame 0: has 3 columns; expected 263"),
        (b"\xff\n", "sent what is no text"),
        (b"1" * (1 << 19), "sent a line of more than 256 kB"),
    ],
)
def test_what_is_no_line_of_a_frame_is_told(server: socket.socket, sent: bytes, words: str):
    params = socket_driver.Params(address=port(server))
    published = socket_driver.SOURCE.open(params)
    assert list(itertools.islice(published, 2))[1] is None
    peer, _ = server.accept()
    peer.setblocking(False)
    with peer, pytest.raises(ValueError, match=words):
        rest = sent
        while True:
            rest = rest[peer.send(rest) :] if rest else rest
            next(published)


def test_nobody_at_the_address_is_told(server: socket.socket):
    address = port(server)
    server.close()
    with pytest.raises(ValueError, match=f"{address}: cannot be reached: Connection refused"):
        list(socket_driver.SOURCE.open(socket_driver.Params(address=address)))


@pytest.mark.parametrize(
    ("address", "end"),
    [
        ("5555", ("127.0.0.1", 5555)),
        (":5555", ("127.0.0.1", 5555)),
        ("localhost:1", ("127.0.0.1", 1)),
        ("192.0.2.7:65535", ("192.0.2.7", 65535)),
    ],
)
def test_an_address_without_a_machine_means_this_one(address: str, end: tuple[str, int]):
    assert socket_driver.parse_address(address) == end


@pytest.mark.parametrize(
    "address", ["", "x", "0", "65536", "192.0.2:1", "sensor.example:5555", "1:2:3", "-1", "٣"]
)
def test_what_is_no_address_is_refused(address: str):
    with pytest.raises(ValueError, match=r"address is .*; expected a port such as 5555"):
        socket_driver.Params(address=address)


def test_a_file_is_published_again_and_a_live_sensor_is_not():
    assert driver.SOURCE.repeats
    assert not socket_driver.SOURCE.repeats
