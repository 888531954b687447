"""Explorations asked for from Python and from the command line."""

import re
from pathlib import Path

import numpy as np
import pytest
import trimesh

import palpate
from palpate.launch.files.source_map import InputError
from palpate.launch.progress import Display
from palpate.tools.exploration import explore


def parts(plan):
    """A plan's launch file with every parameter, and its scene."""
    about = plan.about
    return about["launch"].replace(str(plan.folder.path), ""), about["scene"], plan.demanded


def test_explore_performs_plan_with_progress_on_a_terminal(performed, capsys, tmp_path,
                                                           monkeypatch):  # fmt: skip
    done = explore("vase", seed=3, settings={"planner.tolerance": 1e-4}, out="here", composed=True)
    ((plan, composed, display),) = performed
    assert composed is True and type(display) is Display and done.folder == tmp_path
    assert (plan.name, plan.folder.path) == ("vase", Path("here"))
    nodes = {one.name: one.params for one in plan.wirings}
    assert nodes["planner"].tolerance == 1e-4 and nodes["simulator"].seed == 3
    err = capsys.readouterr().err
    assert err.startswith("palpate: no report.html: ") and err.count("\n") == 1
    monkeypatch.setattr("sys.stderr.isatty", lambda: True, raising=False)
    explore("vase", composed=True)
    explore("vase", composed=True, progress=False)
    assert [type(display) is Display for *_, display in performed] == [True, False, True]


@pytest.mark.parametrize(
    ("words", "options"),
    [
        ("--tolerance 0.4mm", {"tolerance": "0.4mm"}),
        ("--tolerance 0.0004m", {"tolerance": 4e-4}),
        ("--budget 5min --touches 90", {"budget": 300, "touches": 90}),
        ("--feature 4mm --quality fine", {"feature": 0.004, "quality": "fine"}),
        ("--fingers 2 --noise high --seed 5", {"fingers": 2, "noise": "high", "seed": 5}),
        ("--pose 0.01,0.0,0.05", {"pose": (0.01, 0.0, 0.05)}),
        ("--procedure planar --touches 9", {"procedure": "planar", "touches": 9}),
    ],
)
def test_keywords_plan_the_run_of_the_same_options(words, options, performed, call, here):
    assert call(f"run vase --composed {words}").code == 3
    explore("vase", composed=True, **options)
    from_words, from_keywords = (parts(plan) for plan, *_ in performed)
    assert from_words == from_keywords


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
        ({"procedure": "planar", "budget": 9}, "--budget 9.0s: --procedure planar does not use it"),
        ({"unit": "mm"}, "--unit mm: vase is no mesh; a scene has object.mesh.unit"),
        ({"size": "8cm"}, "--size 8cm: vase is no mesh; a scene has object.mesh.size"),
        ({"fingers": 0}, "fingers"),
        ({"seed": -1}, "seed"),
        ({"pose": (1.0, 2.0)}, "--pose 1.0,2.0: must be 3 or 7 numbers"),
    ],
)
def test_impossible_demands_are_refused_as_on_the_command_line(options, words, performed):
    with pytest.raises(InputError, match=re.escape(words)) as refused:
        explore("vase", composed=True, **options)
    assert "\n" not in str(refused.value) and performed == []


def test_meshes_and_maps_are_scenes(performed, here):
    box = trimesh.creation.box((30.0, 40.0, 60.0))
    box.export("box.stl")
    ball = {"superquadric": {"size": [0.03, 0.03, 0.03], "exponents": [1, 1]}}
    for scene, options, height in (
        (box, {"unit": "mm"}, 60),
        ((box.vertices, box.faces), {"size": "9cm"}, 90),
        (palpate.MeshSolid(1e-3 * box.vertices, box.faces), {}, 60),
        (Path("box.stl"), {"size": 0.12}, 120),
        ({"object": ball, "seed": np.int64(3)}, {}, 60),
        ({"object": {"mesh": {"file": "box.stl", "unit": "mm"}}}, {"tolerance": 5e-4}, 60),
    ):
        explore(scene, composed=True, **options)
        assert f"of {height} mm" in performed[-1][0].asked
    flat = {"superquadric": {"size": [1, 1, 1], "exponents": 4}}
    for scene, options, words in (
        ({"object": flat}, {}, r"^scene:3: .*exponents is 4"),
        ((np.eye(3)[:2], [[0, 1, 2]]), {}, "faces must name vertices from 0 to 1"),
        ("box.stl", {"unit": "mm", "size": 0.1}, "unit and --size exclude each other"),
    ):
        with pytest.raises(InputError, match=words):
            explore(scene, composed=True, **options)
