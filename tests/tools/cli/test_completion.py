"""What a shell is offered while a command line is typed."""

import fcntl
import os
import re
import subprocess
import sys

import pytest

from palpate.launch.scene import shipped_scenes
from palpate.tools.cli.command_line import answer_shell
from tests.tools.toy_graph import toy_graph

HEAVY = {"scipy", "trimesh", "palpate.launch.run"}


@pytest.fixture(autouse=True)
def home(tmp_path, runtime, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


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
    kind, value, told = complete("palpate rebu", "zsh")
    assert (kind, value) == ("plain", "rebuild") and told.startswith("Rebuild a solid")
    assert complete("palpate rebu", "fish") == [f"rebuild\t{told}"]


def test_scenes_are_shipped_ones_and_files(complete, home):
    for name in ("vat.yaml", "valve.stl", "vain.txt"):
        (home / name).touch()
    (home / "vases").mkdir()
    assert complete("palpate run va") == ["vase", "valve.stl", "vat.yaml"]
    assert complete("palpate scene check ") == [*shipped_scenes(), "valve.stl", "vat.yaml"]
    assert complete("palpate calibrate ./vat") == ["./vat.yaml"]
    assert complete("palpate run vases/") == ["file,vases/"]


def test_runs_are_those_of_their_folder_latest_first(complete, home):
    assert complete("palpate bag info ") == ["file,"]
    for name in ("2026-01-01_vase", "2026-01-02_box"):
        (home / "runs" / name).mkdir(parents=True)
    (home / "runs" / "latest").symlink_to("2026-01-02_box")
    runs = ["runs/latest", "runs/2026-01-02_box", "runs/2026-01-01_vase"]
    for words in ("bag info", "bag diff runs/latest", "replay", "cost", "recognise", "score"):
        assert complete(f"palpate {words} r") == runs
    assert complete("palpate replay ../x") == ["file,../x"]


def test_topics_and_nodes_are_those_of_the_graph_that_is_meant(complete):
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
def test_damaged_registry_offers_nothing(complete, runtime, card):
    folder = runtime / "palpate-run-x"
    folder.mkdir()
    (folder / "run.json").write_bytes(card)
    lock = os.open(folder / "lock", os.O_CREAT | os.O_RDWR)
    fcntl.flock(lock, fcntl.LOCK_EX)
    assert complete("palpate topic echo /") == complete("palpate node info ") == []
    os.close(lock)


def test_senseless_line_offers_nothing(complete, monkeypatch):
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


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_script_of_a_shell_is_printed(call, shell):
    code, out, err = call("--completion", shell)
    assert (code, err) == (0, "") and f"_PALPATE_COMPLETE={shell}_complete" in out
    assert re.search(r"complete .*palpate|compdef .*palpate", out)


def test_unknown_shell_is_refused(refusal):
    assert "'csh' is not one of 'bash', 'zsh', 'fish'" in refusal("--completion csh")
