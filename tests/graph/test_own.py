"""Sensors, nodes, message types, effects and procedures of a user's own, in whole graphs."""

from __future__ import annotations

import re
import signal
import socket
import threading
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from palpate.launch.files.mesh_file import read_mesh
from palpate.launch.processes.registry import running_graphs
from palpate.launch.run_directory import read_summary
from palpate.messages.types import SurfacePatch
from palpate.nodes.runtime.testing import assert_same, recorded
from tests.graph.conftest import WITHIN, palpate, started, wait_for

pytestmark = pytest.mark.graph
FLAT = "sensor:={pad: {radius: null}}"
NO_SOLID = 1  # Exit code of a graph whose frames make none
TOUCHES = 12


@pytest.fixture(scope="module")
def frames(tmp_path_factory) -> Path:
    """Touches of ever smaller balls, in one place."""
    side = (np.arange(16) - 7.5) * 1e-3
    x, y = np.meshgrid(side, side)
    rows = [
        [0, 0, 0, 0, 0, 0, 1, *np.maximum(8e-4 - 0.5 * (x**2 + y**2) / radius, 0.0).ravel()]
        for radius in np.linspace(0.03, 0.02, TOUCHES)
    ]
    path = tmp_path_factory.mktemp("driver") / "frames.csv"
    np.savetxt(path, rows, delimiter=",")
    return path


def launched(folder: Path, *words: object, code: int = NO_SOLID) -> Path:
    """The run directory of a graph that has come to its end."""
    out = folder / f"run_{len(list(folder.iterdir()))}"
    done = palpate("launch", *words, "--quiet", "--out", out, folder=folder)
    assert done.code == code, done.err
    assert ("there is no solid" in done.err) == bool(code)
    return out


def patches(run: Path) -> list[tuple[str, Any]]:
    return [("/touch/patch", patch) for patch in recorded(run, "/touch/patch", SurfacePatch)]


@pytest.fixture(scope="module")
def own(frames, tmp_path_factory) -> Path:
    """The run directory of a graph with a node of one's own, whose module lies in its parent."""
    folder = tmp_path_factory.mktemp("own")
    assert palpate("init", "node", "own_bends", folder=folder).code == 0
    text = "include: driver.yaml\nnodes:\n  own_bends:\n    kind: own_bends:NODE\n"
    (folder / "own.yaml").write_text(text)
    return launched(folder, "own.yaml", f"path:={frames}", FLAT, "at_once:=true")


def test_own_type_is_found_by_every_process_and_read_without_its_module(own, monkeypatch, tmp_path):
    monkeypatch.syspath_prepend(str(own.parent))
    from own_bends import OwnBends  # type: ignore[import-not-found]

    touches = [one.touch for one in recorded(own, "/own_bends", OwnBends)]
    assert touches == list(range(TOUCHES))  # each bends more than all before

    def output(*words):
        done = palpate(*words, folder=tmp_path)
        assert done.code == 0, done.err
        return done.out

    about = output("interface", "show", "OwnBends", "--bag", own)
    assert re.search(r"^ +curvature +number +1/m$", about, re.MULTILINE)
    output("bag", "export", own, "--format", "csv", "-o", "t", "--topics", "/own_bends")
    rows = (tmp_path / "t" / "own_bends.csv").read_text().splitlines()
    assert "curvature" in rows[0].split(",") and len(rows) == 1 + TOUCHES
    played = output("bag", "play", own, "--rate", 1000)
    assert played.splitlines()[-1].startswith("played ")


def test_frames_of_file_give_same_patches_at_their_rate(own, frames, tmp_path):
    words = ("driver.yaml", f"path:={frames}", FLAT, "--composed")
    published = patches(launched(tmp_path, *words))
    assert len(published) == TOUCHES
    assert_same(published, patches(own))


def test_connection_gives_the_patches_of_its_lines(own, frames, tmp_path):
    with socket.create_server(("127.0.0.1", 0)) as server:

        def answer():
            peer, _ = server.accept()
            with peer:
                peer.sendall(frames.read_bytes())

        sender = threading.Thread(target=answer, daemon=True)
        sender.start()
        address = f"address:=127.0.0.1:{server.getsockname()[1]}"
        live = launched(tmp_path, "socket_driver.yaml", address, FLAT)
        sender.join(timeout=10)
    assert_same(patches(live), patches(own))


