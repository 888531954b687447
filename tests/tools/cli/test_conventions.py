"""What holds of every command: names of options, 80 columns, JSON where facts are told."""

import json
import tempfile
from pathlib import Path

import click
import pytest

from palpate.launch.files import InputError
from palpate.launch.processes.registry import RunCard, announce, find_run, private_folder
from palpate.launch.run_directory import find_run_mesh, find_run_path, read_summary
from palpate.tools.cli import command_line as cli

# Commands that do something, and tell no facts but what they have done.
ACTS = {
    "host", "keys", "bag record", "bag play", "bag pause", "bag resume", "bag step", "bag export",
    "topic echo", "topic pub", "param set", "view", "init effect", "init filter",
    "init planner", "init node",
    "init driver", "film",
}  # fmt: skip
LONG_PATH = 40  # Characters of a word that counts as a path, which no line is broken within


def commands(command, path="", parent=None):
    """Every command and group, by its words."""
    context = click.Context(command, info_name=path or "palpate", parent=parent, terminal_width=78)
    yield path, command, context
    if isinstance(command, click.Group):
        for verb in command.list_commands(context):
            yield from commands(
                command.get_command(context, verb), f"{path} {verb}".strip(), context
            )


ALL = {path: (command, context) for path, command, context in commands(cli.palpate_group)}


def options(command):
    return {name: one for one in command.params for name in one.opts if name.startswith("-")}


@pytest.mark.parametrize("path", ALL)
def test_help_has_80_columns_and_one_word_for_commands(path):
    command, context = ALL[path]
    text = command.get_help(context)
    assert [line for line in text.splitlines() if len(line) > 80] == []
    assert ("\nCommands:\n" in text) == isinstance(command, click.Group)
    assert "..." not in text.partition("\nCommands:\n")[2]


def test_the_help_of_palpate_is_one_screen(capsys):
    assert cli.run(["--help"]) == 0
    assert len(capsys.readouterr().out.splitlines()) <= 36


@pytest.mark.parametrize("path", ALL)
def test_an_option_has_one_name_and_one_form_everywhere(path):
    found = options(ALL[path][0])
    flags = [name for one in ALL[path][0].params for name in one.opts]
    assert len(flags) == len(set(flags))
    assert ("-o" in found) == ("--out" in found)
    assert not {"--output", "--topic", "--node", "--as-json"} & set(found)
    for name in ("--topics", "--nodes", "--kinds"):
        if name in found:
            assert (found[name].metavar, found[name].multiple) == ("A,B", True)
    if "--run" in found:
        assert found["--run"].help == options(ALL["topic list"][0])["--run"].help


def test_whatever_tells_facts_tells_them_as_json_on_request():
    lacking = {
        path
        for path, (command, _) in ALL.items()
        if not (isinstance(command, click.Group) or "--json" in options(command))
    }
    assert lacking == ACTS


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """The directory of a run whose touches were spent before it met its tolerance."""
    folder = tmp_path_factory.mktemp("work") / "spent"
    asked = ["run", "sphere", "--composed", "--touches", "24", "--quiet", "--out", str(folder)]
    assert cli.run(asked) == 1
    return folder


def test_a_budget_that_is_spent_before_the_tolerance_is_met_is_exit_code_1(run):
    summary = read_summary(run)
    assert (summary["status"], summary["tolerance_met"]) == ("finished", False)
    assert summary["reason"].startswith("the budget is spent: 24 of 24 touches")
    assert summary["missed"][0] == "no error bound can be stated (limit 0.200 mm)"


TOLD = (
    "bag info RUN", "bag diff RUN RUN", "bag recover RUN -o OUT", "cost RUN", "recognise RUN",
    "score RUN RUN", "export RUN -o RUN/solid.3mf",
    "replay RUN --nodes filter", "replay RUN --set filter.contact=0.0004",
    "replay RUN --set filter.order=wiener --nodes filter,curvature",
    "rebuild RUN/points.csv", "scene list",
    "scene check sphere", "scene check worn_sensor", "scene effects", "calibrate sphere --quiet",
    "node kinds", "node kinds planner", "interface list", "interface show ShapeModel", "doctor",
    "gallery --list", "launch explore.yaml --show-args", "launch explore.yaml --print fingers:=3",
)  # fmt: skip


