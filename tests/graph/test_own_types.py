"""What init prints is run as printed; a type of one's own is read where its module is not."""

import os
import re
import subprocess
import sys
import time

import pytest

from palpate.launch.processes.registry import running_graphs

pytestmark = [pytest.mark.graph, pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")]
WITHIN = 120.0  # A deadline that only a broken graph misses, s


@pytest.fixture(scope="module")
def elsewhere(tmp_path_factory):
    """A folder from which the module cannot be imported; its graphs are the only ones."""
    return tmp_path_factory.mktemp("elsewhere")


def palpate(words, folder, home):
    """A command of a shell in some folder; what it prints is to be read."""
    return subprocess.Popen(
        [sys.executable, "-m", "palpate", *words.split()],
        cwd=folder,
        env={**os.environ, "XDG_RUNTIME_DIR": str(home)},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )


def output(words, folder, home):
    with palpate(words, folder, home) as process:
        told, _ = process.communicate(timeout=WITHIN)
    assert process.returncode == 0, told
    return told


def begun(kind, folder, home):
    """The commands that init prints: to launch, and to look from another terminal."""
    told = output(f"init {kind} mine", folder, home)
    return re.findall(r"palpate ((?:launch|topic) .+)", told)


def wait_for_graph(home):
    deadline = time.monotonic() + WITHIN
    while not running_graphs(home):
        assert time.monotonic() < deadline, "no graph came up"
        time.sleep(0.05)


def test_a_type_of_one_s_own_is_read_in_a_running_graph_and_in_its_recording(tmp_path, elsewhere):
    launch, echo = begun("node", tmp_path, elsewhere)
    with palpate(f"{launch} --out run", tmp_path, elsewhere) as graph:
        wait_for_graph(elsewhere)
        with palpate(echo, elsewhere, elsewhere) as tool:
            shown = output("interface show Mine", elsewhere, elsewhere)
            about = output("topic info -v /mine", elsewhere, elsewhere)
            told, _ = tool.communicate(timeout=WITHIN)
        graph.communicate(timeout=WITHIN)
    assert (tool.returncode, graph.returncode) == (0, 0)
    assert re.search(r"^curvature: \d", told, re.MULTILINE)
    kept = output(f"interface show Mine --bag {tmp_path / 'run'}", elsewhere, elsewhere)
    for text in (shown, about, kept):
        assert re.search(r"^ +curvature +number +1/m$", text, re.MULTILINE)
    output(f"bag export {tmp_path / 'run'} --format csv -o t --topics /mine", elsewhere, elsewhere)
    rows = (elsewhere / "t" / "mine.csv").read_text().splitlines()
    assert "curvature" in rows[0].split(",")
    assert len(rows) > 1
    played = output(f"bag play {tmp_path / 'run'} --rate 1000", elsewhere, elsewhere)
    assert played.splitlines()[-1].startswith("played ")


def test_what_a_driver_publishes_is_looked_at_as_printed(tmp_path, elsewhere):
    launch, echo = begun("driver", tmp_path, elsewhere)
    with palpate(launch, tmp_path, elsewhere) as graph:
        wait_for_graph(elsewhere)
        told = output(echo, elsewhere, elsewhere)
        graph.communicate(timeout=WITHIN)
    assert graph.returncode in (0, 1)
    assert re.search(r"^k1: ", told, re.MULTILINE)