def test_own_driver_ends_with_a_solid_and_its_bound(tmp_path):
    assert palpate("init", "driver", "own_pad", folder=tmp_path).code == 0
    fast = ("--set", "own_pad.rate=1000", "--set", "reconstructor.quality=draft")
    run = launched(tmp_path, "own_pad.yaml", *fast, code=0)
    summary = read_summary(run)
    assert (run / "mesh.stl").is_file() and summary["touches"] == 60
    assert summary["rms_bound_95_m"] < 5e-5 and summary["open_share"] == 0.0
    vertices = read_mesh(run / "mesh.ply", "m")[0]
    assert np.linalg.norm(vertices, axis=1) == pytest.approx(0.02, abs=1e-4)


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "shown"), [("node", r"^curvature: \d"), ("driver", r"^k1: ")])
def test_commands_that_init_prints_show_the_running_graph(kind, shown, tmp_path):
    work, elsewhere = tmp_path / "work", tmp_path / "elsewhere"
    work.mkdir()
    elsewhere.mkdir()
    printed = palpate("init", kind, f"live_{kind}", folder=work).out
    launch, echo = re.findall(r"palpate ((?:launch|topic) .+)", printed)
    with started(*launch.split(), "--quiet", folder=work) as graph:
        wait_for(running_graphs)
        assert re.search(
            shown, palpate(*echo.split(), "--once", folder=elsewhere).out, re.MULTILINE
        )
        if kind == "node":
            name = palpate("interface", "show", "LiveNode", folder=elsewhere).out
            about = palpate("topic", "info", "-v", "/live_node", folder=elsewhere).out
            for text in (name, about):
                assert re.search(r"^ +curvature +number +1/m$", text, re.MULTILINE)
        graph.send_signal(signal.SIGINT)
        graph.communicate(timeout=WITHIN)
    assert graph.returncode == 130


@pytest.mark.slow
def test_example_frames_become_a_ring_whose_gaps_are_found(tmp_path):
    example = Path(__file__).parents[2] / "examples" / "frames.csv"
    words = (f"path:={example}", "scale:=0.001", "platform:=0", "at_once:=true")
    draft = ("--set", "reconstructor.quality=draft")
    run = launched(tmp_path, "driver.yaml", *words, *draft, code=0)
    summary = read_summary(run)
    places, normals = np.array(summary["open_places_m"]), np.array(summary["open_normals"])
    assert summary["touches"] == 200 and 0.05 < summary["open_share"] < 0.12 and len(places) > 2
    outward = places - 0.062 * places / np.linalg.norm(places[:, :2], axis=1)[:, None]
    outward[:, 2] = places[:, 2] - 0.021
    assert (np.einsum("ni,ni->n", outward, normals) > 0.0).all()
    vertices = read_mesh(run / "mesh.ply", "m")[0]
    vertices = vertices[vertices[:, 2] > 1e-6]  # where it stands it is cut off
    off = np.hypot(np.linalg.norm(vertices[:, :2], axis=1) - 0.062, vertices[:, 2] - 0.021) - 0.021
    assert np.sqrt(np.mean(off**2)) < summary["rms_bound_95_m"] < 2e-4


OBJECT = """
object:
  superquadric: {size: [0.03, 0.026, 0.04], exponents: [0.8, 0.9]}
  pose: {position: [0.0, 0.0, 0.04]}
seed: 5
explore: {planner: uniform, settings: {count: 3}}
"""
DISTURBED = """effects:
  - hum:Hum: {size: 2.0e-6}
  - transport: {drop: 0.1, duplicate: 0.2}
  - salt_and_pepper
  - drift
  - creep
  - pose_error
"""
DYING = """
from dataclasses import dataclass
from typing import Annotated, ClassVar
import numpy as np
from palpate.core.plugins import Range, Ranged
from palpate.core.touch import Phase, Stage

@dataclass(frozen=True, kw_only=True)
class Dying(Ranged):
    phase: ClassVar = Phase.SIGNAL
    after: Annotated[int, Range(0, 10_000, "1")] = 20

    def prepare(self, finger):
        def apply(touch, state):
            if touch.number >= self.after:
                touch.reading = np.zeros_like(touch.reading)
        return Stage(apply)
"""


def explored(folder: Path, out: str, *flags: object) -> dict[str, Any]:
    draft = ("--set", "reconstructor.quality=draft")
    words = ("run", "scene.yaml", "--quiet", "--out", out, *draft, *flags)
    done = palpate(*words, folder=folder)
    assert done.code == 1, done.err  # three slices do not reach the tolerance
    return read_summary(folder / out) | {"stderr": done.err}


@pytest.mark.slow
def test_disturbed_run_is_the_same_in_one_process_and_is_replayed(tmp_path):
    assert palpate("init", "effect", "hum", folder=tmp_path).code == 0
    (tmp_path / "scene.yaml").write_text(OBJECT + DISTURBED)
    many = explored(tmp_path, "many")
    composed = explored(tmp_path, "one", "--composed", "--no-record")
    assert many["mesh_sha256"] == composed["mesh_sha256"]
    assert (many["status"], many["gaps"]) == ("finished", 0)
    assert many["chamfer_m"] < 0.01 * many["size_m"]
    nodes = ("--nodes", "simulator,filter,curvature")
    replayed = palpate("replay", "many/topics.mcap", *nodes, folder=tmp_path)
    assert replayed.code == 0 and replayed.out.count("identical") == 3
    other = explored(tmp_path, "other", "--composed", "--no-record", "--seed", 6)
    assert other["mesh_sha256"] != composed["mesh_sha256"]


@pytest.mark.slow
def test_dying_sensor_ends_the_run_with_what_was_known(tmp_path):
    (tmp_path / "dying.py").write_text(DYING)
    (tmp_path / "scene.yaml").write_text(OBJECT + "effects: ['dying:Dying']\n")
    result = explored(tmp_path, "out", "--composed", "--no-record")
    assert "the sensor of finger 1 failed: the pad was pressed and no taxel" in result["stderr"]
    assert (tmp_path / "out" / "mesh.ply").exists()
