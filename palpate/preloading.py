"""Imports of nodes, made once in the fork server before all nodes.

The fork server imports this module with `PRELOAD_VARIABLE` set. Modules that cannot be imported are
left to their nodes, which report the error.
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

# Environment variables: names of modules, separated by blanks; and to ignore the current folder.
PRELOAD_VARIABLE = "PALPATE_PRELOAD"
SAFE_PATH_VARIABLE = "PYTHONSAFEPATH"
# Environment variables of the number of threads of linear algebra, read when numpy is imported.
THREAD_VARIABLES = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")
# Parts of scipy that core uses as attributes, which are imported at their first use.
SCIPY_PARTS = ("scipy.fft", "scipy.linalg", "scipy.ndimage", "scipy.sparse", "scipy.spatial")
_PR_SET_PDEATHSIG = 1  # of prctl(2)
# Unused parts of numpy that scipy imports, a sixth of all imports.
_UNUSED = ("numpy.f2py", "numpy.ma", "numpy.testing", "numpy.ctypeslib")


def preload(names: Iterable[str]) -> None:
    """Import modules, and exclude their objects from garbage collection."""
    gc.disable()
    # The kernel ends this process with its parent, also during an import.
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
        # Processes must not share the state of the global generator.
        os.register_at_fork(after_in_child=sys.modules["numpy.random"].seed)


def import_when_used(name: str) -> None:
    """Import a part of a package at the first use of its attributes."""
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
    """Open closed standard streams to the null device.

    Otherwise the next file or socket, here or in a new process, would get their numbers.
    """
    for name in ("stdin", "stdout", "stderr"):
        if getattr(sys, name) is None:  # it was closed
            mode = "r" if name == "stdin" else "w"
            stream = open(os.devnull, mode, encoding="utf-8")  # noqa: SIM115 (open to the end)
            os.set_inheritable(stream.fileno(), True)  # the lowest free number: its own
            setattr(sys, name, stream)


def signal_at_parent_death(number: int) -> None:
    """Let the kernel send this process a signal when its parent dies; 0: no signal."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, int(number))


if PRELOAD_VARIABLE in os.environ:
    os.environ.pop(SAFE_PATH_VARIABLE, None)  # programs of nodes must not inherit it
    preload(os.environ.pop(PRELOAD_VARIABLE).split())
