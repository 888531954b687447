"""A view beside a running graph: it sees all, never holds it up, and leaves nothing behind."""

import os
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from palpate.launch import read_summary
from palpate.launch.processes import running_graphs
from palpate.tools.cli import command_line as cli
from palpate.tools.view import Timeline, ViewProcess, read_timeline
from palpate.tools.view.live import show_graph

pytestmark = pytest.mark.graph
STAYS = """
import sys
from functools import partial
from pathlib import Path
from palpate.tools.view import ViewProcess
say, told = partial(print, flush=True), []
with ViewProcess(Path(sys.argv[1]), told.append) as beside:
    say(beside._process.pid)
    say(told[0])
    beside.stay(say)
"""
WITHIN = 60.0  # A deadline that only what is broken misses, s
RUN = """
import sys
from pathlib import Path
from tests.recorded_run import make_run
make_run(Path(sys.argv[1]), composed=False)
"""
BESIDE = """
import sys, time
from pathlib import Path
from palpate.tools.view import ViewProcess
with ViewProcess(Path(sys.argv[1]), lambda _: None) as beside:
    print(beside._process.pid, flush=True)
    time.sleep(1000)
"""


def until(holds):
    end = time.monotonic() + WITHIN
    while not (found := holds()):
        assert time.monotonic() < end
        time.sleep(0.02)
    return found


def card_of(folder):
    path = str(folder.resolve())
    return next((card for card in running_graphs() if card.folder == path), None)


def ended(pid):
    """Whether a process is gone, or only waits to be buried."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] == "Z"
    except FileNotFoundError:
        return True


def sockets(pid):
    """Number of sockets that a process has open."""
    found = 0
    for one in Path(f"/proc/{pid}/fd").iterdir():
        with suppress(FileNotFoundError):  # closed meanwhile
            found += "socket:" in os.readlink(one)
    return found


def test_a_view_sees_of_a_running_graph_what_its_recording_holds(tmp_path):
    run = subprocess.Popen([sys.executable, "-c", RUN, str(tmp_path)])
    line = Timeline()
    view: Any = SimpleNamespace(
        add=lambda messages: [line.add(one) for one in messages], pass_time=lambda _: None
    )
    with run:
        card = until(lambda: card_of(tmp_path / "run"))
        until(lambda: (tmp_path / "run" / "topics.mcap").exists())
        time.sleep(1.0)  # much has been published by now
        assert show_graph(view, card, lambda: False)
    assert run.returncode == 0
    recorded = read_timeline(tmp_path / "run")
    for kind in ("touches", "contours", "models", "grasps"):
        assert len(getattr(line, kind)) == len(getattr(recorded, kind))
    assert [one.time for one in line.touches] == [one.time for one in recorded.touches]
    assert line.scores.keys() == recorded.scores.keys()
    assert line.truth is not None and line.done is not None


@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
def test_a_view_that_is_stopped_changes_nothing_for_the_graph(run_folder, tmp_path):
    told: list[str] = []
    with ViewProcess(tmp_path / "run", told.append) as beside:
        assert told[0].startswith("view  http://127.0.0.1:")
        pid = beside._process.pid
        before = sockets(pid)
        run = subprocess.Popen([sys.executable, "-c", RUN, str(tmp_path)])
        with run:
            card = until(lambda: card_of(tmp_path / "run"))
            until(lambda: sockets(pid) > before + len(card.nodes))  # it has attached
            os.kill(pid, signal.SIGSTOP)
            assert run.wait(WITHIN) == 0
    assert ended(pid)
    found, expected = read_summary(tmp_path / "run"), read_summary(run_folder)
    assert found["mesh_sha256"] == expected["mesh_sha256"] is not None
    assert found["touches"] == expected["touches"]


@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
def test_a_view_ends_with_who_began_it_also_if_that_is_killed(tmp_path):
    command = [sys.executable, "-c", BESIDE, str(tmp_path / "run")]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as parent:
        assert parent.stdout is not None
        pid = int(parent.stdout.readline())
        assert not ended(pid)
        parent.kill()
    until(lambda: ended(pid))


def test_ctrl_c_ends_a_view_without_a_fault(run_folder):
    command = [sys.executable, "-m", "palpate", "view", str(run_folder), "--port", "8490"]
    pipes: Any = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    with subprocess.Popen(command, **pipes) as process:
        assert process.stdout is not None and process.stderr is not None
        told = process.stdout.readline()
        time.sleep(0.5)
        process.send_signal(signal.SIGINT)
        rest, error = process.communicate(timeout=WITHIN)
    assert told.startswith("view  http://127.0.0.1:84")
    assert told.endswith("  (Ctrl-C ends it)\n")
    assert (process.returncode, rest, error) == (0, "", "")


def test_a_run_tells_where_it_is_seen_before_it_begins(tmp_path, capsys):
    asked = ["run", "sphere", "--touches", "24", "--json", "--view", "--out", str(tmp_path / "a")]
    assert cli.run(asked) == 1
    told = capsys.readouterr()
    assert told.err.startswith("view  http://127.0.0.1:")
    assert told.out.startswith("{")


def test_a_view_stays_after_the_run_until_ctrl_c(tmp_path):
    command = [sys.executable, "-c", STAYS, str(tmp_path)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        pid, address, stays = (process.stdout.readline().rstrip() for _ in range(3))
        assert stays == f"view stays at {address.removeprefix('view  ')}; Ctrl-C ends it"
        assert not ended(int(pid))
        process.send_signal(signal.SIGINT)
        assert process.wait(WITHIN) == 0
    until(lambda: ended(int(pid)))


def test_nodes_in_one_process_cannot_be_looked_at(tmp_path, capsys):
    assert cli.run(["run", "sphere", "--composed", "--view", "--out", str(tmp_path / "a")]) == 2
    assert "--view and --composed exclude each other" in capsys.readouterr().err
    assert not (tmp_path / "a").exists()
