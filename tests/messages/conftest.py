from __future__ import annotations

import dataclasses
from collections.abc import Callable
from types import NoneType
from typing import Any, Literal, get_args, get_origin, get_type_hints

import numpy as np
import pytest

from palpate.messages.quantity import Array


def _value(hint: Any, rng: np.random.Generator) -> Any:
    """Some value that a field of this type may have."""
    for mark in getattr(hint, "__metadata__", ()):
        if isinstance(mark, Array):
            shape = [int(rng.integers(1, 5)) if n is None else n for n in mark.shape]
            return (rng.normal(size=shape) * 3).astype(mark.dtype)
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
    values = {
        bool: bool(rng.integers(2)),
        int: int(rng.integers(-(1 << 62), 1 << 62)),
        float: float(rng.normal()),
        str: "ein Grund, µm",
    }
    return values[plain]


@pytest.fixture
def example() -> Callable[[type, int], Any]:
    """Makes a message of any type from a seed."""

    def make(cls: type, seed: int = 0) -> Any:
        rng = np.random.default_rng(seed)
        hints = get_type_hints(cls, include_extras=True)
        names = [field.name for field in dataclasses.fields(cls)]
        return cls(**{name: _value(hints[name], rng) for name in names})

    return make
