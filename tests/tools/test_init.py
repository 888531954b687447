"""Nodes, drivers, filters, effects and planners of one's own, begun from templates that work."""

import json
import os
import re
import shlex
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import palpate
import palpate.testing
from palpate.core.explore.planners import Height, Stop
from palpate.launch.files.source_map import InputError
from palpate.launch.launch_file import describe
from palpate.messages.types import SurfacePatch
from palpate.nodes.runtime.testing import recorded
from palpate.tools.init import begin
from palpate.tools.templates import (
    driver_check,
    effect_check,
    filter_check,
    node,
    node_check,
    planner_check,
    planner_touches_check,
)
from palpate.tools.templates.planner import Template

KINDS = ("node", "driver", "filter", "effect", "planner")
CHECKED = node_check, driver_check, filter_check, effect_check, planner_check, planner_touches_check
CHECKS = [(one, name) for one in CHECKED for name in vars(one) if name.startswith("test_")]
LONG = ("test_solid_of_the_frames_is_the_ball",)
FILES = {
    "node": ("my_node.py", "test_my_node.py", "my_node.yaml"),
    "driver": ("my_driver.py", "test_my_driver.py", "my_driver.yaml"),
    "filter": ("my_filter.py", "test_my_filter.py", "my_filter.yaml", "my_filter_steps.py"),
    "effect": ("my_effect.py", "test_my_effect.py"),
    "planner": ("my_planner.py", "test_my_planner.py"),
    "planner_touches": ("my_planner_touches.py", "test_my_planner_touches.py"),
}
BALL = "object:\n  superquadric: {size: [0.04, 0.04, 0.04], exponents: [1, 1]}\n"
PAGE = (Path(__file__).parents[2] / "docs" / "own_node.md").read_text()
SHELL = "".join(re.findall(r"```sh\n(.*?)```", PAGE, re.DOTALL)).splitlines()
[SNIPPET] = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)


def pytest_in(*words):
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", *words]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stdout
    return done.stdout


@pytest.mark.slow
def test_new_modules_pass_their_tests(here):
    for kind, names in FILES.items():
        begun, named = begin(kind.partition("_")[0], f"my_{kind}", here, kind)
        assert tuple(path.name for path in begun) == names
        assert named == f"my_{kind}:My{kind.title().replace('_', '')}"
        assert not any("emplate" in path.read_text() for path in begun if kind != "effect")
    assert f"{len(CHECKS)} passed" in pytest_in(".")


@pytest.mark.parametrize(
    "check",
    [pytest.param(c, marks=[pytest.mark.slow] if c[1] in LONG else [], id=c[1]) for c in CHECKS],
)
def test_templates_pass_their_tests(check):
    module, name = check
    vars(module)[name]()


def test_tests_of_templates_fail_for_wrong_code(monkeypatch):
    def publish_all(params, most, patch):
        return node.take_patch(params, -1.0, patch)

    class Metres(Template):
        def next(self, observation):
            height = observation.low + 0.01 * (len(observation.slices) + 1)
            return Height(height, "on") if height < 0.08 else Stop("end")

    wrong = replace(node.NODE, inputs={"/touch/patch": (SurfacePatch, publish_all)})
    monkeypatch.setattr(node_check, "NODE", wrong)
    monkeypatch.setattr(planner_check, "Template", Metres)
    for check in (
        node_check.test_each_larger_curvature_is_published,
        node_check.test_smallest_curvature_is_a_parameter,
        planner_check.test_the_plan_in_millimetres_is_the_plan_in_metres,
        planner_check.test_the_budget_is_kept,
        planner_check.test_everything_a_pad_can_touch_is_touched,
    ):
        with pytest.raises(AssertionError):
            check()


@pytest.mark.slow
def test_new_modules_pass_ruff_and_mypy(tmp_path):
    begun = [*begin("node", "my_node", tmp_path)[0], *begin("driver", "my_driver", tmp_path)[0]]
    modules = [path.name for path in begun if path.suffix == ".py"]
    # As if it were installed from a wheel: mypy does not follow what is installed for editing.
    env = {**os.environ, "PYTHONPATH": str(Path(palpate.__file__).parents[1])}
    for tool in (["ruff", "check", "--isolated"], ["mypy", "--strict"]):
        command = [sys.executable, "-m", *tool, *modules]
        done = subprocess.run(command, capture_output=True, cwd=tmp_path, env=env)
        assert done.returncode == 0, done.stdout


@pytest.mark.parametrize(
    ("kind", "name", "words"),
    [
        *((kind, "Bends", "'Bends' cannot name a module") for kind in KINDS),
        *((kind, "../hum", "cannot name a module") for kind in KINDS),
        *((kind, "if", "'if' cannot name a module") for kind in KINDS),
        *((kind, "numpy", "'numpy' is a module that Python has") for kind in KINDS),
        ("node", "filter", "'filter' is a node that palpate has"),
        ("node", "launcher", "'launcher' is a node that palpate has"),
        ("driver", "filter", "'filter' is a driver that palpate has"),
        ("node", "tactile_frame", "the class TactileFrame of 'tactile_frame' has a meaning"),
        ("node", "a" * 33, "is too long; a node's name has at most 32 letters"),
        ("effect", "drift", "'drift' is an effect that palpate has"),
        ("effect", "none", "the class None of 'none' has a meaning already"),
        ("planner", "fuzzy", "'fuzzy' is a planner that palpate has"),
        ("planner", "height", "the class Height of 'height' has a meaning already"),
    ],
)
def test_bad_names_are_refused(kind, name, words, tmp_path):
    with pytest.raises(InputError, match=words):
        begin(kind, name, tmp_path)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("kind", KINDS)
