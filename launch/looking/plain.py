"""Messages from plain values, as a user types them."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any, get_type_hints

import numpy as np

from palpate.messages.quantity import Array


def from_plain(cls: type, values: Mapping[str, Any]) -> object:
    """The message of a type whose fields have these values; lists become arrays.

    Raises
    ------
    ValueError
        If fields are missing or unknown, or a list is no such array. What else may be wrong is
        found when the message is encoded.
    """
    hints = get_type_hints(cls, include_extras=True)
    names = [field.name for field in dataclasses.fields(cls)]
    missing = [name for name in names if name not in values]
    unknown = [str(name) for name in values if name not in names]
    if missing or unknown:
        lacks = f"lacks {', '.join(missing)}" if missing else f"has no {', '.join(unknown)}"
        raise ValueError(f"a {cls.__name__} {lacks}; its fields are {', '.join(names)}")
    return cls(**{name: _value(name, hints[name], values[name]) for name in names})


def _value(name: str, hint: Any, value: Any) -> Any:
    array = next((m for m in getattr(hint, "__metadata__", ()) if isinstance(m, Array)), None)
    if array is not None:
        kind = np.dtype(array.dtype)
        try:
            made = np.array(value, kind)
        except (TypeError, ValueError, OverflowError):
            raise ValueError(f"{name} must be an array of {kind}, got {value!r:.60}") from None
        empty = made.size == 0 and made.ndim != len(array.shape)
        return made.reshape([n or 0 for n in array.shape]) if empty else made
    if isinstance(value, int) and not isinstance(value, bool) and "float" in str(hint):
        return float(value)
    return tuple(value) if isinstance(value, list) else value
