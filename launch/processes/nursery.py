"""Where the processes of a graph are born, and where they end.

They are forked from a server that has already imported what every node needs, so that a node
is up in milliseconds. The server holds nothing heavy, no node's own module and no generator of
random numbers: each node imports what it needs, and nodes share no state.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from multiprocessing import forkserver, resource_tracker
from multiprocessing.connection import wait
from types import ModuleType

from palpate.nodes.runtime_process import enter

GRACE = 2.5
"""A process that is asked to end is killed after this long, s."""
_PRELOAD = ["palpate.nodes.runtime_process", "palpate.messages.types"]
_ENVIRONMENT = {
    # One thread for linear algebra: nodes share the machine, and sums keep their order.
    "OPENBLAS_NUM_THREADS": "1",
    "OMP_NUM_THREADS": "1",
    "MKL_NUM_THREADS": "1",
    "PYTHONHASHSEED": "0",
}
_CONTEXT = multiprocessing.get_context("forkserver")


class Nursery:
    """The processes of one graph; none of them is left when its ``with`` block ends."""

    def __init__(self) -> None:
        self._children: dict[str, multiprocessing.context.ForkServerProcess] = {}

    def __enter__(self) -> Nursery:
        _serve()
        return self

    def __exit__(self, *_: object) -> None:
        self.end()

    def bear(self, name: str, wiring: bytes, place: bytes) -> int:
        """Start the process of a node, and return its sentinel.

        Raises
        ------
        ChildProcessError
            If the process cannot be started.
        """
        child = _CONTEXT.Process(target=enter, args=(wiring, place), name=name, daemon=True)
        try:
            with no_script():
                child.start()
        except (OSError, EOFError) as error:
            reason = str(error) or type(error).__name__
            raise ChildProcessError(f"the process of {name} cannot be started: {reason}") from None
        self._children[name] = child
        return child.sentinel

    def exit_code(self, name: str) -> int:
        """Exit code of a process that has ended; negative for a signal."""
        child = self._children[name]
        child.join()
        return child.exitcode or 0

    def kill(self, name: str) -> None:
        """Kill a process at once."""
        self._children[name].kill()

    def pid(self, name: str) -> int:
        """Number of the process of a node."""
        return self._children[name].pid or 0

    def end(self) -> None:
        """End all processes: they are asked, and killed if they take too long."""
        living = [child for child in self._children.values() if child.exitcode is None]
        for child in living:
            child.terminate()
        deadline = time.monotonic() + GRACE
        while living and (left := deadline - time.monotonic()) > 0:
            wait([child.sentinel for child in living], left)
            living = [child for child in living if child.exitcode is None]
        for child in living:
            child.kill()
        for child in self._children.values():
            child.join()


def how_it_ended(code: int) -> str:
    """Exit code of a process in words."""
    if code < 0:
        return f"was killed by {signal.Signals(-code).name}"
    return f"ended by itself with exit code {code}"


def _serve() -> None:
    """Start the server, unless it runs.

    What must not reach a node is blocked while the server is started, and stays so in all
    that is forked from it. Blocked, not ignored: a Ctrl-C in this moment still reaches us.
    """
    _CONTEXT.set_forkserver_preload(_PRELOAD)
    blocked = {signal.SIGINT, signal.SIGHUP, signal.SIGTERM}
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, blocked)
    before = {key: os.environ.get(key) for key in _ENVIRONMENT}
    try:
        # Started first, for it unblocks the signals that it ignores, behind our back; it does
        # not ignore a hangup.
        resource_tracker.ensure_running()
        signal.pthread_sigmask(signal.SIG_BLOCK, blocked)
        os.environ.update(_ENVIRONMENT)
        with no_script():
            forkserver.ensure_running()
    finally:
        for key, value in before.items():
            if value is None:
                del os.environ[key]
            else:
                os.environ[key] = value
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)


@contextmanager
def no_script() -> Iterator[None]:
    """Keep the child from running the user's script, which a new process does otherwise."""
    script = sys.modules["__main__"]
    sys.modules["__main__"] = ModuleType("__main__")
    try:
        yield
    finally:
        sys.modules["__main__"] = script
