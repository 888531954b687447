from __future__ import annotations

import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from palpate.nodes.specs import frames as frames_file
from palpate.nodes.specs.frames import parse_row, read_frames

POSE = "0.1,0.2,0.3,0,0,0,1"
IMAGE = ",".join(map(str, range(16)))
LINE = f"{POSE},{IMAGE}"
HEADER = "x,y,z,qx,qy,qz,qw," + ",".join(f"v{i}" for i in range(16))
Write = Callable[..., Path]


@pytest.fixture
def write(tmp_path: Path) -> Write:
    """Writes lines into a CSV file, or arrays into an NPZ file."""

    def do(*lines: str, **arrays: Any) -> Path:
        if arrays:
            np.savez(tmp_path / "f.npz", **arrays)
            return tmp_path / "f.npz"
        (tmp_path / "f.csv").write_text("\n".join(lines))
        return tmp_path / "f.csv"

    return do


@pytest.mark.parametrize(
    "lines",
    [[LINE, LINE], [HEADER, LINE, "", LINE, ""], [f"\ufeff{LINE}", LINE.replace(",", " , ")]],
)
def test_a_table_of_frames_is_read(write: Write, lines: list[str]):
    frames = read_frames(write(*lines))
    assert frames.images.shape == (2, 4, 4)
    assert frames.images[1].tolist() == np.arange(16.0).reshape(4, 4).tolist()
    assert frames.poses[0].tolist() == [0.1, 0.2, 0.3, 0, 0, 0, 1]
    assert frames.times is None


def test_times_come_first(write: Write):
    times = read_frames(write(f"t,{HEADER}", f"2.5,{LINE}", f"2.5,{LINE}", f"3,{LINE}")).times
    assert times is not None
    assert times.tolist() == [2.5, 2.5, 3.0]


def test_an_array_that_is_not_square_is_read_if_its_rows_are_told(write: Write):
    path = write(f"{POSE}," + ",".join("0" * 32))
    assert read_frames(path, 4, 8).images.shape == (1, 4, 8)
    with pytest.raises(ValueError, match=r"f\.csv:1: has 39 columns; expected 7 of the pose and"):
        read_frames(path)


def test_every_square_array_is_told_from_its_line_with_a_time_or_without():
    for side in range(4, 65):
        for time in ("", "1.5,"):
            row = parse_row(f"{time}{POSE}," + ",".join("0" * side**2), "f:1", None)
            assert row.image.shape == (side, side)
            assert row.time == (1.5 if time else None)


def test_arrays_of_frames_are_read(write: Write):
    poses = np.tile([0.0, 0, 0, 0, 0, 0, 1], (3, 1))
    frames = read_frames(write(frames=np.ones((3, 4, 6), np.int16), poses=poses, times=[0, 1, 1]))
    assert frames.images.shape == (3, 4, 6)
    assert frames.images.dtype == np.float64
    assert frames.times is not None and frames.times.tolist() == [0.0, 1.0, 1.0]
    assert read_frames(write(frames=np.ones((3, 4, 6)), poses=poses)).times is None


def test_a_rounded_quaternion_is_made_a_unit(write: Write):
    [pose] = read_frames(write(f"0,0,0,0.707,0,0,0.707,{IMAGE}")).poses
    assert np.linalg.norm(pose[3:]) == pytest.approx(1.0, abs=1e-15)


