"""Messages as text, YAML for people and CSV for programs, and the fields of a type."""

from __future__ import annotations

import csv
import io
import json
import math
import re
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np

from palpate.messages import schema

MAX_ITEMS = 16  # A sequence with more elements is shortened, unless all is wanted
ITEMS_SHOWN = 3  # Elements of a shortened sequence that are shown
# Texts that need no quotes in YAML.
_PLAIN = re.compile(r"[A-Za-z_/][A-Za-z0-9_/. -]*[A-Za-z0-9_/.]|[A-Za-z_/]")
_MEANS_MORE = frozenset({"true", "false", "null", "yes", "no", "on", "off", "y", "n"})
_DTYPES = {"<f8": "float64", "<i4": "int32", "|u1": "uint8", "|b1": "bool"}


class TextStyle(NamedTuple):
    """How much of a message is shown, and how."""

    arrays: bool = True  # Whether elements of arrays are shown at all
    full: bool = False  # Whether long arrays are shown whole
    flow: bool = False  # Whether each field takes one line, whatever it holds


_WHOLE = TextStyle(full=True)


def yaml_lines(fields: Mapping[str, Any], style: TextStyle = _WHOLE) -> Iterator[str]:
    """Fields in YAML, one a line, and so those of tables within them."""
    if style.flow:
        yield _flow(fields, style)
        return
    for name, value in fields.items():
        if isinstance(value, Mapping) and value:
            yield f"{_text(name)}:"
            yield from (f"  {line}" for line in yaml_lines(value, style))
        else:
            yield f"{_text(name)}: {_flow(value, style)}"


def yaml_value(value: Any, style: TextStyle) -> str:
    """One value in YAML, in one line."""
    return _flow(value, style)


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
    return [_scalar(value) if not isinstance(value, str) else value]


def field_lines(cls: type) -> list[str]:
    """One line for each field: name, what it holds, unit."""
    rows = [(name, *_described(rule)) for name, rule in schema(cls)["properties"].items()]
    wide = max(len(name) for name, _, _ in rows), max(len(what) for _, what, _ in rows)
    return [f"{name:<{wide[0]}}  {what:<{wide[1]}}  {unit}".rstrip() for name, what, unit in rows]


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


def _flow(value: Any, style: TextStyle) -> str:
    if isinstance(value, Mapping):
        inner = (f"{_text(str(key))}: {_flow(one, style)}" for key, one in value.items())
        return "{" + ", ".join(inner) + "}"
    if isinstance(value, (np.ndarray, tuple, list)):
        return _sequence(value, style)
    return _scalar(value)


def _sequence(value: np.ndarray[Any, Any] | tuple[Any, ...] | list[Any], style: TextStyle) -> str:
    size = value.size if isinstance(value, np.ndarray) else len(value)
    if not style.arrays:
        return _text(_kind(value))
    if size > MAX_ITEMS and not style.full:
        first = (
            value.ravel()[:ITEMS_SHOWN] if isinstance(value, np.ndarray) else value[:ITEMS_SHOWN]
        )
        begun = ", ".join(_scalar(one) for one in _plain(first))
        return _text(f"{_kind(value)}: {begun}, ...")
    return "[" + ", ".join(_flow(one, style._replace(full=True)) for one in _plain(value)) + "]"


def _kind(value: np.ndarray[Any, Any] | tuple[Any, ...] | list[Any]) -> str:
    if isinstance(value, np.ndarray):
        return f"{' x '.join(map(str, value.shape))} {value.dtype}"
    return f"{len(value)} {type(value[0]).__name__ if len(value) else 'values'}"


def _scalar(value: Any) -> str:
    if value is None:
        return "null"
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, float):
        return _number(value)
    return str(value) if isinstance(value, int) else _text(str(value))


def _number(value: float) -> str:
    """A float that every reader of YAML takes for one."""
    if not math.isfinite(value):
        return ".nan" if math.isnan(value) else ".inf" if value > 0 else "-.inf"
    text = repr(value)
    return text.replace("e", ".0e") if "e" in text and "." not in text else text


def _text(text: str) -> str:
    if _PLAIN.fullmatch(text) and text.lower() not in _MEANS_MORE:
        return text
    return json.dumps(text, ensure_ascii=True)


def _plain(value: Any) -> list[Any]:
    listed: list[Any] = value.tolist() if isinstance(value, np.ndarray) else list(value)
    return listed
