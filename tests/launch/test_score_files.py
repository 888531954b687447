from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from palpate.launch import score_files
from palpate.launch.located import InputError
from palpate.launch.score_files import read_shape

TABLE = "x;y;z\n0;0;0\n1;0;0\n0;1;0\n0;0;1\n1;1;0\n1;0;1\n"


@pytest.mark.parametrize(
    "text",
    [
        TABLE,
        TABLE.replace(";", ","),
        TABLE.replace(";", " "),
        TABLE.replace(";", "\t").partition("\n")[2],
        "# felt on Monday\n" + TABLE,
        "\ufeffid;Z;X;Y\n0;0;0;0\n1;0;1;0\n2;0;0;1\n3;1;0;0\n4;0;1;1\n5;1;1;0\n",
    ],
)
def test_points_are_read_however_the_table_is_written(
    write: Callable[[str, str], Path], text: str
) -> None:
    found = read_shape(write("p.csv", text), "cm")

    expected = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 0], [1, 0, 1]]
    np.testing.assert_allclose(found.vertices, np.array(expected) / 100)
    assert found.faces.shape == (0, 3)


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        ("p.csv", "", "p.csv: holds no points"),
        ("p.csv", "x,y,z\n", "p.csv: holds no points under its header"),
        ("p.csv", "1,2\n3,4\n", "p.csv: has 2 columns; x, y and z are needed"),
        ("p.csv", "1,2,3\n4,5,six\n", "p.csv: is no table of numbers: could not convert"),
        ("p.csv", "1,2,3\n4,5\n", "p.csv: is no table of numbers"),
        ("p.csv", "1,2,3\n4,5,6\n", "p.csv: holds 2 points; at least 6 are needed"),
        ("p.csv", "1,2,3\n" * 6 + "nan,0,0\n", "p.csv: point 6 is not finite"),
        ("p.csv", "1,2,3\n" * 6, "p.csv: all 6 points are in one place"),
        ("p.csv", "0,0,0\n" + "1,2,3e200\n" * 6, "p.csv: reaches 3e.200 m from the origin"),
        ("m.obj", "v 0 0 0\nv 1e99 0 0\nv 0 1 0\nf 1 2 3\n", "m.obj: reaches 1e.99 m from"),
        ("m.npz", "hello", "m.npz: is no NPZ file"),
        ("m.ply", "hello", "m.ply: is no mesh in PLY"),
        ("m.doc", "hello", "m.doc: 'doc' is no mesh format"),
    ],
)
def test_files_that_hold_nothing_are_refused(
    write: Callable[[str, str], Path], name: str, text: str, words: str
) -> None:
    with pytest.raises(InputError, match=words):
        read_shape(write(name, text), None)


def test_a_file_that_is_not_there_or_no_text_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"none\.csv: cannot be read: No such file"):
        read_shape(tmp_path / "none.csv", None)
    (tmp_path / "p.csv").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InputError, match=r"p\.csv: is no text in UTF-8"):
        read_shape(tmp_path / "p.csv", None)


def test_a_file_that_is_too_large_is_refused(
    write: Callable[[str, str], Path], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    np.savez_compressed(tmp_path / "m.npz", vertices=np.zeros((2_000_000, 3)))
    with pytest.raises(InputError, match="unpacks to 45 MiB, more than is read"):
        read_shape(tmp_path / "m.npz", None)
    monkeypatch.setattr(score_files, "MAX_BYTES", 1000)
    with pytest.raises(InputError, match="is larger than 0 kB, the most that is read"):
        read_shape(write("p.csv", "1,2,3\n" * 200), None)


@pytest.mark.parametrize(
    ("arrays", "words"),
    [
        ({"vertices": np.eye(3)}, "is no model: it lacks faces$"),
        (
            {"vertices": np.eye(3), "faces": np.zeros((0, 3), int)},
            "the model has no surface; nothing could be rebuilt",
        ),
        (
            {"vertices": np.eye(3), "faces": np.array([[0, 1, 3]])},
            "is no model: faces must name vertices from 0 to 2, got 3",
        ),
        ({"vertices": np.array(["a"]), "faces": np.array([[0, 1, 2]])}, "is no model: "),
        ({"vertices": np.array([{}]), "faces": np.eye(3)}, "'vertices.npy': an array of objects"),
    ],
)
def test_an_archive_that_is_no_model_is_refused(
    tmp_path: Path, arrays: dict[str, Any], words: str
) -> None:
    np.savez(tmp_path / "m.npz", **arrays)
    with pytest.raises(InputError, match=words):
        read_shape(tmp_path / "m.npz", None)
