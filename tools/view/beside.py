"""A view beside a run, as a separate process: its failure does not disturb the run."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

from palpate.launch.processes.fork_server import until_ctrl_c


class ViewProcess:
    """The process of a view, which ends with its standard input: also if this process is killed.

    `end_timeout` [s]: after it, a view that does not end is killed. `poll_interval` [s]: between
    two checks whether it runs.
    """

    def __init__(
        self,
        folder: Path,
        echo: Callable[[str], None],
        *,
        end_timeout: float = 5.0,
        poll_interval: float = 0.2,
    ) -> None:
        self._end_timeout, self._poll_interval = end_timeout, poll_interval
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
        words = self._process.stdout.readline().decode().split()
        self.address = words[1] if words[:1] == ["view"] else ""  # empty if it did not start
        echo(f"view  {self.address}" if self.address else "no view: it could not start")

    def __enter__(self) -> ViewProcess:
        return self

    def __exit__(self, *_: object) -> None:
        with self._process as process:
            assert process.stdin is not None
            process.stdin.close()
            try:
                process.wait(self._end_timeout)
            except subprocess.TimeoutExpired:
                process.kill()

    def stay(self, echo: Callable[[str], None]) -> None:
        """Wait for Ctrl-C, or until the view ends."""
        with until_ctrl_c() as interrupted:
            if self.address:
                echo(f"view stays at {self.address}; Ctrl-C ends it")
            while self._process.poll() is None and not interrupted():
                time.sleep(self._poll_interval)
