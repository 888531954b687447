"""The messages of a topic as they come, filtered: YAML for people and CSV for programs.

A filter like ``touch > 3 and outcome == 'hit'`` compares fields with values, joined by ``and``,
``or`` and brackets; nothing is run. Losses are counted.
"""

from __future__ import annotations

import ast
import csv
import io
import json
import math
import operator
import re
import textwrap
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from itertools import islice
from typing import Any, NamedTuple

import numpy as np

from palpate.launch.files.source_map import hint
from palpate.launch.printing import TEXT_WIDTH, text_table
from palpate.launch.processes.registry import RunCard
from palpate.messages import codec_of, schema
from palpate.tools.introspection.topics import TapMessage, TapSubscription, Topic, message_of

FOLDED = 4  # Columns before what of a sequence stands on its further lines
MAX_ITEMS = 16  # A sequence with more elements is shortened, unless all is wanted
ITEMS_SHOWN = 3  # Elements of a shortened sequence that are shown
# Texts that need no quotes in YAML.
_PLAIN = re.compile(r"[A-Za-z_/][A-Za-z0-9_/. -]*[A-Za-z0-9_/.]|[A-Za-z_/]")
_MEANS_MORE = frozenset({"true", "false", "null", "yes", "no", "on", "off", "y", "n"})
_DTYPES = {"<f8": "float64", "<i4": "int32", "|u1": "uint8", "|b1": "bool"}
Sequence = np.ndarray[Any, Any] | tuple[Any, ...] | list[Any]
LOSS_INTERVAL = 1.0  # Losses are told at most this often, s
QUIET_TIME = 3.0  # If nothing has come for so long, that is told, s
Echo = Callable[[str], None]
MessageFilter = Callable[[Mapping[str, Any]], bool]  # Whether a message, by its fields, is wanted
MAX_FILTER_LENGTH = 1000  # Longest filter, characters
_OPERATORS: dict[type[ast.cmpop], Callable[[Any, Any], bool]] = {
    ast.Eq: operator.eq,
    ast.NotEq: operator.ne,
    ast.LtE: operator.le,
    ast.GtE: operator.ge,
    ast.Lt: operator.lt,
    ast.Gt: operator.gt,
}
_WORDS = {"true": True, "false": False, "null": None}
_NAME = r"[A-Za-z_][A-Za-z0-9_]*"
PATH_PATTERN = rf"{_NAME}(?:\.{_NAME}|\[[0-9]+\])*"  # Pattern of a path
_SHAPE = "a filter looks like touch > 3 and (outcome == 'hit' or pose[2] < 0.01)"
_STEP = re.compile(rf"\.?({_NAME})|\[([0-9]+)\]")
_INDEX_DIGITS = 9  # A longer index is beyond every array, and is not read further


class TextStyle(NamedTuple):
    """How much of a message is shown, and how."""

    arrays: bool = True  # Whether elements of arrays are shown at all
    full: bool = False  # Whether long arrays are shown whole
    flow: bool = False  # Whether each field takes one line, whatever it holds


_WHOLE = TextStyle(full=True)


class EchoFormat(NamedTuple):
    """What is shown of each message, and how."""

    paths: tuple[FieldPath, ...] = ()  # The values wanted; all fields if there is none
    style: TextStyle = TextStyle()
    csv: bool = False
    raw: bool = False  # Whether bytes are shown as they came, unread
    wanted: MessageFilter | None = None  # Which messages are shown; all of them if None
    lacking: Callable[[FieldPath, str | None], None] = lambda path, why: None  # Of each value

    def value(self, path: FieldPath, fields: Mapping[str, Any]) -> Any:
        """The value at a path; None where this message has none, as a list may be too short."""
        try:
            found = path.of(fields)
        except LookupError as error:
            self.lacking(path, str(error.args[0]))
            return None
        self.lacking(path, None)
        return found


class FieldReport:
    """Which of the values that were asked for some message had."""

    def __init__(self, tell: Echo) -> None:
        self._tell = tell
        self._lacking: dict[str, str] = {}
        self._had: set[str] = set()

    def note(self, path: FieldPath, why: str | None) -> None:
        """A message had the value, or lacks it and why; tells of the first that does."""
        if why is None:
            self._had.add(path.text)
        elif path.text not in self._lacking:
            self._lacking[path.text] = why
            self._tell(f"null where there is none: {why}")

    def check(self) -> None:
        """ValueError if no message had one of them."""
        for text, why in self._lacking.items():
            if text not in self._had:
                raise ValueError(f"--field {text}: no message that was shown has it; {why}")


