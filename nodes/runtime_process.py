"""The process around a node: how it begins, and that it never outlives its launcher."""

from __future__ import annotations

import ctypes
import multiprocessing
import os
import signal
import sys
from collections.abc import Callable
from multiprocessing import forkserver

import msgspec

from palpate.messages.bus.place import Place
from palpate.nodes.runtime import run
from palpate.nodes.wiring import Wiring

UNBORN = 4
"""Exit code of a process that could not even reach the launcher."""
_PR_SET_PDEATHSIG = 1


def enter(wiring: bytes, place: bytes) -> None:
    """Run one node in this process, and leave the process.

    Parameters
    ----------
    wiring, place : bytes
        A `Wiring` (its parameters once more as bytes) and a `Place`, in msgpack.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGTERM})
    _let_go_of_parent()
    _die_with_parent(signal.SIGKILL)
    seat = msgspec.msgpack.decode(wiring, type=Wiring)
    os.nice(seat.nice)
    try:
        code = run(seat, msgspec.msgpack.decode(place, type=Place), _protect)
    except Exception as error:  # The edge of the process, without a line to the launcher.
        print(f"{seat.name}: {type(error).__name__}: {error}", file=sys.stderr)
        code = UNBORN
    sys.exit(code)


def _let_go_of_parent() -> None:
    """Close the line that would keep the parent alive.

    The parent is the server that forks the nodes. It ends when nobody holds the far end of its
    line any more, and it hands that end to every child; so a child has to close it, or neither
    would end when the launcher is killed.
    """
    line = getattr(forkserver, "_forkserver", None)
    held = getattr(line, "_forkserver_alive_fd", None)
    if line is not None and held is not None:
        os.close(held)
        line._forkserver_alive_fd = None


def _protect(end: Callable[[], None]) -> None:
    """Let the process close its file when it is asked to end, or its launcher dies."""
    signal.signal(signal.SIGTERM, lambda *_: end())
    _die_with_parent(signal.SIGTERM)


def _die_with_parent(number: signal.Signals) -> None:
    """Have the kernel send a signal when the parent process dies."""
    if sys.platform != "linux":
        return
    before = os.getppid()
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, int(number))
    launcher = multiprocessing.parent_process()
    # The parent may have died before the kernel was told.
    if os.getppid() != before or (launcher is not None and not launcher.is_alive()):
        os._exit(UNBORN)
