from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from palpate.launch import EXPLORE, Display
from palpate.launch.files import InputError
from palpate.tools.exploration import explore


def test_exploring_from_python_is_what_run_does(monkeypatch):
    asked: dict[str, Any] = {}

    def plan(path, args, settings, **rest):
        asked.update(path=path, settings=settings, **rest)
        asked["args"] = {name: value.value for name, value in args.items()}
        return "the plan"

    def perform(plan, **rest):
        asked.update(plan=plan, **rest)
        return SimpleNamespace(folder=Path("here"))

    written: list[Path] = []
    monkeypatch.setattr("palpate.launch.plan_run", plan)
    monkeypatch.setattr("palpate.launch.perform", perform)
    monkeypatch.setattr("palpate.tools.report.write_report", lambda _, path: written.append(path))
    settings = {"planner.tolerance": 1e-4}
    done = explore("vase", seed=3, fingers=2, settings=settings, out="here", composed=True)
    assert done.folder == Path("here")
    assert written == [Path("here/report.html")]
    assert asked["plan"] == "the plan"
    assert (asked["path"], asked["name"], asked["out"]) == (EXPLORE, "vase", Path("here"))
    assert Path(asked["args"].pop("scene")).name == "vase.yaml"
    assert asked["args"] == {"record": True, "seed": 3, "fingers": 2}
    assert asked["settings"]["planner.tolerance"].value == 1e-4
    assert asked["composed"] is True
    assert isinstance(asked["display"], Display)


def test_a_scene_that_is_not_there_is_refused():
    with pytest.raises(InputError, match="there is no scene 'vaes'"):
        explore("vaes")


def test_a_report_that_cannot_be_written_is_no_fault_of_the_run(monkeypatch, tmp_path, capsys):
    def fail(*_):
        raise InputError("the disk is full")

    run = SimpleNamespace(folder=tmp_path)
    monkeypatch.setattr("palpate.launch.plan_run", lambda *_, **__: None)
    monkeypatch.setattr("palpate.launch.perform", lambda *_, **__: run)
    monkeypatch.setattr("palpate.tools.report.write_report", fail)
    assert explore("vase", composed=True) is run  # type: ignore[comparison-overlap]
    assert capsys.readouterr().err == "palpate: no report.html: the disk is full\n"
