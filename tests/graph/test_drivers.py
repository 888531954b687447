"""A sensor of one's own in the simulator's place, and a node of one's own beside it."""

import socket
import subprocess
import sys
import threading

import numpy as np
import pytest

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


def launched(folder, *words):
    """The run directory of a graph that has come to its end."""
    out = folder / f"run_{len(list(folder.iterdir()))}"
    command = [sys.executable, "-m", "palpate", "launch", *words, "--quiet", "--out", str(out)]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
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
