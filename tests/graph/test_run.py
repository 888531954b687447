"""One exploration as a user starts it, asked all that is promised of a run and of a view of it."""

from __future__ import annotations

import json
import os
import re
import signal
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
import pytest

from palpate.launch.launch_source import EXPLORE
from palpate.launch.processes.registry import running_graphs
from palpate.launch.run_directory import read_summary
from palpate.launch.scene import SHIPPED_SCENES
from palpate.messages.recording import open_recording
from palpate.tools.view.live import show_graph
from palpate.tools.view.timeline import Timeline, read_timeline
from tests.graph.conftest import FEW, Harm, finished, in_group, palpate, started, wait_for

pytestmark = pytest.mark.graph
MISSED = 1  # Exit code of a run that leaves most of the object untouched


class Explored(NamedTuple):
    folder: Path
    summary: dict[str, Any]
    err: str
    seen: Timeline


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Explored:
    """A short exploration of the sphere by processes, with a view of the running graph."""
    folder, seen = tmp_path_factory.mktemp("separate"), Timeline()
    settings = [word for key, value in FEW.items() for word in ("--set", f"{key}={value}")]
    view: Any = SimpleNamespace(
        add=lambda messages: [seen.add(one) for one in messages], pass_time=lambda _: None
    )
    command = ("run", "sphere", *settings, "--quiet", "--out", "run")
    with started(*command, folder=folder) as process:
        card = wait_for(running_graphs)[0]
        assert show_graph(view, card, lambda: False)
        _, err = process.communicate()
    assert process.returncode == MISSED, err
    return Explored(folder / "run", read_summary(folder / "run"), err, seen)


def test_run_loses_nothing_and_leaves_closed_solid_and_all_that_is_promised(run):
    summary = run.summary
    assert (summary["status"], summary["gaps"], summary["duplicates"]) == ("finished", 0, 0)
    assert (summary["watertight"], summary["genus"]) == (True, 0)
    assert (summary["touches"], summary["restarts"]) == (24, {})
    assert summary["chamfer_m"] < 0.02 * summary["size_m"]
    assert "untouched gap" in run.err and run.err.count("\n") == 1
    counts = open_recording(run.folder / "topics.mcap").counts
    assert counts["/touch/raw"] == counts["/touch/patch"] == summary["touches"]
    assert counts["/score"] == len(summary["curve"])
    meshes = {"mesh.ply", "mesh.stl", "mesh.glb"}
    written = {"model.npz", "topics.mcap", "scene.yaml", "launch.yaml", "summary.json", "log.jsonl"}
    names = {path.name for path in run.folder.iterdir()}
    assert names == meshes | written | {"cost.svg", "report.html"}
    with np.load(run.folder / "model.npz", allow_pickle=False) as model:
        assert model["vertices"].shape[1] == 3


def test_replay_of_nodes_is_identical(run):
    done = palpate("replay", run.folder / "topics.mcap", "--nodes", "filter,curvature")
    assert done.code == 0, done.out + done.err
    verdicts = [line.split(",")[0] for line in done.out.splitlines()]
    assert verdicts == ["filter: identical", "curvature: identical"]


def test_view_of_running_graph_sees_what_its_recording_holds(run):
    recorded = read_timeline(run.folder)
    for kind in ("touches", "contours", "models", "grasps"):
        assert len(getattr(run.seen, kind)) == len(getattr(recorded, kind))
    assert [one.time for one in run.seen.touches] == [one.time for one in recorded.touches]
    assert run.seen.scores.keys() == recorded.scores.keys()
    assert run.seen.truth is not None and run.seen.done is not None


@pytest.mark.slow
def test_launch_file_of_run_gives_its_solid_again_in_one_process(run, tmp_path):
    done = finished(run.folder / "launch.yaml", tmp_path / "run", {}, {}, composed=True)
    assert done.exit_code == MISSED
    assert done.summary["mesh_sha256"] == run.summary["mesh_sha256"]


@pytest.mark.slow
def test_nodes_killed_at_random_moments_change_nothing(run, tmp_path):
    harm = Harm(["", "", ""], seed=3)
    args = {"scene": "sphere"}
    done = finished(EXPLORE, tmp_path / "run", args, FEW, composed=False)
    assert harm.count == 3 and 0 < sum(done.summary["restarts"].values()) <= 3
    assert done.summary["mesh_sha256"] == run.summary["mesh_sha256"]
    kept, other = (
        {(one.topic, one.seq): one.body for one in open_recording(bag / "topics.mcap").messages()}
        for bag in (run.folder, tmp_path / "run")
    )
    assert kept == other


