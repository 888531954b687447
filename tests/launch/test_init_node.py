from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

import palpate
from palpate.launch.cli import main as cli
from palpate.launch.init_node import init_node
from palpate.launch.launch_file import describe
from palpate.launch.located import InputError
from palpate.launch.templates import driver_check, node_check
from palpate.messages.types import SurfacePatch
from palpate.testing import recorded

CHECKS = [
    (module, name)
    for module in (node_check, driver_check)
    for name in vars(module)
    if name.startswith("test_")
]


@pytest.mark.parametrize("kind", ["node", "driver"])
def test_what_is_new_works_at_once_and_its_test_passes(kind: str, tmp_path: Path) -> None:
    begun = init_node("my_own", tmp_path, kind)  # type: ignore[arg-type]
    assert [path.name for path in begun] == ["my_own.py", "test_my_own.py", "my_own.yaml"]
    for path in begun:
        assert "emplate" not in path.read_text()

    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", str(begun.test)]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=100)
    assert done.returncode == 0, done.stdout
    count = sum(module.__name__.endswith(f"{kind}_check") for module, _ in CHECKS)
    assert f"{count} passed" in done.stdout


@pytest.mark.parametrize("check", CHECKS, ids=lambda check: check[1])
def test_the_templates_pass_their_own_tests(check: tuple[object, str]) -> None:
    module, name = check
    vars(module)[name]()


def test_the_test_of_the_node_fails_for_one_that_tells_everything(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    from dataclasses import replace

    from palpate.launch.templates import node

    def tell(params: node.Params, most: float, patch: SurfacePatch) -> tuple[float, list[object]]:
        return node.take_patch(params, -1.0, patch)  # type: ignore[return-value]

    wrong = replace(node.NODE, inputs={"/touch/patch": (SurfacePatch, tell)})
    monkeypatch.setattr(node_check, "NODE", wrong)
    with pytest.raises(AssertionError):
        node_check.test_each_place_that_bends_more_than_all_before_is_told()
    with pytest.raises(AssertionError):
        node_check.test_the_launch_file_may_say_what_is_little()


@pytest.mark.slow
def test_what_is_new_is_free_of_complaints(tmp_path: Path) -> None:
    begun = [*init_node("my_node", tmp_path, "node"), *init_node("my_driver", tmp_path, "driver")]
    modules = [path.name for path in begun if path.suffix == ".py"]

    for tool in (["ruff", "check", "--isolated"], ["mypy", "--strict"]):
        command = [sys.executable, "-m", *tool, *modules]
        # As if it were installed from a wheel: mypy does not follow what is installed for editing.
        env = {**os.environ, "PYTHONPATH": str(Path(palpate.__file__).parents[1])}
        done = subprocess.run(
            command, cwd=tmp_path, capture_output=True, text=True, timeout=100, env=env
        )
        assert done.returncode == 0, done.stdout + done.stderr


def test_the_new_node_joins_the_graph_of_its_launch_file(here: Path) -> None:
    begun = init_node("joins", here, "node")

    graph = describe(begun.launch, {}, here / "out").graph
    graph.check()
    line = next(line for line in graph.table().splitlines() if line.startswith("/joins "))
    assert line.split()[1:] == ["Joins", "joins", "recorder"]


def test_a_type_of_ones_own_travels_and_is_recorded(here: Path) -> None:
    begun = init_node("bends", here, "node")
    command = [
        "launch",
        str(begun.launch),
        "scene:=sphere",
        "--composed",
        "--quiet",
        "--out",
        "out",
    ]
    budget = ["--set", "planner.most_touches=60", "--set", "bends.least=1.0"]

    assert cli.run([*command, *budget]) in (0, 1)
    from bends import Bends  # type: ignore[import-not-found]

    told = recorded(here / "out", "/bends", Bends)
    patches = recorded(here / "out", "/touch/patch", SurfacePatch)
    smooth = [patch.k1 for patch in patches if patch.kind == "smooth"]
    assert told[-1].curvature == max(smooth)
    with pytest.raises(ValueError, match="/bends holds Bends, which palpate does not have; name"):
        recorded(here / "out", "/bends")


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("Bends", "'Bends' cannot name a module"),
        ("filter", "'filter' is a node that palpate has"),
        ("launcher", "'launcher' is a node that palpate has"),
        ("world", "the class World of 'world' has a meaning already"),
        ("tactile_frame", "the class TactileFrame of 'tactile_frame' has a meaning already"),
        ("a" * 33, "is too long; a node's name has at most 32 letters"),
        ("numpy", "'numpy' is a module that Python has"),
    ],
)
def test_a_bad_name_is_refused(name: str, words: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=words):
        init_node(name, tmp_path, "node")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("there", ["mine.py", "test_mine.py", "mine.yaml"])
def test_nothing_is_overwritten_and_nothing_half_written(there: str, tmp_path: Path) -> None:
    (tmp_path / there).write_text("mine")
    with pytest.raises(InputError, match=rf"{there}: is there already"):
        init_node("mine", tmp_path, "driver")
    assert [file.name for file in tmp_path.iterdir()] == [there]


@pytest.mark.parametrize("kind", ["node", "driver"])
def test_the_verb_says_what_was_written_and_what_to_do_next(
    kind: str, here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.run(["init", kind, "verbal"]) == 0
    said = capsys.readouterr().out
    assert said.startswith("verbal.py, test_verbal.py, verbal.yaml: written")
    for command in ("python -m pytest test_verbal.py", "palpate launch verbal.yaml"):
        assert command in said
    assert f"palpate topic echo {'/verbal' if kind == 'node' else '/touch/patch'}\n" in said
    assert cli.run(["init", kind, "verbal"]) == 2