def test_nothing_is_overwritten_or_half_written(kind, tmp_path):
    for there in (name.replace(f"my_{kind}", "mine") for name in FILES[kind]):
        (tmp_path / there).write_text("mine")
        with pytest.raises(InputError, match=rf"{there}: exists already; it is not overwritten"):
            begin(kind, "mine", tmp_path)
        assert [file.name for file in tmp_path.iterdir()] == [there]
        (tmp_path / there).unlink()
    with pytest.raises(InputError, match=r"mine\.py: cannot be written: there is no folder"):
        begin(kind, "mine", tmp_path / "no")


@pytest.mark.parametrize("kind", KINDS)
def test_init_prints_working_commands(kind, here, call):
    text = call(f"init {kind} printed").out
    assert re.match(r"printed\.py[^:]*: written", text)
    commands = re.findall(r"python -m .+|palpate (?!in ).+", text)
    assert len(commands) == {"effect": 1, "planner": 1}.get(kind, 3)
    for command in commands:
        program, *words = shlex.split(command)
        if program == "python":  # their tests are run by another test
            assert words == ["-m", "pytest", "test_printed.py"]
            continue
        graph = describe(here / "printed.yaml", {}, here / "out").graph
        graph.wirings()
        assert words[0] == "launch" or (words[1] == "echo" and words[2] in graph.topics())
    if kind in ("effect", "planner"):
        key = {"effect": "effects", "planner": "explore"}[kind]
        lines = text.split(f"{key}:\n")[1]
        (here / "scene.yaml").write_text(f"{BALL}{key}:\n{lines}")
        assert call("scene check scene.yaml").code == 0
    assert call(f"init {kind} printed").code == 2


@pytest.mark.slow
def test_new_node_publishes_its_own_type_in_a_run(here, call):
    (*_, launch), _ = begin("node", "bends", here)
    budget = ["--set", "planner.most_touches=30", "--set", "bends.least=1.0"]
    command = ["--composed", "--quiet", "--out", "out", *budget]
    assert call("launch", launch, "scene:=sphere", *command).code in (0, 1)
    from bends import Bends

    messages = recorded(here / "out", "/bends", Bends)
    patches = recorded(here / "out", "/touch/patch", SurfacePatch)
    assert messages[-1].curvature == max(one.k1 for one in patches if one.kind == "smooth")
    with pytest.raises(ValueError, match="/bends holds Bends, which palpate does not have; name"):
        recorded(here / "out", "/bends")


@pytest.mark.slow
def test_planner_of_single_touches_explores_without_slices(here, call):
    assert call("init planner --touches pokes").code == 0
    asked = "--set planner.planner=pokes:Pokes --touches 32 --composed --quiet --out out"
    assert call(f"run sphere {asked}").code in (0, 1)
    summary = json.loads((here / "out" / "summary.json").read_text())
    assert (summary["contours"], summary["touches"], summary["method"]) == (1, 32, "general")
    assert 5 < len(recorded(here / "out", "/probe/traced")) < 32


@pytest.fixture
def reader(here):
    """The reader's folder: ten frames of a ball of 20 mm, the last one without contact."""
    side = (np.arange(16) - 7.5) * 1e-3
    x, y = np.meshgrid(side, side)
    depths = [*np.linspace(0.4e-3, 1e-3, 9), 0.0]
    images = [np.maximum(depth - 0.5 * (x**2 + y**2) / 0.02, 0.0) for depth in depths]
    rows = [[0, 0, 0.01 * i, 0, 0, 0, 1, *image.ravel()] for i, image in enumerate(images)]
    np.savetxt("frames.csv", rows, delimiter=",")
    return here


def test_page_is_short_and_its_snippet_measures_curvatures(reader, capsys):
    assert len(PAGE.splitlines()) <= 60
    assert len([line for line in SNIPPET.splitlines() if line]) <= 10
    assert {*re.findall(r"`([a-z_]+)\(", PAGE)} == {*palpate.testing.__all__}
    exec(SNIPPET, {})
    *lines, last = capsys.readouterr().out.splitlines()
    assert last == "miss" and len(lines) == 9
    for line in lines:
        assert line.startswith("k1 50.00 +- 0.00, k2 50.00 +- 0.00 1/m, normal [")


@pytest.mark.slow
def test_every_command_of_the_page_works(reader, call):
    for line in SHELL:
        program, *words = shlex.split(line)
        if program == "python":
            pytest_in(*words[2:])
        elif words[0] == "launch":
            # The frames of this test contradict each other, and make no solid.
            code = int("path:=frames.csv" in line)
            if words[1] == "mine.yaml":  # whose pace is for eyes
                words += ["--set", "mine.rate=1000"]
            assert call(*words, "--composed", "--quiet", "--out", f"{words[1]}.d").code == code
        elif words[0] == "topic":
            assert words[2] in describe(Path("bends.yaml"), {}, reader).graph.topics()
        else:
            assert call(*words).code == 0, line
    assert len(SHELL) == 8
