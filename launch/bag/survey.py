"""What all messages of a topic have in common: shapes of arrays, and names in tables.

A table has as many columns in its last row as in its first: they are known after a first reading.
"""

from __future__ import annotations

import dataclasses
from typing import Any

from palpate.messages.codec import schema

FIRST = "robot_time"
"""The field that comes first."""


@dataclasses.dataclass(slots=True)
class Survey:
    """One topic, as far as it has been read."""

    cls: type
    count: int = 0
    """Messages."""
    shapes: dict[str, tuple[int, ...] | None] = dataclasses.field(default_factory=dict)
    """Shape of each array, a list's being its length; None if it varies."""
    names: dict[str, dict[str, None]] = dataclasses.field(default_factory=dict)
    """Names that occur in each table, in the order of their first mention."""

    def fields(self) -> list[str]:
        """The fields of a message, robot time first."""
        names = [field.name for field in dataclasses.fields(self.cls)]
        return sorted(names, key=lambda name: name != FIRST)

    def add(self, message: Any) -> None:
        """Look at one more message."""
        for name in self.fields():
            value = getattr(message, name)
            if isinstance(value, dict):
                self.names.setdefault(name, {}).update(dict.fromkeys(value))
            elif (shape := shape_of(value)) is not None:
                same = self.shapes.setdefault(name, shape) == shape
                self.shapes[name] = shape if same else None
        self.count += 1


def shape_of(value: Any) -> tuple[int, ...] | None:
    """Shape of an array or a list; None for anything else."""
    if isinstance(value, tuple):
        return (len(value),)
    shape: tuple[int, ...] | None = getattr(value, "shape", None)
    return shape


def is_list(cls: type, field: str) -> bool:
    """Whether a field is a list of any length, not an array."""
    described: dict[str, Any] = schema(cls)["properties"][field]
    return described.get("type") == "array"


def units_of(cls: type) -> dict[str, str]:
    """Units of the fields that have one."""
    found = {}
    for name, described in schema(cls)["properties"].items():
        unit = described.get("unit") or described.get("anyOf", [{}])[0].get("unit")
        if unit not in (None, "#"):
            found[name] = unit
    return found
