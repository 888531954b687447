"""What holds of every command: options, 80 columns, JSON, and what a shell is offered of it."""

import fcntl
import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import click
import pytest

from palpate.launch.files.source_map import InputError
from palpate.launch.processes.registry import Announcement, RunCard, find_run, private_folder
from palpate.launch.run_directory import find_run_path
from palpate.launch.scene import shipped_scenes
from palpate.tools.cli.command_line import answer_shell, palpate_group
from tests.tools.toy_graph import toy_graph

pytestmark = pytest.mark.usefixtures("here", "runtime")
# Commands that do something, and tell no facts but what they have done.
ACTS = {
    "host", "keys", "bag record", "bag play", "bag pause", "bag resume", "bag step", "bag export",
    "topic echo", "topic pub", "param set", "view", "init effect", "init filter",
    "init planner", "init node", "init driver", "film",
}  # fmt: skip


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
    named = options(command)
    flags = [name for one in command.params for name in one.opts]
    assert len(flags) == len({*flags})
    assert ("-o" in named) == ("--out" in named)
    assert not {"--output", "--topic", "--node", "--as-json"} & {*named}
    for name in {"--topics", "--nodes", "--kinds"} & {*named}:
        assert (named[name].metavar, named[name].multiple) == ("A,B", True)
    if "--run" in named:
        assert named["--run"].help == options(ALL["topic list"][0])["--run"].help
    if not isinstance(command, click.Group):  # what tells facts has JSON
        assert ("--json" in named) == (path not in ACTS) and {*ALL} >= ACTS


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
        result = call(words.replace("OUT", str(out)), *(["--json"] if name == "json" else []))
        assert result.code in (0, 1, 2) and "bug" not in result.err
        if name == "json" and result.out:
            json.loads(result.out)
        lines = [line for line in result.out.splitlines() if len(line) > 80 and name == "text"]
        # A line is not broken in a path: a word of 40 letters or more.
        assert [line for line in lines if max(map(len, line.split())) < 40] == []


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
        with pytest.raises(InputError, match="vase: several running graphs have this name: ab12"):
            find_run_path(Path("vase"))


HEAVY = {"scipy", "trimesh", "palpate.launch.run"}


@pytest.fixture
def complete(monkeypatch, capsys):
    """What is offered for a line, as the shell takes it; nothing else may be printed."""

    def ask(line, shell="bash"):
        *before, last = line.split(" ")
        monkeypatch.setenv("_PALPATE_COMPLETE", f"{shell}_complete")
        monkeypatch.setenv("COMP_WORDS", line)
        monkeypatch.setenv("COMP_CWORD", last if shell == "fish" else str(len(before)))
        assert answer_shell() == 0
        out, err = capsys.readouterr()
        assert err == ""
        return [line.removeprefix("plain,") for line in out.splitlines() if line]

    return ask


def test_commands_and_options_are_completed_in_every_shell(complete):
    assert complete("palpate sc") == ["scene", "score"]
    assert complete("palpate bag ex") == ["export"]
    assert "--tolerance" in complete("palpate run --")
    assert complete("palpate run --noise ") == ["none", "low", "default", "high"]
    kind, value, help_text = complete("palpate rebu", "zsh")
    assert (kind, value) == ("plain", "rebuild") and help_text.startswith("Rebuild a solid")
    assert complete("palpate rebu", "fish") == [f"rebuild\t{help_text}"]


def test_script_of_a_shell_is_printed(call):
    for shell in ("bash", "zsh", "fish"):
        code, out, err = call("--completion", shell)
        assert (code, err) == (0, "") and f"_PALPATE_COMPLETE={shell}_complete" in out
        assert re.search(r"complete .*palpate|compdef .*palpate", out)


def test_scenes_are_shipped_ones_and_files_and_runs_the_latest_first(complete, here):
    for name in ("vat.yaml", "valve.stl", "vain.txt"):
        (here / name).touch()
    (here / "vases").mkdir()
    assert complete("palpate run va") == ["vase", "valve.stl", "vat.yaml"]
    assert complete("palpate scene check ") == [*shipped_scenes(), "valve.stl", "vat.yaml"]
    assert complete("palpate calibrate ./vat") == ["./vat.yaml"]
    assert complete("palpate run vases/") == ["file,vases/"]
    # Runs are those of their folder, the latest first.
    assert complete("palpate bag info ") == ["file,"]
    for name in ("2026-01-01_vase", "2026-01-02_box"):
        (here / "runs" / name).mkdir(parents=True)
    (here / "runs" / "latest").symlink_to("2026-01-02_box")
    runs = ["runs/latest", "runs/2026-01-02_box", "runs/2026-01-01_vase"]
    for words in ("bag info", "bag diff runs/latest", "replay", "cost", "recognise", "score"):
        assert complete(f"palpate {words} r") == runs
    assert complete("palpate replay ../x") == ["file,../x"]


def test_topics_and_nodes_are_of_the_chosen_graph(complete):
    for words in ("topic echo /", "node info ", "topic hz /", "param dump ", "topic echo --run "):
        assert complete(f"palpate {words}") == []
    with toy_graph() as first:
        assert "/own" in complete("palpate topic echo /")
        run = first.card.run[:6]
        with toy_graph() as second:
            assert complete("palpate topic echo /") == []  # either may be meant
            assert complete(f"palpate topic echo --run {run} /ow") == ["/own"]
            assert complete(f"palpate topic hz --run {run} /log /ow") == ["/own"]
            assert complete("palpate topic info --run none /") == []
            assert complete(f"palpate node info --run {run} t") == ["talker"]
            names = [run, "vase", second.card.run[:6], "vase"]
            assert sorted(complete("palpate topic list --run ")) == sorted(names)


@pytest.mark.parametrize("card", [b"", b"{", b"\xff\x00", b'{"run": 3}', b"[]"])
def test_damaged_registry_and_senseless_lines_offer_nothing(complete, runtime, monkeypatch, card):
    folder = runtime / "palpate-run-x"
    folder.mkdir()
    (folder / "run.json").write_bytes(card)
    lock = os.open(folder / "lock", os.O_CREAT | os.O_RDWR)
    fcntl.flock(lock, fcntl.LOCK_EX)
    assert complete("palpate topic echo /") == complete("palpate node info ") == []
    os.close(lock)
    for line in ("palpate none ", "palpate run --none ", "palpate topic nothing x"):
        complete(line)
    monkeypatch.setattr("palpate.launch.processes.registry.running_graphs", lambda: 1 / 0)
    assert complete("palpate topic list --run ") == []


TIMED = """
import sys
from palpate.tools.cli.command_line import main
try:
    main()
finally:
    print(*sys.modules, file=sys.stderr)
"""


@pytest.mark.parametrize(
    ("line", "heavy"),
    [
        ("palpate r", {"numpy", "msgspec", *HEAVY}),
        ("palpate bag info r", {"numpy", *HEAVY}),
        ("palpate topic echo /", HEAVY),
    ],
)
def test_completion_imports_only_what_it_needs(line, heavy):
    asked = {"COMP_WORDS": line, "COMP_CWORD": str(len(line.split(" ")) - 1)}
    environment = {**os.environ, **asked, "_PALPATE_COMPLETE": "bash_complete"}
    command = [sys.executable, "-c", TIMED]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    assert not heavy & {*done.stderr.split()}
