"""Short reprs of records that hold arrays, for notebooks: a shape in place of the numbers.

It rests on nothing, so that core and messages, which know nothing of each other, both use it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from typing import Any, TypeVar

MAX_ITEMS = 6  # Entries of a list or map, or numbers of an array, that are written out
MAX_FIELD = 80  # Characters of one field
MAX_LENGTH = 900  # Characters of a record
Record = TypeVar("Record")


def readable(cls: type[Record]) -> type[Record]:
    """Give a dataclass or a named tuple a repr of one line of at most 900 characters."""
    setattr(cls, "__repr__", short_repr)  # noqa: B010 (checkers refuse to assign to a method)
    return cls


def short_repr(record: Any) -> str:
    """A dataclass or named tuple in one line, with arrays as their shapes."""
    if is_dataclass(record):
        names: tuple[str, ...] = tuple(one.name for one in fields(record) if one.repr)
    else:
        names = record._fields
    parts = (f"{name}={_value(getattr(record, name))}" for name in names)
    return f"{type(record).__name__}({_cut(', '.join(parts), MAX_LENGTH)})"


def _value(value: Any) -> str:
    shape = getattr(value, "shape", None)
    if isinstance(shape, tuple) and hasattr(value, "dtype"):
        if 0 < value.size <= MAX_ITEMS and len(shape) == 1:
            return f"[{', '.join(_value(item) for item in value.tolist())}]"
        return f"<{value.dtype} {shape}>" if shape else repr(value.item())
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, Mapping | tuple | list) and len(value) > MAX_ITEMS:
        return f"<{type(value).__name__} of {len(value)}>"
    if isinstance(value, Mapping):
        return f"{{{', '.join(f'{key!r}: {_value(item)}' for key, item in value.items())}}}"
    if type(value) in (tuple, list):
        return f"({', '.join(map(_value, value))})"
    if isinstance(value, str | bytes):
        return _cut(repr(value[: 2 * MAX_FIELD]), MAX_FIELD)
    return _cut(" ".join(repr(value).split()), MAX_FIELD)


def _cut(text: str, most: int) -> str:
    return text if len(text) <= most else f"{text[: most - 3]}..."
