import json
import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import palpate
from palpate.core.explore.planners.protocol import make_planner
from palpate.core.touch.effects.catalogue import effect_type
from palpate.launch.files.source_map import InputError
from palpate.launch.launch_file import describe
from palpate.launch.scene import load_scene
from palpate.messages.types.touch import SurfacePatch
from palpate.nodes.runtime.testing import recorded
from palpate.tools.cli import command_line as cli
from palpate.tools.init import begin
from palpate.tools.templates import (
    driver_check,
    effect_check,
    filter_check,
    node_check,
    planner_check,
    planner_touches_check,
)
from palpate.tools.templates.planner import Template

KINDS = ("node", "driver", "filter", "effect", "planner")
CHECKS = [
    (module, name)
    for module in (
        node_check,
        driver_check,
        filter_check,
        effect_check,
        planner_check,
        planner_touches_check,
    )
    for name in vars(module)
    if name.startswith("test_")
]
FILES = {
    "node": ("my_node.py", "test_my_node.py", "my_node.yaml"),
    "driver": ("my_driver.py", "test_my_driver.py", "my_driver.yaml"),
    "filter": ("my_filter.py", "test_my_filter.py", "my_filter.yaml", "my_filter_steps.py"),
    "effect": ("my_effect.py", "test_my_effect.py"),
    "planner": ("my_planner.py", "test_my_planner.py"),
    "planner_touches": ("my_planner_touches.py", "test_my_planner_touches.py"),
}


def test_what_is_new_works_at_once_and_its_tests_pass(tmp_path):
    for kind, names in FILES.items():
        begun, named = begin(kind.partition("_")[0], f"my_{kind}", tmp_path, kind)
        assert tuple(path.name for path in begun) == names
        assert named == f"my_{kind}:My{kind.title().replace('_', '')}"
        assert not any("emplate" in path.read_text() for path in begun if kind != "effect")
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", str(tmp_path)]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stdout
    assert f"{len(CHECKS)} passed" in done.stdout


@pytest.mark.parametrize("check", CHECKS, ids=lambda check: check[1])
def test_the_templates_pass_their_own_tests(check):
    module, name = check
    vars(module)[name]()


def test_the_test_of_the_node_fails_for_one_that_tells_everything(monkeypatch):
    from dataclasses import replace

    from palpate.tools.templates import node

    def tell(params, most, patch):
        return node.take_patch(params, -1.0, patch)

    wrong = replace(node.NODE, inputs={"/touch/patch": (SurfacePatch, tell)})
    monkeypatch.setattr(node_check, "NODE", wrong)
    with pytest.raises(AssertionError):
        node_check.test_each_place_that_bends_more_than_all_before_is_told()
    with pytest.raises(AssertionError):
        node_check.test_the_launch_file_may_say_what_is_little()


@pytest.mark.slow
def test_what_is_new_is_free_of_complaints(tmp_path):
    begun = [*begin("node", "my_node", tmp_path)[0], *begin("driver", "my_driver", tmp_path)[0]]
    modules = [path.name for path in begun if path.suffix == ".py"]
    for tool in (["ruff", "check", "--isolated"], ["mypy", "--strict"]):
        command = [sys.executable, "-m", *tool, *modules]
        # As if it were installed from a wheel: mypy does not follow what is installed for editing.
        env = {**os.environ, "PYTHONPATH": str(Path(palpate.__file__).parents[1])}
        done = subprocess.run(
            command, cwd=tmp_path, capture_output=True, text=True, timeout=300, env=env
        )
        assert done.returncode == 0, done.stdout + done.stderr


def test_the_new_node_joins_the_graph_of_its_launch_file(here):
    begun, _ = begin("node", "joins", here)
    graph = describe(begun[2], {}, here / "out").graph
    graph.wirings()
    line = next(line for line in graph.table().splitlines() if line.startswith("/joins "))
    assert line.split()[1:] == ["Joins", "joins", "recorder"]


