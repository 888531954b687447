from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from palpate.core.explore.planners.catalogue import make_planner
from palpate.launch.cli import main as cli
from palpate.launch.init_planner import init_planner
from palpate.launch.located import InputError
from palpate.launch.templates import planner_check
from palpate.launch.templates.planner import Template

CHECKS = [name for name in vars(planner_check) if name.startswith("test_")]


def test_a_new_planner_works_at_once_and_its_test_passes(tmp_path: Path) -> None:
    path, test, named = init_planner("by_steepness", tmp_path)
    assert (path.name, test.name) == ("by_steepness.py", "test_by_steepness.py")
    assert named == "by_steepness:BySteepness"
    for file in (path, test):
        assert "emplate" not in file.read_text()

    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", str(test)]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=100)
    assert done.returncode == 0, done.stdout
    assert f"{len(CHECKS)} passed" in done.stdout


def test_a_new_planner_is_found_by_its_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    _, _, named = init_planner("by_bow", tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    assert getattr(make_planner(named, {"most_bow": 2.0}), "most_bow") == 2.0  # noqa: B009
    with pytest.raises(ValueError, match=r"most_bow is 0; expected 0.1 to 100"):
        make_planner(named, {"most_bow": 0.0})


@pytest.mark.parametrize("name", CHECKS)
def test_the_template_passes_its_own_test(name: str) -> None:
    vars(planner_check)[name]()


def test_the_test_of_the_template_fails_for_a_planner_that_has_a_length_of_its_own(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    from palpate.core.explore.planners.choice import Choice, Height, Stop
    from palpate.core.explore.planners.known import Known

    class Metres(Template):
        def next(self, known: Known) -> Choice:
            heights = [known.low + 0.01 * (i + 1) for i in range(len(known.slices) + 1)]
            return Height(heights[-1], "on") if heights[-1] < 0.08 else Stop("end", None)

    monkeypatch.setattr(planner_check, "Template", Metres)
    with pytest.raises(AssertionError):
        planner_check.test_the_plan_in_millimetres_is_the_plan_in_metres()
    with pytest.raises(AssertionError):
        planner_check.test_the_budget_is_kept()
    with pytest.raises(AssertionError):
        planner_check.test_everything_a_pad_can_feel_is_felt()


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("Steps", "'Steps' cannot name a module"),
        ("by-bow", "'by-bow' cannot name a module"),
        ("../bow", "cannot name a module"),
        ("fuzzy", "'fuzzy' is a planner that palpate has"),
        ("if", "'if' cannot name a module"),
        ("height", "the class Height of 'height' has a meaning already"),
        ("trial", "the class Trial of 'trial' has a meaning already"),
        ("numpy", "'numpy' is a module that Python has"),
    ],
)
def test_a_bad_name_is_refused(name: str, words: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=words):
        init_planner(name, tmp_path)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("there", ["mine.py", "test_mine.py"])
def test_nothing_is_overwritten_and_nothing_half_written(there: str, tmp_path: Path) -> None:
    (tmp_path / there).write_text("mine")
    with pytest.raises(InputError, match=rf"{there}: is there already"):
        init_planner("mine", tmp_path)
    assert [file.name for file in tmp_path.iterdir()] == [there]
    assert (tmp_path / there).read_text() == "mine"


def test_a_folder_that_is_not_there_is_told(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"mine\.py: cannot be written: No such file"):
        init_planner("mine", tmp_path / "no")


def test_the_verb_says_what_was_written_and_how_it_is_used(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert cli.run(["init", "planner", "my_planner"]) == 0
    said = capsys.readouterr().out
    assert "python -m pytest test_my_planner.py" in said
    assert said.endswith("explore:\n  planner: my_planner:MyPlanner\n")
    assert cli.run(["init", "planner", "my_planner"]) == 2
    assert capsys.readouterr().err == (
        "palpate: my_planner.py: is there already; choose another name\n"
    )
