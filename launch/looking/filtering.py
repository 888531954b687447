"""Which messages a user wants to see: ``touch > 3 and outcome == 'hit'``.

Comparisons of a field with a value, joined by ``and``, ``or`` and brackets; nothing is run.
"""

from __future__ import annotations

import operator
import re
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from palpate.launch.looking.field_path import PATH, FieldPath, read_path

Wanted = Callable[[Mapping[str, Any]], bool]
"""Whether a message, by its fields, is wanted."""

LONGEST = 1000
"""Longest filter, characters."""
DEEPEST = 20
"""Most brackets within brackets."""
_OPERATORS: dict[str, Callable[[Any, Any], bool]] = {
    "==": operator.eq,
    "!=": operator.ne,
    "<=": operator.le,
    ">=": operator.ge,
    "<": operator.lt,
    ">": operator.gt,
}
_WORDS = {"true": True, "True": True, "false": False, "False": False, "null": None, "None": None}
_NUMBER = r"[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]+)?"
_TOKEN = re.compile(
    rf"\s*(?:(?P<op>[=!<>]=|[<>])|(?P<bracket>[()])|(?P<number>{_NUMBER}(?![\w.]))"
    rf"|(?P<text>'[^']*'|\"[^\"]*\")|(?P<word>{PATH}))\s*"
)
_SHAPE = "a filter looks like touch > 3 and (outcome == 'hit' or pose[2] < 0.01)"


def read_filter(text: str, cls: type) -> Wanted:
    """A filter for messages of one type.

    Raises
    ------
    ValueError
        If it is not made of such comparisons, or the type has no such field.
    """
    if len(text) > LONGEST:
        raise ValueError(f"a filter has at most {LONGEST} characters, got {len(text)}")
    reader = _Reader(_tokens(text), cls)
    wanted = reader.either()
    if reader.next()[0]:
        raise ValueError(f"--filter: {reader.next()[1]!r} is one too many; {_SHAPE}")
    return wanted


def _tokens(text: str) -> list[tuple[str, str]]:
    found, at = [], len(text) - len(text.lstrip())
    while at < len(text):
        match = _TOKEN.match(text, at)
        if match is None:
            raise ValueError(f"--filter: cannot read {text[at : at + 20]!r}; {_SHAPE}")
        kind = str(match.lastgroup)
        found.append((kind, match[kind]))
        at = match.end()
    return found


class _Reader:
    """Reads a filter from left to right; ``and`` binds more tightly than ``or``."""

    def __init__(self, tokens: list[tuple[str, str]], cls: type) -> None:
        self._tokens, self._cls, self._at, self._depth = tokens, cls, 0, 0

    def next(self) -> tuple[str, str]:
        """Kind and text of what is read next; empty at the end."""
        return self._tokens[self._at] if self._at < len(self._tokens) else ("", "")

    def either(self) -> Wanted:
        """Parts joined by ``or``."""
        parts = [self._all()]
        while self._took("word", "or"):
            parts.append(self._all())
        return lambda fields: any(part(fields) for part in parts)

    def _all(self) -> Wanted:
        parts = [self._one()]
        while self._took("word", "and"):
            parts.append(self._one())
        return lambda fields: all(part(fields) for part in parts)

    def _one(self) -> Wanted:
        if self._took("bracket", "("):
            return self._bracket()
        path = read_path(self._take("word", "a field"), self._cls)
        compare = _OPERATORS[self._take("op", f"one of {' '.join(_OPERATORS)}")]
        return _comparison(path, compare, self._value())

    def _bracket(self) -> Wanted:
        self._depth += 1
        if self._depth > DEEPEST:
            raise ValueError(f"--filter: more than {DEEPEST} brackets within brackets; {_SHAPE}")
        inner = self.either()
        if not self._took("bracket", ")"):
            raise ValueError(f"--filter: a bracket is not closed; {_SHAPE}")
        self._depth -= 1
        return inner

    def _value(self) -> Any:
        kind, text = self.next()
        if kind == "number":
            self._at += 1
            return int(text) if text.lstrip("+-").isdigit() else float(text)
        if kind == "text":
            self._at += 1
            return text[1:-1]
        if kind == "word" and text in _WORDS:
            self._at += 1
            return _WORDS[text]
        got = f"got {text!r}" if kind else "it ends there"
        raise ValueError(f"--filter: expected a number, 'text', true, false or null; {got}")

    def _take(self, kind: str, what: str) -> str:
        got, text = self.next()
        if got != kind:
            came = f"got {text!r}" if got else "it ends there"
            raise ValueError(f"--filter: expected {what}; {came}; {_SHAPE}")
        self._at += 1
        return text

    def _took(self, kind: str, text: str) -> bool:
        if self.next() != (kind, text):
            return False
        self._at += 1
        return True


def _comparison(path: FieldPath, compare: Callable[[Any, Any], bool], wanted: Any) -> Wanted:
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
