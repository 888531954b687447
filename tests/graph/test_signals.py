"""Signals to a launcher: the graph ends as interrupted, and no process and no file is left."""

from __future__ import annotations

import os
import signal
import sys
import time
from contextlib import suppress

import pytest

from tests.graph.conftest import WITHIN, in_group, started, wait_for

pytestmark = [pytest.mark.graph, pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")]
OTHERS = (signal.SIGTERM, signal.SIGHUP)


@pytest.fixture
def launcher(runtime):
    """A launcher of a graph without an end, in a process group of its own, before its launch."""
    with started("run_graph.py", "ring", runtime, 0.0, start_new_session=True) as process:
        try:
            assert process.stdout is not None
            assert process.stdout.readline() == "launching\n"
            yield process
        finally:
            with suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)


def let_run(process, moment):
    """Until it is up, for no number; else for some seconds."""
    if moment is None:
        assert process.stdout.readline() == "ready\n"
    else:
        time.sleep(moment)


def assert_nothing_left(process, folder):
    wait_for(lambda: not in_group(process.pid))
    lines = folder / "lines.txt"
    assert not lines.exists() or lines.read_text().endswith("closed\n")


@pytest.mark.parametrize(
    ("number", "whole_group", "times", "moment"),
    [
        *((signal.SIGINT, True, 1, moment) for moment in (None, 0.05, 0.2, 0.4)),
        (signal.SIGINT, True, 2, 0.3),
        *((number, whole, 1, None) for number in OTHERS for whole in (True, False)),
    ],
)
def test_signal_ends_the_graph_as_interrupted(
    number, whole_group, times, moment, launcher, runtime
):
    let_run(launcher, moment)
    for _ in range(times):
        if whole_group:
            os.killpg(launcher.pid, number)
        else:
            launcher.send_signal(number)
    out, err = launcher.communicate(timeout=WITHIN)
    expected = f"interrupted - {number.name} was received\nthe environment is unchanged: True\n"
    assert (out.removeprefix("ready\n"), err, launcher.returncode) == (expected, "", 0)
    assert_nothing_left(launcher, runtime)
    assert [one.name for one in runtime.iterdir() if one.name != "lines.txt"] == []


@pytest.mark.parametrize("moment", [None, 0.05, 0.3])
def test_no_node_outlives_a_killed_launcher(moment, launcher, runtime):
    let_run(launcher, moment)
    launcher.kill()
    launcher.wait(WITHIN)
    assert_nothing_left(launcher, runtime)
