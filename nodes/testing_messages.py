"""Messages under test: one made of a few fields, and two lists compared bit by bit."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any, TypeVar

import numpy as np

from palpate.messages.codec import encode, schema
from palpate.messages.recording.difference import first_difference
from palpate.nodes.node import Finished

Message = TypeVar("Message")

_PLAIN: dict[str, Any] = {
    "number": 0.0,
    "integer": 0,
    "boolean": False,
    "string": "",
    "array": (),
}


def example(cls: type[Message], **fields: object) -> Message:
    """A message of which only some fields matter.

    Parameters
    ----------
    cls : type
        The message type.
    fields : values
        Those that matter; the others are 0, empty, the first word that is allowed or, if they
        have one, their default. An array has no rows where its type leaves their number open.

    Raises
    ------
    ValueError
        If the type has no such field, or a value does not fit.
    """
    described = schema(cls)["properties"]
    unknown = sorted(fields.keys() - described.keys())
    if unknown:
        raise ValueError(f"a {cls.__name__} has no {unknown[0]}; it has {', '.join(described)}")
    defaults = {
        field.name
        for field in dataclasses.fields(cls)  # type: ignore[arg-type]
        if field.default is not dataclasses.MISSING
        or field.default_factory is not dataclasses.MISSING
    }
    plain = {name: _plain(rule) for name, rule in described.items() if name not in defaults}
    message = cls(**{**plain, **fields})
    encode(message)
    return message


def messages_on(said: Sequence[tuple[str, Any] | Finished], topic: str) -> list[Any]:
    """The messages on one topic, in their order."""
    return [one[1] for one in said if not isinstance(one, Finished) and one[0] == topic]


def assert_same(
    said: Sequence[tuple[str, object] | Finished], expected: Sequence[tuple[str, object] | Finished]
) -> None:
    """Compare what was said with what is expected, bit by bit.

    Raises
    ------
    AssertionError
        With the first message, and the first field in it, that differs.
    """
    for number, (one, other) in enumerate(zip(said, expected, strict=False)):
        if _named(one) != _named(other):
            raise AssertionError(f"{number}: said {_named(one)}, expected {_named(other)}")
        if isinstance(one, Finished) or isinstance(other, Finished):
            continue
        found = first_difference(type(one[1]), encode(one[1]), encode(other[1]))
        if found is not None:
            field, now, then = found
            raise AssertionError(f"{number}: {one[0]} {field}: said {now}, expected {then}")
    rest = said[len(expected) :] or expected[len(said) :]
    if rest:
        more = "more was said" if len(said) > len(expected) else "not said"
        raise AssertionError(
            f"said {len(said)}, expected {len(expected)}; {more}: {_named(rest[0])}"
        )


def _plain(rule: dict[str, Any]) -> Any:
    """The plainest value that a field of this schema may have."""
    if "anyOf" in rule:
        return None
    if "enum" in rule:
        return rule["enum"][0]
    if "dtype" in rule:
        return np.zeros(
            [0 if length is None else length for length in rule["shape"]], rule["dtype"]
        )
    return {} if rule["type"] == "object" else _PLAIN[rule["type"]]


def _named(one: tuple[str, object] | Finished) -> str:
    if isinstance(one, Finished):
        return f"Finished({one.reason!r})"
    return f"a {type(one[1]).__name__} on {one[0]}"