def test_a_type_of_ones_own_travels_and_is_recorded(here):
    (*_, launch), _ = begin("node", "bends", here)
    command = ["launch", str(launch), "scene:=sphere", "--composed", "--quiet", "--out", "out"]
    budget = ["--set", "planner.most_touches=30", "--set", "bends.least=1.0"]
    assert cli.run([*command, *budget]) in (0, 1)
    from bends import Bends

    told = recorded(here / "out", "/bends", Bends)
    patches = recorded(here / "out", "/touch/patch", SurfacePatch)
    smooth = [patch.k1 for patch in patches if patch.kind == "smooth"]
    assert told[-1].curvature == max(smooth)
    with pytest.raises(ValueError, match="/bends holds Bends, which palpate does not have; name"):
        recorded(here / "out", "/bends")


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
        ("node", "world", "the class World of 'world' has a meaning already"),
        ("node", "tactile_frame", "the class TactileFrame of 'tactile_frame' has a meaning"),
        ("node", "a" * 33, "is too long; a node's name has at most 32 letters"),
        ("effect", "mains-hum", "'mains-hum' cannot name a module"),
        ("effect", "drift", "'drift' is an effect that palpate has"),
        ("effect", "_", "'_' cannot name a module"),
        ("effect", "none", "the class None of 'none' has a meaning already"),
        ("effect", "stage", "the class Stage of 'stage' has a meaning already"),
        ("planner", "fuzzy", "'fuzzy' is a planner that palpate has"),
        ("planner", "height", "the class Height of 'height' has a meaning already"),
        ("planner", "planner_trial", "the class PlannerTrial of 'planner_trial' has a meaning"),
    ],
)
def test_a_bad_name_is_refused(kind, name, words, tmp_path):
    with pytest.raises(InputError, match=words):
        begin(kind, name, tmp_path)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("kind", "there"),
    [
        *(("driver", name) for name in ("mine.py", "test_mine.py", "mine.yaml")),
        *(("planner", name) for name in ("mine.py", "test_mine.py")),
        *(("filter", name) for name in ("mine.py", "mine_steps.py")),
        *(("effect", name) for name in ("mine.py", "test_mine.py")),
    ],
)
def test_nothing_is_overwritten_and_nothing_half_written(kind, there, tmp_path):
    (tmp_path / there).write_text("mine")
    with pytest.raises(InputError, match=rf"{there}: exists already; it is not overwritten"):
        begin(kind, "mine", tmp_path)
    assert [file.name for file in tmp_path.iterdir()] == [there]
    assert (tmp_path / there).read_text() == "mine"


def test_a_folder_that_is_not_there_is_told(tmp_path):
    with pytest.raises(InputError, match=r"mine\.py: cannot be written: there is no folder"):
        begin("effect", "mine", tmp_path / "no")


@pytest.mark.parametrize("kind", KINDS)
def test_every_command_that_the_verb_prints_does_what_it_says(kind, here, capsys):
    assert cli.run(["init", kind, "printed"]) == 0
    told = capsys.readouterr().out
    commands = re.findall(r"python -m .+|palpate (?!in ).+", told)
    assert len(commands) == {"effect": 1, "planner": 1}.get(kind, 3)
    for command in commands:
        program, *words = shlex.split(command)
        if program == "python":
            again = [sys.executable, *words, "-p", "no:cacheprovider"]
            done = subprocess.run(again, capture_output=True, text=True, timeout=300)
            assert done.returncode == 0, done.stdout
        elif words[0] == "launch":
            budget = ["--set", "planner.most_touches=30"] if kind != "driver" else []
            assert cli.run([*words, "--composed", "--quiet", "--out", "d", *budget]) in (0, 1)
        else:
            graph = describe(here / "printed.yaml", {}, here / "out").graph
            assert words[:2] == ["topic", "echo"]
            assert words[2] in graph.topics()


@pytest.mark.parametrize(("kind", "key"), [("effect", "effects"), ("planner", "explore")])
def test_the_lines_that_the_verb_prints_for_a_scene_are_a_scene_s(kind, key, here, capsys):
    assert cli.run(["init", kind, "printed"]) == 0
    lines = capsys.readouterr().out.split(f"{key}:\n")[1]
    scene = here / "scene.yaml"
    ball = "object:\n  superquadric: {size: [0.04, 0.04, 0.04], exponents: [1, 1]}\n"
    scene.write_text(f"{ball}{key}:\n{lines}")
    assert cli.run(["scene", "check", str(scene)]) == 0
    budget = ["--set", "planner.most_touches=30", "--composed", "--quiet", "--out", "d"]
    assert cli.run(["run", str(scene), *budget]) in (0, 1)


@pytest.mark.parametrize("kind", ["node", "driver"])
def test_the_verb_says_what_was_written_and_what_to_do_next(kind, here, capsys):
    assert cli.run(["init", kind, "verbal"]) == 0
    published = capsys.readouterr().out
    assert published.startswith("verbal.py, test_verbal.py, verbal.yaml: written")
    for command in ("python -m pytest test_verbal.py", "palpate launch verbal.yaml"):
        assert command in published
    assert f"palpate topic echo {'/verbal' if kind == 'node' else '/touch/patch'}\n" in published
    assert cli.run(["init", kind, "verbal"]) == 2


