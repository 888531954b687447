"""A view beside a running graph: it never holds it up, and leaves nothing behind."""

from __future__ import annotations

import signal
import subprocess
import sys

import psutil
import pytest

from palpate.launch.processes.registry import running_graphs
from palpate.tools.view.beside import ViewProcess
from tests.graph.conftest import FINGERS, WITHIN, in_group, palpate, started, wait_for

pytestmark = [pytest.mark.graph, pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")]
BESIDE = """
import sys
from functools import partial
from pathlib import Path
from palpate.tools.view.beside import ViewProcess
say, told = partial(print, flush=True), []
with ViewProcess(Path(sys.argv[1]), told.append) as beside:
    say(told[0])
    beside.stay(say)
"""


@pytest.mark.slow
def test_stopped_view_changes_nothing_for_the_graph(explored, tmp_path):
    lines: list[str] = []
    before = psutil.Process().children()
    with ViewProcess(tmp_path / "run", lines.append):
        assert lines[0].startswith("view  http://127.0.0.1:")
        [view] = {*psutil.Process().children()} - {*before}
        files = view.num_fds()
        words = ("launch", FINGERS, "fingers:=2", "--quiet", "--out", tmp_path / "run")
        with started(*words) as run:
            card = wait_for(running_graphs)[0]
            wait_for(lambda: view.num_fds() > files + len(card.nodes))  # it has attached
            view.suspend()
            run.communicate(timeout=WITHIN)
    assert run.returncode == 0
    assert view not in psutil.Process().children()
    difference = palpate("bag", "diff", explored(2), tmp_path / "run")
    assert difference.code == 0, difference.out


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGKILL])
def test_view_beside_run_ends_with_the_process_that_started_it(number, tmp_path):
    command = [sys.executable, "-c", BESIDE, str(tmp_path / "run")]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as parent:
        assert parent.stdout is not None
        address, stays = (parent.stdout.readline().rstrip() for _ in range(2))
        assert stays == f"view stays at {address.removeprefix('view  ')}; Ctrl-C ends it"
        [view] = psutil.Process(parent.pid).children()
        parent.send_signal(number)
        assert parent.wait(WITHIN) == (0 if number == signal.SIGINT else -number)
    wait_for(lambda: not in_group(view.pid))  # of its own


@pytest.mark.slow
def test_ctrl_c_ends_view_without_fault(explored):
    with started("view", explored(1), "--port", 8490) as process:
        assert process.stdout is not None
        line = process.stdout.readline()
        process.send_signal(signal.SIGINT)
        rest, error = process.communicate(timeout=WITHIN)
    assert line.startswith("view  http://127.0.0.1:84")
    assert line.endswith("  (Ctrl-C ends it)\n")
    assert (process.returncode, rest, error) == (0, "", "")


def test_view_of_composed_nodes_is_refused(tmp_path):
    done = palpate("run", "sphere", "--composed", "--view", "--out", tmp_path / "a")
    assert done.code == 2
    assert "--view and --composed exclude each other" in done.err
    assert not (tmp_path / "a").exists()
