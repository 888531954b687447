from __future__ import annotations

import errno
import os
import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from palpate.launch.bag import new_file
from palpate.launch.bag.decoded import open_source
from palpate.launch.bag.export import export_bag
from palpate.launch.bag.new_file import write_new
from palpate.launch.cli import main as cli
from palpate.launch.located import InputError
from palpate.messages.codec import encode, schema_hash
from palpate.messages.header import Header
from palpate.messages.recording.writer import RecordingWriter
from palpate.messages.types import TYPES, World

Record = Callable[..., Path]
WORLD = World(platform=0.0, reach=0.3, fingers=1, seed=3)
EVERY = pytest.mark.parametrize("kind", ["csv", "npz", "foxglove"])


@dataclass(frozen=True)
class Strange:
    value: float


@EVERY
def test_each_format_is_written_whole_and_said(
    explored: Path, tmp_path: Path, kind: str, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"

    assert cli.run(["bag", "export", str(explored), "--format", kind, "-o", str(out)]) == 0

    assert re.fullmatch(
        rf"{out}: \d+ (files|arrays|messages) of 9 topics\n", capsys.readouterr().out
    )
    assert sorted(one.name for one in tmp_path.iterdir()) == ["out", "topics.mcap"]


@EVERY
def test_nothing_is_overwritten(explored: Path, tmp_path: Path, kind: str) -> None:
    (tmp_path / "out").mkdir()
    (tmp_path / "file").write_text("mine")

    for name in ("out", "file"):
        with pytest.raises(InputError, match=f"{name}: exists already; it is not overwritten"):
            export_bag(explored, kind, tmp_path / name)
    assert (tmp_path / "file").read_text() == "mine"


@EVERY
def test_a_message_that_cannot_be_decoded_leaves_nothing_behind(
    record: Record, tmp_path: Path, kind: str
) -> None:
    path = tmp_path / "topics.mcap"
    writer = RecordingWriter(path, {"/world": "World"}, {}, {})
    for seq, body in enumerate([encode(WORLD), b"\x80"]):
        writer.write("/world", Header(0, 0, seq, 0, 0.0, schema_hash(World)), body)
    writer.close()

    with pytest.raises(InputError, match=r"topics.mcap: /world 1: not a World: missing fields"):
        export_bag(path, kind, tmp_path / "out")
    assert [one.name for one in tmp_path.iterdir()] == ["topics.mcap"]


def test_another_version_of_a_message_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "topics.mcap"
    writer = RecordingWriter(path, {"/world": "World"}, {}, {})
    writer.write("/world", Header(0, 0, 0, 0, 0.0, 7), encode(WORLD))
    writer.close()

    with pytest.raises(InputError, match=r"/world was recorded with another version of World"):
        export_bag(path, "npz", tmp_path / "out")


def test_an_unknown_message_is_refused(
    record: Record, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(TYPES, "Strange", Strange)
    path = record([("/a", Strange(1.0)), ("/world", WORLD)])
    monkeypatch.delitem(TYPES, "Strange")

    with pytest.raises(InputError, match="/a holds Strange; there is no such type of message"):
        export_bag(path, "csv", tmp_path / "out")
    export_bag(path, "csv", tmp_path / "out", ["/world"])


def test_a_damaged_recording_is_to_be_recovered_first(explored: Path, tmp_path: Path) -> None:
    explored.write_bytes(explored.read_bytes()[:-30])

    with pytest.raises(InputError, match=r"cut off at byte \d+; `palpate bag recover` saves what"):
        export_bag(explored, "csv", tmp_path / "out")


def test_a_recording_that_was_never_closed_is_exported_and_said_to_be(
    record: Record, tmp_path: Path
) -> None:
    path = record([("/world", WORLD)] * 3, close=False)

    assert "never closed" in export_bag(path, "npz", tmp_path / "out.npz")


def test_unknown_topics_and_empty_recordings_are_refused(record: Record, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="has no topic '/wrold'; did you mean '/world'"):
        open_source(record([("/world", WORLD)]), ["/wrold"])
    with pytest.raises(InputError, match="holds no message"):
        open_source(record([], name="empty.mcap"))


def test_times_count_from_the_first_message_of_all(record: Record, tmp_path: Path) -> None:
    path = record([("/a", WORLD), ("/b", WORLD)])
    export_bag(path, "npz", tmp_path / "out.npz", ["/b"])

    with np.load(tmp_path / "out.npz") as found:
        assert found["b.sent_s"] == pytest.approx([0.007])


@pytest.mark.parametrize("number", [errno.EPERM, errno.EEXIST, errno.ENOSPC])
def test_a_file_is_moved_though_there_are_no_links_but_never_onto_another(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, number: int
) -> None:
    def link(source: Path, target: Path) -> None:
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr(new_file.os, "link", link)
    path = tmp_path / "a"
    if number == errno.EPERM:
        write_new(path, lambda part: part.write_text("whole"))
        assert path.read_text() == "whole"
    else:
        with pytest.raises(InputError, match=r"not overwritten|cannot be written: No space"):
            write_new(path, lambda part: part.write_text("whole"))
    assert len(list(tmp_path.iterdir())) == (number == errno.EPERM)


def test_what_came_meanwhile_is_not_overwritten(tmp_path: Path) -> None:
    path = tmp_path / "a"

    def slow(part: Path) -> None:
        part.mkdir()
        path.write_text("mine")

    with pytest.raises(InputError, match="a: exists already"):
        write_new(path, slow)
    assert path.read_text() == "mine"
    assert [one.name for one in tmp_path.iterdir()] == ["a"]
