import dataclasses
import json
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from palpate.launch.files.source_map import InputError, SourceMapped
from palpate.launch.graph import read_settings
from palpate.launch.launch_source import EXPLORE
from palpate.launch.progress import Display
from palpate.launch.run import perform, plan_run
from palpate.messages.types.model import Score, ShapeModel
from palpate.messages.types.motion import Contour
from palpate.nodes.runtime.node import Finished, Node

LAUNCH = """
args: {seed: 5, maker: t.maker}
nodes:
  maker: {kind: $(maker)}
  judge: {kind: t.judge}
ends: judge
"""


@pytest.fixture
def launch_file(make_node, write, tmp_path, monkeypatch, tetrahedron, contour, score):
    """A graph of two nodes: one makes a contour and a model, the other scores it and ends."""
    monkeypatch.chdir(tmp_path)
    make_node("t.maker")
    make_node("t.judge")
    import sys

    params = sys.modules["t.maker"].NODE.params
    outputs = {"/contour/traced": Contour, "/model/shape": ShapeModel}
    messages = [("/contour/traced", contour), ("/model/shape", tetrahedron)]

    def judge(_, state, message):
        return state, [("/score", score), Finished("scored")]

    def fail(*_):
        raise ValueError("the finger fell off")

    maker = Node(params=params, start=lambda _: (None, messages), inputs={}, outputs=outputs)
    make_node("t.maker", value=maker)
    make_node("t.broken", value=dataclasses.replace(maker, start=fail))
    make_node(
        "t.judge",
        value=Node(
            params=params,
            start=lambda _: (None, []),
            inputs={"/model/shape": (ShapeModel, judge)},
            outputs={"/score": Score},
        ),
    )
    return write("f.yaml", LAUNCH)


def start(path, **args):
    located = {name: SourceMapped(value, name) for name, value in args.items()}
    plan = plan_run(path, located, {}, name="toy", out=Path("here"))
    assert not Path("here").exists()
    return perform(plan, composed=True, display=Display())


def test_a_run_leaves_its_results_and_what_was_run_in_its_directory(launch_file):
    run = start(launch_file)
    assert run.exit_code == 0
    names = {path.name for path in run.folder.iterdir()}
    assert names == {
        "cost.svg", "launch.yaml", "log.jsonl", "mesh.glb", "mesh.ply", "mesh.stl", "model.npz",
        "summary.json",
    }  # fmt: skip
    summary = json.loads((run.folder / "summary.json").read_text())
    assert summary == run.summary
    assert (summary["status"], summary["reason"], summary["seed"]) == ("finished", "scored", 5)
    assert (summary["contours"], summary["touches"]) == (1, 30)
    assert summary["chamfer_m"] == 0.0003
    assert set(summary["nodes"]) == {"maker", "judge"}
    assert run.model is not None
    np.testing.assert_array_equal(run.model.vertices.shape, (4, 3))
    assert "here/mesh.glb" in run.text and "mesh.stl" in run.details
    text = (run.folder / "launch.yaml").read_text()
    assert "kind: t.maker" in text
    assert "ends: judge" in text
    assert "$(" not in text


def test_a_node_that_fails_ends_the_run_with_3_and_its_name(launch_file):
    run = start(launch_file, maker="t.broken")
    assert run.exit_code == 3
    assert "maker" in run.summary["reason"]
    assert "the finger fell off" in run.summary["reason"]
    assert run.summary["chamfer_m"] is None


def test_a_plan_that_is_refused_leaves_no_trace(launch_file, tmp_path):
    before = sorted(tmp_path.iterdir())
    with pytest.raises(InputError, match="there is no node 'makre'; did you mean 'maker'"):
        plan_run(launch_file, {}, read_settings(["makre.x=1"]), name="toy")
    assert sorted(tmp_path.iterdir()) == before


BALL = "object:\n  superquadric: {size: [0.03, 0.03, 0.03], exponents: [1, 1]}\n"


def planned(folder, text, fingers=1, **settings):
    scene = folder / "s.yaml"
    scene.write_text(BALL + text)
    args = {"scene": SourceMapped(str(scene), "scene"), "fingers": SourceMapped(fingers, "fingers")}
    laid = {
        f"planner.{key}": SourceMapped(value, f"--set {key}") for key, value in settings.items()
    }
    plan_run(EXPLORE, args, laid, name="s", out=folder / "run")


def test_a_demand_that_can_be_met_passes_and_a_setting_is_named_as_such(tmp_path):
    planned(tmp_path, "explore: {tolerance: 0.1e-3}\n", fingers=2)
    with pytest.raises(InputError, match="--set tolerance: tolerance is 1e-06 m"):
        planned(tmp_path, "", tolerance=1e-6)


@pytest.mark.parametrize(("text", "fingers", "words"), [
    ("explore:\n  tolerance: 5.0e-6\n", 1,
     "s.yaml:4: tolerance is 5e-06 m; it must be at least what the sensor can tell, 1e-05 m"),
    ("effects:\n  - gaussian_noise: {sigma: 50.0e-6}\nexplore:\n  tolerance: 40.0e-6\n", 1,
     "s.yaml:6: tolerance is 4e-05 m; it must be at least what the sensor can tell, 5e-05 m"),
    ("explore:\n  planner: uniform\n  settings:\n    count: 2\n", 3,
     "s.yaml:6: count is 2, but there are 3 fingers; a finger would have nothing to do"),
    ("", 4, "fingers is 4, but an object of 0.06 m has room for 3, 0.024 m apart"),
])  # fmt: skip
def test_a_demand_that_cannot_be_met_is_refused_in_its_place(tmp_path, text, fingers, words):
    with pytest.raises(InputError, match=re.escape(words)):
        planned(tmp_path, text, fingers)
    assert [path.name for path in tmp_path.iterdir()] == ["s.yaml"]


def test_to_plan_a_run_and_to_write_its_solid_scipy_and_trimesh_are_not_imported(tmp_path):
    script = f"""
import sys
from pathlib import Path
from palpate import launch
from palpate.launch.files import SourceMapped, write_mesh
from palpate.tools.exploration import perform_and_print
args = {{"scene": SourceMapped(str(launch.find_scene("egg")), "")}}
launch.plan_run(launch.EXPLORE, args, {{}}, name="egg", out=Path({str(tmp_path / "run")!r}))
import numpy as np
corners = np.eye(4)[:, :3]
for kind in ("ply", "stl", "glb"):
    write_mesh(Path({str(tmp_path)!r}) / f"mesh.{{kind}}", corners, np.array([[0, 1, 2]]))
print(sorted({{"scipy", "trimesh", "rich", "matplotlib"}} & set(sys.modules)))
"""
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    assert (done.stdout, done.stderr) == ("[]\n", "")
