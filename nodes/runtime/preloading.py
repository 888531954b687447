"""What a node needs is imported before its first message, and once for all that are forked.

The server that forks the nodes imports this module with `PRELOAD_VARIABLE` set. What cannot be
imported is left to the node that wants it, which says in words what is wrong.
"""

from __future__ import annotations

import ast
import ctypes
import gc
import inspect
import os
import signal
import sys
from collections.abc import Iterable
from contextlib import suppress
from importlib import import_module
from types import ModuleType

# Variable of the environment with the names of the modules, between blanks.
PRELOAD_VARIABLE = "PALPATE_PRELOAD"
_PR_SET_PDEATHSIG = 1


def preload(names: Iterable[str]) -> None:
    """Import modules, and keep all that came of it out of later searches for garbage."""
    gc.disable()
    # The kernel ends this process with its parent: in an import it would notice too late.
    signal_at_parent_death(signal.SIGKILL)
    for name in names:
        with suppress(Exception):
            import_whole(name)
    signal_at_parent_death(0)
    gc.enable()
    gc.freeze()
    if "numpy.random" in sys.modules:
        # Who draws without a generator of its own must not draw what its neighbours draw.
        os.register_at_fork(after_in_child=sys.modules["numpy.random"].seed)


def import_whole(name: str) -> None:
    """Import a module, and what its functions take from rooms, which import only when asked.

    Raises what the imports raise.
    """
    module = import_module(name)
    rooms = {key: one for key, one in vars(module).items() if isinstance(one, ModuleType)}
    with suppress(OSError, TypeError):  # no source, no look ahead: the first message takes longer
        for taken in ast.walk(ast.parse(inspect.getsource(module))):
            match taken:
                case ast.Attribute(ast.Name(key), attribute) if key in rooms:
                    getattr(rooms[key], attribute, None)


def signal_at_parent_death(number: int) -> None:
    """Have the kernel send this process a signal when its parent dies; 0 sends none."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, int(number))


if PRELOAD_VARIABLE in os.environ:
    preload(os.environ.pop(PRELOAD_VARIABLE).split())
