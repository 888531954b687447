"""Whether a value can be what a field is declared to hold; a true one is never refused."""

from __future__ import annotations

import collections.abc
import types
from functools import cache
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

import numpy as np

NUMBERS: dict[type, tuple[type, ...]] = {
    float: (float, int, np.floating, np.integer),
    int: (int, np.integer),
    bool: (bool, np.bool_),
}
"""What stands for each kind of number."""


@cache
def declared(kind: type) -> dict[str, Any]:
    """What the fields of a class are declared to hold; nothing where that cannot be told."""
    try:
        return get_type_hints(kind)
    except NameError:  # a name that is imported for checkers alone
        return {}


def fits(value: object, hint: Any) -> bool:
    """Whether a value may be held by what is declared so; True for what is not understood."""
    origin, args = get_origin(hint), get_args(hint)
    if hint is Any:
        return True
    if origin in (Union, types.UnionType):
        return any(fits(value, arg) for arg in args)
    if origin is Literal:
        return value in args
    if origin is tuple:
        return isinstance(value, tuple) and _tuple_fits(value, args)
    if origin in (list, collections.abc.Sequence):
        return isinstance(value, list | tuple) and all(fits(item, args[0]) for item in value)
    if origin in (dict, collections.abc.Mapping):
        return isinstance(value, dict) and all(fits(item, args[1]) for item in value.values())
    if origin is np.ndarray:
        return isinstance(value, np.ndarray)
    if hint is None or hint is type(None):
        return value is None
    if isinstance(hint, type) and not getattr(hint, "_is_protocol", False):
        return isinstance(value, NUMBERS.get(hint, (hint,)))
    return value is not None


def _tuple_fits(value: tuple[object, ...], args: tuple[Any, ...]) -> bool:
    if len(args) == 2 and args[1] is ...:
        return all(fits(item, args[0]) for item in value)
    return len(value) == len(args) and all(map(fits, value, args))
