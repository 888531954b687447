from __future__ import annotations

import re
import signal
import subprocess
import sys

import pytest

from palpate.launch.processes.process_hosts import exit_text


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
from palpate.launch.processes.process_hosts import ForkServer
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
