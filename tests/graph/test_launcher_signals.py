import os
import random
import signal
import subprocess
import sys
import time
from contextlib import suppress

import pytest

pytestmark = [pytest.mark.graph, pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")]
SCRIPT = "tests.graph.toys.run_for_ever"
GONE_WITHIN = 4.0


def slowly(case):
    return pytest.param(case, marks=pytest.mark.slow)


@pytest.fixture
def process(tmp_path):
    """A launcher in a process group of its own, just before its launch."""
    with subprocess.Popen(
        [sys.executable, "-m", SCRIPT, str(tmp_path)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    ) as started:
        try:
            assert started.stdout is not None
            assert started.stdout.readline() == "launching\n"
            yield started
        finally:
            # Also what a failed test would leave; a process that is only to be buried stays.
            with suppress(ProcessLookupError):
                os.killpg(started.pid, signal.SIGKILL)


def let_run(process, seconds):
    with pytest.raises(subprocess.TimeoutExpired):
        process.wait(seconds)


def left_in(folder):
    return sorted(path.name for path in folder.iterdir() if path.name != "lines.txt")


def assert_ended_well(process, folder, signal_name, gone):
    began = time.monotonic()
    out, err = process.communicate(timeout=GONE_WITHIN)
    assert out == f"interrupted - {signal_name} was received\n"
    assert err == ""
    assert process.returncode == 0
    assert gone(process.pid, GONE_WITHIN - (time.monotonic() - began))
    assert left_in(folder) == []
    lines = folder / "lines.txt"
    if lines.exists():
        assert lines.read_text().endswith("closed\n")


@pytest.mark.parametrize("seed", [*range(4), *(slowly(n) for n in range(4, 10))])
def test_ctrl_c_at_any_moment_leaves_nothing_behind(seed, process, tmp_path, group_is_gone):
    let_run(process, random.Random(seed).random() * 0.8 + 0.05)
    os.killpg(process.pid, signal.SIGINT)
    assert_ended_well(process, tmp_path, "SIGINT", group_is_gone)


@pytest.mark.parametrize("seed", [0, slowly(1), slowly(2)])
def test_ctrl_c_may_be_pressed_twice(seed, process, tmp_path, group_is_gone):
    let_run(process, 0.6)
    os.killpg(process.pid, signal.SIGINT)
    os.killpg(process.pid, signal.SIGINT)
    assert_ended_well(process, tmp_path, "SIGINT", group_is_gone)


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_a_signal_to_the_launcher_alone_ends_the_graph(number, process, tmp_path, group_is_gone):
    let_run(process, 0.6)
    process.send_signal(number)
    assert_ended_well(process, tmp_path, number.name, group_is_gone)


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_a_signal_to_the_whole_group_counts_as_an_interruption(
    number, process, tmp_path, group_is_gone
):
    let_run(process, 0.6)
    os.killpg(process.pid, number)
    assert_ended_well(process, tmp_path, number.name, group_is_gone)


@pytest.mark.parametrize("moment", [0.05, 0.3, 0.7])
def test_no_node_outlives_a_launcher_that_is_killed(moment, process, tmp_path, group_is_gone):
    let_run(process, moment)
    process.kill()
    process.wait(GONE_WITHIN)
    assert group_is_gone(process.pid, 2.0)
    lines = tmp_path / "lines.txt"
    if lines.exists():
        assert lines.read_text().endswith("closed\n")
