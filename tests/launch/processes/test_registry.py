"""Which graphs run: private folders, the cards in them, and what killed launchers leave."""

import os
import re
import shutil
import time
from contextlib import ExitStack
from pathlib import Path

import pytest

from palpate.launch.processes import registry
from palpate.launch.processes.node_status import check_open_files

OLD = 7 * 24 * 3600.0  # Age of what nothing can be still about to announce [s]


def card(run, name="vase", folder="", started_in=""):
    texts = {"began": f"2026-01-01T00:00:{run[-2:]}", "tools": "", "started_in": started_in}
    return registry.RunCard(
        run=run, name=name, folder=folder, pid=1, ends="a", nodes=(), taps={}, **texts
    )


def test_graph_runs_while_its_lock_is_held_and_card_readable(tmp_path):
    with registry.private_folder(tmp_path) as folder:
        assert registry.running_graphs(tmp_path) == []
        registry.Announcement(folder, card("ab01"))
        assert [one.run for one in registry.running_graphs(tmp_path)] == ["ab01"]
    assert registry.running_graphs(tmp_path) == []
    with registry.private_folder(tmp_path) as folder:
        (folder / "run.json").write_text("{")
        assert registry.running_graphs(tmp_path) == []


SWEPT = [  # Name, age [s], files, whether its card was written; whether nothing is left of it
    ("palpate-run-dead", 0.0, ["lock"], True, True),
    ("palpate-run-old", OLD, ["lock"], False, True),
    ("palpate-run-half", OLD, ["n0"], False, True),  # taken away but for a part
    ("palpate-run-new_half", 0.0, ["n0"], False, False),
    ("palpate-run-young", 0.0, ["lock"], False, False),  # just coming up
    ("palpate-run-of-mine", OLD, ["lock", "thesis.tex"], True, False),
    ("palpate-thesis", OLD, [], False, False),
    ("somebody-dead", OLD, ["lock"], True, False),
]


@pytest.mark.parametrize(("name", "age", "files", "announced", "swept"), SWEPT)
def test_only_remains_of_killed_launchers_are_swept(name, age, files, announced, swept, tmp_path):
    folder, run = tmp_path / name, tmp_path / "run"
    (run / ".published").mkdir(parents=True)
    folder.mkdir()
    for file in files:
        (folder / file).touch()
    if announced:
        registry.Announcement(folder, card("dead", folder=str(run)))
    for path in (*folder.iterdir(), folder):
        os.utime(path, (time.time() - age,) * 2)
    assert registry.running_graphs(tmp_path) == []
    with registry.private_folder(tmp_path) as first, registry.private_folder(tmp_path) as other:
        registry.Announcement(first, card("ab01"))
        assert registry.stale_folders(tmp_path) == [] and first.is_dir() and other.is_dir()
    registry.remove_stale_folders(tmp_path)
    assert folder.exists() != swept
    assert (run / ".published").exists() != (swept and announced)


def found(asked, folder):
    """Number of the graph that is found, or why none is."""
    try:
        return registry.find_run(asked, folder).run
    except ValueError as error:
        return str(error)


def test_run_is_found_by_number_name_or_working_directory(tmp_path, monkeypatch):
    assert "no graph of yours is running" in found(None, tmp_path)
    with registry.private_folder(tmp_path) as first, registry.private_folder(tmp_path) as other:
        registry.Announcement(first, card("ab01"))
        assert found(None, tmp_path) == "ab01"
        registry.Announcement(other, card("ac02", "egg"))
        for asked, words in (
            ("ab", "^ab01$"),
            ("egg", "^ac02$"),
            (None, r"2 graphs run and none.* --run ab01 \(vase\), --run ac"),
            ("a", "several running graphs are called 'a'; there are"),
            ("x", r"no running graph is called 'x'; .* ab01 \(vase\)"),
        ):
            assert re.search(words, found(asked, tmp_path))
    monkeypatch.delenv("PALPATE_GRAPH", raising=False)
    here, there = tmp_path / "here", tmp_path / "there"
    (here / "runs" / "1_vase").mkdir(parents=True)
    there.mkdir()
    graphs = [
        card("ab01", started_in=str(there), folder=str(there / "runs" / "1_egg")),
        card("ac02", started_in=str(there), folder=str(here / "runs" / "1_vase")),
        card("ad03", started_in=str(tmp_path)),
    ]
    with ExitStack() as stack:
        for entry in graphs:
            registry.Announcement(stack.enter_context(registry.private_folder(tmp_path)), entry)
        meant = ((here, "ac02"), (here / "runs" / "1_vase", "ac02"), (tmp_path, "ad03"))
        for folder, number in (*meant, (there, "2 graphs run of this folder.*ab01.*ac02")):
            monkeypatch.chdir(folder)
            assert re.search(number, found(None, tmp_path))
        for name, number in (
            ("ad", "ad03"),
            ("1_egg", "ab01"),
            (str(there / "runs" / "1_egg"), "ab01"),
            ("cube", "PALPATE_GRAPH=cube: no running graph is called"),
        ):
            monkeypatch.setenv("PALPATE_GRAPH", name)
            assert number in found(None, tmp_path)
            assert found("ac", tmp_path) == "ac02"


def test_private_folder_is_made_where_its_path_is_short_and_vanishes(tmp_path, monkeypatch):
    with registry.private_folder(tmp_path) as folder:
        assert folder.stat().st_mode & 0o777 == 0o700
        (folder / "n0").touch()
    assert list(tmp_path.iterdir()) == []
    with registry.private_folder(tmp_path) as folder:
        shutil.rmtree(folder)  # somebody else has tidied up
    deep = tmp_path / ("x" * 110)
    deep.mkdir()
    for runtime, temporary, parent in (
        (tmp_path, deep, tmp_path),
        (tmp_path / "nowhere", tmp_path, tmp_path),
        (deep, deep, Path("/tmp")),
    ):
        monkeypatch.setenv("XDG_RUNTIME_DIR", str(runtime))
        monkeypatch.setattr("tempfile.tempdir", str(temporary))
        with registry.private_folder(None) as folder:
            assert folder.parent == parent
    assert list(deep.iterdir()) == []


@pytest.mark.parametrize(
    ("limits", "allowed"), [((40, 40), None), ((40, 400), 64), ((64, 64), 64), ((9999, 9999), 9999)]
)
def test_open_files_are_allowed_as_needed_or_refused(limits, allowed, monkeypatch):
    now = [limits]
    monkeypatch.setattr("resource.getrlimit", lambda _: now[-1])
    monkeypatch.setattr("resource.setrlimit", lambda _, limits: now.append(limits))
    if allowed is None:
        with pytest.raises(ValueError, match=r"8 nodes needs 64 open files, the system allows 40"):
            check_open_files(8)
    else:
        check_open_files(8)
        assert now[-1] == (allowed, limits[1])


def test_nodes_have_distinct_addresses(tmp_path):
    place = registry.addresses_of(tmp_path, ["finger_1/filter", "x" * 200], depth=7, past=tmp_path)
    addresses = [*place.endpoints.values(), *place.taps.values(), place.control, place.tools]
    assert len(set(addresses)) == 6
    assert all(address.startswith(f"ipc://{tmp_path}/") for address in addresses)
    assert place.depth == 7