class LossReport:
    """How many messages were sent and not received, told in sentences."""

    def __init__(self, topic: str, tell: Echo) -> None:
        self._topic, self._tell = topic, tell
        self._lost = self._told = 0
        self._due = 0.0

    def add(self, lost: int, now: float) -> None:
        """So many are missing more; tells of it from time to time."""
        self._lost += lost
        if now >= self._due:
            self._due = now + LOSS_INTERVAL
            self.tell()

    def tell(self) -> None:
        """Tell of what has not been told of."""
        if self._lost > self._told:
            self._told = self._lost
            self._tell(f"{self._topic}: {self._lost} messages lost on the way here so far")


def echo_topic(
    card: RunCard,
    topic: Topic,
    form: EchoFormat,
    *,
    most: int | None,
    say: Echo,
    tell: Echo,
    losses: LossReport,
) -> None:
    """Show the messages of a topic until the graph ends, or so many have been shown.

    `say` takes each message, `tell` what is odd. Raises ValueError if what comes is not what the
    topic carries, or cannot be compared as the filter asks.
    """
    report = FieldReport(tell)
    form = form._replace(lacking=report.note)
    with TapSubscription(card, [topic], latched=True) as taps:
        texts = (message_text(topic, one, form) for one in _received(taps, topic, losses, tell))
        for text in islice((text for text in texts if text is not None), most):
            say(text)
    losses.tell()
    report.check()


def _received(
    taps: TapSubscription, topic: Topic, losses: LossReport, tell: Echo
) -> Iterator[TapMessage]:
    quiet: float | None = time.monotonic() + QUIET_TIME
    for batch in taps.batches():
        for received in batch:
            quiet = None
            losses.add(received.lost, time.monotonic())
            yield received
        if quiet is not None and time.monotonic() > quiet:
            quiet = None
            tell(f"nothing has come on {topic.name} yet; only what is latched is repeated")


def message_text(topic: Topic, received: TapMessage, form: EchoFormat) -> str | None:
    """A message as text; None if the filter does not want it."""
    fields = {} if form.raw and form.wanted is None else fields_of(topic, received)
    if form.wanted is not None and not form.wanted(fields):
        return None
    if form.raw:
        return f"{received.body!r}\n---"
    values = [form.value(path, fields) for path in form.paths] or list(fields.values())
    if form.csv:
        return csv_line(values, form.style)
    if not form.paths:
        return "\n".join([*yaml_lines(fields, form.style), "---"])
    shown = [yaml_value(value, form.style) for value in values]
    if len(shown) > 1:
        shown = [f"{p.text}: {text}" for p, text in zip(form.paths, shown, strict=True)]
    return "\n".join([*shown, "---"])


def fields_of(topic: Topic, received: TapMessage) -> dict[str, Any]:
    """Fields of a message and their values; raises ValueError if it is not of the topic's type."""
    found = message_of(topic, received.header, received.body)
    codec = codec_of(type(found))
    return dict(zip(codec.names, codec.values(found), strict=True))


def yaml_lines(fields: Mapping[str, Any], style: TextStyle = _WHOLE) -> Iterator[str]:
    """Fields in YAML, one a line, and so those of tables within them."""
    if style.flow:
        yield yaml_value(fields, style)
        return
    for name, value in fields.items():
        if isinstance(value, Mapping) and value:
            yield f"{_text(name)}:"
            yield from (f"  {line}" for line in yaml_lines(value, style))
        else:
            yield from _folded(f"{_text(name)}: {yaml_value(value, style)}", value)


def _folded(line: str, value: Any) -> list[str]:
    """A line of YAML; of 80 columns, if it is a sequence, as every reader of YAML takes it."""
    if len(line) <= TEXT_WIDTH or not isinstance(value, (np.ndarray, tuple, list)):
        return [line]
    return textwrap.wrap(
        line,
        TEXT_WIDTH - FOLDED,
        subsequent_indent=" " * FOLDED,
        break_long_words=False,
        break_on_hyphens=False,
    )


def csv_line(values: list[Any], style: TextStyle) -> str:
    """Values as one row, arrays and tables spread over as many columns as they have elements."""
    stream = io.StringIO()
    row = [cell for value in values for cell in _cells(value, style)]
    csv.writer(stream, lineterminator="").writerow(row)
    return stream.getvalue()


def _cells(value: Any, style: TextStyle) -> list[Any]:
    if isinstance(value, Mapping):
        return [cell for one in value.values() for cell in _cells(one, style)]
    if isinstance(value, (np.ndarray, tuple, list)):
        if not style.arrays:
            return [_kind(value)]
        return [cell for one in _plain(value) for cell in _cells(one, style)]
    return [value if isinstance(value, str) else _scalar(value)]


