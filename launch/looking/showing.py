"""A message as text: YAML for people, CSV for programs."""

from __future__ import annotations

import csv
import io
import json
import math
import re
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np

FEW = 16
"""A sequence with more elements is shortened, unless all is wanted."""
SHOWN = 3
"""Elements of a shortened sequence that are shown."""
_PLAIN = re.compile(r"[A-Za-z_/][A-Za-z0-9_/. -]*[A-Za-z0-9_/.]|[A-Za-z_/]")
"""Texts that need no quotes in YAML."""
_MEANS_MORE = frozenset({"true", "false", "null", "yes", "no", "on", "off", "y", "n"})


class Style(NamedTuple):
    """How much of a message is shown, and how."""

    arrays: bool = True
    """Whether elements of arrays are shown at all."""
    full: bool = False
    """Whether long arrays are shown whole."""
    flow: bool = False
    """Whether each field takes one line, whatever it holds."""


_WHOLE = Style(full=True)


def yaml_lines(fields: Mapping[str, Any], style: Style = _WHOLE) -> Iterator[str]:
    """Fields in YAML, one a line, and so those of tables within them.

    Parameters
    ----------
    fields : mapping
        Name of the field to its value: a number, text, array, or list or table of such.
    style : Style
        How much is shown, and how.
    """
    if style.flow:
        yield _flow(fields, style)
        return
    for name, value in fields.items():
        if isinstance(value, Mapping) and value:
            yield f"{_text(name)}:"
            yield from (f"  {line}" for line in yaml_lines(value, style))
        else:
            yield f"{_text(name)}: {_flow(value, style)}"


def yaml_value(value: Any, style: Style) -> str:
    """One value in YAML, in one line."""
    return _flow(value, style)


def csv_line(values: list[Any], style: Style) -> str:
    """Values as one row, arrays and tables spread over as many columns as they have elements."""
    stream = io.StringIO()
    row = [cell for value in values for cell in _cells(value, style)]
    csv.writer(stream, lineterminator="").writerow(row)
    return stream.getvalue()


def _flow(value: Any, style: Style) -> str:
    if isinstance(value, Mapping):
        inner = (f"{_text(str(key))}: {_flow(one, style)}" for key, one in value.items())
        return "{" + ", ".join(inner) + "}"
    if isinstance(value, (np.ndarray, tuple, list)):
        return _sequence(value, style)
    return _scalar(value)


def _sequence(value: np.ndarray[Any, Any] | tuple[Any, ...] | list[Any], style: Style) -> str:
    size = value.size if isinstance(value, np.ndarray) else len(value)
    if not style.arrays:
        return _text(_kind(value))
    if size > FEW and not style.full:
        first = value.ravel()[:SHOWN] if isinstance(value, np.ndarray) else value[:SHOWN]
        begun = ", ".join(_scalar(one) for one in _plain(first))
        return _text(f"{_kind(value)}: {begun}, ...")
    return "[" + ", ".join(_flow(one, style._replace(full=True)) for one in _plain(value)) + "]"


def _plain(value: Any) -> list[Any]:
    listed: list[Any] = value.tolist() if isinstance(value, np.ndarray) else list(value)
    return listed


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


def _cells(value: Any, style: Style) -> list[Any]:
    if isinstance(value, Mapping):
        return [cell for one in value.values() for cell in _cells(one, style)]
    if isinstance(value, (np.ndarray, tuple, list)):
        if not style.arrays:
            return [_kind(value)]
        return [cell for one in _plain(value) for cell in _cells(one, style)]
    return [_scalar(value) if not isinstance(value, str) else value]