@pytest.mark.parametrize(
    ("words", "scores"),
    [
        (("launch", "fingers.yaml", "fingers:=1"), 0),
        pytest.param(("run", "sphere", "--view"), 1, marks=pytest.mark.slow),
    ],
)
def test_ctrl_c_ends_run_and_leaves_readable_recording(words, scores, tmp_path):
    out = tmp_path / "run"
    process = started(*words, "--out", out, start_new_session=True)
    assert process.stderr is not None
    with process:
        if "--view" in words:  # its address comes first
            assert process.stderr.readline().startswith("view  http://127.0.0.1:")
        while not process.stderr.readline().startswith("ready"):
            pass
        for _ in range(scores):  # one line for each
            assert process.stderr.readline()
        process.send_signal(signal.SIGINT)
        process.communicate(timeout=10.0)
    assert process.returncode == 130
    wait_for(lambda: not in_group(process.pid))
    assert json.loads((out / "summary.json").read_text())["status"] == "interrupted"
    assert open_recording(out / "topics.mcap").closed


OWN_SCENE = """
object:
  mesh: {file: ../elsewhere/mesh.ply, unit: mm}
effects: [my_effect:MyEffect]
explore: {planner: my_planner:MyPlanner}
"""


@pytest.mark.slow
@pytest.mark.parametrize("scene", ["from_mesh", "amphora", "worn_sensor"])
def test_scene_file_of_run_gives_its_solid_again_unrecorded(scene, tmp_path):
    def solid(name, args, settings):
        args |= {"record": False}
        done = finished(EXPLORE, tmp_path / name, args, settings, composed=True)
        assert not (tmp_path / name / "topics.mcap").exists()
        return [done.summary[key] for key in ("mesh_sha256", "seed", "touches")]

    draft = {"reconstructor.quality": "draft"}
    three = {"planner.planner": "uniform", "planner.settings.count": 3, **draft}
    first = solid("first", {"scene": scene, "seed": 11}, three)
    assert first[0] is not None
    moved = (tmp_path / "first").rename(tmp_path / "moved") / "scene.yaml"
    assert solid("again", {"scene": str(moved)}, draft) == first


@pytest.mark.slow
def test_meshes_and_modules_of_ones_own_go_with_the_run(here):
    work, other, out = (here / name for name in ("work", "other", "run"))
    for folder in (work / "scenes", work / "elsewhere", other / "runs"):
        folder.mkdir(parents=True)
    for what in ("effect", "planner"):
        assert palpate("init", what, f"my_{what}", folder=work).code == 0
    (work / "my_helper.py").touch()
    with (work / "my_planner.py").open("a") as file:
        file.write("\nimport my_helper\n")
    mesh = (SHIPPED_SCENES / "pear.ply").read_bytes()
    (work / "elsewhere" / "mesh.ply").write_bytes(mesh)
    (work / "scenes" / "s.yaml").write_text(OWN_SCENE)

    own = {"mesh.ply", "my_effect.py", "my_helper.py", "my_planner.py"}

    def solid(folder, *words, into):
        for name in own:  # as in a process of its own
            sys.modules.pop(name.removesuffix(".py"), None)
        done = palpate(*words, "--quiet", folder=folder)
        assert done.code in (0, 1), done.err
        return read_summary(folder / into)["mesh_sha256"]

    few = ("--touches", 30, "--set", "reconstructor.quality=draft")
    first = solid(work, "run", "scenes/s.yaml", *few, "--out", "../run", into="../run")
    assert first is not None
    assert {one.name for one in (out / "inputs").iterdir()} == own
    assert not re.search(r"work|elsewhere", (out / "scene.yaml").read_text())
    work.rename(here / "gone")
    assert solid(other, "launch", "../run/launch.yaml", "--out", "b", into="b") == first
    out.rename(other / "runs" / "first")
    os.symlink("first", other / "runs" / "latest")  # which is the new run's meanwhile
    again = solid(other, "launch", "runs/latest/launch.yaml", into="runs/latest")
    assert again == first
