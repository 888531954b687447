"""Drivers: files and lines of frames as messages, sensors as data, what a tool may type."""

from __future__ import annotations

import itertools
import pickle
import socket
import struct
import zipfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.nodes import console, curvature, driver, filter, socket_driver
from palpate.nodes.runtime.node import Finished, Timed
from palpate.nodes.runtime.testing import drive, messages_on
from palpate.nodes.specs.frames import (
    FRAMES_PER_GOAL,
    MAX_FRAMES,
    SensorParams,
    parse_row,
    read_frames,
    sensor_info,
    tactile_frame,
)
from palpate.nodes.specs.sensors import (
    CalibrationSpec,
    PadSpec,
    SensorSpec,
    calibration_of_info,
    info_of,
    pad_of_info,
    resolution_of_info,
)
from tests.messages.cases import cases

PAD: dict[str, Any] = {"sensor": {"pad": {"radius": None}}}
POSE = (0.1, 0.0, 0.0, 0.5, 0.5, 0.5, 0.5)
SMALL = "0.1,0.2,0.3,0,0,0,1," + ",".join(map(str, range(16)))
HEADER = "x,y,z,qx,qy,qz,qw," + ",".join(f"v{i}" for i in range(16))
TURNED = f"placement,{HEADER}"
UNITS, FRAMES = np.tile([0.0, 0, 0, 0, 0, 0, 1], (2, 1)), np.zeros((2, 4, 4))
Write = Callable[[str, str], Path]


def ball(radius: float = 0.02, depth: float = 0.8e-3) -> Floats:
    side = (np.arange(16) - 7.5) * 1e-3
    x, y = np.meshgrid(side, side)
    return np.maximum(depth - 0.5 * (x**2 + y**2) / radius, 0.0)


def line(image: Floats) -> str:
    return ",".join(map(repr, (*POSE, *image.ravel().tolist())))


@pytest.fixture
def table(tmp_path: Path) -> Path:
    """Three touches of a ball in a CSV file."""
    path = tmp_path / "frames.csv"
    path.write_text("\n".join(line(ball(depth=depth)) for depth in (0.4e-3, 0.6e-3, 0.8e-3)))
    return path


def packed(folder: Path, **arrays: Any) -> Path:
    np.savez(folder / "f.npz", **arrays)
    return folder / "f.npz"


@pytest.mark.parametrize(
    "lines",
    [[SMALL] * 2, [HEADER, SMALL, "", SMALL, ""], [f"\ufeff{SMALL}", SMALL.replace(",", " , ")]],
)
def test_table_of_frames_is_read(write: Write, lines: list[str]):
    frames = read_frames(write("f.csv", "\n".join(lines)))
    assert frames.images[1].tolist() == np.arange(16.0).reshape(4, 4).tolist()
    assert frames.poses[0].tolist() == [0.1, 0.2, 0.3, 0, 0, 0, 1]
    assert frames.images.shape == (2, 4, 4) and frames.times is None
    lines = [f"t,{HEADER}", *(f"{time},{SMALL}" for time in (2.5, 2.5, 3))]
    timed = read_frames(write("f.csv", "\n".join(lines)))
    assert timed.times is not None and timed.times.tolist() == [2.5, 2.5, 3.0]


def test_square_array_is_told_from_its_columns_and_any_other_needs_its_rows(write: Write):
    path = write("f.csv", "0,0,0,0.707,0,0,0.707," + ",".join("0" * 32))
    frames = read_frames(path, 4, 8)
    assert frames.images.shape == (1, 4, 8)
    assert np.linalg.norm(frames.poses[0][3:]) == pytest.approx(1.0, abs=1e-15)
    with pytest.raises(ValueError, match=r"f\.csv:1: has 39 columns; expected 7 of the pose and"):
        read_frames(path)
    for side, time in itertools.product(range(4, 65), ("", "1.5,")):
        row = parse_row(f"{time}0,0,0,0,0,0,1," + ",".join("0" * side**2), "f:1", None)
        assert row.image.shape == (side, side) and row.time == (1.5 if time else None)


