"""Where the processes of a graph are born, and where they end.

They are forked from a server (`server`) that has already imported what they need, so that a node
is up in milliseconds. Nodes share no state.
"""

from __future__ import annotations

import multiprocessing
import signal
import time
from collections.abc import Iterable
from multiprocessing.connection import wait

from palpate.launch.processes.server import no_script, wake
from palpate.nodes.runtime_process import enter

GRACE = 2.5
"""A process that is asked to end is killed after this long, s."""
_CONTEXT = multiprocessing.get_context("forkserver")


class Nursery:
    """The processes of one graph; none of them is left when its ``with`` block ends.

    Parameters
    ----------
    modules : iterable of str
        Modules of the nodes that will be born.
    """

    def __init__(self, modules: Iterable[str]) -> None:
        self._modules = tuple(modules)
        self._children: dict[str, multiprocessing.context.ForkServerProcess] = {}

    def __enter__(self) -> Nursery:
        wake(self._modules)
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
