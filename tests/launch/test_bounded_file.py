from __future__ import annotations

import os
from pathlib import Path

import pytest

from palpate.launch.bounded_file import read_bounded
from palpate.launch.located import InputError


def test_a_file_is_read_up_to_its_bound(tmp_path: Path) -> None:
    (tmp_path / "a").write_bytes(b"x" * 2048)

    assert read_bounded(tmp_path / "a", 2048) == b"x" * 2048
    assert read_bounded(tmp_path / "a", 1 << 60) == b"x" * 2048  # which nobody could set aside
    with pytest.raises(InputError, match="a: is larger than 1 kB, the most that is read"):
        read_bounded(tmp_path / "a", 2047)


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("none", "none: the mesh cannot be read: No such file or directory"),
        ("folder", "folder: the mesh cannot be read: Is a directory"),
        ("pipe", "pipe: the mesh cannot be read: it is no plain file"),
        ("a\0b", "the mesh cannot be read: embedded null"),
        ("\ud800", "the mesh cannot be read: 'utf-8' codec"),
    ],
)
def test_what_is_no_plain_file_is_refused_at_once(tmp_path: Path, name: str, words: str) -> None:
    (tmp_path / "folder").mkdir()
    os.mkfifo(tmp_path / "pipe")

    with pytest.raises(InputError) as caught:
        read_bounded(tmp_path / name, 10, "the mesh ")
    assert words in str(caught.value)