@pytest.mark.parametrize("column", [0, 7, 23])
def test_header_tells_which_column_counts_turns(write: Write, column: int):
    def with_cell(line: str, cell: str) -> str:
        cells = line.split(",")
        return ",".join([*cells[:column], cell, *cells[column:]])

    lines = [with_cell(HEADER, " Placement"), *(with_cell(SMALL, n) for n in "0011")]
    frames = read_frames(write("f.csv", "\n".join(lines)))
    assert frames.placements.tolist() == [0, 0, 1, 1]
    assert frames.images[3].ravel().tolist() == list(range(16))
    assert read_frames(write("f.csv", SMALL)).placements.tolist() == [0]


def test_arrays_of_frames_are_read(tmp_path: Path):
    poses = np.tile(UNITS[0], (3, 1))
    arrays = {"frames": np.ones((3, 4, 6), np.int16), "poses": poses}
    frames = read_frames(packed(tmp_path, **arrays, times=[0, 1, 1]))
    assert frames.images.shape == (3, 4, 6) and frames.images.dtype == np.float64
    assert frames.times is not None and frames.times.tolist() == [0.0, 1.0, 1.0]
    assert read_frames(packed(tmp_path, **arrays)).times is None


@cases(
    "lines, words",
    ([SMALL, f"{SMALL},1,2"], r":2: has 25 columns; expected 23: x,y,z,qx,qy,qz,qw and 4"),
    ([HEADER, "", SMALL.replace("0.2", "nan")], ":3: column 2 is 'nan'; expected a finite"),
    ([SMALL, SMALL.replace("0.2", "high")], ":2: column 2 is 'high'; expected a finite"),
    ([SMALL, SMALL.replace("0.2", "")], ":2: column 2 is ''; expected a finite number"),
    ([SMALL.replace("0,0,0,1", "0,0,0,2", 1)], ":1: the quaternion has length 2; exp"),
    ([f"1,{SMALL}", f"0.5,{SMALL}"], ":2: the time 0.5 comes before 1"),
    ([f"1,{SMALL}", SMALL], ":2: not every line has a time; expected all or none"),
    ([], ": holds no frames"),
    ([HEADER], ": holds no frames"),
    ([TURNED, f"0,{SMALL}", f"2,{SMALL}"], ":3: the placement is 2 after 0; expected 0, or 1 once"),
    ([TURNED, f"1,{SMALL}", f"0,{SMALL}"], ":3: the placement is 0 after 1; expected 1, or 2 once"),
    ([TURNED, f"0.5,{SMALL}"], ":2: the placement is 0.5 after 0"),
    ([TURNED, f",{SMALL}"], ":2: the placement is nan after 0"),
    ([TURNED, *(f"{n},{SMALL}" for n in range(10))], ":11: the placement is 9; expected 8 at most"),
)
def test_wrong_table_is_refused_with_its_line(write: Write, lines: list[str], words: str):
    with pytest.raises(ValueError, match=rf"f\.csv{words}"):
        read_frames(write("f.csv", "\n".join(lines)))


@cases(
    "arrays, words",
    ({"poses": UNITS}, "lacks the array 'frames'"),
    ({"frames": FRAMES}, "lacks the array 'poses'"),
    ({"frames": FRAMES[0], "poses": UNITS}, "frames is an array of float64 with 2 dimensions"),
    ({"frames": FRAMES == 0, "poses": UNITS}, "frames is an array of bool"),
    ({"frames": FRAMES + np.inf, "poses": UNITS}, "frames must be finite"),
    ({"frames": FRAMES, "poses": UNITS[:1]}, r"poses has shape \(1, 7\); expected \(2, 7\)"),
    ({"frames": FRAMES, "poses": UNITS, "times": [1.0]}, r"times has shape \(1,\); expected"),
    ({"frames": FRAMES, "poses": UNITS, "times": [1.0, 0.0]}, "times must not fall"),
    ({"frames": FRAMES, "poses": UNITS, "placements": [0, 2]}, r"placements\[1\]: the place"),
    ({"frames": FRAMES, "poses": 2 * UNITS}, r"poses\[0\]: the quaternion has length 2"),
    ({"frames": FRAMES[:0], "poses": UNITS[:0]}, "holds no frames"),
    ({"frames": np.zeros((2, 3, 4)), "poses": UNITS}, "frames of 3 by 4; expected 4 to 64"),
    ({"frames": np.array([None]), "poses": UNITS}, "is no NPZ file of plain arrays"),
)
def test_wrong_arrays_are_refused(tmp_path: Path, arrays: dict[str, Any], words: str):
    with pytest.raises(ValueError, match=rf"f\.npz.*{words}"):
        read_frames(packed(tmp_path, **arrays))


