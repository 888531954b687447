"""Which classes an archive may hold: dataclasses and named tuples of `palpate.core`, by name."""

from __future__ import annotations

import dataclasses
import importlib
import importlib.util
import re
from typing import Any

HOME = "palpate.core."
"""Where all of them live."""
NAME = re.compile(r"[a-z_0-9]+(\.[a-z_0-9]+)*:[A-Za-z_][A-Za-z_0-9]*")
"""Module below `HOME`, and class."""
LONGEST = 200
"""Name, in letters."""


def name_of(kind: type) -> str | None:
    """Name of a class in archives; None if they do not hold it."""
    if not (kind.__module__.startswith(HOME) and _is_record(kind)):
        return None
    return f"{kind.__module__.removeprefix(HOME)}:{kind.__qualname__}"


def class_named(name: str) -> Any:
    """The class of a name.

    Raises
    ------
    ValueError
        If there is no such class, or archives do not hold it.
    """
    refused = ValueError(f"archives hold no class {name!r:.80}")
    if len(name) > LONGEST or not NAME.fullmatch(name):
        raise refused
    module, _, kind = name.partition(":")
    try:
        found = getattr(importlib.import_module(HOME + module), kind, None)
    except ModuleNotFoundError:
        raise refused from None
    # Not what a module merely imports: a class has one name.
    if not isinstance(found, type) or name_of(found) != name:
        raise refused
    return found


def field_names(kind: type) -> tuple[str, ...]:
    """Fields with which an instance is made; others are computed from them."""
    if dataclasses.is_dataclass(kind):
        return tuple(field.name for field in dataclasses.fields(kind) if field.init)
    fields: tuple[str, ...] = kind._fields  # type: ignore[attr-defined]
    return fields


def _is_record(kind: type) -> bool:
    return dataclasses.is_dataclass(kind) or (issubclass(kind, tuple) and hasattr(kind, "_fields"))
