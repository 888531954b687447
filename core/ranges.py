"""Ranges of a description's numbers: declared beside each field, checked in one place."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import cache
from typing import Any, NamedTuple, get_type_hints


class Range(NamedTuple):
    """What a number may be, in which unit; both ends belong to it. ``"1"`` is no unit."""

    low: float
    """Smallest value."""
    high: float
    """Largest value."""
    unit: str
    """Its unit."""

    def __str__(self) -> str:
        unit = "" if self.unit == "1" else f" {self.unit}"
        return f"{self.low:g} to {self.high:g}{unit}"


def ranges_of(described: type) -> Mapping[str, Range]:
    """The ranges that a dataclass declares: ``sigma: Annotated[float, Range(0, 1, "m")]``."""
    return _ranges_of(described)


def check_ranges(value: Any) -> None:
    """Refuse a dataclass with a number outside its range; call it in ``__post_init__``.

    Raises
    ------
    ValueError
        With the field, its value, the range and the unit.
    """
    described: type = type(value)
    for name, allowed in _ranges_of(described).items():
        number = getattr(value, name)
        if number is None:  # an optional number that was left out
            continue
        if not math.isfinite(number) or not allowed.low <= number <= allowed.high:
            unit = "" if allowed.unit == "1" else f" {allowed.unit}"
            raise ValueError(f"{name} is {number:g}{unit}; expected {allowed}")


@cache
def _ranges_of(described: type) -> Mapping[str, Range]:
    found = {}
    for name, kind in get_type_hints(described, include_extras=True).items():
        for note in getattr(kind, "__metadata__", ()):
            if isinstance(note, Range):
                found[name] = note
    return found