@cases(
    "name, data, words",
    ("f.npz", b"PK\3\4 no", "is no NPZ file of plain arrays"),
    ("f.npz", pickle.dumps({"frames": 1}), "is no NPZ file of plain arrays"),
    ("f.csv", b"\xff\xfe", "is not text in UTF-8"),
    ("f.txt", b"", "its name must end in .csv or .npz"),
    ("no.csv", None, r"no\.csv: cannot be read: No such file or directory"),
)
def test_file_that_holds_no_frames_is_refused(tmp_path, name, data, words):
    if data is not None:
        (tmp_path / name).write_bytes(data)
    with pytest.raises(ValueError, match=words):
        read_frames(tmp_path / name)


def test_too_large_file_is_refused_packed_or_not(tmp_path: Path):
    path = tmp_path / "f.csv"
    with path.open("wb") as file:
        file.truncate((256 << 20) + 1)
    with pytest.raises(ValueError, match="is larger than"):
        read_frames(path)
    packed = tmp_path / "f.npz"
    with zipfile.ZipFile(packed, "w") as file:
        file.writestr("frames.npy", bytes(12345))
    stated = struct.pack("<I", 12345), struct.pack("<I", (256 << 20) + 1)
    packed.write_bytes(packed.read_bytes().replace(*stated))
    with pytest.raises(ValueError, match="unpacks to more than"):
        read_frames(packed)


def published(params: Any) -> list[Timed]:
    return [one for one in driver.SOURCE.open(params) if isinstance(one, Timed)]


def test_frames_of_a_file_become_patches_of_the_ball_at_their_times_or_at_once(table: Path):
    sent = drive(driver.SOURCE, params={**PAD, "path": str(table)})
    assert sent[-1] == Finished(f"published the 3 frames of {table}")
    assert messages_on(sent, "/touch/end")[0].frames == 3
    images = drive(filter.NODE, sent[:-2])
    patches = messages_on(drive(curvature.NODE, [sent[0], *images]), "/touch/patch")
    for patch in patches:
        # Rounding alone: a paraboloid is a jet.
        assert (patch.k1, patch.k2) == pytest.approx((50.0, 50.0), rel=1e-6)
        # The pad's z axis, x of the world, points into the object.
        assert patch.normal == pytest.approx([-1.0, 0.0, 0.0], abs=1e-9)
    assert [patch.kind for patch in patches] == ["smooth"] * 3
    params = msgspec.convert({**PAD, "path": str(table), "rate": 20.0}, driver.Params)
    assert [one.due for one in published(params)] == [0.0, 0.0, 0.05, 0.1, 0.1]
    assert [one.message.robot_time for one in published(params)[1:]] == [0.0, 0.05, 0.1, 0.1]
    quick = published(msgspec.structs.replace(params, at_once=True))
    assert [one.due for one in quick] == [0.0] * 5
    lines = table.read_text().splitlines()
    table.write_text("\n".join(f"{t},{one}" for t, one in zip((7.0, 7.5, 9.0), lines, strict=True)))
    assert [one.due for one in published(params)] == [0.0, 0.0, 0.5, 2.0, 2.0]
    assert driver.SOURCE.repeats and not socket_driver.SOURCE.repeats


