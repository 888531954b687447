import os
import shutil
import time
from contextlib import ExitStack
from pathlib import Path

import pytest

from palpate.launch.processes.node_status import check_open_files
from palpate.launch.processes.registry import (
    CARD_FILE,
    GRACE_AGE,
    LOCK_FILE,
    RunCard,
    addresses_of,
    announce,
    find_run,
    private_folder,
    remove_stale_folders,
    running_graphs,
    stale_folders,
)


def card(run, name="vase", folder="", started_in=""):
    return RunCard(
        started_in=started_in,
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


def test_a_graph_runs_as_long_as_its_lock_is_held_and_its_card_can_be_read(tmp_path):
    with private_folder(tmp_path) as folder:
        assert running_graphs(tmp_path) == []
        announce(folder, card("ab01"))
        assert [one.run for one in running_graphs(tmp_path)] == ["ab01"]
    assert running_graphs(tmp_path) == []
    with private_folder(tmp_path) as folder:
        (folder / CARD_FILE).write_text("{")
        assert running_graphs(tmp_path) == []


def left(folder, *, age=0.0, announced=True, run=None):
    """What a launcher leaves that was killed."""
    folder.mkdir()
    (folder / LOCK_FILE).touch()
    when = time.time() - age
    os.utime(folder / LOCK_FILE, (when, when))
    if announced:
        announce(folder, card("dead", folder="" if run is None else str(run)))


def test_what_a_killed_launcher_left_is_no_running_graph_and_is_swept(tmp_path):
    run = tmp_path / "run"
    (run / ".published").mkdir(parents=True)
    left(tmp_path / "palpate-run-dead", run=run)
    left(tmp_path / "palpate-run-old", age=2 * GRACE_AGE, announced=False)
    assert running_graphs(tmp_path) == []
    assert len(stale_folders(tmp_path)) == 2
    with private_folder(tmp_path) as folder:
        assert sorted(tmp_path.iterdir()) == sorted([folder, run])
    assert list(run.iterdir()) == []


@pytest.mark.parametrize(("age", "swept"), [(0.0, False), (GRACE_AGE + 1.0, True)])
def test_what_was_taken_away_but_for_a_part_is_swept_when_it_is_old(age, swept, tmp_path):
    half = tmp_path / "palpate-run-half"
    half.mkdir()
    (half / "n0").touch()
    os.utime(half, (time.time() - age,) * 2)
    remove_stale_folders(tmp_path)
    assert half.exists() != swept


def test_what_is_not_ours_or_just_coming_up_is_left_alone(tmp_path):
    left(tmp_path / "palpate-run-young", announced=False)
    left(tmp_path / "somebody-dead")
    (tmp_path / "palpate-run-file").touch()
    with private_folder(tmp_path) as one, private_folder(tmp_path) as other:
        announce(one, card("ab01"))
        assert stale_folders(tmp_path) == []
        assert one.is_dir() and other.is_dir()
    assert len(list(tmp_path.iterdir())) == 3


def test_a_run_is_found_by_its_number_or_name_or_as_the_only_one(tmp_path):
    with pytest.raises(ValueError, match="no graph of yours is running"):
        find_run(None, tmp_path)
    with private_folder(tmp_path) as one, private_folder(tmp_path) as other:
        announce(one, card("ab01"))
        assert find_run(None, tmp_path).run == "ab01"
        announce(other, card("ac02", "egg"))
        with pytest.raises(
            ValueError, match=r"2 graphs run and none.* --run ab01 \(vase\), --run ac"
        ):
            find_run(None, tmp_path)
        assert find_run("ab", tmp_path).run == "ab01"
        assert find_run("egg", tmp_path).run == "ac02"
        with pytest.raises(ValueError, match=r"several running graphs are called 'a'; there are"):
            find_run("a", tmp_path)
        with pytest.raises(ValueError, match=r"no running graph is called 'x'; .* ab01 \(vase\)"):
            find_run("x", tmp_path)


def test_the_graph_of_the_working_directory_is_meant_before_others(tmp_path, monkeypatch):
    monkeypatch.delenv("PALPATE_GRAPH", raising=False)
    here, there = tmp_path / "here", tmp_path / "there"
    (here / "runs" / "1_vase").mkdir(parents=True)
    there.mkdir()
    graphs = {
        "ab01": card("ab01", started_in=str(there), folder=str(there / "runs" / "1_egg")),
        "ac02": card("ac02", started_in=str(there), folder=str(here / "runs" / "1_vase")),
        "ad03": card("ad03", started_in=str(tmp_path)),
    }
    with ExitStack() as stack:
        for one in graphs.values():
            announce(stack.enter_context(private_folder(tmp_path)), one)
        meant = ((here, "ac02"), (here / "runs" / "1_vase", "ac02"), (tmp_path, "ad03"))
        for folder, number in meant:
            monkeypatch.chdir(folder)
            assert find_run(None, tmp_path).run == number
        monkeypatch.chdir(there)
        with pytest.raises(ValueError, match=r"2 graphs run of this folder.*ab01.*ac02"):
            find_run(None, tmp_path)
        for name in ("ad", "1_egg", str(there / "runs" / "1_egg")):
            monkeypatch.setenv("PALPATE_GRAPH", name)
            assert find_run(None, tmp_path).run == ("ad03" if name == "ad" else "ab01")
            assert find_run("ac", tmp_path).run == "ac02"
        monkeypatch.setenv("PALPATE_GRAPH", "cube")
        with pytest.raises(ValueError, match="PALPATE_GRAPH=cube: no running graph is called"):
            find_run(None, tmp_path)


def test_a_folder_that_holds_anything_else_is_somebodys_own(tmp_path):
    mine = tmp_path / "palpate-run-of-mine"
    left(mine, age=2 * GRACE_AGE)
    (mine / "thesis.tex").touch()
    other = tmp_path / "palpate-thesis"
    other.mkdir()
    os.utime(other, (0.0, 0.0))
    remove_stale_folders(tmp_path)
    assert mine.exists() and other.exists()


def test_the_folder_is_private_and_vanishes_with_all_that_is_in_it(tmp_path):
    with private_folder(tmp_path) as folder:
        assert folder.stat().st_mode & 0o777 == 0o700
        (folder / "n0").touch()
    assert list(tmp_path.iterdir()) == []
    with private_folder(tmp_path) as folder:
        shutil.rmtree(folder)  # somebody else has tidied up


def test_the_folder_of_the_user_is_preferred_to_the_temporary_one(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    with private_folder(None) as folder:
        assert folder.parent == tmp_path
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path / "nowhere"))
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    with private_folder(None) as folder:
        assert folder.parent == tmp_path


