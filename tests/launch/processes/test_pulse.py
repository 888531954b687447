from __future__ import annotations

import os
import signal
import subprocess
import sys
import time

import pytest

from palpate.launch.processes import pulse
from palpate.launch.processes.pulse import Busy, Pulse, busy

PIDS = {"node": 1}


def watched(monkeypatch: pytest.MonkeyPatch, does: Busy | None, longest: float = 1.0) -> Pulse:
    """A pulse whose node gave its last sign at 10 s, with 2 s used, looked at ten times a s."""
    monkeypatch.setattr(pulse, "busy", lambda pid: does)
    made = Pulse({"node": longest})
    made.hung(10.0, PIDS)
    made.sign("node", 10.0, 2.0)
    return made


def hung_at(made: Pulse, until: float) -> float | None:
    """When it is found to hang, s after its last sign."""
    for tick in range(1, round(10 * until) + 1):
        found = made.hung(10.0 + 0.1 * tick, PIDS)
        if found:
            return 0.1 * tick
    return None


@pytest.mark.parametrize(
    ("does", "longest", "found"),
    [
        (Busy("T", 2.0), 60.0, 1.3),  # stopped
        (Busy("S", 2.0), 1.0, 1.3),  # blocked
        (Busy("S", 2.0), 3.0, 3.1),
        (Busy("R", 3.5), 1.0, 1.3),  # in an endless loop
        (Busy("R", 2.1), 1.0, None),  # starved by others
        (Busy("R", 3.5), 60.0, None),  # at work
        (None, 1.0, 1.3),
        (None, 3.0, 3.1),
    ],
)
def test_a_node_hangs_that_neither_works_nor_waits_for_the_processor(
    monkeypatch: pytest.MonkeyPatch, does: Busy | None, longest: float, found: float | None
) -> None:
    at = hung_at(watched(monkeypatch, does, longest), 5.0)
    assert at == (None if found is None else pytest.approx(found))


def test_nobody_is_blamed_for_the_time_in_which_the_launcher_did_not_run(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    made = watched(monkeypatch, Busy("T", 2.0))
    assert made.hung(60.0, PIDS) == {}
    assert made.hung(60.4, PIDS) == {}
    assert made.hung(60.8, PIDS) == {}
    assert "node" in made.hung(61.3, PIDS)


@pytest.mark.parametrize(
    ("does", "found"), [(Busy("T", 2.0), 1.3), (Busy("S", 2.0), None), (Busy("R", 9.0), None)]
)
def test_a_node_that_begins_may_take_its_time_but_must_not_be_stopped(
    monkeypatch: pytest.MonkeyPatch, does: Busy, found: float | None
) -> None:
    made = watched(monkeypatch, does)
    made.begin("node", 10.0)
    assert hung_at(made, 5.0) == (None if found is None else pytest.approx(found))


def test_nothing_is_expected_of_a_node_that_has_said_goodbye(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    made = watched(monkeypatch, Busy("T", 2.0))
    made.forget("node")
    assert hung_at(made, 5.0) is None


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux says what a process does")
def test_the_system_says_what_a_process_does() -> None:
    assert busy(1 << 30) is None
    child = subprocess.Popen([sys.executable, "-c", "while True: pass"])
    try:
        deadline = time.monotonic() + 20
        while (does := busy(child.pid)) is None or does.used < 0.1:
            assert time.monotonic() < deadline
        assert does.state == "R"
        os.kill(child.pid, signal.SIGSTOP)
        while (does := busy(child.pid)) is None or does.state != "T":
            assert time.monotonic() < deadline
    finally:
        child.kill()
        child.wait()