@pytest.mark.parametrize(
    ("lines", "words"),
    [
        ([LINE, f"{LINE},1,2"], r"f\.csv:2: has 25 columns; expected 23: x,y,z,qx,qy,qz,qw and 4"),
        (
            [HEADER, "", LINE.replace("0.2", "nan")],
            r"f\.csv:3: column 2 is 'nan'; expected a finite",
        ),
        ([LINE, LINE.replace("0.2", "high")], r"f\.csv:2: column 2 is 'high'; expected a finite"),
        ([LINE, LINE.replace("0.2", "")], r"f\.csv:2: column 2 is ''; expected a finite number"),
        ([LINE.replace("0,0,0,1", "0,0,0,2", 1)], r"f\.csv:1: the quaternion has length 2; exp"),
        ([f"1,{LINE}", f"0.5,{LINE}"], r"f\.csv:2: the time 0.5 comes before 1"),
        ([f"1,{LINE}", LINE], r"f\.csv:2: not every line has a time; expected all or none"),
        ([], r"f\.csv: holds no frames"),
        ([HEADER], r"f\.csv: holds no frames"),
    ],
)
def test_a_wrong_table_is_refused_with_its_line(write: Write, lines: list[str], words: str):
    with pytest.raises(ValueError, match=words):
        read_frames(write(*lines))


UNIT = np.tile([0.0, 0, 0, 0, 0, 0, 1], (2, 1))
FRAMES = np.zeros((2, 4, 4))


@pytest.mark.parametrize(
    ("arrays", "words"),
    [
        ({"poses": UNIT}, "lacks the array 'frames'"),
        ({"frames": FRAMES}, "lacks the array 'poses'"),
        ({"frames": FRAMES[0], "poses": UNIT}, "frames is an array of float64 with 2 dimensions"),
        ({"frames": FRAMES == 0, "poses": UNIT}, "frames is an array of bool"),
        ({"frames": FRAMES + np.inf, "poses": UNIT}, "frames must be finite"),
        ({"frames": FRAMES, "poses": UNIT[:1]}, r"poses has shape \(1, 7\); expected \(2, 7\)"),
        (
            {"frames": FRAMES, "poses": UNIT, "times": [1.0]},
            r"times has shape \(1,\); expected \(2,\)",
        ),
        ({"frames": FRAMES, "poses": UNIT, "times": [1.0, 0.0]}, "times must not fall"),
        ({"frames": FRAMES, "poses": 2 * UNIT}, r"poses\[0\]: the quaternion has length 2"),
        ({"frames": FRAMES[:0], "poses": UNIT[:0]}, "holds no frames"),
        ({"frames": np.zeros((2, 3, 4)), "poses": UNIT}, "has frames of 3 by 4; expected 4 to 64"),
        ({"frames": np.array([None]), "poses": UNIT}, "is no NPZ file of plain arrays"),
    ],
)
def test_wrong_arrays_are_refused(write: Write, arrays: dict[str, Any], words: str):
    with pytest.raises(ValueError, match=rf"f\.npz: .*{words}|f\.npz: {words}"):
        read_frames(write(**arrays))


@pytest.mark.parametrize(
    ("name", "data", "words"),
    [
        ("f.npz", b"PK\3\4 no", "is no NPZ file of plain arrays"),
        ("f.npz", pickle.dumps({"frames": 1}), "is no NPZ file of plain arrays"),
        ("f.csv", b"\xff\xfe", "is not text in UTF-8"),
        ("f.txt", b"", "its name must end in .csv or .npz"),
    ],
)
def test_what_is_no_file_of_frames_is_refused(tmp_path: Path, name: str, data: bytes, words: str):
    (tmp_path / name).write_bytes(data)
    with pytest.raises(ValueError, match=words):
        read_frames(tmp_path / name)


def test_a_file_that_is_not_there_is_told(tmp_path: Path):
    with pytest.raises(ValueError, match=r"no\.csv: cannot be read: No such file or directory"):
        read_frames(tmp_path / "no.csv")


def test_too_large_a_file_is_refused_packed_or_not(write: Write, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(frames_file, "MAX_FILE_BYTES", 2000)
    with pytest.raises(ValueError, match="is larger than"):
        read_frames(write(*[LINE] * 100))
    packed = write(frames=FRAMES, poses=UNIT)
    np.savez_compressed(packed, frames=np.zeros((9, 64, 64)), poses=UNIT)
    with pytest.raises(ValueError, match="unpacks to more than"):
        read_frames(packed)
