"""What a room shows: names that are imported when somebody first asks for them.

The ``__init__`` of a room lists its exports once, as imports under ``TYPE_CHECKING``, which type
checkers and editors read. At run time the same list says where each name comes from, so that a
node that starts pays only for the chapters it uses (PEP 562).
"""

from __future__ import annotations

import ast
import sys
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING as TYPE_CHECKING
from typing import Any


def lazy(room: str) -> tuple[Callable[[str], Any], Callable[[], list[str]]]:
    """``__getattr__`` and ``__dir__`` of a room, whose exports stand under ``if TYPE_CHECKING:``.

    ``__all__`` is among the attributes: the names that the room exports, for ``import *`` and
    ``help``. What is returned raises AttributeError if the room exports no such name.
    """
    module = sys.modules[room]
    homes: dict[str, str] = {}

    def read() -> dict[str, str]:
        if not homes:
            homes.update(_exports(Path(str(module.__file__)).read_text(encoding="utf-8")))
        return homes

    def get(name: str) -> Any:
        if name == "__all__":
            return sorted(read())
        if name.startswith("__") or name not in read():
            raise AttributeError(f"module {room!r} has no attribute {name!r}")
        home = homes[name]
        inner = home == room  # a room within this one
        found = import_module(f"{room}.{name}") if inner else getattr(import_module(home), name)
        setattr(module, name, found)  # Asked once a name: what comes later finds it without us.
        return found

    return get, lambda: sorted({*read(), *filter(_is_special, vars(module))})


def _is_special(name: str) -> bool:
    return name.startswith("__") and name.endswith("__")


def _exports(source: str) -> dict[str, str]:
    """Names exported by the source of a room, and the modules they come from."""
    return {
        alias.name: str(statement.module)
        for block in ast.parse(source).body
        if isinstance(block, ast.If)
        for statement in block.body
        if isinstance(statement, ast.ImportFrom)
        for alias in statement.names
    }