@cases(
    "changes, words",
    ({"sensor": {"rows": 12}}, r"frames\.csv:1: has 263 columns; expected 199"),
    ({"path": "no.csv"}, r"no\.csv: cannot be read"),
    ({"scale": 1e3}, "frame 2: the pad is compressed by 0.788 m, but is 0.003 m thick; are the"),
)
def test_file_that_cannot_be_published_is_refused_before_the_start(table, changes, words):
    params = msgspec.convert({**PAD, "path": str(table), **changes}, driver.Params)
    with pytest.raises(ValueError, match=words):
        driver.SOURCE.outputs(params)


@cases(
    "fields, unit",
    ({}, 1.0),
    ({"scale": 1e-3}, 1e3),
    ({"sensor": {"signal": "force"}}, 1.0),
    ({"values": "signal", "sensor": {"signal": "force"}}, 2e8 * 1e-6),
)
def test_numbers_mean_what_the_parameters_say(fields: dict[str, Any], unit: float):
    sensing = msgspec.convert(fields, SensorParams)
    frame = tactile_frame(sensing, 0, 0.0, np.array(POSE), unit * ball())
    back = calibration_of_info(sensor_info(sensing)).decode(frame.array)
    # Lengths of 3 mm at most, through few operations: a few units in the last place of that.
    assert np.abs(back - ball()).max() <= 8 * np.finfo(float).eps * 0.003
    array = 2.0 * (0.003 - ball()) / 1000.0
    times = tactile_frame(SensorParams(values="signal"), 0, 0.0, np.array(POSE), array)
    assert times.array.tolist() == array.tolist()


@pytest.mark.parametrize(
    ("image", "outcome"),
    [(np.zeros((16, 16)), "miss"), (ball(), "hit"), (np.full((16, 16), 2.5e-3), "bottomed")],
)
def test_outcome_is_told_from_the_image(image: Floats, outcome: str):
    number = 3 * FRAMES_PER_GOAL + 2
    frame = tactile_frame(SensorParams(), number, 0.5, np.array(POSE), image)
    assert frame.move.tolist() == [0.0, 0.0, 0.0, 0.0, -1.0] and frame.finger == 1
    assert (frame.outcome, frame.goal, frame.touch, frame.robot_time) == (outcome, 3, 2, 0.5)
    assert tactile_frame(SensorParams(), MAX_FRAMES - 1, 0.0, np.array(POSE), image).goal == 3999
    with pytest.raises(ValueError, match="frame 100000: a sequence has 100000 frames at most"):
        tactile_frame(SensorParams(), MAX_FRAMES, 0.0, np.array(POSE), image)


@pytest.fixture
def server() -> Iterator[socket.socket]:
    """A server on a free port of this machine."""
    with socket.create_server(("127.0.0.1", 0)) as listening:
        yield listening


def port(server: socket.socket) -> str:
    return str(server.getsockname()[1])


def test_lines_become_frames_as_they_come(server: socket.socket):
    params = msgspec.convert({**PAD, "address": port(server), "rate": 4.0}, socket_driver.Params)
    opened = socket_driver.SOURCE.open(params)
    assert next(opened).topic == "/touch/info" and next(opened) is None
    peer, _ = server.accept()
    with peer:
        assert next(opened) is None
        text = line(ball())
        peer.sendall(b"placement,x,y,z,what,ever\n0," + text[:50].encode())
        assert next(opened) is None
        peer.sendall(f"{text[50:]}\n\n1,{text}".encode())
        first = next(one for one in opened if one is not None)
    second, end, finished = (one for one in opened if one is not None)
    assert (first.due, first.message.touch, second.message.touch) == (0.0, 0, 1)
    assert second.message.robot_time == 0.25 == end.message.robot_time and end.message.frames == 2
    assert finished == Finished(f"{params.address} closed the connection after 2 frames")
    assert (first.message.placement, second.message.placement) == (0, 1)
    assert first.message.goal != second.message.goal  # A goal is touched in one placement
    wanted = tactile_frame(params, 0, 0.0, np.array(POSE), ball())
    assert np.array_equal(first.message.array, wanted.array)