def test_a_new_effect_can_be_listed_at_once(write, tmp_path, monkeypatch):
    (path, _), listed = begin("effect", "mains_hum", tmp_path)
    assert (path, listed) == (tmp_path / "mains_hum.py", "mains_hum:MainsHum")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", list(sys.path))
    ball = "object:\n  superquadric: {size: [0.04, 0.04, 0.04], exponents: [1, 1]}\n"
    scene = write("s.yaml", ball + f"effects:\n  - {listed}: {{size: 2.0e-6}}\n")
    assert load_scene(scene).spec.effects == {listed: {"size": 2e-6}}
    assert effect_type(listed).__name__ == "MainsHum"
    assert "emplate" not in path.read_text().replace("the template", "")


def test_a_new_planner_is_found_by_its_name(tmp_path, monkeypatch):
    _, named = begin("planner", "by_bow", tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    assert getattr(make_planner(named, {"most_bow": 2.0}), "most_bow") == 2.0  # noqa: B009
    with pytest.raises(ValueError, match=r"most_bow is 0; expected 0.1 to 100"):
        make_planner(named, {"most_bow": 0.0})


def test_the_test_of_the_template_fails_for_a_planner_that_has_a_length_of_its_own(monkeypatch):
    from palpate.core.explore.planners.protocol import Height, Stop

    class Metres(Template):
        def next(self, observation):
            heights = [observation.low + 0.01 * (i + 1) for i in range(len(observation.slices) + 1)]
            return Height(heights[-1], "on") if heights[-1] < 0.08 else Stop("end")

    monkeypatch.setattr(planner_check, "Template", Metres)
    with pytest.raises(AssertionError):
        planner_check.test_the_plan_in_millimetres_is_the_plan_in_metres()
    with pytest.raises(AssertionError):
        planner_check.test_the_budget_is_kept()
    with pytest.raises(AssertionError):
        planner_check.test_everything_a_pad_can_touch_is_touched()


def test_the_verb_says_what_was_written_and_how_it_is_used(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert cli.run(["init", "planner", "my_planner"]) == 0
    published = capsys.readouterr().out
    assert "python -m pytest test_my_planner.py" in published
    assert published.endswith("explore:\n  planner: my_planner:MyPlanner\n")
    assert cli.run(["init", "planner", "my_planner"]) == 2
    told = "palpate: my_planner.py: exists already; it is not overwritten\n"
    assert capsys.readouterr().err == told


PAGE = (Path(__file__).parents[2] / "docs" / "own_node.md").read_text()
SHELL = [
    line for block in re.findall(r"```sh\n(.*?)```", PAGE, re.DOTALL) for line in block.splitlines()
]
[SNIPPET] = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)


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


def test_the_page_is_short():
    assert len(PAGE.splitlines()) <= 60
    assert len([line for line in SNIPPET.splitlines() if line]) <= 10


def test_the_snippet_tells_normals_and_curvatures(reader, capsys):
    exec(SNIPPET, {})
    *lines, last = capsys.readouterr().out.splitlines()
    assert last == "miss"
    assert len(lines) == 9
    for line in lines:
        found = re.fullmatch(r"k1 (\S+) \+- (\S+), k2 (\S+) \+- (\S+) 1/m, normal \[.+\]", line)
        assert found is not None
        assert found.groups() == ("50.00", "0.00", "50.00", "0.00")


def test_every_command_of_the_page_does_what_it_says(reader):
    for line in SHELL:
        program, *words = shlex.split(line)
        if program == "python":
            command = [sys.executable, *words, "-p", "no:cacheprovider"]
            done = subprocess.run(command, capture_output=True, text=True, timeout=300)
            assert done.returncode == 0, done.stdout
        elif words[0] == "launch":
            # The frames of this test contradict each other, and make no solid.
            code = int("path:=frames.csv" in line)
            assert cli.run([*words, "--composed", "--quiet", "--out", f"{words[1]}.d"]) == code
        elif words[0] == "topic":
            graph = describe(Path("bends.yaml"), {}, reader).graph
            assert words[2] in graph.topics()
        else:
            assert cli.run(words) == 0, line
    assert len(SHELL) == 8


def test_what_the_table_names_is_there():
    import palpate.testing

    named = re.findall(r"`([a-z_]+)\(", PAGE)
    assert {*named} == {*palpate.testing.__all__}


@pytest.mark.slow
def test_a_planner_of_single_touches_explores_without_slices(here):
    assert cli.run(["init", "planner", "--touches", "pokes"]) == 0
    asked = ["--set", "planner.planner=pokes:Pokes", "--touches", "32", "--composed", "--quiet"]
    assert cli.run(["run", "sphere", *asked, "--out", "out"]) in (0, 1)
    found = json.loads((here / "out" / "summary.json").read_text())
    assert (found["contours"], found["touches"], found["method"]) == (1, 32, "general")
    probes = recorded(here / "out", "/probe/traced")
    assert 5 < len(probes) < 32
