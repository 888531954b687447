"""The whole program, as a user starts it: every node a process of its own."""

import json
import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader

from palpate.messages.recording.reader import open_recording

pytestmark = pytest.mark.graph
SECONDS = 300.0  # Beside other work a run of five seconds has taken a minute
EVEN = ("--set", "planner.planner=uniform", "--set", "planner.settings.count=2")
MISSED = 1  # Exit code of a run that leaves most of the object untouched, as two slices do
KILLS = 3
TOYS = Path(__file__).parent / "toys"


def palpate(*arguments, folder):
    command = [sys.executable, "-m", "palpate", *arguments]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=SECONDS)


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """A short exploration of the sphere: its folder and its summary."""
    folder = tmp_path_factory.mktemp("separate")
    done = palpate("run", "sphere", *EVEN, "--quiet", "--out", "run", folder=folder)
    assert done.returncode == MISSED, done.stderr
    assert "untouched gap" in done.stderr and done.stderr.count("\n") == 1
    return folder / "run", json.loads((folder / "run" / "summary.json").read_text())


def test_a_run_loses_nothing_and_leaves_a_closed_solid(run):
    _, summary = run
    assert (summary["status"], summary["gaps"], summary["duplicates"]) == ("finished", 0, 0)
    assert (summary["watertight"], summary["genus"], summary["contours"]) == (True, 0, 2)
    assert summary["chamfer_m"] < 2e-3 * summary["size_m"]
    assert len(summary["curve"]) == 3


def test_it_leaves_everything_that_the_run_directory_promises(run):
    folder, _ = run
    names = {path.name for path in folder.iterdir()}
    meshes = {"mesh.ply", "mesh.stl", "mesh.glb"}
    written = {"model.npz", "topics.mcap", "scene.yaml", "launch.yaml", "summary.json", "log.jsonl"}
    assert names == meshes | written | {"cost.svg", "report.html"}
    with np.load(folder / "model.npz", allow_pickle=False) as model:
        assert model["vertices"].shape[1] == 3


def test_the_stock_reader_opens_the_recording(run):
    folder, summary = run
    with (folder / "topics.mcap").open("rb") as file:
        found = make_reader(file).get_summary()
        assert found is not None and found.statistics is not None
        counts = {
            channel.topic: found.statistics.channel_message_counts[channel.id]
            for channel in found.channels.values()
        }
        assert {channel.message_encoding for channel in found.channels.values()} == {"msgpack"}
        assert {schema.encoding for schema in found.schemas.values()} == {"jsonschema"}
    assert counts["/touch/raw"] == counts["/touch/patch"] == summary["touches"]
    assert counts["/score"] == 3


def test_a_replay_of_filter_and_curvature_is_identical(run, tmp_path):
    folder, _ = run
    bag = str(folder / "topics.mcap")
    done = palpate("replay", bag, "--nodes", "filter,curvature", folder=tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr
    assert [line.split(",")[0] for line in done.stdout.splitlines()] == [
        "filter: identical",
        "curvature: identical",
    ]


def test_unscored_and_unrecorded_in_one_process_it_is_the_same_solid_to_the_last_bit(run, tmp_path):
    words = (str(TOYS / "unscored.yaml"), "scene:=sphere", "record:=false", "--composed", "--quiet")
    out = ("--out", str(tmp_path / "run"))
    done = palpate("launch", *words, *out, folder=TOYS.parent)
    assert done.returncode == MISSED, done.stderr
    summary = json.loads((tmp_path / "run" / "summary.json").read_text())
    assert summary["mesh_sha256"] == run[1]["mesh_sha256"]
    assert not (tmp_path / "run" / "topics.mcap").exists()


def nodes_of(launcher):
    """Processes of the nodes: the launcher's server has forked them."""
    parents = {}
    for folder in Path("/proc").iterdir():
        if folder.name.isdecimal():
            try:
                fields = (folder / "stat").read_text().rpartition(")")[2].split()
            except (FileNotFoundError, ProcessLookupError):
                continue
            if fields[0] != "Z":
                parents[int(folder.name)] = int(fields[1])
    return sorted(pid for pid, parent in parents.items() if parents.get(parent) == launcher)


def kill_some(launcher, seed):
    """Kill nodes at random while it runs; returns how many."""
    rng, killed = random.Random(seed), 0
    while killed < KILLS and launcher.poll() is None:
        time.sleep(rng.uniform(0.2, 0.6))
        nodes = nodes_of(launcher.pid)
        if nodes and launcher.poll() is None:
            os.kill(rng.choice(nodes), signal.SIGKILL)
            killed += 1
    return killed


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux tells who is whose child")
def test_a_run_whose_nodes_are_killed_comes_to_the_same_solid(run, tmp_path):
    out, calm = run
    words = [
        str(TOYS / "unscored.yaml"),
        "scene:=sphere",
        "--quiet",
        "--out",
        str(tmp_path / "run"),
    ]
    command = [sys.executable, "-m", "palpate", "launch", *words]
    process = subprocess.Popen(command, cwd=TOYS.parent, stderr=subprocess.PIPE, text=True)
    try:
        killed = kill_some(process, seed=3)
        _, told = process.communicate(timeout=SECONDS)
    finally:
        process.kill()
        process.communicate()
    assert (process.returncode, killed) == (MISSED, KILLS), told
    harmed = json.loads((tmp_path / "run" / "summary.json").read_text())
    assert harmed["mesh_sha256"] == calm["mesh_sha256"]
    assert (harmed["gaps"], harmed["touches"]) == (0, calm["touches"])
    assert 0 < sum(harmed["restarts"].values()) <= KILLS and calm["restarts"] == {}
    kept, other = (
        {
            (one.topic, one.seq): one.body
            for one in open_recording(path / "topics.mcap").messages()
            if one.topic != "/score"
        }
        for path in (out, tmp_path / "run")
    )
    assert kept == other


@pytest.mark.parametrize("lines", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_a_ctrl_c_ends_everything_and_the_recording_can_be_read(tmp_path, lines, group_is_gone):
    out = tmp_path / "run"
    command = [sys.executable, "-m", "palpate", "run", "sphere", "--out", str(out)]
    process = subprocess.Popen(
        command,
        cwd=tmp_path,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    try:
        assert process.stderr is not None
        while not process.stderr.readline().startswith("ready"):
            pass
        for _ in range(lines - 1):  # one for each score
            assert process.stderr.readline()
        process.send_signal(signal.SIGINT)
        process.stderr.read()
        assert process.wait(timeout=4.0) == 130
    finally:
        process.kill()
        process.wait()
        process.stderr.close()
    assert group_is_gone(process.pid, 1.0)
    assert json.loads((out / "summary.json").read_text())["status"] == "interrupted"
    with (out / "topics.mcap").open("rb") as file:
        assert make_reader(file).get_summary() is not None
