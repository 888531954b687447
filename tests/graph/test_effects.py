"""Effects in the whole program: one's own among them, in processes of their own or composed."""

import json
import subprocess
import sys
from typing import Any

import pytest

pytestmark = pytest.mark.graph
SECONDS = 300.0  # Beside other work a run of five seconds has taken a minute
SCENE = """
object:
  superquadric: {size: [0.03, 0.026, 0.04], exponents: [0.8, 0.9]}
  pose: {position: [0.0, 0.0, 0.04]}
effects:
  - hum:Hum: {size: 2.0e-6}
  - transport: {drop: 0.1, duplicate: 0.2}
  - salt_and_pepper
  - drift
  - creep
  - pose_error
explore: {planner: uniform, settings: {count: 3}}
seed: 5
"""


def palpate(*arguments, folder):
    command = [sys.executable, "-m", "palpate", *arguments]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=SECONDS)


@pytest.fixture(scope="module")
def lab(tmp_path_factory):
    """A folder with an effect of one's own, and a scene that lists it."""
    folder = tmp_path_factory.mktemp("lab")
    assert palpate("init", "effect", "hum", folder=folder).returncode == 0
    (folder / "scene.yaml").write_text(SCENE)
    return folder


def explored(lab, name, *flags):
    done = palpate("run", "scene.yaml", "--quiet", "--out", name, *flags, folder=lab)
    assert done.returncode == 1, done.stderr  # three even slices do not reach the tolerance
    assert "the tolerance was not reached" in done.stderr
    summary: dict[str, Any] = json.loads((lab / name / "summary.json").read_text())
    return summary


@pytest.mark.slow
def test_a_disturbed_run_is_the_same_in_one_process_and_in_many_and_can_be_replayed(lab):
    separate, composed = explored(lab, "many"), explored(lab, "one", "--composed")
    assert separate["mesh_sha256"] == composed["mesh_sha256"]
    assert (separate["status"], separate["gaps"]) == ("finished", 0)
    assert separate["chamfer_m"] < 0.01 * separate["size_m"]
    nodes = "simulator,filter,curvature"
    replayed = palpate("replay", "many/topics.mcap", "--nodes", nodes, folder=lab)
    assert replayed.returncode == 0, replayed.stdout + replayed.stderr
    assert replayed.stdout.count("identical") == 3


@pytest.mark.slow
def test_another_seed_is_another_sensor(lab):
    few = ("--composed", "--no-record", "--set", "planner.most_touches=60")
    hashes = {explored(lab, f"s{n}", *few, "--seed", n)["mesh_sha256"] for n in "12"}
    assert len(hashes) == 2


DYING = """
from dataclasses import dataclass
from typing import Annotated, ClassVar
import numpy as np
from palpate.core.plugins import Range, Ranged
from palpate.core.touch import Phase, Stage

@dataclass(frozen=True, kw_only=True)
class Dying(Ranged):
    phase: ClassVar = Phase.SIGNAL
    after: Annotated[int, Range(0, 10_000, "1")] = 40
    reading: Annotated[float, Range(-1.0, 1.0, "m")] = 0.0

    def prepare(self, finger):
        def apply(touch, state):
            if touch.number >= self.after:
                touch.reading = np.full_like(touch.reading, self.reading)
        return Stage(apply)
"""


def test_a_sensor_that_dies_ends_the_run_with_what_was_known(tmp_path):
    (tmp_path / "dying.py").write_text(DYING)
    scene = SCENE.partition("effects:")[0]
    scene += "effects:\n  - dying:Dying: {after: 30}\nexplore: {planner: touches}\n"
    (tmp_path / "scene.yaml").write_text(scene)
    given = ("run", "scene.yaml", "--quiet", "--composed", "--no-record", "--out", "out")
    done = palpate(*given, folder=tmp_path)
    assert done.returncode == 1, done.stderr
    assert "the sensor of finger 1 failed: the pad was pressed and no taxel" in done.stderr
    assert (tmp_path / "out" / "mesh.ply").exists()