def field_lines(cls: type) -> list[str]:
    """One line for each field: name, what it holds, unit."""
    fields = schema(cls)["properties"].items()
    return text_table([(name, "  ".join(filter(None, _described(rule)))) for name, rule in fields])


def _described(rule: dict[str, Any]) -> tuple[str, str]:
    """What a field holds, and its unit."""
    unit = str(rule.get("unit", ""))
    if "dtype" in rule:
        sides = " x ".join("any" if n is None else str(n) for n in rule["shape"])
        return f"{sides} {_DTYPES.get(rule['dtype'], rule['dtype'])}", unit
    if "enum" in rule:
        return " | ".join(map(str, rule["enum"])), unit
    if "anyOf" in rule:
        inner, inner_unit = _described(rule["anyOf"][0])
        return f"{inner} or null", inner_unit
    if rule["type"] == "array":
        inner, inner_unit = _described(rule["items"])
        return f"list of {inner}", inner_unit
    if rule["type"] == "object":
        return "table of number", unit
    return str(rule["type"]), unit


def yaml_value(value: Any, style: TextStyle) -> str:
    """One value in YAML, in one line."""
    if isinstance(value, Mapping):
        inner = (f"{_text(str(key))}: {yaml_value(one, style)}" for key, one in value.items())
        return "{" + ", ".join(inner) + "}"
    if isinstance(value, (np.ndarray, tuple, list)):
        return _sequence(value, style)
    return _scalar(value)


def _sequence(value: Sequence, style: TextStyle) -> str:
    size = value.size if isinstance(value, np.ndarray) else len(value)
    if not style.arrays:
        return _text(_kind(value))
    if size > MAX_ITEMS and not style.full:
        every = value.ravel() if isinstance(value, np.ndarray) else value
        begun = ", ".join(_scalar(one) for one in _plain(every[:ITEMS_SHOWN]))
        return _text(f"{_kind(value)}: {begun}, ...")
    inner = style._replace(full=True)
    return "[" + ", ".join(yaml_value(one, inner) for one in _plain(value)) + "]"


def _kind(value: Sequence) -> str:
    if isinstance(value, np.ndarray):
        return f"{' x '.join(map(str, value.shape))} {value.dtype}"
    return f"{len(value)} {type(value[0]).__name__ if len(value) else 'values'}"


def _scalar(value: Any) -> str:
    if value is None:
        return "null"
    if isinstance(value, int):
        return str(value).lower()  # true and false
    if not isinstance(value, float):
        return _text(str(value))
    if not math.isfinite(value):
        return ".nan" if math.isnan(value) else ".inf" if value > 0 else "-.inf"
    text = repr(value)  # as every reader of YAML takes it for a float
    return text.replace("e", ".0e") if "e" in text and "." not in text else text


def _text(text: str) -> str:
    if _PLAIN.fullmatch(text) and text.lower() not in _MEANS_MORE:
        return text
    return json.dumps(text, ensure_ascii=True)


def _plain(value: Sequence) -> list[Any]:
    return value.tolist() if isinstance(value, np.ndarray) else list(value)


def read_filter(text: str, cls: type) -> MessageFilter:
    """A filter for messages of one type; raises ValueError if it is none, or lacks a field."""
    if len(text) > MAX_FILTER_LENGTH:
        raise ValueError(f"a filter has at most {MAX_FILTER_LENGTH} characters, got {len(text)}")
    source = text.strip()
    try:
        tree = ast.parse(source, mode="eval")  # read, and never run
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        raise ValueError(f"--filter: cannot read {source!r:.60}; {_SHAPE}") from None
    return _filter_of(source, tree.body, cls)


def _filter_of(source: str, node: ast.expr, cls: type) -> MessageFilter:
    """What one part of a filter wants: comparisons, joined by ``and`` or ``or``."""
    match node:
        case ast.BoolOp(op=op, values=values):
            parts = [_filter_of(source, one, cls) for one in values]
            joined = all if isinstance(op, ast.And) else any
            return lambda fields: joined(part(fields) for part in parts)
        case ast.Compare(left=left, ops=[op], comparators=[right]) if type(op) in _OPERATORS:
            path = read_path(_written(source, left), cls)
            return _comparison(path, _OPERATORS[type(op)], _constant(source, right))
    raise ValueError(f"--filter: {_written(source, node)!r:.60} is no comparison; {_SHAPE}")