@pytest.mark.parametrize("words", TOLD)
def test_what_is_printed_has_80_columns_but_for_paths_and_is_json_on_request(
    words, run, tmp_path, capsys, monkeypatch
):
    monkeypatch.chdir(run.parent)
    ball = [f"{x},{y},{z}\n" for z in (0.0, 0.01, 0.02) for x, y in ((0.02, 0.0), (0.0, 0.02))]
    rest = [f"{-x},{-y},{z}\n" for z in (0.0, 0.01, 0.02) for x, y in ((0.02, 0.0), (0.0, 0.02))]
    (run / "points.csv").write_text("x,y,z\n" + "".join(ball + rest))
    for number, more in enumerate(((), ("--json",))):
        out = str(tmp_path / f"{number}.mcap")
        asked = words.replace("RUN", run.name).replace("OUT", out).split()
        cli.run([*asked, *more])
        told, err = capsys.readouterr()
        assert "bug" not in err
        if more and told:
            json.loads(told)
        lines = [] if more else [line for line in told.splitlines() if len(line) > 80]
        assert [line for line in lines if max(map(len, line.split())) < LONG_PATH] == []


def test_a_run_is_meant_by_its_directory_or_its_recording(run, capsys, monkeypatch):
    monkeypatch.chdir(run.parent)
    for words in ("bag info", "cost", "recognise", "replay --nodes filter", "score"):
        told = []
        for meant in ("spent", "spent/topics.mcap"):
            code = cli.run([*words.split(), meant, *(["spent"] if words == "score" else [])])
            assert code in (0, 1)
            told.append(capsys.readouterr().out)
        assert told[0] == told[1]
    assert read_summary(run / "topics.mcap") == read_summary(run)
    assert find_run_mesh(run / "topics.mcap") == find_run_mesh(run) == run / "mesh.ply"
    assert find_run_mesh(run / "mesh.stl") == run / "mesh.stl"
    with pytest.raises(InputError, match=r"none: does not exist; it must be a run or a file"):
        find_run_mesh(Path("none"))
    (run.parent / "empty").mkdir(exist_ok=True)
    with pytest.raises(InputError, match=r"empty: holds no rebuilt solid: there is no mesh\.ply"):
        find_run_mesh(Path("empty"))


def test_a_running_graph_is_meant_by_number_name_directory_or_recording(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    card = {"name": "vase", "pid": 1, "ends": "a", "nodes": (), "taps": {}, "tools": ""}
    for name in ("one", "two"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "topics.mcap").touch()
    (tmp_path / "latest").symlink_to("two")
    with tempfile.TemporaryDirectory() as runtime:
        monkeypatch.setenv("XDG_RUNTIME_DIR", runtime)
        with private_folder(None) as first, private_folder(None) as second:
            for folder, number, name in ((first, "ab12", "one"), (second, "cd34", "two")):
                announce(
                    folder,
                    RunCard(
                        run=number, began=number, folder=str((tmp_path / name).resolve()), **card
                    ),
                )
            for meant in ("cd", "two", "latest", "two/topics.mcap", "latest/topics.mcap"):
                assert find_run(meant).run == "cd34"
            assert find_run_path(Path("ab")) == tmp_path / "one"
            assert find_run_path(Path("two")) == Path("two")
            assert find_run_path(Path("none")) == Path("none")
            with pytest.raises(
                InputError, match="vase: several running graphs are called so: ab12"
            ):
                find_run_path(Path("vase"))


def test_names_are_given_between_commas_or_one_by_one(run, tmp_path, capsys):
    for number, topics in enumerate(
        (["/score,/world"], ["/score", "/world"], [" /score, /world,"])
    ):
        words = [word for topic in topics for word in ("--topics", topic)]
        out = str(tmp_path / f"{number}.npz")
        assert cli.run(["bag", "export", str(run), "--format", "npz", "-o", out, *words]) == 0
        assert capsys.readouterr().out.endswith("arrays of 2 topics\n")
