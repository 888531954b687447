"""Short representations of records with arrays, for notebooks: shapes in place of numbers.

This module imports no other part of palpate, so that both core and messages can use it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from typing import Any, TypeVar

Record = TypeVar("Record")


def readable(cls: type[Record]) -> type[Record]:
    """Decorator: give a dataclass or a named tuple the representation of `short_repr`."""
    setattr(cls, "__repr__", short_repr)  # noqa: B010 (checkers refuse to assign to a method)
    return cls


def short_repr(record: Any, max_length: int = 900) -> str:
    """A dataclass or named tuple in one line of `max_length` characters, with shapes of arrays."""
    if is_dataclass(record):
        names: tuple[str, ...] = tuple(field.name for field in fields(record) if field.repr)
    else:
        names = record._fields
    parts = (f"{name}={_value(getattr(record, name))}" for name in names)
    return f"{type(record).__name__}({_cut(', '.join(parts), max_length)})"


def _value(value: Any, max_items: int = 6, max_chars: int = 80) -> str:
    """A field of `max_chars` characters; arrays and lists of `max_items` are written out."""
    shape = getattr(value, "shape", None)
    if isinstance(shape, tuple) and hasattr(value, "dtype"):
        if 0 < value.size <= max_items and len(shape) == 1:
            return f"[{', '.join(_value(item) for item in value.tolist())}]"
        return f"<{value.dtype} {shape}>" if shape else repr(value.item())
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, Mapping | tuple | list) and len(value) > max_items:
        return f"<{type(value).__name__} of {len(value)}>"
    if isinstance(value, Mapping):
        return f"{{{', '.join(f'{key!r}: {_value(item)}' for key, item in value.items())}}}"
    if type(value) in (tuple, list):
        return f"({', '.join(map(_value, value))})"
    if isinstance(value, str | bytes):
        return _cut(repr(value[: 2 * max_chars]), max_chars)
    return _cut(" ".join(repr(value).split()), max_chars)


def _cut(text: str, max_chars: int) -> str:
    return text if len(text) <= max_chars else f"{text[: max_chars - 3]}..."