def _constant(source: str, node: ast.expr) -> Any:
    if isinstance(node, ast.Name) and node.id in _WORDS:
        return _WORDS[node.id]
    with suppress(ValueError):
        value = ast.literal_eval(node)
        if value is None or isinstance(value, int | float | str):
            return value
    got = _written(source, node)
    raise ValueError(f"--filter: expected a number, 'text', true, false or null; got {got!r:.60}")


def _written(source: str, node: ast.expr) -> str:
    return ast.get_source_segment(source, node) or ""


def read_path(text: str, cls: type) -> FieldPath:
    """A path in messages of one type; ``m.`` before it means the message and may be left out.

    Raises ValueError if it cannot be read, or the type has no such field.
    """
    wanted = text.removeprefix("m.")
    if not re.fullmatch(PATH_PATTERN, wanted):
        raise ValueError(
            f"{text!r:.60} is no field; expected something like pose[2] or robot_time: one value, "
            "by an index from 0"
        )
    steps = tuple(
        int(index[: _INDEX_DIGITS + 1]) if index else name for name, index in _STEP.findall(wanted)
    )
    known = codec_of(cls).names
    if steps[0] not in known:
        raise ValueError(f"{cls.__name__} has no field {steps[0]!r}; {hint(str(steps[0]), known)}")
    path = FieldPath(text, steps)
    _check_steps(path, schema(cls)["properties"][steps[0]])
    return path


def _check_steps(path: FieldPath, rule: dict[str, Any]) -> None:
    """Refuse, by a ValueError, what no message can have, by the schema of the first step."""
    shape: list[int | None] = []
    for count, step in enumerate(path.steps[1:], 1):
        before = path.written(count)
        if not shape and "anyOf" in rule:
            rule = rule["anyOf"][0]
        if not shape and "dtype" in rule:
            rule, shape = {"type": "number"}, list(rule["shape"])
        if isinstance(step, str):
            if shape or rule.get("type") != "object":
                raise ValueError(f"{before} holds {_held(rule, shape)}: it has no field {step!r}")
            rule = {"type": "number"}
        elif shape:
            length = shape.pop(0)
            if length is not None and step >= length:
                raise ValueError(_beyond(before, length, path.text))
        elif rule.get("type") == "array":
            rule = rule["items"]
        else:
            raise ValueError(f"{before} holds {_held(rule, shape)}: it has no element [{step}]")


def _held(rule: dict[str, Any], shape: list[int | None]) -> str:
    """What is there, in words."""
    if shape or rule.get("type") == "array":
        return "several values by their indices"
    return "a table, by its names" if rule.get("type") == "object" else "one value"


def _beyond(name: str, length: int, text: str) -> str:
    last = f"from {name}[0] to {name}[{length - 1}]" if length else "none"
    return f"{text!r:.60}: {name} has {length} elements, {last}"


def _comparison(path: FieldPath, compare: Callable[[Any, Any], bool], wanted: Any) -> MessageFilter:
    orders = compare not in (operator.eq, operator.ne)

    def holds(fields: Mapping[str, Any]) -> bool:
        try:
            value = path.of(fields)
        except LookupError:
            return False
        if isinstance(value, (np.ndarray, tuple, Mapping)):
            raise ValueError(
                f"--filter: {path.text} holds several values; name one, as {path.text}[0]"
            )
        if orders and (value is None or wanted is None):
            return False
        if orders and isinstance(value, str) != isinstance(wanted, str):
            raise ValueError(f"--filter: {path.text} is {value!r}; {wanted!r} is of another kind")
        return compare(value, wanted)

    return holds


class FieldPath(NamedTuple):
    """Steps from a message to one of its values."""

    text: str  # As it was written
    steps: tuple[str | int, ...]  # Field, then keys of tables and indices of sequences

    def written(self, count: int) -> str:
        """The first so many steps, as a text."""
        return "".join(
            f"[{one}]" if isinstance(one, int) else f".{one}" for one in self.steps[:count]
        ).removeprefix(".")

    def of(self, fields: Mapping[str, Any]) -> Any:
        """The value at this path; raises LookupError, that says why, if this message has none."""
        value: Any = fields
        for count, step in enumerate(self.steps):
            before = self.written(count)
            if value is None:
                raise LookupError(f"{before} is null")
            if isinstance(step, str) and step not in value:
                raise LookupError(f"{before} has no {step!r}; {hint(step, value)}")
            if isinstance(step, int) and step >= len(value):
                raise LookupError(_beyond(before, len(value), self.text))
            value = value[step]
        return value.item() if isinstance(value, np.generic) else value
