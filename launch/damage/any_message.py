"""Messages of any type, drawn at random within what the type allows."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from types import NoneType
from typing import Any, Literal, get_args, get_origin, get_type_hints

import numpy as np

from palpate.messages.quantity import Array


def any_message(cls: type, rng: np.random.Generator) -> Any:
    """Some message of a type, every field of which is drawn."""
    hints = get_type_hints(cls, include_extras=True)
    names = [field.name for field in dataclasses.fields(cls)]
    return cls(**{name: _value(hints[name], rng) for name in names})


def _value(hint: Any, rng: np.random.Generator) -> Any:
    for mark in getattr(hint, "__metadata__", ()):
        if isinstance(mark, Array):
            shape = [int(rng.integers(1, 5)) if n is None else n for n in mark.shape]
            return (3.0 * rng.normal(size=shape)).astype(mark.dtype)
    plain = get_args(hint)[0] if hasattr(hint, "__metadata__") else hint
    origin, args = get_origin(plain), get_args(plain)
    if NoneType in args:
        return _value(args[0], rng) if rng.integers(4) else None
    if origin is Literal:
        return args[int(rng.integers(len(args)))]
    if origin is tuple:
        return tuple(_value(args[0], rng) for _ in range(int(rng.integers(0, 4))))
    if origin is dict:
        return {f"figure {i}": float(rng.normal()) for i in range(3)}
    return _PLAIN[plain](rng)


_PLAIN: dict[type, Callable[[np.random.Generator], Any]] = {
    bool: lambda rng: bool(rng.integers(2)),
    int: lambda rng: int(rng.integers(-(1 << 62), 1 << 62)),
    float: lambda rng: float(rng.normal()),
    str: lambda rng: "a reason, µm"[: int(rng.integers(1, 13))],
}
"""Values of fields without structure."""