@cases(
    "sent, words",
    (b"1,2,3\n", "frame 0: has 3 columns; expected 263"),
    (b"\xff\n", "sent what is no text"),
    (b"1" * (1 << 19), "sent a line of more than 256 kB"),
)
def test_line_that_is_no_frame_is_refused(server: socket.socket, sent: bytes, words: str):
    opened = socket_driver.SOURCE.open(socket_driver.Params(address=port(server)))
    assert list(itertools.islice(opened, 2))[1] is None
    peer, _ = server.accept()
    peer.setblocking(False)
    with peer, pytest.raises(ValueError, match=words):
        while True:
            sent = sent[peer.send(sent) :] if sent else sent
            next(opened)


def test_address_where_nobody_listens_is_named(server: socket.socket):
    address = port(server)
    server.close()
    with pytest.raises(ValueError, match=f"{address}: cannot be reached: Connection refused"):
        list(socket_driver.SOURCE.open(socket_driver.Params(address=address)))


@cases(
    "address, end",
    ("5555", ("127.0.0.1", 5555)),
    (":5555", ("127.0.0.1", 5555)),
    ("localhost:1", ("127.0.0.1", 1)),
    ("192.0.2.7:65535", ("192.0.2.7", 65535)),
    *((one, None) for one in ("", "x", "0", "65536", "192.0.2:1", "a.example:5", "1:2:3", "-1")),
    ("٣", None),
)
def test_address_is_a_port_or_numbers(address: str, end: Any):
    if end is not None:
        assert socket_driver.parse_address(address) == end
        return
    with pytest.raises(ValueError, match=r"address is .*; expected a port such as 5555"):
        socket_driver.Params(address=address)


def test_console_publishes_what_tools_type_and_nothing_else():
    params = console.Params(topics={"/log": "LogRecord"})
    assert drive(console.SOURCE, params=params, most=0) == [] and console.SOURCE.outside
    assert next(console.SOURCE.open(params)) is None
    assert [cls.__name__ for cls in console.SOURCE.outputs(params).values()] == ["LogRecord"]
    with pytest.raises(ValueError, match="/log must be of a known type, got 'Lag'; there are"):
        console.Params(topics={"/log": "Lag"})


def test_sensor_tells_its_data_sheet_which_a_calibration_replaces():
    sensor = SensorSpec(pitch=0.9e-3, pad=PadSpec(thickness=0.004, sound_speed=900.0))
    info = info_of(sensor, 0.0)
    assert info.taxel_stiffness == pytest.approx(sensor.pad.stiffness * 0.81e-6)
    sheet, pad = calibration_of_info(info), pad_of_info(info)
    assert (sheet.thickness, sheet.sound_speed) == (0.004, 900.0)
    assert (pad.rows, pad.pitch, pad.thickness, pad.dome) == (16, 0.9e-3, 0.004, 1 / 0.015)
    calibration = CalibrationSpec(
        gain=((1.1,) * 16,) * 16, offset=((1e-5,) * 16,) * 16, sound_speed=950.0, noise=2e-5
    )
    info = info_of(SensorSpec(calibration=calibration), 1e-6)
    assert (info.sound_speed, info.noise, resolution_of_info(info)) == (950.0, 2e-5, 2e-5)
    assert (info.gain == 1.1).all() and (info.offset == 1e-5).all()
    assert resolution_of_info(info_of(SensorSpec(), 1e-6)) == pytest.approx(1e-5)


SHORT = {"gain": [[1.0]], "offset": [[0.0] * 16] * 16, "sound_speed": 1000.0, "noise": 0.0}


@cases(
    "wrong, words",
    ({"rows": 5}, "an array of 4 by 15 mm; contours are followed with 5 to 40 mm"),
    ({"cols": 42}, "an array of 15 by 41 mm; contours are followed with 5 to 40 mm"),
    ({"pad": {"radius": 0.01}}, "a dome over this array needs more than 0.0106 m"),
    ({"pad": {"thickness": 0.001}}, r"it must be at least 0.00\d+ m, to be pressed by 0.0"),
    ({"calibration": SHORT}, "calibration.gain must have 16 rows of 16, as the array;"),
)
def test_sensor_that_could_not_work_is_refused(wrong: dict[str, Any], words: str):
    with pytest.raises(msgspec.ValidationError, match=words):
        msgspec.convert(wrong, SensorSpec)
