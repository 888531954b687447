"""A view beside a run, as a process of its own: whatever becomes of it, the run goes on."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

from palpate.launch.processes.fork_server import until_ctrl_c

PATIENCE = 5.0  # It is killed if it takes longer to end, s
LOOK = 0.2  # Whether it still runs is looked at this often, s


class ViewProcess:
    """The process, which ends when its standard input does: also if this one is killed."""

    def __init__(self, folder: Path, echo: Callable[[str], None]) -> None:
        command = [
            sys.executable,
            "-P",
            "-m",
            "palpate",
            "view",
            "--attached",
            str(folder.absolute()),
        ]
        self._process = subprocess.Popen(
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            start_new_session=True,  # Ctrl-C is for the run, which ends it
        )
        assert self._process.stdout is not None
        told = self._process.stdout.readline().decode().split()
        self.address = told[1] if told[:1] == ["view"] else ""  # Nothing if it could not begin
        echo(f"view  {self.address}" if self.address else "no view: it could not begin")

    def __enter__(self) -> ViewProcess:
        return self

    def __exit__(self, *_: object) -> None:
        with self._process as process:
            assert process.stdin is not None
            process.stdin.close()
            try:
                process.wait(PATIENCE)
            except subprocess.TimeoutExpired:
                process.kill()

    def stay(self, echo: Callable[[str], None]) -> None:
        """Wait for Ctrl-C, or for its own end."""
        with until_ctrl_c() as interrupted:
            if self.address:
                echo(f"view stays at {self.address}; Ctrl-C ends it")
            while self._process.poll() is None and not interrupted():
                time.sleep(LOOK)
