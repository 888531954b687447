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
# Environment of all processes of a graph.
NODE_ENVIRONMENT = {
    # One thread for linear algebra: nodes share the machine, and sums keep their order.
    **dict.fromkeys(THREAD_VARIABLES, "1"),
    "PYTHONHASHSEED": "0",
}
# Path of the server's socket in the temporary folder, and the system's limit on it [bytes].
LONGEST_LISTENER, MAX_SOCKET_BYTES = "pymp-xxxxxxxx/listener-xxxxxxxx", 103
_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


def start_fork_server(modules: Iterable[str]) -> None:
    """Start the server for a graph with nodes in these modules, unless a server runs already.

    The server imports the modules in the background. A running server is not changed: nodes import
    the modules that it lacks. Signals that must not reach a node are blocked while the server is
    started, and stay blocked in its processes; a Ctrl-C still reaches this process afterwards.
    """
    open_closed_streams()
    multiprocessing.get_context("forkserver").set_forkserver_preload([_PRELOADING])
    # Python would search the current folder first; nodes get their path later.
    settings = {
        **NODE_ENVIRONMENT,
        SAFE_PATH_VARIABLE: "1",
        PRELOAD_VARIABLE: " ".join(preloaded_modules(modules)),
    }
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, _SIGNALS)
    try:
        with without_main_module(), _environment(settings):
            # The tracker is started first, since it unblocks the signals that it ignores.
            resource_tracker.ensure_running()
            signal.pthread_sigmask(signal.SIG_BLOCK, _SIGNALS)
            _choose_socket_folder()
            forkserver.ensure_running()
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)


def _choose_socket_folder() -> None:
    """Choose a temporary folder in which the path of the server's socket is short enough."""
    socket = f"{tempfile.gettempdir()}/{LONGEST_LISTENER}"
    if len(os.fsencode(socket)) > MAX_SOCKET_BYTES:
        from palpate.launch.processes.registry import runtime_folder  # imported late: slow

        before, tempfile.tempdir = tempfile.tempdir, str(runtime_folder())
        try:
            util.get_temp_dir()
        finally:
            tempfile.tempdir = before


@contextmanager
def _environment(settings: dict[str, str]) -> Iterator[None]:
    """Set environment variables during a ``with`` block."""
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
    """Modules that the server imports for a graph with nodes in these modules."""
    return (*_RUNTIME, *dict.fromkeys(name for name in modules if name.startswith(_OWN)))


@contextmanager
def without_main_module() -> Iterator[None]:
    """Keep new processes from running the user's script."""
    script = sys.modules["__main__"]
    sys.modules["__main__"] = ModuleType("__main__")
    try:
        yield
    finally:
        sys.modules["__main__"] = script


@contextmanager
def _handled(numbers: Iterable[signal.Signals], handler: Callable[..., object]) -> Iterator[None]:
    """Set the handler of signals during a ``with`` block."""
    before = {number: signal.signal(number, handler) for number in numbers}
    try:
        yield
    finally:
        for number, other in before.items():
            signal.signal(number, signal.SIG_DFL if other is None else other)


class Interrupts:
    """Records signals to end during its ``with`` block, in which they have no other effect.

    Raises RuntimeError on entry if this is not the main thread, which receives signals.
    """

    def __init__(self) -> None:
        self.came: str | None = None  # name of the first signal
        self._kept = ExitStack()

    def __enter__(self) -> Interrupts:
        if threading.current_thread() is not threading.main_thread():
            raise RuntimeError("a graph can only be launched from the main thread of a process")
        # Under nohup a hangup is ignored.
        ignored = signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
        self._kept.enter_context(_handled(_SIGNALS[: 2 if ignored else 3], self._note))
        return self

    def __exit__(self, *_: object) -> None:
        self._kept.close()

    def _note(self, number: int, _: FrameType | None) -> None:
        self.came = self.came or signal.Signals(number).name


@contextmanager
def signals_as_ctrl_c() -> Iterator[None]:
    """Let all signals to end interrupt the main thread as Ctrl-C does.

    In other threads, which receive no signals, nothing is changed.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    active = [number for number in _SIGNALS[1:] if signal.getsignal(number) is not signal.SIG_IGN]
    with _handled(active, signal.default_int_handler):
        yield


@contextmanager
def until_ctrl_c() -> Iterator[Callable[[], bool]]:
    """Record the first Ctrl-C, so that a loop can end; the second Ctrl-C raises KeyboardInterrupt.

    Yields a function that returns whether Ctrl-C came; in other threads it is always False.
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
