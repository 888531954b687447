from __future__ import annotations

import json
import os
import re
from pathlib import Path

import pytest

from palpate.launch import run_directory as run_dir
from palpate.launch.files.source_map import InputError
from palpate.launch.run_directory import choose_run_directory


@pytest.fixture(autouse=True)
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def test_choosing_leaves_no_trace():
    folder = choose_run_directory("vase", None)
    assert re.fullmatch(r"runs/\d{4}-\d\d-\d\dT\d\d-\d\d-\d\d_vase", str(folder.path))
    assert not Path("runs").exists()


def test_latest_points_to_the_last_run_made():
    for name in ("one", "two"):
        choose_run_directory(name, None).create()
    assert Path("runs/latest").resolve().name.endswith("_two")
    assert len([p for p in Path("runs").iterdir() if not p.is_symlink()]) == 2
    assert not any(p.name.startswith(".") for p in Path("runs").iterdir())


def test_two_runs_in_one_second_get_a_folder_each(monkeypatch):
    monkeypatch.setattr(run_dir.time, "strftime", lambda _: "now")
    for _ in range(3):
        choose_run_directory("vase", None).create()
    names = {path.name for path in Path("runs").iterdir()}
    assert names == {"now_vase", "now_vase-2", "now_vase-3", "latest"}


def test_a_folder_that_the_user_chooses_is_taken_as_it_is():
    folder = choose_run_directory("vase", Path("here/there"))
    folder.create()
    assert not any(folder.path.iterdir())
    assert not Path("here/latest").exists()


def test_files_are_written_whole(tmp_path):
    folder = choose_run_directory("vase", Path("here"))
    folder.create()
    folder.write_json("summary.json", {"a": 1.5, "b": None})
    assert os.listdir("here") == ["summary.json"]
    assert json.loads(Path("here/summary.json").read_text()) == {"a": 1.5, "b": None}


def test_a_number_that_json_does_not_have_is_refused():
    folder = choose_run_directory("vase", Path("here"))
    folder.create()
    with pytest.raises(ValueError, match="not JSON compliant"):
        folder.write_json("summary.json", {"a": float("nan")})


def test_a_folder_that_holds_something_is_refused():
    Path("here").mkdir()
    Path("here/x").write_text("mine")
    with pytest.raises(InputError, match="--out here: is not empty"):
        choose_run_directory("vase", Path("here"))


def test_a_file_in_the_place_of_the_folder_is_refused():
    Path("here").write_text("mine")
    with pytest.raises(InputError, match="--out here: is a file"):
        choose_run_directory("vase", Path("here"))


def test_a_folder_that_cannot_be_made_is_refused():
    Path("file").write_text("mine")
    with pytest.raises(InputError, match="file/here: cannot be written: Not a directory"):
        choose_run_directory("vase", Path("file/here")).create()


def test_a_folder_that_cannot_be_written_is_refused(monkeypatch):
    def refuse(*_: object) -> None:
        raise OSError(30, os.strerror(30))

    monkeypatch.setattr(Path, "write_bytes", refuse)
    with pytest.raises(InputError, match="cannot be written: Read-only file system"):
        choose_run_directory("vase", Path("here")).create()


def test_a_disk_that_is_too_full_is_refused_before_anything_is_made(tmp_path):
    folder = choose_run_directory("vase", tmp_path / "a" / "run")
    folder.check_room(0)
    with pytest.raises(InputError, match=r"a/run: only \d+ MiB are free on its disk, and the"):
        folder.check_room(1 << 60)
    assert list(tmp_path.iterdir()) == []
