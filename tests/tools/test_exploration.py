import re
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import trimesh

import palpate
from palpate.launch import EXPLORE, Display
from palpate.launch.files import InputError
from palpate.launch.progress import LiveDisplay
from palpate.tools.cli import command_line as cli
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


@pytest.fixture
def planned(monkeypatch):
    """What explore would perform: the plan is made, and not carried out."""
    monkeypatch.setattr("palpate.tools.exploration._perform", lambda plan, **_: plan)

    def plan(*words: Any, **options: Any) -> Any:
        return explore(*words, composed=True, **options)

    return plan


def resolved(plan):
    """What a plan leaves in its run directory: the launch file with every parameter."""
    return {**plan.about, "launch": plan.about["launch"].replace(str(plan.folder.path), "")}


OPTIONS: list[tuple[list[str], dict[str, Any]]] = [
    (["--tolerance", "0.4mm"], {"tolerance": "0.4mm"}),
    (["--tolerance", "0.0004m"], {"tolerance": 4e-4}),
    (["--budget", "5min", "--touches", "90"], {"budget": 300, "touches": 90}),
    (["--feature", "4mm", "--quality", "fine"], {"feature": 0.004, "quality": "fine"}),
    (["--fingers", "2", "--noise", "high", "--seed", "5"], dict(fingers=2, noise="high", seed=5)),
    (["--pose", "0.01,0.0,0.05"], {"pose": (0.01, 0.0, 0.05)}),
    (["--procedure", "planar", "--touches", "9"], {"procedure": "planar", "touches": 9}),
]


@pytest.mark.parametrize(("words", "options"), OPTIONS)
def test_keywords_plan_the_run_of_the_same_options(words, options, planned, monkeypatch):
    asked: list[Any] = []
    monkeypatch.setattr(
        "palpate.tools.exploration.perform_and_print", lambda plan, **_: asked.append(plan) or 0
    )
    assert cli.run(["run", "vase", "--composed", *words]) == 0
    plan = planned("vase", **options)
    ours, theirs = resolved(plan), resolved(asked[0])
    assert ours["launch"] == theirs["launch"] and ours["scene"] == theirs["scene"]


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"tolerance": "0.2"}, "--tolerance 0.2: must have a unit: m, cm, mm, um"),
        ({"tolerance": -1}, "--tolerance -1.0m: must be more than 0"),
        ({"tolerance": float("nan")}, "--tolerance nanm: must be a number with a unit"),
        ({"budget": "5 parsec"}, "--budget 5 parsec: the unit 'parsec' is none of s, min, h"),
        ({"budget": 1}, "most_seconds is 1 s; the grasp alone may take"),
        ({"touches": 0}, "--touches 0: must be at least 1"),
        ({"quality": "best"}, "--quality best"),
        ({"noise": "loud"}, "--noise loud: must be one of none, low, default, high"),
        ({"procedure": "fishing"}, "--procedure fishing: must be one of containment, planar"),
        ({"procedure": "planar", "budget": 9}, "--budget 9.0s: --procedure planar explores in its"),
        ({"unit": "mm"}, "--unit mm: vase is no mesh; a scene has object.mesh.unit"),
        ({"size": "8cm"}, "--size 8cm: vase is no mesh; a scene has object.mesh.size"),
        ({"fingers": 0}, "fingers"),
        ({"seed": -1}, "seed"),
        ({"pose": (1.0, 2.0)}, "--pose 1.0,2.0: must be 3 or 7 numbers"),
    ],
)
def test_what_cannot_be_asked_is_refused_in_the_words_of_the_command_line(options, words, planned):
    with pytest.raises(InputError, match=re.escape(words)) as refused:
        planned("vase", **options)
    assert "\n" not in str(refused.value)


def test_meshes_and_maps_are_scenes(planned, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    box = trimesh.creation.box((30.0, 40.0, 60.0))
    box.export("box.stl")
    ball = {"superquadric": {"size": [0.03, 0.03, 0.03], "exponents": [1, 1]}}
    for scene, options, height in (
        (box, {"unit": "mm"}, 60.0),
        ((box.vertices, box.faces), {"size": "9cm"}, 90.0),
        (palpate.MeshSolid(1e-3 * box.vertices, box.faces), {}, 60.0),
        (Path("box.stl"), {"size": 0.12}, 120.0),
        ({"object": ball, "seed": np.int64(3)}, {}, 60.0),
        ({"object": {"mesh": {"file": "box.stl", "unit": "mm"}}}, {"tolerance": 5e-4}, 60.0),
    ):
        assert f"of {height:.0f} mm" in planned(scene, **options).asked
    with pytest.raises(InputError, match=r"^scene:3: .*exponents is 4"):
        planned({"object": {"superquadric": {"size": [1, 1, 1], "exponents": 4}}})
    with pytest.raises(InputError, match="faces must name vertices from 0 to 1"):
        planned((np.eye(3)[:2], [[0, 1, 2]]))
    with pytest.raises(InputError, match="unit and --size exclude each other"):
        planned("box.stl", unit="mm", size=0.1)


def test_a_bar_is_shown_only_where_it_can_be_drawn(monkeypatch):
    seen: list[Any] = []
    monkeypatch.setattr("palpate.launch.plan_run", lambda *_, **__: None)
    monkeypatch.setattr(
        "palpate.tools.exploration._perform", lambda _, display, **__: seen.append(type(display))
    )
    explore("vase", composed=True)
    monkeypatch.setattr("sys.stderr", SimpleNamespace(isatty=lambda: True))
    explore("vase", composed=True)
    explore("vase", composed=True, progress=False)
    assert seen == [Display, LiveDisplay, Display]
