"""A sensor of one's own in the simulator's place, and a node of one's own beside it."""

import json
import socket
import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
import pytest

from palpate.launch.files import read_mesh
from palpate.messages.types.touch import SurfacePatch
from palpate.nodes.runtime.testing import assert_same, recorded
from palpate.tools.init import begin

pytestmark = pytest.mark.graph
FLAT = "sensor:={pad: {radius: null}}"


@pytest.fixture(scope="module")
def frames(tmp_path_factory):
    """Twelve touches of ever smaller balls."""
    side = (np.arange(16) - 7.5) * 1e-3
    x, y = np.meshgrid(side, side)
    rows = [
        [0, 0, 0, 0, 0, 0, 1, *np.maximum(8e-4 - 0.5 * (x**2 + y**2) / radius, 0.0).ravel()]
        for radius in np.linspace(0.03, 0.02, 12)
    ]
    path = tmp_path_factory.mktemp("driver") / "frames.csv"
    np.savetxt(path, rows, delimiter=",")
    return path


@pytest.fixture(scope="module")
def filed(frames):
    """The patches of the file, read at once."""
    words = ("driver.yaml", f"path:={frames}", FLAT, "at_once:=true")
    return patches(launched(frames.parent, *words))


def launched(folder, *words, code=1):
    """The run directory of a graph that has come to its end, with a solid if the code is 0."""
    out = folder / f"run_{len(list(folder.iterdir()))}"
    command = [sys.executable, "-m", "palpate", "launch", *words, "--quiet", "--out", str(out)]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=300)
    # Frames of so many balls in one place make no solid, which is told in a sentence.
    assert done.returncode == code, done.stderr
    assert ("there is no solid" in done.stderr) == bool(code)
    return out


def patches(run):
    return [("/touch/patch", patch) for patch in recorded(run, "/touch/patch", SurfacePatch)]


def test_a_file_of_frames_gives_the_same_patches_at_its_rate_and_in_one_process(
    frames, filed, tmp_path
):
    words = ("driver.yaml", f"path:={frames}", FLAT, "--composed")
    assert len(filed) == 12
    assert_same(filed, patches(launched(tmp_path, *words)))


def test_a_connection_gives_the_patches_of_its_lines(frames, filed, tmp_path):
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
    assert_same(patches(live), filed)


def test_a_node_of_ones_own_and_its_type_are_found_by_every_process(frames, tmp_path, monkeypatch):
    begin("node", "own_bends", tmp_path)
    (tmp_path / "own.yaml").write_text(
        "include: driver.yaml\nnodes:\n  own_bends:\n    kind: own_bends:NODE\n"
    )
    run = launched(tmp_path, "own.yaml", f"path:={frames}", FLAT, "at_once:=true")
    monkeypatch.syspath_prepend(str(tmp_path))
    from own_bends import OwnBends  # type: ignore[import-not-found]

    assert [one.touch for one in recorded(run, "/own_bends", OwnBends)] == list(range(12))


def summary(run):
    return json.loads((run / "summary.json").read_text())


def test_a_driver_of_ones_own_ends_with_a_solid_and_its_bound(tmp_path):
    begin("driver", "own_pad", tmp_path)
    run = launched(tmp_path, "own_pad.yaml", code=0)
    found = summary(run)
    assert (run / "mesh.stl").is_file() and found["touches"] == 60
    assert found["rms_bound_95_m"] < 5e-5 and found["open_share"] == 0.0


@pytest.mark.slow
def test_the_example_becomes_a_ring_whose_missing_touches_are_told(tmp_path):
    example = Path(__file__).parents[2] / "examples" / "frames.csv"
    words = (f"path:={example}", "scale:=0.001", "platform:=0", "at_once:=true")
    run = launched(tmp_path, "driver.yaml", *words)
    found = summary(run)
    places, normals = np.array(found["open_places_m"]), np.array(found["open_normals"])
    assert found["touches"] == 200 and 0.05 < found["open_share"] < 0.12 and len(places) > 2
    outward = places - 0.062 * places / np.linalg.norm(places[:, :2], axis=1)[:, None]
    outward[:, 2] = places[:, 2] - 0.021
    assert (np.einsum("ni,ni->n", outward, normals) > 0.0).all()
    mesh = read_mesh(run / "mesh.ply", "m")
    vertices = mesh[0][mesh[0][:, 2] > 1e-6]  # where it stands it is cut off
    off = np.hypot(np.linalg.norm(vertices[:, :2], axis=1) - 0.062, vertices[:, 2] - 0.021) - 0.021
    assert np.sqrt(np.mean(off**2)) < found["rms_bound_95_m"] < 2e-4
