"""Prints the messages of a topic as they come, filtered, in YAML or CSV, and counts losses.

A filter such as ``touch > 3 and outcome == 'hit'`` compares fields with values, joined by ``and``,
``or`` and brackets; it is parsed and never executed.
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

# Texts that need no quotes in YAML.
_PLAIN = re.compile(r"[A-Za-z_/][A-Za-z0-9_/. -]*[A-Za-z0-9_/.]|[A-Za-z_/]")
_MEANS_MORE = frozenset({"true", "false", "null", "yes", "no", "on", "off", "y", "n"})
_DTYPES = {"<f8": "float64", "<i4": "int32", "|u1": "uint8", "|b1": "bool"}
Sequence = np.ndarray[Any, Any] | tuple[Any, ...] | list[Any]
Echo = Callable[[str], None]
MessageFilter = Callable[[Mapping[str, Any]], bool]  # whether to show a message, from its fields
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
PATH_PATTERN = rf"{_NAME}(?:\.{_NAME}|\[[0-9]+\])*"
_SHAPE = "a filter looks like touch > 3 and (outcome == 'hit' or pose[2] < 0.01)"
_STEP = re.compile(rf"\.?({_NAME})|\[([0-9]+)\]")
_MAX_INDEX_DIGITS = 9  # beyond the length of any array


class TextStyle(NamedTuple):
    """How much of a message is shown, and how."""

    arrays: bool = True  # whether elements of arrays are shown
    full: bool = False  # whether long arrays are shown whole
    flow: bool = False  # whether each field is on one line
    max_items: int = 16  # longest sequence that is shown whole; longer ones are shortened
    n_shown: int = 3  # elements that are shown of a shortened sequence
    indent: int = 4  # [letters] of the second and later lines of a sequence


_WHOLE = TextStyle(full=True)


class EchoFormat(NamedTuple):
    """Values that are shown of each message, and how."""

    paths: tuple[FieldPath, ...] = ()  # shown values; empty: all fields
    style: TextStyle = TextStyle()
    csv: bool = False
    raw: bool = False  # whether bytes are shown undecoded
    wanted: MessageFilter | None = None  # which messages are shown; None: all
    # Called for each value, with the reason if a message lacks it.
    lacking: Callable[[FieldPath, str | None], None] = lambda path, why: None

    def value(self, path: FieldPath, fields: Mapping[str, Any]) -> Any:
        """The value at a path; None if this message lacks it, as if a list is too short."""
        try:
            value = path.of(fields)
        except LookupError as error:
            self.lacking(path, str(error.args[0]))
            return None
        self.lacking(path, None)
        return value


class FieldReport:
    """Records which of the requested values any message had."""

    def __init__(self, tell: Echo) -> None:
        self._tell = tell
        self._lacking: dict[str, str] = {}
        self._had: set[str] = set()

    def note(self, path: FieldPath, why: str | None) -> None:
        """Take note that a message has a value, or lacks it; reports the first that lacks it."""
        if why is None:
            self._had.add(path.text)
        elif path.text not in self._lacking:
            self._lacking[path.text] = why
            self._tell(f"null where there is none: {why}")

    def check(self) -> None:
        """Raise ValueError if no message had one of the values."""
        for text, why in self._lacking.items():
            if text not in self._had:
                raise ValueError(f"--field {text}: no message that was shown has it; {why}")


class LossReport:
    """Reports the number of lost messages, at most once in an `interval` [s]."""

    def __init__(self, topic: str, tell: Echo, interval: float = 1.0) -> None:
        self._topic, self._tell, self._interval = topic, tell, interval
        self._lost = self._reported = 0
        self._due = 0.0

    def add(self, lost: int, now: float) -> None:
        """Count lost messages, and report them if a report is due."""
        self._lost += lost
        if now >= self._due:
            self._due = now + self._interval
            self.tell()

    def tell(self) -> None:
        """Report losses that were not reported yet."""
        if self._lost > self._reported:
            self._reported = self._lost
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
    """Show the messages of a topic until the graph ends, or `most` have been shown.

    `say` takes each message, `tell` remarks. Raises ValueError if a message is not of the type of
    the topic, or cannot be compared by the filter.
    """
    report = FieldReport(tell)
    form = form._replace(lacking=report.note)
    with TapSubscription(card, [topic], latched=True) as taps:
        received = _received(taps, topic, losses, tell)
        texts = (message_text(topic, message, form) for message in received)
        for text in islice((text for text in texts if text is not None), most):
            say(text)
    losses.tell()
    report.check()


def _received(
    taps: TapSubscription, topic: Topic, losses: LossReport, tell: Echo, quiet_time: float = 3.0
) -> Iterator[TapMessage]:
    """Copies of messages; a remark is made if none comes in the `quiet_time` [s] at the start."""
    quiet: float | None = time.monotonic() + quiet_time
    for batch in taps.batches():
        for received in batch:
            quiet = None
            losses.add(received.lost, time.monotonic())
            yield received
        if quiet is not None and time.monotonic() > quiet:
            quiet = None
            tell(f"nothing has come on {topic.name} yet; only latched messages are repeated")


def message_text(topic: Topic, received: TapMessage, form: EchoFormat) -> str | None:
    """A message as text; None if the filter excludes it."""
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
    message = message_of(topic, received.header, received.body)
    codec = codec_of(type(message))
    return dict(zip(codec.names, codec.values(message), strict=True))


def yaml_lines(fields: Mapping[str, Any], style: TextStyle = _WHOLE) -> Iterator[str]:
    """Fields in YAML, one a line, and those of nested tables below."""
    if style.flow:
        yield yaml_value(fields, style)
        return
    for name, value in fields.items():
        if isinstance(value, Mapping) and value:
            yield f"{_text(name)}:"
            yield from (f"  {line}" for line in yaml_lines(value, style))
        else:
            yield from _folded(f"{_text(name)}: {yaml_value(value, style)}", value, style.indent)


def _folded(line: str, value: Any, indent: int) -> list[str]:
    """A line of YAML; that of a sequence is folded to 80 columns, which YAML allows."""
    if len(line) <= TEXT_WIDTH or not isinstance(value, (np.ndarray, tuple, list)):
        return [line]
    return textwrap.wrap(
        line,
        TEXT_WIDTH - indent,
        subsequent_indent=" " * indent,
        break_long_words=False,
        break_on_hyphens=False,
    )


def csv_line(values: list[Any], style: TextStyle) -> str:
    """Values as one row, with a column for each element of arrays and tables."""
    stream = io.StringIO()
    row = [cell for value in values for cell in _cells(value, style)]
    csv.writer(stream, lineterminator="").writerow(row)
    return stream.getvalue()


def _cells(value: Any, style: TextStyle) -> list[Any]:
    if isinstance(value, Mapping):
        return [cell for item in value.values() for cell in _cells(item, style)]
    if isinstance(value, (np.ndarray, tuple, list)):
        if not style.arrays:
            return [_kind(value)]
        return [cell for item in _plain(value) for cell in _cells(item, style)]
    return [value if isinstance(value, str) else _scalar(value)]


def field_lines(cls: type) -> list[str]:
    """One line for each field: name, kind, unit."""
    fields = schema(cls)["properties"].items()
    return text_table([(name, "  ".join(filter(None, _described(rule)))) for name, rule in fields])


def _described(rule: dict[str, Any]) -> tuple[str, str]:
    """Kind of a field, and its unit."""
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
        inner = (f"{_text(str(key))}: {yaml_value(item, style)}" for key, item in value.items())
        return "{" + ", ".join(inner) + "}"
    if isinstance(value, (np.ndarray, tuple, list)):
        return _sequence(value, style)
    return _scalar(value)


def _sequence(value: Sequence, style: TextStyle) -> str:
    size = value.size if isinstance(value, np.ndarray) else len(value)
    if not style.arrays:
        return _text(_kind(value))
    if size > style.max_items and not style.full:
        flat = value.ravel() if isinstance(value, np.ndarray) else value
        start = ", ".join(map(_scalar, _plain(flat[: style.n_shown])))
        return _text(f"{_kind(value)}: {start}, ...")
    inner = style._replace(full=True)
    return "[" + ", ".join(yaml_value(item, inner) for item in _plain(value)) + "]"


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
    text = repr(value)  # a form that YAML 1.1 and 1.2 read as a float
    return text.replace("e", ".0e") if "e" in text and "." not in text else text


def _text(text: str) -> str:
    if _PLAIN.fullmatch(text) and text.lower() not in _MEANS_MORE:
        return text
    return json.dumps(text, ensure_ascii=True)


def _plain(value: Sequence) -> list[Any]:
    return value.tolist() if isinstance(value, np.ndarray) else list(value)


def read_filter(text: str, cls: type, max_length: int = 1000) -> MessageFilter:
    """A filter for messages of one type; raises ValueError if it is invalid, or lacks a field."""
    if len(text) > max_length:
        raise ValueError(f"a filter has at most {max_length} characters, got {len(text)}")
    source = text.strip()
    try:
        tree = ast.parse(source, mode="eval")  # parsed, and never executed
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        raise ValueError(f"--filter: cannot read {source!r:.60}; {_SHAPE}") from None
    return _filter_of(source, tree.body, cls)


def _filter_of(source: str, node: ast.expr, cls: type) -> MessageFilter:
    """Filter of a part of an expression: comparisons, joined by ``and`` or ``or``."""
    match node:
        case ast.BoolOp(op=op, values=values):
            parts = [_filter_of(source, value, cls) for value in values]
            joined = all if isinstance(op, ast.And) else any
            return lambda fields: joined(part(fields) for part in parts)
        case ast.Compare(left=left, ops=[op], comparators=[right]) if type(op) in _OPERATORS:
            path = read_path(_source_text(source, left), cls)
            return _comparison(path, _OPERATORS[type(op)], _constant(source, right))
    raise ValueError(f"--filter: {_source_text(source, node)!r:.60} is no comparison; {_SHAPE}")


def _constant(source: str, node: ast.expr) -> Any:
    if isinstance(node, ast.Name) and node.id in _WORDS:
        return _WORDS[node.id]
    with suppress(ValueError):
        value = ast.literal_eval(node)
        if value is None or isinstance(value, int | float | str):
            return value
    got = _source_text(source, node)
    raise ValueError(f"--filter: expected a number, 'text', true, false or null; got {got!r:.60}")


def _source_text(source: str, node: ast.expr) -> str:
    return ast.get_source_segment(source, node) or ""


def read_path(text: str, cls: type) -> FieldPath:
    """A path in messages of one type; the prefix ``m.``, for the message, is optional.

    Raises ValueError if it cannot be read, or the type has no such field.
    """
    wanted = text.removeprefix("m.")
    if not re.fullmatch(PATH_PATTERN, wanted):
        raise ValueError(
            f"{text!r:.60} is no field; expected something like pose[2] or robot_time: one value, "
            "by an index from 0"
        )
    steps = tuple(
        int(index[: _MAX_INDEX_DIGITS + 1]) if index else name
        for name, index in _STEP.findall(wanted)
    )
    known = codec_of(cls).names
    if steps[0] not in known:
        raise ValueError(f"{cls.__name__} has no field {steps[0]!r}; {hint(str(steps[0]), known)}")
    path = FieldPath(text, steps)
    _check_steps(path, schema(cls)["properties"][steps[0]])
    return path


def _check_steps(path: FieldPath, rule: dict[str, Any]) -> None:
    """Raise ValueError if no message can have the path, by the schema of its first step."""
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
                raise ValueError(_out_of_range(before, length, path.text))
        elif rule.get("type") == "array":
            rule = rule["items"]
        else:
            raise ValueError(f"{before} holds {_held(rule, shape)}: it has no element [{step}]")


def _held(rule: dict[str, Any], shape: list[int | None]) -> str:
    """Content of a field, in words."""
    if shape or rule.get("type") == "array":
        return "several values by their indices"
    return "a table, by its names" if rule.get("type") == "object" else "one value"


def _out_of_range(name: str, length: int, text: str) -> str:
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

    text: str  # as written by the user
    steps: tuple[str | int, ...]  # field, then keys of tables and indices of sequences

    def written(self, count: int) -> str:
        """The first `count` steps, as a text."""
        return "".join(
            f"[{step}]" if isinstance(step, int) else f".{step}" for step in self.steps[:count]
        ).removeprefix(".")

    def of(self, fields: Mapping[str, Any]) -> Any:
        """The value at this path; raises LookupError with the reason if a message lacks it."""
        value: Any = fields
        for count, step in enumerate(self.steps):
            before = self.written(count)
            if value is None:
                raise LookupError(f"{before} is null")
            if isinstance(step, str) and step not in value:
                raise LookupError(f"{before} has no {step!r}; {hint(step, value)}")
            if isinstance(step, int) and step >= len(value):
                raise LookupError(_out_of_range(before, len(value), self.text))
            value = value[step]
        return value.item() if isinstance(value, np.generic) else value
