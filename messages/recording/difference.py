"""The first difference between two encoded messages, in few words."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from palpate.messages.codec import decode
from palpate.messages.fields import CodecError

LONGEST = 60
"""Characters of a value that are shown."""


def first_difference(cls: type, one: bytes, other: bytes) -> tuple[str, str, str] | None:
    """Where two bodies of the same type differ first.

    Parameters
    ----------
    cls : type
        The message type.
    one, other : bytes
        The bodies.

    Returns
    -------
    field, value, value
        The field, with the place within it if it is an array, and what is there in each body;
        the field ``bytes`` if the bodies differ though the values do not, or if one of them is
        no such message. None if the bodies are identical.
    """
    if one == other:
        return None
    try:
        first: Any = decode(cls, one)
        second: Any = decode(cls, other)
    except CodecError as error:
        return "bytes", f"{len(one)} bytes", f"{len(other)} bytes: {error}"
    for field in dataclasses.fields(cls):
        mine, theirs = getattr(first, field.name), getattr(second, field.name)
        found = _difference(mine, theirs)
        if found is not None:
            place, mine_text, theirs_text = found
            return field.name + place, mine_text, theirs_text
    place_of = next(i for i, (a, b) in enumerate(zip(one, other, strict=False)) if a != b)
    return f"bytes[{place_of}]", f"{one[place_of]:#04x}", f"{other[place_of]:#04x}"


def _difference(one: Any, other: Any) -> tuple[str, str, str] | None:
    if isinstance(one, dict) and one.keys() == other.keys():
        entries = ((f"[{key!r}]", one[key], other[key]) for key in one)
        different = (entry for entry in entries if repr(entry[1]) != repr(entry[2]))
        return next(((at, short(a), short(b)) for at, a, b in different), None)
    if not isinstance(one, np.ndarray):
        return None if repr(one) == repr(other) else ("", short(one), short(other))
    if one.shape != other.shape:
        return ".shape", str(one.shape), str(other.shape)
    if one.tobytes() == other.tobytes():
        return None
    # Bytes, not values: a zero that changed its sign is a difference.
    width = one.dtype.itemsize
    bits = [np.frombuffer(a.tobytes(), np.uint8).reshape(-1, width) for a in (one, other)]
    first = int((bits[0] != bits[1]).any(axis=1).argmax())
    place = np.unravel_index(first, one.shape)
    at = "[" + ", ".join(str(int(i)) for i in place) + "]"
    return at, short(one[place].item()), short(other[place].item())


def short(value: Any) -> str:
    """A value as it is written, cut off after `LONGEST` characters."""
    text = repr(value)
    return text if len(text) <= LONGEST else text[: LONGEST - 3] + "..."
