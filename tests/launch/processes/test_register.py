from __future__ import annotations

import os
import time
from pathlib import Path

import pytest

from palpate.launch.processes.folder import private_folder
from palpate.launch.processes.register import (
    CARD,
    LOCK,
    YOUNG,
    Card,
    announce,
    find_run,
    running,
    stale,
    sweep,
)


def card(run: str, name: str = "vase", folder: str = "") -> Card:
    return Card(
        run=run,
        name=name,
        began=f"2026-01-01T00:00:{run[-2:]}",
        pid=1,
        folder=folder,
        ends="a",
        nodes=(),
        taps={},
        tools="",
    )


def test_a_graph_runs_as_long_as_its_lock_is_held(tmp_path: Path) -> None:
    with private_folder(tmp_path) as folder:
        assert running(tmp_path) == []
        announce(folder, card("ab01"))
        assert [one.run for one in running(tmp_path)] == ["ab01"]
    assert running(tmp_path) == []


def left(
    folder: Path, *, age: float = 0.0, announced: bool = True, run: Path | None = None
) -> None:
    """What a launcher leaves that was killed."""
    folder.mkdir()
    (folder / LOCK).touch()
    when = time.time() - age
    os.utime(folder / LOCK, (when, when))
    if announced:
        announce(folder, card("dead", folder="" if run is None else str(run)))


def test_what_a_killed_launcher_left_is_no_running_graph_and_is_swept(tmp_path: Path) -> None:
    run = tmp_path / "run"
    (run / ".said").mkdir(parents=True)
    left(tmp_path / "palpate-run-dead", run=run)
    left(tmp_path / "palpate-run-old", age=2 * YOUNG, announced=False)
    assert running(tmp_path) == []
    assert len(stale(tmp_path)) == 2
    with private_folder(tmp_path) as folder:
        assert sorted(tmp_path.iterdir()) == sorted([folder, run])
    assert list(run.iterdir()) == []


@pytest.mark.parametrize(("age", "swept"), [(0.0, False), (YOUNG + 1.0, True)])
def test_what_was_taken_away_but_for_a_part_is_swept_when_it_is_old(
    age: float, swept: bool, tmp_path: Path
) -> None:
    half = tmp_path / "palpate-run-half"
    half.mkdir()
    (half / "n0").touch()
    os.utime(half, (time.time() - age,) * 2)
    sweep(tmp_path)
    assert half.exists() != swept


def test_what_is_not_ours_or_just_coming_up_is_left_alone(tmp_path: Path) -> None:
    left(tmp_path / "palpate-run-young", announced=False)
    left(tmp_path / "somebody-dead")
    (tmp_path / "palpate-run-file").touch()
    with private_folder(tmp_path) as one, private_folder(tmp_path) as other:
        announce(one, card("ab01"))
        assert stale(tmp_path) == []
        assert one.is_dir() and other.is_dir()
    assert len(list(tmp_path.iterdir())) == 3


def test_a_spoilt_card_is_no_running_graph(tmp_path: Path) -> None:
    with private_folder(tmp_path) as folder:
        (folder / CARD).write_text("{")
        assert running(tmp_path) == []


def test_a_run_is_found_by_its_number_or_name_or_as_the_latest(tmp_path: Path) -> None:
    with private_folder(tmp_path) as one, private_folder(tmp_path) as other:
        announce(one, card("ab01"))
        announce(other, card("ac02", "egg"))
        assert find_run(None, tmp_path).run == "ac02"
        assert find_run("ab", tmp_path).run == "ab01"
        assert find_run("egg", tmp_path).run == "ac02"
        with pytest.raises(ValueError, match=r"several running graphs are called 'a'; there are"):
            find_run("a", tmp_path)
        with pytest.raises(ValueError, match=r"no running graph is called 'x'; .* ab01 \(vase\)"):
            find_run("x", tmp_path)


def test_without_a_running_graph_that_is_said(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="no graph of yours is running"):
        find_run(None, tmp_path)


def test_a_folder_that_holds_anything_else_is_somebodys_own(tmp_path: Path) -> None:
    mine = tmp_path / "palpate-run-of-mine"
    left(mine, age=2 * YOUNG)
    (mine / "thesis.tex").touch()
    other = tmp_path / "palpate-thesis"
    other.mkdir()
    os.utime(other, (0.0, 0.0))
    sweep(tmp_path)
    assert mine.exists() and other.exists()
