"""What holds of every command: names of options, 80 columns, JSON where facts are told."""

import json
import shutil
from pathlib import Path

import click
import pytest

from palpate.launch.files.source_map import InputError
from palpate.launch.processes.registry import Announcement, RunCard, find_run, private_folder
from palpate.launch.run_directory import find_run_mesh, find_run_path, read_summary
from palpate.tools.cli.command_line import palpate_group

# Commands that do something, and tell no facts but what they have done.
ACTS = {
    "host", "keys", "bag record", "bag play", "bag pause", "bag resume", "bag step", "bag export",
    "topic echo", "topic pub", "param set", "view", "init effect", "init filter",
    "init planner", "init node", "init driver", "film",
}  # fmt: skip
LONG_PATH = 40  # Characters of a word that counts as a path, within which no line is broken


def commands(command, path="", parent=None):
    """Every command and group, by its words; what measures palpate itself is left out."""
    context = click.Context(command, info_name=path or "palpate", parent=parent, terminal_width=78)
    yield path, command, context
    if isinstance(command, click.Group):
        for verb in command.list_commands(context):
            if verb != "dev":
                name = f"{path} {verb}".strip()
                yield from commands(command.get_command(context, verb), name, context)


ALL = {path: (command, context) for path, command, context in commands(palpate_group)}


def options(command):
    return {name: one for one in command.params for name in one.opts if name.startswith("-")}


@pytest.mark.parametrize("path", ALL)
def test_commands_have_uniform_help_and_options(path):
    command, context = ALL[path]
    text = command.get_help(context)
    assert [line for line in text.splitlines() if len(line) > 80] == []
    assert ("\nCommands:\n" in text) == isinstance(command, click.Group)
    assert "..." not in text.partition("\nCommands:\n")[2]
    found = options(command)
    flags = [name for one in command.params for name in one.opts]
    assert len(flags) == len({*flags})
    assert ("-o" in found) == ("--out" in found)
    assert not {"--output", "--topic", "--node", "--as-json"} & {*found}
    for name in {"--topics", "--nodes", "--kinds"} & {*found}:
        assert (found[name].metavar, found[name].multiple) == ("A,B", True)
    if "--run" in found:
        assert found["--run"].help == options(ALL["topic list"][0])["--run"].help


def test_commands_that_tell_facts_have_json():
    lacking = {
        path
        for path, (command, _) in ALL.items()
        if not (isinstance(command, click.Group) or "--json" in options(command))
    }
    assert lacking == ACTS


@pytest.fixture(scope="module")
def work(run_folder, tmp_path_factory):
    """A folder with a copy of a run."""
    folder = tmp_path_factory.mktemp("work")
    shutil.copytree(run_folder, folder / "run")
    rows = [(x, y, z) for z in (0.0, 0.01, 0.02) for x, y in ((2, 0), (0, 2), (-2, 0), (0, -2))]
    text = "".join(f"{0.01 * x},{0.01 * y},{z}\n" for x, y, z in rows)
    (folder / "points.csv").write_text(f"x,y,z\n{text}")
    return folder


VERBS = (
    "bag info run", "bag diff run run", "bag recover run -o OUT", "cost run",
    pytest.param("score run run", marks=pytest.mark.slow), "export run -o OUT/solid.3mf",
    "replay run --nodes filter",
    "replay run --set filter.contact=0.0004 --nodes filter,curvature", "rebuild points.csv",
    "scene list", "scene check sphere", "scene effects", "node kinds", "node kinds planner",
    "interface list", "interface show ShapeModel", "launch explore.yaml --show-args",
    "launch explore.yaml --print fingers:=3",
)  # fmt: skip


@pytest.mark.parametrize("words", VERBS)
def test_output_has_80_columns_or_is_json(words, work, tmp_path, call, monkeypatch):
    monkeypatch.chdir(work)
    for name in ("text", "json"):
        out = tmp_path / name
        if "OUT/" in words:
            out.mkdir()
        found = call(words.replace("OUT", str(out)), *(["--json"] if name == "json" else []))
        assert found.code in (0, 1, 2) and "bug" not in found.err
        if name == "json" and found.out:
            json.loads(found.out)
        lines = [line for line in found.out.splitlines() if len(line) > 80 and name == "text"]
        assert [line for line in lines if max(map(len, line.split())) < LONG_PATH] == []


@pytest.mark.slow
def test_run_is_meant_by_its_directory_or_its_recording(work, call, monkeypatch):
    monkeypatch.chdir(work)
    for words in ("bag info", "cost", "replay --nodes filter", "score"):
        rest = ["run"] if words == "score" else []
        one, other = (call(words, path, *rest) for path in ("run", "run/topics.mcap"))
        assert one == other and one.code in (0, 1)
    run = Path("run")
    assert read_summary(run / "topics.mcap") == read_summary(run)
    assert find_run_mesh(run / "topics.mcap") == find_run_mesh(run) == run / "mesh.ply"
    assert find_run_mesh(run / "mesh.stl") == run / "mesh.stl"
    Path("empty").mkdir()
    for name, words in (
        ("none", r"none: does not exist; it must be a run or a file"),
        ("empty", r"empty: holds no rebuilt solid: there is no mesh\.ply"),
    ):
        with pytest.raises(InputError, match=words):
            find_run_mesh(Path(name))


def test_graph_is_meant_by_number_name_directory_or_recording(tmp_path, runtime, monkeypatch):
    monkeypatch.chdir(tmp_path)
    card = {"name": "vase", "pid": 1, "ends": "a", "nodes": (), "taps": {}, "tools": ""}
    for name in ("one", "two"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "topics.mcap").touch()
    (tmp_path / "latest").symlink_to("two")
    with private_folder(None) as first, private_folder(None) as second:
        for folder, number, name in ((first, "ab12", "one"), (second, "cd34", "two")):
            where = str((tmp_path / name).resolve())
            Announcement(folder, RunCard(run=number, began=number, folder=where, **card))
        for meant in ("cd", "two", "latest", "two/topics.mcap", "latest/topics.mcap"):
            assert find_run(meant).run == "cd34"
        assert find_run_path(Path("ab")) == tmp_path / "one"
        assert find_run_path(Path("two")) == Path("two")
        assert find_run_path(Path("none")) == Path("none")
        with pytest.raises(InputError, match="vase: several running graphs are called so: ab12"):
            find_run_path(Path("vase"))
