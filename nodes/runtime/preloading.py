"""Imported by the server that forks the nodes, and by nobody else: what they need is then there.

What cannot be imported is left to the node that wants it, which says in words what is wrong.
"""

from __future__ import annotations

import ctypes
import gc
import os
import signal
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from importlib import import_module

# Variable of the environment with the names of the modules, between blanks.
PRELOAD_VARIABLE = "PALPATE_PRELOAD"
_PR_SET_PDEATHSIG = 1


def preload(names: Iterable[str]) -> None:
    """Import modules, and keep all that came of it out of later searches for garbage."""
    gc.disable()
    with _no_longer_than_parent():
        for name in names:
            with suppress(Exception):
                import_module(name)
    gc.enable()
    gc.freeze()
    if "numpy.random" in sys.modules:
        # Who draws without a generator of its own must not draw what its neighbours draw.
        os.register_at_fork(after_in_child=sys.modules["numpy.random"].seed)


@contextmanager
def _no_longer_than_parent() -> Iterator[None]:
    """Let the kernel end this process with its parent: in an import it would notice too late."""
    signal_at_parent_death(signal.SIGKILL)
    yield
    signal_at_parent_death(0)


def signal_at_parent_death(number: int) -> None:
    """Have the kernel send this process a signal when its parent dies; 0 sends none."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, int(number))


if PRELOAD_VARIABLE in os.environ:
    preload(os.environ.pop(PRELOAD_VARIABLE).split())
