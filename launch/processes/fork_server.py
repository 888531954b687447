"""The server from which node processes are forked, and the signals that reach none of them."""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
import tempfile
import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, contextmanager
from multiprocessing import forkserver, resource_tracker, util
from types import FrameType, ModuleType

from palpate.preloading import (
    PRELOAD_VARIABLE,
    SAFE_PATH_VARIABLE,
    THREAD_VARIABLES,
    open_closed_streams,
)

_RUNTIME = ("palpate.nodes.runtime.loop", "palpate.messages.types.catalogue")
_PRELOADING = "palpate.preloading"
_OWN = "palpate.nodes."
# Of all processes of a graph.
NODE_ENVIRONMENT = {
    # One thread for linear algebra: nodes share the machine, and sums keep their order.
    **dict.fromkeys(THREAD_VARIABLES, "1"),
    "PYTHONHASHSEED": "0",
}
# The server's socket in the temporary folder, and the longest path of one that systems take.
LONGEST_LISTENER, MAX_SOCKET_BYTES = "pymp-xxxxxxxx/listener-xxxxxxxx", 103
_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


def start_fork_server(modules: Iterable[str]) -> None:
    """Start the server for a graph whose nodes are in these modules, unless one runs.

    It goes on by itself, and is ready when the first node can be forked. One that runs already
    stays as it is: nodes import what it lacks. What must not reach a node is blocked while it is
    started, and stays so in all that is forked from it. Blocked, not ignored: a Ctrl-C still comes.
    """
    open_closed_streams()
    multiprocessing.get_context("forkserver").set_forkserver_preload([_PRELOADING])
    # Python looks for modules first where it is started; our nodes are told where to look later.
    settings = {
        **NODE_ENVIRONMENT,
        SAFE_PATH_VARIABLE: "1",
        PRELOAD_VARIABLE: " ".join(preloaded_modules(modules)),
    }
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, _SIGNALS)
    try:
        with without_main_module(), _environment(settings):
            # Started first, for it unblocks the signals that it ignores, behind our back; it does
            # not ignore a hangup.
            resource_tracker.ensure_running()
            signal.pthread_sigmask(signal.SIG_BLOCK, _SIGNALS)
            _choose_socket_folder()
            forkserver.ensure_running()
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)


def _choose_socket_folder() -> None:
    """Have the server's own socket lie where its path is short enough: the folder is made once."""
    socket = f"{tempfile.gettempdir()}/{LONGEST_LISTENER}"
    if len(os.fsencode(socket)) > MAX_SOCKET_BYTES:
        from palpate.launch.processes.registry import runtime_folder  # not before: it takes long

        before, tempfile.tempdir = tempfile.tempdir, str(runtime_folder())
        try:
            util.get_temp_dir()
        finally:
            tempfile.tempdir = before


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


def preloaded_modules(modules: Iterable[str]) -> tuple[str, ...]:
    """What the server imports for a graph whose nodes are in these modules."""
    return (*_RUNTIME, *dict.fromkeys(name for name in modules if name.startswith(_OWN)))


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
def _handled(numbers: Iterable[signal.Signals], handler: Callable[..., object]) -> Iterator[None]:
    """Have signals handled otherwise meanwhile."""
    before = {number: signal.signal(number, handler) for number in numbers}
    try:
        yield
    finally:
        for number, other in before.items():
            signal.signal(number, signal.SIG_DFL if other is None else other)


class Interrupts:
    """Within its ``with`` block, a request to end is only noted, however often it comes.

    Raises RuntimeError on entry, if this is not the main thread: only it receives signals.
    """

    def __init__(self) -> None:
        self.came: str | None = None  # Name of the first signal that came
        self._kept = ExitStack()

    def __enter__(self) -> Interrupts:
        if threading.current_thread() is not threading.main_thread():
            raise RuntimeError("a graph can only be launched from the main thread of a process")
        # Under nohup a closed terminal is no reason to end.
        ignored = signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
        self._kept.enter_context(_handled(_SIGNALS[: 2 if ignored else 3], self._note))
        return self

    def __exit__(self, *_: object) -> None:
        self._kept.close()

    def _note(self, number: int, _: FrameType | None) -> None:
        self.came = self.came or signal.Signals(number).name


@contextmanager
def signals_as_ctrl_c() -> Iterator[None]:
    """Have a request to end, whichever it is, interrupt this thread as Ctrl-C does.

    Elsewhere than in the main thread nothing is changed: signals do not arrive there.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    heard = [one for one in _SIGNALS[1:] if signal.getsignal(one) is not signal.SIG_IGN]
    with _handled(heard, signal.default_int_handler):
        yield


@contextmanager
def until_ctrl_c() -> Iterator[Callable[[], bool]]:
    """Have the first Ctrl-C only noted, so that a loop ends where it can; the second one raises.

    Yields a function that tells whether it came; elsewhere than in the main thread it never does.
    """
    came: list[int] = []
    if threading.current_thread() is not threading.main_thread():
        yield lambda: False
        return

    def note(number: int, _: FrameType | None) -> None:
        came.append(number)
        signal.signal(signal.SIGINT, signal.default_int_handler)

    with _handled([signal.SIGINT], note):
        yield lambda: bool(came)
