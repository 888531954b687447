"""What a node needs is imported before its first message, and once for all that are forked.

The server that forks the nodes imports this module with `PRELOAD_VARIABLE` set. What cannot be
imported is left to the node that wants it, which says in words what is wrong.
"""

from __future__ import annotations

import ctypes
import gc
import os
import signal
import sys
from collections.abc import Iterable
from contextlib import suppress
from importlib import import_module
from importlib.util import LazyLoader, find_spec, module_from_spec

PRELOAD_VARIABLE = "PALPATE_PRELOAD"  # Of the environment: names of modules between blanks
SAFE_PATH_VARIABLE = "PYTHONSAFEPATH"  # Of the environment: no module comes from the current folder
# Of the environment: how many threads linear algebra takes, read when numpy is imported.
THREAD_VARIABLES = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")
# Parts of scipy that core takes as attributes, so that they are imported when they are first used.
SCIPY_PARTS = ("scipy.fft", "scipy.linalg", "scipy.ndimage", "scipy.sparse", "scipy.spatial")
_PR_SET_PDEATHSIG = 1
# Parts of numpy that scipy names as it is imported, and nobody uses; a sixth of all imports.
_UNUSED = ("numpy.f2py", "numpy.ma", "numpy.testing", "numpy.ctypeslib")


def preload(names: Iterable[str]) -> None:
    """Import modules, and keep all that came of it out of later searches for garbage."""
    gc.disable()
    # The kernel ends this process with its parent: in an import it would notice too late.
    signal_at_parent_death(signal.SIGKILL)
    for name in _UNUSED:
        with suppress(Exception):
            import_when_used(name)
    for name in names:
        with suppress(Exception):
            import_module(name)
    if "scipy" in sys.modules:
        for name in SCIPY_PARTS:
            import_module(name)
    signal_at_parent_death(0)
    gc.enable()
    gc.freeze()
    if "numpy.random" in sys.modules:
        # Who draws without a generator of its own must not draw what its neighbours draw.
        os.register_at_fork(after_in_child=sys.modules["numpy.random"].seed)


def import_when_used(name: str) -> None:
    """Have a part of a package there, and imported once something in it is asked for."""
    spec = find_spec(name)
    loader = getattr(spec, "loader", None)
    if spec is None or loader is None or name in sys.modules:
        return
    spec.loader = LazyLoader(loader)
    module = sys.modules[name] = module_from_spec(spec)
    spec.loader.exec_module(module)
    package, _, part = name.rpartition(".")
    setattr(sys.modules[package], part, module)


def open_closed_streams() -> None:
    """Have a standard stream that was closed lead to nowhere.

    Otherwise the next file or socket has its number, here or in a process that is started.
    """
    for name in ("stdin", "stdout", "stderr"):
        if getattr(sys, name) is None:  # so Python says that it was closed
            mode = "r" if name == "stdin" else "w"
            stream = open(os.devnull, mode, encoding="utf-8")  # noqa: SIM115 (open to the end)
            os.set_inheritable(stream.fileno(), True)  # the lowest free number: its own
            setattr(sys, name, stream)


def signal_at_parent_death(number: int) -> None:
    """Have the kernel send this process a signal when its parent dies; 0 sends none."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, int(number))


if PRELOAD_VARIABLE in os.environ:
    os.environ.pop(SAFE_PATH_VARIABLE, None)  # it is not for the programs that a node starts
    preload(os.environ.pop(PRELOAD_VARIABLE).split())
