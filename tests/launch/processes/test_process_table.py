import os
import re
import signal
import subprocess
import sys
import time

import pytest

from palpate.launch.processes import process_table as pulse
from palpate.launch.processes.process_table import (
    OUT_OF_MEMORY,
    KilledNodes,
    ProcessState,
    RestartPolicy,
    Watchdog,
    exit_text,
    process_state,
)


def test_a_node_is_started_again_but_not_in_a_storm_nor_to_die_of_the_same():
    restarts = RestartPolicy({"a": "restart", "b": "restart"})
    how = "was killed by SIGKILL"
    assert [restarts.refusal("a", how, False, now) for now in (0.0, 1.0, 2.0)] == [None] * 3
    assert restarts.refusal("b", how, False, 3.0) is None
    assert restarts.refusal("a", how, False, 9.0) == (
        "a was killed by SIGKILL, after it had been started again 3 times in 10 s"
    )
    assert restarts.refusal("a", how, False, 10.5) is None
    assert restarts.counts == {"a": 4, "b": 1}
    restarts = RestartPolicy({"a": "restart"})
    how = "failed while handling /in 7 from b: ValueError: no"
    assert restarts.refusal("a", how, True, 0.0) is None
    assert restarts.refusal("a", how.replace("7", "8"), True, 50.0) is None
    assert restarts.refusal("a", how.replace("7", "8"), True, 90.0) == (
        "a failed while handling /in 8 from b: ValueError: no; so it did when it was started again"
    )
    restarts = RestartPolicy({"a": "stop"})
    assert restarts.refusal("a", "hung", False, 0.0) == "a hung"
    assert restarts.counts == {"a": 0}


@pytest.mark.parametrize("counts", [(0, 1, 2), (0, 0, 0, 0)])
def test_a_node_that_is_killed_twice_for_memory_ends_the_run(tmp_path, monkeypatch, counts):
    told = iter(counts)
    monkeypatch.setattr(pulse, "memory_kills", lambda: next(told))
    journal = tmp_path / "journal"
    journal.write_bytes(b"what was consumed")
    kills, restarts = KilledNodes({"a": str(journal)}), RestartPolicy({"a": "restart"})
    answers = []
    for death in range(len(counts) - 1):
        kills.begun("a", 100.0 * death)
        for_memory = kills.for_memory("a", 100.0 * death + 50.0)
        how = OUT_OF_MEMORY if for_memory else "was killed by SIGKILL"
        answers.append(restarts.refusal("a", how, False, 100.0 * death))
    assert answers[-1] == f"a {OUT_OF_MEMORY}; so it did when it was started again"
    assert answers[:-1] == [None] * (len(counts) - 2)


def test_a_node_that_goes_on_after_a_kill_was_killed_by_somebody(tmp_path, monkeypatch):
    monkeypatch.setattr(pulse, "memory_kills", lambda: 0)
    journal = tmp_path / "journal"
    kills = KilledNodes({"a": str(journal)})
    for death in range(5):
        kills.begun("a", 100.0 * death)
        journal.write_bytes(bytes(death))
        assert not kills.for_memory("a", 100.0 * death + 50.0)


PIDS = {"node": 1}


def watched(monkeypatch, does, handler_timeout=1.0):
    """A pulse whose node gave its last sign at 10 s, with 2 s used, looked at ten times a s."""
    monkeypatch.setattr(pulse, "process_state", lambda pid: does)
    made = Watchdog({"node": handler_timeout})
    made.hung(10.0, PIDS)
    made.sign("node", 10.0, 2.0)
    return made


def hung_at(made, until):
    """When it is found to hang, s after its last sign."""
    for tick in range(1, round(10 * until) + 1):
        found = made.hung(10.0 + 0.1 * tick, PIDS)
        if found:
            return 0.1 * tick
    return None


@pytest.mark.parametrize(
    ("does", "handler_timeout", "found"),
    [
        (ProcessState("T", 2.0), 60.0, 1.3),  # stopped
        (ProcessState("S", 2.0), 1.0, 1.3),  # blocked
        (ProcessState("S", 2.0), 3.0, 3.1),
        (ProcessState("R", 3.5), 1.0, 1.3),  # in an endless loop
        (ProcessState("R", 2.1), 1.0, None),  # starved by others
        (ProcessState("R", 3.5), 60.0, None),  # at work
        (None, 1.0, 1.3),
        (None, 3.0, 3.1),
    ],
)
def test_a_node_hangs_that_neither_works_nor_waits_for_the_processor(
    monkeypatch, does, handler_timeout, found
):
    at = hung_at(watched(monkeypatch, does, handler_timeout), 5.0)
    assert at == (None if found is None else pytest.approx(found))


def test_nobody_is_blamed_for_the_time_in_which_the_launcher_did_not_run(monkeypatch):
    made = watched(monkeypatch, ProcessState("T", 2.0))
    assert made.hung(60.0, PIDS) == {}
    assert made.hung(60.4, PIDS) == {}
    assert made.hung(60.8, PIDS) == {}
    assert "node" in made.hung(61.3, PIDS)


@pytest.mark.parametrize(
    ("does", "found"),
    [(ProcessState("T", 2.0), 1.3), (ProcessState("S", 2.0), None), (ProcessState("R", 9.0), None)],
)
def test_a_node_that_begins_may_take_its_time_but_must_not_be_stopped(monkeypatch, does, found):
    made = watched(monkeypatch, does)
    made.begin("node", 10.0)
    assert hung_at(made, 5.0) == (None if found is None else pytest.approx(found))


def test_nothing_is_expected_of_a_node_that_has_told_goodbye(monkeypatch):
    made = watched(monkeypatch, ProcessState("T", 2.0))
    made.forget("node")
    assert hung_at(made, 5.0) is None


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux tells what a process does")
def test_the_system_tells_what_a_process_does():
    assert process_state(1 << 30) is None
    child = subprocess.Popen([sys.executable, "-c", "while True: pass"])
    try:
        deadline = time.monotonic() + 20
        while (does := process_state(child.pid)) is None or does.used < 0.1:
            assert time.monotonic() < deadline
        assert does.state == "R"
        os.kill(child.pid, signal.SIGSTOP)
        while (does := process_state(child.pid)) is None or does.state != "T":
            assert time.monotonic() < deadline
    finally:
        child.kill()
        child.wait()


@pytest.mark.parametrize(("code", "words"), [
    (-9, "was killed by SIGKILL"),
    (-11, "was killed by SIGSEGV"),
    (3, "ended by itself with exit code 3"),
    (0, "ended by itself with exit code 0"),
])  # fmt: skip
def test_an_exit_code_is_put_into_words(code, words):
    assert exit_text(code) == words


TRACKED = """
import signal
from multiprocessing import resource_tracker
from palpate.launch.processes.process_table import ForkServer
with ForkServer(()):
    print(open(f"/proc/{resource_tracker._resource_tracker._pid}/status").read())
    assert not signal.pthread_sigmask(signal.SIG_BLOCK, ())
"""


@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
def test_a_closed_terminal_does_not_reach_the_process_that_keeps_track():
    run = [sys.executable, "-c", TRACKED]
    told = subprocess.run(run, capture_output=True, text=True, timeout=30.0, check=True).stdout
    [held] = re.findall(r"^SigBlk:\s*(\w+)$", told, re.MULTILINE)
    assert int(held, 16) >> (signal.SIGHUP - 1) & 1
