"""What has changed between messages of one topic, field by field, and by how much."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator
from typing import Any, Literal

import numpy as np

from palpate.messages.codec import decode, schema
from palpate.messages.fields import CodecError
from palpate.messages.recording.difference import short

Kind = Literal["shape", "keys", "element", "value", "byte"]
"""What is not measured but counted: arrays of another shape, tables with other keys, elements of a
mask, texts and the like, and bodies that differ though their values do not."""
POSE = {"m, 1": ("m",) * 3 + ("1",) * 4}
"""Units of single numbers, where a field names fewer than it has numbers: a pose."""


@dataclasses.dataclass(slots=True)
class Note:
    """Changes that have no size."""

    count: int
    """How many."""
    then: str
    """Before the first of them."""
    now: str
    """After it."""


@dataclasses.dataclass(slots=True)
class FieldChange:
    """What has become of one field of a topic's messages.

    Numbers are measured over all numbers of the field in the messages in which it differs.
    """

    unit: str
    """Unit of the numbers; empty if it is no quantity."""
    first: int
    """Sequence of the first message in which it differs."""
    differ: int = 0
    """Messages in which it differs."""
    numbers: int = 0
    """Numbers that were measured."""
    largest: float = 0.0
    """The largest absolute change of a number."""
    squares: float = 0.0
    """Sum of the squared changes."""
    notes: dict[Kind, Note] = dataclasses.field(default_factory=dict)
    """What was counted."""

    @property
    def rms(self) -> float:
        """Root mean square change of a number."""
        return math.sqrt(self.squares / self.numbers) if self.numbers else 0.0

    def measure(self, then: Any, now: Any) -> None:
        """Take up a number, or an array of numbers, that differs."""
        with np.errstate(over="ignore"):  # beyond all floats it is infinite, and shown like that
            change = np.asarray(now, np.float64) - np.asarray(then, np.float64)
            self.squares += float(np.square(change).sum())
        self.numbers += change.size
        self.largest = max(self.largest, float(np.abs(change).max()))

    def note(self, kind: Kind, count: int, then: str, now: str) -> None:
        """Take up changes that have no size."""
        if kind in self.notes:
            self.notes[kind].count += count
        else:
            self.notes[kind] = Note(count, then, now)


class TopicChanges:
    """The changes of one topic's messages.

    Parameters
    ----------
    cls : type
        The message type.
    """

    def __init__(self, cls: type) -> None:
        self._cls = cls
        self._fields: dict[str, FieldChange] = {}
        self._units = {name: _unit(one) for name, one in schema(cls)["properties"].items()}
        self._seq = 0
        self._touched: set[str] = set()

    @property
    def fields(self) -> dict[str, FieldChange]:
        """In the order of the type; a field by its parts if these have different units."""
        places = {name: place for place, name in enumerate(self._units)}
        names = sorted(self._fields, key=lambda name: places.get(name.partition("[")[0], -1))
        return {name: self._fields[name] for name in names}

    def add(self, seq: int, then: bytes, now: bytes) -> None:
        """Take up two bodies that differ; they are the message `seq` then and now."""
        self._seq, self._touched = seq, set()
        try:
            before: Any = decode(self._cls, then)
            after: Any = decode(self._cls, now)
        except CodecError as error:
            self._change("bytes").note("byte", 1, f"{len(then)} bytes", str(error))
            return
        for name in self._units:
            self._compare(name, getattr(before, name), getattr(after, name))
        if not self._touched:
            self._change("bytes").note("byte", 1, f"{len(then)} bytes", f"{len(now)} bytes")

    def _compare(self, name: str, then: Any, now: Any) -> None:
        if isinstance(then, np.ndarray) and isinstance(now, np.ndarray):
            self._compare_arrays(name, then, now)
        elif isinstance(then, dict) and isinstance(now, dict):
            self._compare_tables(name, then, now)
        elif repr(then) == repr(now):
            return
        elif _is_number(then) and _is_number(now):
            self._change(name, self._units[name]).measure(then, now)
        else:
            self._change(name).note("value", 1, short(then), short(now))

    def _compare_arrays(self, name: str, then: Any, now: Any) -> None:
        if then.shape != now.shape:
            self._change(name).note("shape", 1, str(then.shape), str(now.shape))
            return
        for part, where, unit in _parts(self._units[name], then.shape):
            before, after = then[where], now[where]
            if before.tobytes() == after.tobytes():
                continue
            if then.dtype.kind in "fi":
                self._change(name + part, unit).measure(before, after)
            else:  # a mask, or bytes that mean something only to who packed them
                other = before != after
                first = (short(one[other][0].item()) for one in (before, after))
                self._change(name + part).note("element", int(other.sum()), *first)

    def _compare_tables(self, name: str, then: dict[str, float], now: dict[str, float]) -> None:
        if then.keys() != now.keys():
            lost, new = sorted(then.keys() - now.keys()), sorted(now.keys() - then.keys())
            self._change(name).note("keys", 1, short(lost), short(new))
        for key in sorted(then.keys() & now.keys()):
            if repr(then[key]) != repr(now[key]):
                self._change(f"{name}[{key!r}]").measure(then[key], now[key])

    def _change(self, field: str, unit: str = "") -> FieldChange:
        """The change of a field, in which the message differs."""
        change = self._fields.setdefault(field, FieldChange(unit, self._seq))
        change.unit = change.unit or unit
        change.differ += field not in self._touched
        self._touched.add(field)
        return change


def _is_number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def _unit(described: dict[str, Any]) -> str:
    """The unit in the schema of a field, which may be one that can be null."""
    unit: str = described.get("unit") or described.get("anyOf", [{}])[0].get("unit", "")
    return unit


def _parts(unit: str, shape: tuple[int, ...]) -> Iterator[tuple[str, slice, str]]:
    """Stretches of an array with one unit each, and what is put behind the field's name."""
    units = POSE.get(unit, tuple(unit.split(", ")))
    if len(units) == 1 or (len(units),) != shape:
        yield "", slice(None), unit
        return
    start = 0
    for end in range(1, len(units) + 1):
        if end == len(units) or units[end] != units[start]:
            where = str(start) if end == start + 1 else f"{start}:{end}"
            yield f"[{where}]", slice(start, end), units[start]
            start = end
