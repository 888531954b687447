import fcntl
import os
import re
import subprocess
import sys
import tempfile
from contextlib import contextmanager
from pathlib import Path

import msgspec
import pytest

from palpate.launch import RUNS, shipped_scenes
from palpate.launch.processes.registry import LOCK_FILE, RunCard, announce, private_folder
from palpate.nodes.runtime.node import RecordedNode
from palpate.tools.cli import command_line as cli

HEAVY = {"scipy", "trimesh", "palpate.launch.run"}
TIMED = """
import sys
from palpate.tools.cli.command_line import main
try:
    main()
finally:
    print(*sys.modules, file=sys.stderr)
"""


@pytest.fixture(autouse=True)
def home(tmp_path, monkeypatch):
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    with tempfile.TemporaryDirectory() as runtime:  # short, as paths of sockets must be
        monkeypatch.setenv("XDG_RUNTIME_DIR", runtime)
        yield tmp_path


@pytest.fixture
def complete(monkeypatch, capsys):
    """What a shell is offered for a line: type, value and help; nothing else may be printed."""

    def ask(line, shell="bash"):
        *before, last = line.split(" ")
        monkeypatch.setenv("_PALPATE_COMPLETE", f"{shell}_complete")
        monkeypatch.setenv("COMP_WORDS", line)
        monkeypatch.setenv("COMP_CWORD", last if shell == "fish" else str(len(before)))
        assert cli.answer_shell() == 0
        out, err = capsys.readouterr()
        assert err == ""
        return [line for line in out.splitlines() if line]

    return ask


@contextmanager
def running(run="ab12", name="vase"):
    node = RecordedNode(
        name="simulator",
        module="palpate.nodes.simulator",
        params=msgspec.Raw(b"{}"),
        inputs=(),
        outputs={"/touch/raw": "/touch/raw"},
        types={"/touch/raw": "TactileFrame"},
    )
    with private_folder(None) as folder:
        card = RunCard(
            run=run, name=name, began=run, pid=1, folder="", ends="simulator",
            nodes=(node,), taps={}, tools="",
        )  # fmt: skip
        announce(folder, card)
        yield


def values(lines):
    return [line.removeprefix("plain,") for line in lines]


def test_commands_and_options_are_completed_in_every_shell(complete):
    assert complete("palpate sc") == ["plain,scene", "plain,score"]
    assert complete("palpate dev ") == ["plain,bench", "plain,chaos"]
    assert values(complete("palpate bag ex")) == ["export"]
    assert "--tolerance" in values(complete("palpate run --"))
    assert values(complete("palpate run --noise ")) == ["none", "low", "default", "high"]
    kind, value, told = complete("palpate swe", "zsh")
    assert (kind, value) == ("plain", "sweep") and told.startswith("Explore with many")
    assert complete("palpate swe", "fish") == [f"plain,sweep\t{told}"]


def test_scenes_are_the_shipped_ones_and_the_files_that_can_be_explored(complete, home):
    for name in ("vat.yaml", "valve.stl", "vain.txt"):
        (home / "here" / name).touch()
    (home / "here" / "vases").mkdir()
    assert values(complete("palpate run va")) == ["vase", "valve.stl", "vat.yaml"]
    assert values(complete("palpate scene check ")) == [*shipped_scenes(), "valve.stl", "vat.yaml"]
    assert values(complete("palpate calibrate ./vat")) == ["./vat.yaml"]
    assert complete("palpate run vases/") == ["file,vases/"]


def test_runs_are_those_in_their_folder_the_latest_first_or_else_files(complete, home):
    assert cli.RUNS == RUNS
    assert complete("palpate bag info ") == ["file,"]
    for name in ("2026-01-01_vase", "2026-01-02_box"):
        (home / "here" / "runs" / name).mkdir(parents=True)
    (home / "here" / "runs" / "latest").symlink_to("2026-01-02_box")
    runs = ["runs/latest", "runs/2026-01-02_box", "runs/2026-01-01_vase"]
    for words in ("bag info", "bag diff runs/latest", "replay", "cost", "recognise", "score"):
        assert values(complete(f"palpate {words} r")) == runs
    assert complete("palpate replay ../x") == ["file,../x"]


def test_topics_and_nodes_are_those_of_the_running_graph_that_is_meant(complete):
    for words in ("topic echo /", "node info ", "topic hz /", "param dump ", "topic echo --run "):
        assert complete(f"palpate {words}") == []
    with running():
        assert "/touch/raw" in values(complete("palpate topic echo /"))
    with running(), running("cd34", "egg"):
        assert complete("palpate topic echo /") == []  # either may be meant
        assert values(complete("palpate topic echo --run ab /t")) == ["/touch/raw"]
        assert values(complete("palpate topic hz --run ab /log /to")) == ["/touch/raw"]
        assert complete("palpate topic info --run none /") == []
        assert values(complete("palpate node info --run ab s")) == ["simulator"]
        assert values(complete("palpate topic list --run ")) == ["ab12", "vase", "cd34", "egg"]


@pytest.mark.parametrize("card", [b"", b"{", b"\xff\x00", b'{"run": 3}', b"[]"])
def test_a_damaged_registry_offers_nothing_and_says_nothing(complete, card):
    folder = Path(os.environ["XDG_RUNTIME_DIR"]) / "palpate-run-x"
    folder.mkdir()
    (folder / "run.json").write_bytes(card)
    lock = os.open(folder / LOCK_FILE, os.O_CREAT | os.O_RDWR)
    fcntl.flock(lock, fcntl.LOCK_EX)
    assert complete("palpate topic echo /") == []
    assert complete("palpate node info ") == []
    os.close(lock)


def test_a_line_that_makes_no_sense_offers_nothing_and_says_nothing(complete, monkeypatch):
    for line in ("palpate none ", "palpate run --none ", "palpate topic nothing x"):
        complete(line)
    monkeypatch.setattr("palpate.launch.processes.running_graphs", lambda: 1 / 0)
    assert complete("palpate topic list --run ") == []


@pytest.mark.parametrize(
    ("line", "heavy"),
    [
        ("palpate r", {"numpy", "msgspec", *HEAVY}),
        ("palpate bag info r", {"numpy", *HEAVY}),
        ("palpate run --", HEAVY),
        ("palpate topic echo /", HEAVY),
    ],
)
def test_a_shell_does_not_wait_for_what_it_does_not_ask_for(line, heavy):
    asked = {"COMP_WORDS": line, "COMP_CWORD": str(len(line.split(" ")) - 1)}
    environment = {**os.environ, **asked, "_PALPATE_COMPLETE": "bash_complete"}
    done = subprocess.run(
        [sys.executable, "-c", TIMED],
        env=environment, capture_output=True, text=True, timeout=300, check=True,
    )  # fmt: skip
    assert not heavy & set(done.stderr.split())


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_the_script_of_a_shell_is_printed(capsys, shell):
    assert cli.run(["--completion", shell]) == 0
    out, err = capsys.readouterr()
    assert err == ""
    assert f"_PALPATE_COMPLETE={shell}_complete" in out
    assert re.search(r"complete .*palpate|compdef .*palpate", out)


def test_a_shell_that_is_not_known_is_refused(capsys):
    assert cli.run(["--completion", "csh"]) == 2
    assert "'csh' is not one of 'bash', 'zsh', 'fish'" in capsys.readouterr().err
