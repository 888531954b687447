"""A run directory holds all that its run was made with, and gives the same solid again."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from palpate import launch
from palpate.launch.files.source_map import SourceMapped
from palpate.launch.launch_source import EXPLORE
from palpate.launch.scene import shipped_scenes
from palpate.tools.cli import command_line

FEW = {"planner.most_touches": SourceMapped(24, "--touches"),
       "planner.planner": SourceMapped("uniform", "--set")}  # fmt: skip
OWN_SCENE = """
object:
  mesh: {file: ../elsewhere/mesh.ply, unit: mm}
effects: [my_effect:MyEffect]
explore: {planner: my_planner:MyPlanner}
"""


def solid_of(path, args, settings, out, name):
    given = {key: SourceMapped(value, key) for key, value in args.items()}
    plan = launch.plan_run(path, given, settings, name=name, out=out)
    run = launch.perform(plan, composed=True, display=launch.Display())
    return run.summary["mesh_sha256"], run.summary["seed"], run.summary["touches"]


@pytest.mark.parametrize(
    "scene",
    [one if one == "from_mesh" else pytest.param(one, marks=pytest.mark.slow)
     for one in shipped_scenes()],
)  # fmt: skip
def test_scene_and_launch_file_of_a_run_give_its_solid_again(scene, tmp_path):
    args = {"seed": 11, "record": False}
    first = solid_of(EXPLORE, {**args, "scene": scene}, FEW, tmp_path / "first", scene)
    assert first[0] is not None
    shutil.move(tmp_path / "first", tmp_path / "moved")
    scene_file, launch_file = (tmp_path / "moved" / f"{one}.yaml" for one in ("scene", "launch"))
    again = {"record": False, "scene": str(scene_file)}
    assert solid_of(EXPLORE, again, {}, tmp_path / "again", "again") == first
    assert solid_of(launch_file, {}, {}, tmp_path / "launched", "launched") == first


def test_meshes_and_modules_of_ones_own_go_with_the_run(tmp_path, monkeypatch):
    for folder in ("work/scenes", "work/elsewhere", "other"):
        (tmp_path / folder).mkdir(parents=True)
    monkeypatch.chdir(tmp_path / "work")
    for what in ("effect", "planner"):
        assert command_line.run(["init", what, f"my_{what}"]) == 0
    Path("my_helper.py").write_text("")
    with Path("my_planner.py").open("a") as file:
        file.write("\nimport my_helper\n")
    shutil.copy(launch.SHIPPED_SCENES / "pear.ply", "elsewhere/mesh.ply")
    Path("scenes/s.yaml").write_text(OWN_SCENE)

    def palpate(folder, *told, into=None):
        env = {**os.environ, "PYTHONPATH": str(Path(launch.__file__).parents[2])}
        words = [sys.executable, "-m", "palpate", *told, "--quiet"]
        done = subprocess.run(words, cwd=folder, env=env, capture_output=True, text=True)
        assert done.returncode in (0, 1), done.stderr
        return (launch.read_summary(folder / (into or told[-1])))["mesh_sha256"]

    first = palpate(tmp_path / "work", "run", "scenes/s.yaml", "--touches", "40", "--out", "../run")
    kept = {str(one.relative_to(tmp_path / "run")) for one in (tmp_path / "run/inputs").iterdir()}
    own = ("mesh.ply", "my_effect.py", "my_helper.py", "my_planner.py")
    assert kept == {f"inputs/{name}" for name in own}
    assert not re.search(r"work|elsewhere", (tmp_path / "run/scene.yaml").read_text())
    shutil.rmtree(tmp_path / "work")
    assert first is not None
    assert palpate(tmp_path / "other", "run", "../run/scene.yaml", "--out", "a") == first
    assert palpate(tmp_path / "other", "launch", "../run/launch.yaml", "--out", "b") == first
    (tmp_path / "other/runs").mkdir()
    shutil.move(tmp_path / "run", tmp_path / "other/runs/first")
    (tmp_path / "other/runs/latest").symlink_to("first")  # which is the new run's meanwhile
    latest = "runs/latest"
    assert palpate(tmp_path / "other", "launch", f"{latest}/launch.yaml", into=latest) == first
