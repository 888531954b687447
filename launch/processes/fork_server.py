"""The server from which nodes are forked: what it is, and how it is started.

It has imported what the nodes of palpate's own kinds in its graph need, on one thread and without
a socket, so that a node is up in milliseconds. Modules of a user's own are imported by their
nodes: a node that is started again then sees what was changed. Imports little, so that it can be
started first.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from multiprocessing import forkserver, resource_tracker
from types import ModuleType

from palpate.nodes.runtime import PRELOAD_VARIABLE

_RUNTIME = ("palpate.nodes.runtime.loop", "palpate.messages.types.catalogue")
_PRELOADING = "palpate.nodes.runtime.preloading"
_OWN = "palpate.nodes."
# Of all processes of a graph.
NODE_ENVIRONMENT = {
    # One thread for linear algebra: nodes share the machine, and sums keep their order.
    "OPENBLAS_NUM_THREADS": "1",
    "OMP_NUM_THREADS": "1",
    "MKL_NUM_THREADS": "1",
    "PYTHONHASHSEED": "0",
}


def preloaded_modules(modules: Iterable[str]) -> tuple[str, ...]:
    """What the server imports for a graph whose nodes are in these modules."""
    return (*_RUNTIME, *dict.fromkeys(name for name in modules if name.startswith(_OWN)))


def start_fork_server(modules: Iterable[str]) -> None:
    """Start the server for a graph whose nodes are in these modules, unless one runs.

    It goes on by itself, and is ready when the first node can be forked. One that runs already
    stays as it is: nodes import what it lacks.

    What must not reach a node is blocked while the server is started, and stays so in all
    that is forked from it. Blocked, not ignored: a Ctrl-C in this moment still reaches us.
    """
    multiprocessing.get_context("forkserver").set_forkserver_preload([_PRELOADING])
    blocked = {signal.SIGINT, signal.SIGHUP, signal.SIGTERM}
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, blocked)
    try:
        # Started first, for it unblocks the signals that it ignores, behind our back; it does
        # not ignore a hangup.
        resource_tracker.ensure_running()
        signal.pthread_sigmask(signal.SIG_BLOCK, blocked)
        with (
            without_main_module(),
            _environment(
                {**NODE_ENVIRONMENT, PRELOAD_VARIABLE: " ".join(preloaded_modules(modules))}
            ),
        ):
            forkserver.ensure_running()
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)


@contextmanager
def without_main_module() -> Iterator[None]:
    """Keep the child from running the user's script, which a new process does otherwise."""
    script = sys.modules["__main__"]
    sys.modules["__main__"] = ModuleType("__main__")
    try:
        yield
    finally:
        sys.modules["__main__"] = script


@contextmanager
def _environment(settings: dict[str, str]) -> Iterator[None]:
    """Set variables for what is started meanwhile."""
    before = {key: os.environ.get(key) for key in settings}
    os.environ.update(settings)
    try:
        yield
    finally:
        for key, value in before.items():
            if value is None:
                del os.environ[key]
            else:
                os.environ[key] = value