def test_a_folder_too_long_for_sockets_is_passed_over(tmp_path, monkeypatch):
    deep = tmp_path / ("x" * 110)
    deep.mkdir()
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(deep))
    monkeypatch.setattr("tempfile.tempdir", str(deep))
    with private_folder(None) as folder:
        assert folder.parent == Path("/tmp")
    assert list(deep.iterdir()) == []


@pytest.mark.parametrize(
    ("limits", "allowed"), [((40, 40), None), ((40, 400), 64), ((64, 64), 64), ((9999, 9999), 9999)]
)
def test_as_many_open_files_as_a_graph_needs_are_allowed_or_it_is_refused(
    limits, allowed, monkeypatch
):
    now = [limits]
    monkeypatch.setattr("resource.getrlimit", lambda _: now[-1])
    monkeypatch.setattr("resource.setrlimit", lambda _, limits: now.append(limits))
    if allowed is None:
        with pytest.raises(ValueError, match=r"8 nodes needs 64 open files, the system allows 40"):
            check_open_files(8)
    else:
        check_open_files(8)
        assert now[-1] == (allowed, limits[1])


def test_nodes_of_any_name_have_addresses_of_their_own(tmp_path):
    place = addresses_of(tmp_path, ["finger_1/filter", "x" * 200], depth=7, past=tmp_path)
    addresses = [*place.endpoints.values(), *place.taps.values(), place.control, place.tools]
    assert len(set(addresses)) == 6
    assert all(address.startswith(f"ipc://{tmp_path}/") for address in addresses)
    assert place.depth == 7
