"""Differences between recorded messages and messages published now, field by field."""

from __future__ import annotations

import dataclasses
import math
from collections import deque
from collections.abc import Iterator
from typing import Any, Literal

import numpy as np

from palpate.messages import CodecError, decode, first_difference, schema, shortened

# Changes that are counted instead of measured: arrays of another shape, tables with other keys,
# elements of a mask, texts and the like, and bodies that differ with equal values.
ChangeKind = Literal["shape", "keys", "element", "value", "byte"]
POSE_UNITS = {"m, 1": ("m",) * 3 + ("1",) * 4}  # units of single numbers, where a field names fewer


class TopicComparison:
    """Compares the messages of one topic; holds those that wait for their counterpart."""

    def __init__(self, topic: str, cls: type) -> None:
        self.topic = topic
        self.compared = self.differ = 0  # numbers of compared messages, and of those that differ
        # Numbers of messages that were only recorded, and that are only published now.
        self.fewer = self.more = 0
        self.changes = TopicChanges(cls)  # field by field
        self.first = ""  # the first difference, in words; empty without one
        self._cls = cls
        self._then, self._now = deque[bytes](), deque[bytes]()
        self._silent, self._unpublished = False, 0

    def recorded(self, body: bytes) -> None:
        """Take the next recorded message."""
        self._then.append(body)
        self._compare()
        if self._silent:
            self.fall_silent()

    def add_published(self, body: bytes) -> None:
        """Take the next message published now."""
        self._now.append(body)
        self._compare()

    def fall_silent(self) -> None:
        """Count recorded messages from now on without holding them: no more are published."""
        self._silent = True
        self._unpublished += len(self._then)
        self._then.clear()

    def end(self, *, closed: bool) -> None:
        """Count messages without counterpart, if the recording is complete."""
        if not closed:
            return
        self.fewer, self.more = self._unpublished + len(self._then), len(self._now)
        if not self.first and (self.fewer or self.more):
            fewer, more = "recorded, but not published again", "published now, but not recorded"
            self.first = f"{self.topic} {self.compared}: {fewer if self.fewer else more}"

    def figures(self) -> dict[str, Any]:
        """Counts and changes as JSON values."""
        counts = {name: getattr(self, name) for name in ("compared", "differ", "fewer", "more")}
        return {
            **counts,
            "fields": {k: change.figures() for k, change in self.changes.fields.items()},
        }

    def _compare(self) -> None:
        if not (self._then and self._now):
            return
        then, now, seq = self._then.popleft(), self._now.popleft(), self.compared
        self.compared += 1
        if then == now:
            return
        self.differ += 1
        self.changes.add(seq, then, now)
        difference = None if self.first else first_difference(self._cls, then, now)
        if difference is not None:
            field, before, after = difference
            self.first = f"{self.topic} {seq} {field}: recorded {before}, now {after}"


@dataclasses.dataclass(slots=True)
class ChangeNote:
    """Changes without a size."""

    count: int
    then: str  # before the first of them
    now: str  # after it


@dataclasses.dataclass(slots=True)
class FieldChange:
    """Changes of one field of the messages of a topic.

    Sizes are over all numbers of the field in the messages in which it differs.
    """

    unit: str  # of the numbers; empty if the field is no quantity
    first: int  # sequence number of the first message in which the field differs
    differ: int = 0  # messages in which the field differs
    numbers: int = 0  # measured numbers
    largest: float = 0.0  # absolute change of a number
    squares: float = 0.0  # sum of the squared changes
    # Changes without a size.
    notes: dict[ChangeKind, ChangeNote] = dataclasses.field(default_factory=dict)

    @property
    def rms(self) -> float:
        """Root mean square change of a number."""
        return math.sqrt(self.squares / self.numbers) if self.numbers else 0.0

    def figures(self) -> dict[str, Any]:
        """The changes as JSON values."""
        sizes = (self.largest, self.rms) if self.numbers else (math.nan, math.nan)
        largest, rms = (size if math.isfinite(size) else None for size in sizes)
        notes = {kind: dataclasses.asdict(note) for kind, note in self.notes.items()}
        counts = {"unit": self.unit, "first": self.first, "differ": self.differ}
        return {**counts, "largest": largest, "rms": rms, "notes": notes}

    def measure(self, then: Any, now: Any) -> None:
        """Add a number, or an array of numbers, that differs."""
        with np.errstate(over="ignore"):  # a change beyond all floats is infinite
            change = np.asarray(now, np.float64) - np.asarray(then, np.float64)
            self.squares += float(np.square(change).sum())
        self.numbers += change.size
        self.largest = max(self.largest, float(np.abs(change).max()))

    def note(self, kind: ChangeKind, count: int, then: str, now: str) -> None:
        """Add changes without a size."""
        self.notes.setdefault(kind, ChangeNote(0, then, now)).count += count


class TopicChanges:
    """Changes of the messages of one topic."""

    def __init__(self, cls: type) -> None:
        self._cls = cls
        self._fields: dict[str, FieldChange] = {}
        self._units = {name: _unit(rule) for name, rule in schema(cls)["properties"].items()}
        self._seq = 0
        self._touched: set[str] = set()

    @property
    def fields(self) -> dict[str, FieldChange]:
        """Changes by field, in the order of the type; parts with different units are separate."""
        order = ["bytes", *self._units]
        names = sorted(self._fields, key=lambda name: order.index(name.partition("[")[0]))
        return {name: self._fields[name] for name in names}

    def add(self, seq: int, then: bytes, now: bytes) -> None:
        """Add two bodies that differ: of the message `seq` then and now."""
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
            self._change(name).note("value", 1, shortened(then), shortened(now))

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
            else:  # a mask, or packed bytes
                changed = before != after
                first = (shortened(values[changed][0].item()) for values in (before, after))
                self._change(name + part).note("element", int(changed.sum()), *first)

    def _compare_tables(self, name: str, then: dict[str, float], now: dict[str, float]) -> None:
        if then.keys() != now.keys():
            lost, new = sorted(then.keys() - now.keys()), sorted(now.keys() - then.keys())
            self._change(name).note("keys", 1, shortened(lost), shortened(new))
        for key in sorted(then.keys() & now.keys()):
            if repr(then[key]) != repr(now[key]):
                self._change(f"{name}[{key!r}]").measure(then[key], now[key])

    def _change(self, field: str, unit: str = "") -> FieldChange:
        """The change of a field in which the current message differs."""
        change = self._fields.setdefault(field, FieldChange(unit, self._seq))
        change.unit = change.unit or unit
        change.differ += field not in self._touched
        self._touched.add(field)
        return change


def _unit(described: dict[str, Any]) -> str:
    """The unit in the schema of a field, also of one that can be null."""
    unit: str = described.get("unit") or described.get("anyOf", [{}])[0].get("unit", "")
    return unit


def _is_number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def _parts(unit: str, shape: tuple[int, ...]) -> Iterator[tuple[str, slice, str]]:
    """Parts of an array with one unit each: suffix of the field's name, slice and unit."""
    units = POSE_UNITS.get(unit, tuple(unit.split(", ")))
    if len(units) == 1 or (len(units),) != shape:
        yield "", slice(None), unit
        return
    start = 0
    for end in range(1, len(units) + 1):
        if end == len(units) or units[end] != units[start]:
            where = str(start) if end == start + 1 else f"{start}:{end}"
            yield f"[{where}]", slice(start, end), units[start]
            start = end
